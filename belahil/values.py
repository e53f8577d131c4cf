"""The values that cross the cut: frozen, in SI units, with the unit in the name."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass, field
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from belahil.stimuli import Stimulus

Trigger = Literal["immediate", "generator", "digitizer"]
Source = Literal["return", "transmit"]
Products = Literal["window", "candidates", "correlation_windows", "window_and_candidates"]

TRIGGERS: tuple[Trigger, ...] = ("immediate", "generator", "digitizer")
SOURCES: tuple[Source, ...] = ("return", "transmit")
PRODUCTS: tuple[Products, ...] = ("window", "candidates", "correlation_windows", "window_and_candidates")
"""Their order is that of the numbers on the GRM link."""
WITH_SAMPLES = frozenset({"window", "window_and_candidates"})
WITH_CORRELATION_WINDOWS = frozenset({"correlation_windows", "window_and_candidates"})

_NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class Waveform:
    """Volts on a uniform time grid.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        Voltage of each sample, V.
    sample_rate_hz : float
        Samples per second.
    start_s : float
        Time of the first sample, s.
    """

    volts: NDArray[np.float64]
    sample_rate_hz: float
    start_s: float = 0.0


@dataclass(frozen=True, slots=True)
class WindowRequest:
    """What one shot asks of a digitizer.

    Parameters
    ----------
    shot : int
        Index in the plan, 0 to 2**32 - 1. It comes back with the window: the proof against stale data.
    gain_code : int or None
        Gain setting of the receiver; None where it has none.
    sample_count : int
        Samples to digitize.
    delay_s : float
        From the trigger to the first sample, s; the receiver rounds it to its own grid.
    trigger : {"immediate", "generator", "digitizer"}
        Who starts the window. The bench fills this in from the stimulus; only with `NoSignal` is
        "digitizer" kept: the receiver's shot pulse, which fires the laser, starts a window of silence.
    source : {"return", "transmit"}
        The return channel, or the laser's own pulse.
    products : {"window", "candidates", "correlation_windows", "window_and_candidates"}
        What to report: all samples; what the range finder found, without samples; the same with the samples
        round each; all samples of one window and what the range finder found in it, with the samples round
        each.
    """

    shot: int
    gain_code: int | None = None
    sample_count: int = 16064
    delay_s: float = 0.0
    trigger: Trigger = "immediate"
    source: Source = "return"
    products: Products = "window"

    def check(self) -> None:
        """Refuse what no receiver could take.

        Raises
        ------
        RefusedInput
            A shot or a count that is no whole number, a negative shot, a window of no sample, or a delay that
            is not finite.
        """
        check_whole("shot", self.shot, 0)
        check_whole("sample_count", self.sample_count, 1)
        if not isinstance(self.delay_s, Real) or not math.isfinite(self.delay_s):
            raise RefusedInput(f"a window with delay_s = {self.delay_s!r}: must be a finite number")


def check_whole(name: str, number: object, least: int) -> None:
    """Refuse what is not a whole number of at least `least`, of Python or of NumPy.

    Raises
    ------
    RefusedInput
        One line with the name and what is allowed.
    """
    try:
        fits = operator.index(number) >= least  # type: ignore[arg-type]
    except TypeError:
        fits = False
    if not fits:
        raise RefusedInput(f"{name} = {number!r}: must be a whole number of {least} or more")


@dataclass(frozen=True, slots=True)
class Candidate:
    """One pulse that the range finder reports.

    Parameters
    ----------
    arrival_s : float
        Centre, s after the first sample of the window.
    fwhm_s : float
        Full width at half maximum, s.
    amplitude_v : float
        Height at the converter, V.
    correlation_window : tuple of int
        Counts round the arrival; empty when not reported.
    first_sample : int
        Sample of the range window with which the correlation window begins.
    """

    arrival_s: float
    fwhm_s: float
    amplitude_v: float
    correlation_window: tuple[int, ...] = ()
    first_sample: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class RangeWindow:
    """What a digitizer measured in one shot.

    Counts are integers and stay so; volts are derived. Two windows compare by `equals`.

    Parameters
    ----------
    counts : ndarray of int16, shape (n,)
        Converter codes; none where only candidates were asked for.
    volts_per_count : float
        Size of one code at the converter, V.
    zero_count : float
        Code of zero volts.
    sample_interval_s : float
        Nominal time between samples, s.
    start_s : float
        First sample after the trigger on the receiver's own grid, s.
    gain_code : int or None
        Gain setting that was in force.
    shot : int
        Index that the request carried.
    saturated : int
        Number of clipped samples, of all that were digitized.
    candidates : tuple of Candidate
        At most as many as the receiver keeps.
    housekeeping : mapping of str to float
        What the receiver tells of itself, SI units in the names.
    """

    counts: NDArray[np.int16]
    volts_per_count: float
    zero_count: float
    sample_interval_s: float
    start_s: float
    gain_code: int | None
    shot: int
    saturated: int = 0
    candidates: tuple[Candidate, ...] = ()
    housekeeping: Mapping[str, float] = field(default_factory=lambda: _NOTHING)

    @property
    def volts(self) -> NDArray[np.float64]:
        """Volts at the converter, shape (n,)."""
        volts = self.counts.astype(np.float64)
        volts -= self.zero_count
        volts *= self.volts_per_count
        return volts

    def equals(self, other: RangeWindow) -> bool:
        """Tell whether both hold the same counts and the same description, bit for bit."""
        return bool(np.array_equal(self.counts, other.counts)) and self._words() == other._words()

    def _words(self) -> tuple[object, ...]:
        return (
            self.volts_per_count,
            self.zero_count,
            self.sample_interval_s,
            self.start_s,
            self.gain_code,
            self.shot,
            self.saturated,
            self.candidates,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One stimulus and the window it gave.

    Parameters
    ----------
    played : Stimulus
        What the generator really played, in volts at the cut.
    window : RangeWindow
        What the digitizer returned.
    date : str
        UTC date of the measurement, ISO 8601.
    attempt : int
        1 when the first try succeeded.
    """

    played: Stimulus
    window: RangeWindow
    date: str
    attempt: int = 1


@dataclass(frozen=True, slots=True)
class Estimate:
    """A measured number.

    Parameters
    ----------
    value : float
        Best estimate, in `unit`.
    standard_uncertainty : float
        Combined standard uncertainty, in `unit` (JCGM 100).
    unit : str
        SI unit without prefix: "Hz", "V", "s", "1".
    """

    value: float
    standard_uncertainty: float
    unit: str = "1"

    def as_json(self) -> dict[str, float | str]:
        """Return the form that ``summary.json`` uses."""
        return {"value": self.value, "standard_uncertainty": self.standard_uncertainty, "unit": self.unit}
