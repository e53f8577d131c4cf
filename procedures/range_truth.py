"""What the range campaign calls true range, slope and roughness, and how its outputs say so."""

from __future__ import annotations

from dataclasses import dataclass

from belahil.errors import RefusedInput

TRUTHS = {
    "light": "c/2 times the beam-weighted mean of the two-way time 2 (H - z) / c at nominal pointing",
    "centre": "c/2 times the two-way time 2 (H - z) / c to the post in the middle of the footprint, at "
    "nominal pointing",
    "plane": "c/2 times the two-way time 2 (H - z) / c to the least-squares plane in the middle of the "
    "footprint, at nominal pointing",
}
_PLANES = {
    False: "the least-squares plane over the 1/e^2 disc, every post alike",
    True: "the least-squares plane over the whole beam, posts weighted by it",
}


@dataclass(frozen=True, slots=True)
class Definitions:
    """Which of the definitions hold.

    Parameters
    ----------
    truth : str
        Key of `TRUTHS`.
    by_beam : bool
        Planes weighted by the beam; else every post of the 1/e^2 disc alike.

    Raises
    ------
    RefusedInput
        Another truth.
    """

    truth: str = "light"
    by_beam: bool = False

    def __post_init__(self) -> None:
        if self.truth not in TRUTHS:
            raise RefusedInput(f"--truth {self.truth}: allowed are {', '.join(TRUTHS)}")

    def told(self) -> dict[str, str]:
        """Return each definition as a sentence, by what it defines."""
        plane, true = _PLANES[self.by_beam], TRUTHS[self.truth]
        if self.truth == "plane":
            true += f"; it is {plane}"
        return {
            "true_range": f"True range: {true}.",
            "slope_and_roughness": f"Slope and roughness: tilt of, and standard deviation about, {plane}.",
            "false_detection": "False detection: the candidate nearest to the true range is more than 10 m "
            "off, after the correction of arrivals.",
            "error": "Error: rms over detections after the calibrated bias was taken off; it is told apart.",
        }


USUAL = Definitions()
