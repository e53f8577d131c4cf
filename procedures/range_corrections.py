"""What each way to correct arrivals does to the range error: our own curve, the published one, and none.

The published polynomial is taken as it is printed, with a linear coefficient of 9.37e-1, and with 9.37e-2.
A slope near one lets the noise of the width into the range; which of them is meant, see
`procedures.arrival_curve`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.delay_curve import published_curve
from procedures.echo_hits import HALF_LIGHT
from procedures.range_chunks import correction
from procedures.range_scenes import noise_scene
from procedures.range_statistics import CellDraws, weighted_rms
from procedures.range_table import cell_draws
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from belahil.delay_curve import DelayCurve
    from belahil.values import Estimate
    from procedures.noise_clusters import LevelLaws
    from procedures.range_points import Drawn

NAMES = ("own curve", "published with 9.37e-2", "published as printed, 9.37e-1", "none")


@dataclass(frozen=True, slots=True)
class Corrected:
    """Errors with one correction.

    Parameters
    ----------
    altitude_m : float
        m.
    light, name : str
        "day" or "night"; one of `NAMES`.
    error : Estimate or None
        Rms about its own calibrated bias, m; detections are those with our own curve.
    bias_m : float
        What it leaves on the average without noise, m; that of a published curve has its constant.
    """

    altitude_m: float
    light: str
    name: str
    error: Estimate | None
    bias_m: float


def corrections(drawn: Drawn, laws: Mapping[str, LevelLaws], reflectance: float) -> tuple[Corrected, ...]:
    """Return the errors at a point with each correction, by day and by night.

    Parameters
    ----------
    drawn, laws, reflectance
        As in `procedures.range_histograms.histograms`.
    """
    own, linear = correction(drawn.scene), drawn.linear
    law = laws[as_toml(noise_scene(drawn.scene))]
    quiet_s = linear.moved_m / HALF_LIGHT + _held(own, linear.width_s)
    found = []
    for row, condition in enumerate(drawn.conditions):
        if condition.reflectance != reflectance:
            continue
        draws: CellDraws = cell_draws(drawn, row, own, 0.0)
        weights = draws.weights(law.at(condition.noise_rms_v))
        arrival_s, width_s = drawn.arrays["arrival_s"][row], drawn.arrays["width_s"][row]
        for name in NAMES:
            bias_m = float(np.mean(_corrected_m(name, own, quiet_s, linear.width_s)))
            errors_m = np.where(draws.hit, _corrected_m(name, own, arrival_s, width_s) - bias_m, 0.0)
            spread = weighted_rms(errors_m, weights, draws.echoes)
            found.append(Corrected(drawn.scene.altitude_m, condition.light, name, spread, bias_m))
    return tuple(found)


def _corrected_m(
    name: str, own: DelayCurve, arrival_s: NDArray[np.float64], width_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    if name == NAMES[0]:
        return np.asarray(HALF_LIGHT * (arrival_s - _held(own, width_s)))
    if name == NAMES[-1]:
        return HALF_LIGHT * arrival_s
    # The published shift is the transmitted pulse's delay less the received one's, so it is added.
    published = published_curve(as_printed=name == NAMES[2])
    return np.asarray(HALF_LIGHT * (arrival_s + _held(published, width_s)))


def _held(curve: DelayCurve, width_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return curve.at(np.clip(width_s, curve.narrowest_s, curve.widest_s))
