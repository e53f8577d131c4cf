"""Kinds of ground and their reflectances at 1064 nm, the contrasts between them, and what ages the laser."""

from __future__ import annotations

from dataclasses import dataclass

from procedures.range_scenes import MEAN_REFLECTANCE, REFLECTANCES

ICE_IN_MIXTURE, RISE_OF_MIXTURE = 0.75, 0.15
"""An intimate mixture: so much ice raises the reflectance by so much (paper, citing Yoldi 2015)."""
RISE_OF_FRESH = 0.30
"""Fresh ejecta over mature ground (paper, citing Riner 2012)."""

KINDS = {
    "dark": REFLECTANCES[0],
    "regolith": MEAN_REFLECTANCE,
    "icy mixture": MEAN_REFLECTANCE * (1 + RISE_OF_MIXTURE),
    "fresh": MEAN_REFLECTANCE * (1 + RISE_OF_FRESH),
    "ice": REFLECTANCES[2],
}
"""Reflectances; of ice assumed, its value is not printed."""


@dataclass(frozen=True, slots=True)
class Contrast:
    """Two kinds of ground to be told apart.

    Parameters
    ----------
    low, high : str
        The darker and the brighter, keys of `KINDS`.
    """

    low: str
    high: str

    @property
    def name(self) -> str:
        """Both of them."""
        return f"{self.low} and {self.high}"

    @property
    def ratio(self) -> float:
        """Brighter over darker reflectance."""
        return KINDS[self.high] / KINDS[self.low]


CONTRASTS = (
    Contrast("dark", "regolith"),
    Contrast("regolith", "ice"),
    Contrast("regolith", "icy mixture"),
    Contrast("regolith", "fresh"),
)

AGEING = {"shots": -0.20, "radiation": -0.113}
"""Loss of transmitted energy after some 10^8 shots, and by gamma rays and photons (paper, citing Kallenbach
et al. 2013)."""
CROSSOVERS = (16e6, 60e6)
"""Places that are met twice in the mission (paper, citing Steinbruegge 2018)."""
