"""The emulated laser's own pulse, as it reaches the cut through its fibre.

The receiver fires the laser with its shot pulse, which also starts the window. The light comes `delay_s`
later, passes the fibre, and is a voltage at the cut like that of any echo.

Through the fibre comes only what is above a part of the peak (Nishiyama et al., appendix "Time delay of
transmitted pulse", where 17 % for the main and 22 % for the redundant laser reproduce what the range finder
reported). "hard" is that model. "soft" has an edge: what passes rises in a straight line from nothing to
everything over `cut_width`, about the threshold. Either goes by the pulse's own peak, so that a stronger
pulse keeps its shape.

What this does not model: why a fibre should do this; noise of the light, its shot noise included; what the
generator plays meanwhile, which such a window does not see; an echo in the same window; recovery of the
receiver from a strong pulse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import ConfigError
from belahil.stimuli import SampledPulse
from sim.pulse_shape import crossing_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.config import EmulatedTransmitter
    from sim.draws import Draws
    from sim.pulse_shape import PulseShape

_WHERE = "[emulation.transmitter]"
_POINTS_IN_SCALE = 64
"""Break points in a standard deviation of the Gaussian: lines between them are within 4e-5 of the peak."""
_NOTHING = 1e-9
"""Of the peak: where an uncut pulse ends."""
_ENDS, _TAIL_ENDS = 7.0, 25.0
"""Standard deviations and time constants, after which a pulse is below that."""
_LONGEST_TAIL = 100.0


@dataclass(frozen=True)
class Transmitter:
    """A laser and its fibre.

    Parameters
    ----------
    truth : EmulatedTransmitter
        Shape, cut, delay and jitter.

    Raises
    ------
    ConfigError
        A cut that is not described, a tail too long for its rise, or a table that cannot be used.
    """

    truth: EmulatedTransmitter

    def __post_init__(self) -> None:
        truth = self.truth
        if truth.cut == "hard" and truth.cut_width:
            raise ConfigError(f'{_WHERE} cut_width = {truth.cut_width:g}: must be 0 with cut = "hard"')
        if truth.cut == "soft" and not 0 < truth.cut_width <= 2 * (1 - truth.threshold):
            raise ConfigError(
                f'{_WHERE} cut_width = {truth.cut_width:g} with cut = "soft" and threshold = '
                f"{truth.threshold:g}: must be above 0, to {2 * (1 - truth.threshold):g}"
            )
        if truth.pulse == "tailed" and truth.tail_s > _LONGEST_TAIL * truth.fwhm_s:
            raise ConfigError(
                f"{_WHERE} tail_s = {truth.tail_s:g}: must be at most {_LONGEST_TAIL:g} times fwhm_s"
            )
        if truth.pulse == "table":
            _ = self.mean  # a file that cannot be used is told now

    def pulse(self, draws: Draws) -> SampledPulse:
        """Return the pulse of a shot at the cut, timed from the shot pulse.

        Parameters
        ----------
        draws : Draws
            Of this shot: "energy", and "laser_jitter" of the time.
        """
        truth, mean = self.truth, self.mean
        energy = 1 + truth.energy_jitter * float(draws.stream("energy").standard_normal())
        late_s = truth.delay_s
        if truth.jitter_s:
            late_s += truth.jitter_s * float(draws.stream("laser_jitter").standard_normal())
        return SampledPulse(mean.volts * energy, mean.sample_rate_hz, mean.start_s + late_s)

    @cached_property
    def mean(self) -> SampledPulse:
        """The pulse behind the fibre without jitter, V at the cut; time 0 is that of its shape.

        Its break points begin and end where the cut begins and ends it; a cut inside a pulse of several humps
        comes to one step of them.
        """
        shape, truth = self._shape, self.truth
        width = truth.cut_width if truth.cut == "soft" else 0.0
        lowest = max(truth.threshold - width / 2, _NOTHING)
        times_s = _places_s(shape)
        density = shape.density(times_s)
        least = lowest * float(density.max())
        first, last = np.flatnonzero(density >= least)[[0, -1]]
        begin_s = crossing_s(shape, least, times_s[first], times_s[max(first - 1, 0)])
        end_s = crossing_s(shape, least, times_s[last], times_s[min(last + 1, times_s.size - 1)])
        count = int(last - first) + 3
        relative = shape.density(np.linspace(begin_s, end_s, count)) / density.max()
        # Rounding must not cost the end points, where a hard cut jumps.
        passed = relative >= lowest * (1 - 1e-9)
        if width:
            relative *= np.clip((relative - truth.threshold) / width + 0.5, 0.0, 1.0)
        volts = np.where(passed, truth.peak_v * relative, 0.0)
        return SampledPulse(volts, (count - 1) / (end_s - begin_s), begin_s)

    @cached_property
    def _shape(self) -> PulseShape:
        from sim.laser import pulse_shape, read_pulse_table
        from sim.scene_tables import Laser

        truth = self.truth
        if truth.pulse == "table":
            return read_pulse_table(truth.table, _WHERE)
        return pulse_shape(Laser(pulse=truth.pulse, fwhm_s=truth.fwhm_s, tail_s=truth.tail_s))


def _places_s(shape: PulseShape) -> NDArray[np.float64]:
    """Times from before a pulse to after it, s."""
    if shape.pieces:
        (piece,) = shape.pieces
        step_s = piece.sigma_s / _POINTS_IN_SCALE
        begin_s, end_s = -_ENDS * piece.sigma_s, _ENDS * piece.sigma_s + _TAIL_ENDS * piece.tau_s
    else:
        step_s = shape.std_s / (4 * _POINTS_IN_SCALE)
        begin_s, end_s = shape.times_s[0] - step_s, shape.times_s[-1] + step_s
    return np.linspace(begin_s, end_s, math.ceil((end_s - begin_s) / step_s) + 1)
