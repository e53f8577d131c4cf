"""The transmitted pulse before the fibre, and what an analysis may assume about it.

The shape is that of a laser whose light was measured before the fibre: a Gaussian with an exponential tail,
or a table. What is unknown of it enters as three relative uncertainties: of the time scale of its fall, of
that of its rise, and of the power at any time, which may err independently every 4 ns. All three are assumed,
because nobody published an uncertainty of the shape.

What this does not model: a shape that changes from shot to shot, or with the energy of the shot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.laser import PulsePiece, PulseShape, read_pulse_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.tx_delay import TxDelayOptions

_SIGMA_OF_FWHM = 1 / (2 * math.sqrt(2 * math.log(2)))
_POINTS_IN_SCALE = 64
"""Points in a standard deviation of the rise: lines between them are within 4e-5 of the peak."""
_RISE_ENDS, _TAIL_ENDS = 7.0, 25.0
"""Standard deviations and time constants after which a pulse is below 1e-10 of its peak."""
_TABLE_POINTS = 4096
_MOST_POINTS = 200_000

BEND_S = 4e-9
"""Assumed time over which an error of the power keeps its sign: some resolved times of a fast photodiode."""


@dataclass(frozen=True, eq=False)
class OpticalPulse:
    """A pulse as points with straight lines between them: peak 1, at time 0.

    Parameters
    ----------
    first_s, step_s : float
        Time of the first point after the peak (negative), and between points, s.
    relative : ndarray of float64, shape (n,)
        Power relative to the peak; zero outside.
    """

    first_s: float
    step_s: float
    relative: NDArray[np.float64]

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times of the points, s, shape (n,)."""
        steps = np.arange(self.relative.size)
        return np.asarray(self.first_s + self.step_s * steps, dtype=np.float64)

    @property
    def last_s(self) -> float:
        """Time of the last point, s."""
        return self.first_s + self.step_s * (self.relative.size - 1)

    def above(self, level: float) -> list[tuple[float, float]]:
        """Return the stretches in which the pulse is not below a level, s.

        Parameters
        ----------
        level : float
            Relative to the peak; at 0 and below the whole pulse is one stretch.
        """
        if level <= 0:
            return [(self.first_s, self.last_s)]
        values = np.concatenate([[0.0], self.relative, [0.0]])
        change = np.diff((values >= level).astype(np.int8))
        rises, falls = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        return [(self._crossing(int(up), level, values), self._crossing(int(down), level, values))
                for up, down in zip(rises, falls, strict=True)]  # fmt: skip

    def _crossing(self, place: int, level: float, values: NDArray[np.float64]) -> float:
        """Time of a crossing between the points `place - 1` and `place`; at the ends the pulse jumps."""
        if place == 0:
            return self.first_s
        if place == values.size - 2:
            return self.last_s
        low, high = values[place], values[place + 1]
        return self.first_s + self.step_s * (place - 1 + float((level - low) / (high - low)))

    def bent(self, at_s: float, size: float) -> OpticalPulse:
        """Return the pulse with its power raised by `size`, relative, within 4 ns of a time."""
        bump = np.maximum(1 - np.abs(self.times_s - at_s) / BEND_S, 0.0)
        return _at_its_peak(self.step_s, self.relative * (1 + size * bump))

    def centroid_s(self, threshold: float = 0.0) -> float:
        """Return the centroid of what is not below a threshold, s after the peak."""
        area = moment = 0.0
        for begin_s, end_s in self.above(threshold):
            inside = self.times_s[(self.times_s > begin_s) & (self.times_s < end_s)]
            times = np.concatenate([[begin_s], inside, [end_s]])
            power = np.interp(times, self.times_s, self.relative)
            width = np.diff(times)
            area += float(np.sum(width * (power[:-1] + power[1:])) / 2)
            both = power[:-1] * (2 * times[:-1] + times[1:]) + power[1:] * (times[:-1] + 2 * times[1:])
            moment += float(np.sum(width * both) / 6)
        return moment / area

    @property
    def rms_width_s(self) -> float:
        """Standard deviation of the whole pulse about its centroid, s."""
        away = self.times_s - self.centroid_s()
        return math.sqrt(float(np.sum(self.relative * away**2) / np.sum(self.relative)))


@dataclass(frozen=True, slots=True)
class KnownPulse:
    """What is assumed of the pulse before the fibre.

    Parameters
    ----------
    fwhm_s, tail_s : float
        Full width of the Gaussian at half maximum, above zero; time constant of the exponential, 0 for none;
        s. Not used where there is a table.
    times_s, power : tuple of float
        A table: times in rising order, s, and power on any scale, its peak the highest row; empty where there
        is none.
    fall_relative, rise_relative, shape_relative : float
        Standard uncertainty of the time scale of fall and rise, and of the power at any time, relative.

    Raises
    ------
    RefusedInput
        A width that is not positive, a tail or an uncertainty that is negative, or a table that is none.
    """

    fwhm_s: float
    tail_s: float
    fall_relative: float
    rise_relative: float
    shape_relative: float = 0.0
    times_s: tuple[float, ...] = ()
    power: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (0 < self.fwhm_s < math.inf and 0 <= self.tail_s < math.inf):
            raise RefusedInput(
                f"a pulse {self.fwhm_s!r} s wide with a tail of {self.tail_s!r} s: the width must be above "
                "zero, the tail not negative"
            )
        for name in ("fall", "rise", "shape"):
            value = getattr(self, f"{name}_relative")
            if not 0 <= value < 0.5:
                raise RefusedInput(f"relative uncertainty of the {name} {value!r}: 0 to below 0.5 is allowed")
        if self.times_s:
            PulseShape(times_s=np.array(self.times_s), relative=np.array(self.power))

    @classmethod
    def of(cls, options: TxDelayOptions) -> KnownPulse:
        """Return what the options say; a table is read now.

        Raises
        ------
        ConfigError
            A table that cannot be used.
        """
        times_s: tuple[float, ...] = ()
        power: tuple[float, ...] = ()
        if options.pulse_table:
            table = read_pulse_table(options.pulse_table, "--pulse-table")
            times_s, power = tuple(table.times_s.tolist()), tuple(table.relative.tolist())
        return cls(
            options.pulse_fwhm_s,
            options.pulse_tail_s,
            options.fall_uncertainty,
            options.rise_uncertainty,
            options.shape_uncertainty,
            times_s,
            power,
        )

    @property
    def words(self) -> str:
        """Say what it is in a few words."""
        if self.times_s:
            return f"table of {len(self.times_s)} points"
        return f"Gaussian of {self.fwhm_s * 1e9:g} ns, tail {self.tail_s * 1e9:g} ns"

    def pulse(self, fall: float = 1.0, rise: float = 1.0) -> OpticalPulse:
        """Return the pulse with the time scales of fall and rise changed by factors.

        Parameters
        ----------
        fall, rise : float
            Above zero. With pieces they multiply tail and width; with a table they stretch the time after
            and before the peak.
        """
        if self.times_s:
            return _from_table(np.array(self.times_s), np.array(self.power), fall, rise)
        return tailed_pulse(self.fwhm_s * rise, self.tail_s * fall)


def tailed_pulse(fwhm_s: float, tail_s: float) -> OpticalPulse:
    """Return a Gaussian convolved with a one-sided exponential.

    Parameters
    ----------
    fwhm_s, tail_s : float
        Full width of the Gaussian at half maximum, above zero; time constant, 0 for none; s.

    Raises
    ------
    RefusedInput
        A tail so long that 200 000 points do not hold the pulse.
    """
    sigma_s = fwhm_s * _SIGMA_OF_FWHM
    step_s = sigma_s / _POINTS_IN_SCALE
    length_s = 2 * _RISE_ENDS * sigma_s + _TAIL_ENDS * tail_s
    if not length_s / step_s < _MOST_POINTS:
        raise RefusedInput(f"a tail of {tail_s!r} s after a pulse {fwhm_s!r} s wide: too long a tail")
    shape = PulseShape((PulsePiece(1.0, sigma_s, tail_s),))
    times_s = np.arange(-_RISE_ENDS * sigma_s, _RISE_ENDS * sigma_s + _TAIL_ENDS * tail_s + step_s, step_s)
    density = shape.density(times_s)
    return _at_its_peak(step_s, density)


def _at_its_peak(step_s: float, power: NDArray[np.float64]) -> OpticalPulse:
    """Scale and shift to a peak of 1 at time 0, the vertex of the parabola through three points."""
    top = int(np.clip(power.argmax(), 1, power.size - 2))
    below, peak, after = power[top - 1 : top + 2]
    bend = below - 2 * peak + after
    part = 0.5 * (below - after) / bend if bend < 0 else 0.0
    height = peak - 0.25 * (below - after) * part
    return OpticalPulse(-(top + part) * step_s, step_s, power / height)


def _from_table(
    times_s: NDArray[np.float64], power: NDArray[np.float64], fall: float, rise: float
) -> OpticalPulse:
    away_s = times_s - times_s[int(power.argmax())]
    away_s = np.where(away_s > 0, fall * away_s, rise * away_s)
    step_s = float(away_s[-1] - away_s[0]) / _TABLE_POINTS
    before, after = math.floor(-away_s[0] / step_s), math.floor(away_s[-1] / step_s)
    relative = np.interp(np.arange(-before, after + 1) * step_s, away_s, power / power.max())
    return OpticalPulse(-before * step_s, step_s, relative)
