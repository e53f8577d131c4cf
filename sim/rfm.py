"""The Range Finder Module: from a range window to its candidates.

The window is correlated with a bank of Gaussian templates at every whole lag; the best four lags, each at
least eleven samples from the others, are refined to centre, width and amplitude by interpolation and by steps
towards the least-squares Gaussian of their correlation window (`belahil.pulse_fit`).

The flight algorithm is not public. Assumed are the widths of the bank, floating point, the exclusion of 10
samples, and that the module sees an AC-coupled signal: the mean of the window is taken off and no other
baseline.

What this does not model: fixed-point arithmetic, a detection threshold, compression, and clipping (a clipped
pulse is fitted as it is and comes out too wide; `belahil.pulse_fit.gaussian_fit` knows better).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from belahil.errors import RefusedInput
from belahil.values import WITH_CORRELATION_WINDOWS, WITH_SAMPLES, Candidate
from sim.template_bank import TemplateBank

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from belahil.receiver import ReceiverSpec
    from belahil.values import Products, RangeWindow
    from sim.scene_tables import RangeFinderTable

EXCLUSION_SAMPLES = 10


class Loops(Protocol):
    """What `sim.compiled_rfm` and `sim.reference_rfm` both have; the latter says what each does."""

    def find(
        self, samples: NDArray[np.float64], mean: float, bank: TemplateBank, count: int, exclusion: int
    ) -> NDArray[np.int64]:
        """As in `sim.reference_rfm`."""
        ...

    def find_in_pieces(
        self,
        pieces: NDArray[np.float64],
        near: tuple[int, int],
        bank: TemplateBank,
        count: int,
        exclusion: int,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """As in `sim.reference_rfm`."""
        ...

    def refine(
        self,
        samples: NDArray[np.float64],
        mean: float,
        lags: NDArray[np.int64],
        widths: NDArray[np.float64],
        window: int,
        steps: int,
    ) -> NDArray[np.float64]:
        """As in `sim.reference_rfm`."""
        ...


@cache
def loops() -> Loops:
    """Return the compiled loops where numba can be imported."""
    try:
        from sim import compiled_rfm
    except ImportError:
        from sim import reference_rfm

        return cast(Loops, reference_rfm)
    return cast(Loops, compiled_rfm)


@dataclass(frozen=True)
class RangeFinder:
    """A range finder.

    Parameters
    ----------
    bank : TemplateBank
        Its templates.
    candidate_count : int
        Pulses it keeps at most, at least 1.
    correlation_window_samples : int
        Samples it keeps round each, at least 4: 42 for BELA, 64 for GALA.
    exclusion_samples : int
        No two candidates lie within so many samples.
    refinement_steps : int
        After the interpolation; 0 or more. One comes within 0.13 mm of the least squares for filtered pulses
        of 30 to 100 ns, two to rounding.
    compiled : bool
        False: the NumPy loops even where numba can be imported, as for a single shot in a fresh process.

    Raises
    ------
    RefusedInput
        A number outside these ranges.
    """

    bank: TemplateBank
    candidate_count: int = 4
    correlation_window_samples: int = 42
    exclusion_samples: int = EXCLUSION_SAMPLES
    refinement_steps: int = 1
    compiled: bool = True

    def __post_init__(self) -> None:
        if self.candidate_count < 1 or self.correlation_window_samples < 4:
            raise RefusedInput(
                f"{self.candidate_count} candidates with {self.correlation_window_samples} samples each: "
                "at least 1 with 4 are allowed"
            )
        if self.exclusion_samples < 0 or self.refinement_steps < 0:
            raise RefusedInput(
                f"exclusion of {self.exclusion_samples} samples, {self.refinement_steps} refinement steps: "
                "neither may be negative"
            )

    @classmethod
    def of(cls, spec: ReceiverSpec, table: RangeFinderTable | None = None) -> RangeFinder:
        """Make the range finder of a receiver: its rate, candidates and correlation windows.

        Parameters
        ----------
        spec : ReceiverSpec
            The receiver.
        table : RangeFinderTable or None
            ``[range_finder]`` of a scene; None: the defaults.
        """
        bank = TemplateBank(spec.digitizer.sample_interval_s)
        if table is None:
            return cls(bank, spec.candidate_count, spec.correlation_window_samples)
        return cls(
            replace(bank, count=table.template_count, narrowest_s=table.narrowest_s, widest_s=table.widest_s),
            spec.candidate_count,
            table.correlation_window_samples or spec.correlation_window_samples,
            table.exclusion_samples,
            table.refinement_steps,
        )

    def search(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Find the best pulses of a window.

        Parameters
        ----------
        volts : array_like of float, shape (n,)
            n at least 4. Zero is assumed outside.

        Returns
        -------
        ndarray of float64, shape (m, 4)
            Best first: arrival (s after the first sample), full width (s), amplitude (V), first sample of the
            correlation window. Fewer than asked for where nothing more rises above the mean; none in a
            constant window.

        Raises
        ------
        RefusedInput
            Another shape, or samples that are not finite.
        """
        samples = np.ascontiguousarray(volts, dtype=np.float64)
        if samples.ndim != 1 or samples.size < 4:
            raise RefusedInput(f"a window of shape {samples.shape}: one row of at least 4 samples is allowed")
        mean = float(samples.sum()) / samples.size
        if not math.isfinite(mean):
            raise RefusedInput(f"a window whose mean is {mean}: every sample must be finite")
        use = _plain() if not self.compiled else loops()
        lags = use.find(samples, mean, self.bank, self.candidate_count, self.exclusion_samples)
        window = min(self.correlation_window_samples, samples.size)
        found = use.refine(samples, mean, lags, self.bank.widths, window, self.refinement_steps)
        found[:, :2] *= self.bank.sample_interval_s
        return found

    def candidates(self, window: RangeWindow, with_samples: bool = False) -> tuple[Candidate, ...]:
        """Find the candidates of a digitized window, best first.

        Parameters
        ----------
        window : RangeWindow
            Its counts.
        with_samples : bool
            Whether each carries the counts of its correlation window.
        """
        size = min(self.correlation_window_samples, window.counts.size) if with_samples else 0
        return tuple(
            Candidate(
                arrival_s, fwhm_s, amplitude_v, tuple(window.counts[first : first + size].tolist()), first
            )
            for arrival_s, fwhm_s, amplitude_v, first in (
                (*row[:3], int(row[3])) for row in self.search(window.volts).tolist()
            )
        )

    def report(self, window: RangeWindow, products: Products) -> RangeWindow:
        """Return what the module reports of a window.

        Parameters
        ----------
        window : RangeWindow
            As digitized.
        products : {"window", "candidates", "correlation_windows", "window_and_candidates"}
            The whole window with its candidates; the candidates without any window; the candidates with
            their correlation windows; those and the whole window. Without a window the counts are empty.
        """
        found = self.candidates(window, with_samples=products in WITH_CORRELATION_WINDOWS)
        if products in WITH_SAMPLES:
            return replace(window, candidates=found)
        nothing = np.zeros(0, dtype=np.int16)
        nothing.setflags(write=False)
        return replace(window, counts=nothing, candidates=found)


def _plain() -> Loops:
    from sim import reference_rfm

    return cast(Loops, reference_rfm)
