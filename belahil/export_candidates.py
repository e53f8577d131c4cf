"""What the range finder found, in the data file; nothing there where no window has candidates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.export_tables import NO_FLOAT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.values import Candidate

NO_SAMPLE = -1
_NUMBERS = (
    ("candidate_arrival_s", "s", "centre of a pulse, after the first sample of the window"),
    ("candidate_fwhm_s", "s", "full width at half maximum of a pulse"),
    ("candidate_amplitude_v", "V", "height of a pulse at the converter"),
)
_FIRST = "sample of the range window with which the correlation window begins"
_COUNTS = "converter counts of the correlation window; volts are (counts - zero_count) * volts_per_count"


@dataclass
class FoundCandidates:
    """The candidates of many shots, gathered one shot after the other."""

    _numbers: list[NDArray[np.float64]] = field(default_factory=list)
    _firsts: list[NDArray[np.int32]] = field(default_factory=list)
    _counts: list[tuple[NDArray[np.int16], ...]] = field(default_factory=list)

    def add(self, candidates: Sequence[Candidate]) -> None:
        """Take those of the next shot."""
        numbers = [(one.arrival_s, one.fwhm_s, one.amplitude_v) for one in candidates]
        self._numbers.append(np.array(numbers, np.float64).reshape(-1, len(_NUMBERS)))
        self._firsts.append(np.array([one.first_sample for one in candidates], np.int32))
        self._counts.append(tuple(np.array(one.correlation_window, np.int16) for one in candidates))

    @property
    def nbytes(self) -> int:
        """Octets that they take in the file."""
        most, longest = self._sizes
        return len(self._numbers) * (2 + most * (8 * len(_NUMBERS) + 4 + 2 * longest))

    @property
    def _sizes(self) -> tuple[int, int]:
        """Most candidates of a shot, longest correlation window."""
        most = max((len(firsts) for firsts in self._firsts), default=0)
        return most, max((one.size for shot in self._counts for one in shot), default=0)

    def write(self, file: Any, no_count: int) -> None:
        """Write the variables.

        Parameters
        ----------
        file : h5netcdf.File
            Open for writing, with its dimension ``shot``.
        no_count : int
            What stands where a correlation window has ended.
        """
        most, longest = self._sizes
        if not most:
            return
        file.dimensions["candidate"] = most
        sizes = np.array([len(firsts) for firsts in self._firsts], np.int16)
        _variable(file, "candidate_count", sizes, None, "1", "pulses that the range finder reported")
        numbers = _filled([row.T for row in self._numbers], (len(_NUMBERS), most), NO_FLOAT)
        for place, (name, unit, words) in enumerate(_NUMBERS):
            _variable(file, name, numbers[:, place], NO_FLOAT, unit, words)
        firsts = _filled(self._firsts, (most,), NO_SAMPLE)
        _variable(file, "candidate_first_sample", firsts, NO_SAMPLE, "1", _FIRST)
        if longest:
            file.dimensions["candidate_sample"] = longest
            counts = np.full((len(self._counts), most, longest), no_count, np.int16)
            for shot, windows in enumerate(self._counts):
                for place, window in enumerate(windows):
                    counts[shot, place, : window.size] = window
            _variable(file, "candidate_counts", counts, no_count, "1", _COUNTS)


def _filled(rows: Sequence[NDArray[Any]], shape: tuple[int, ...], fill: float) -> NDArray[Any]:
    whole = np.full((len(rows), *shape), fill, rows[0].dtype)
    for place, row in enumerate(rows):
        whole[place, ..., : row.shape[-1]] = row
    return whole


def _variable(file: Any, name: str, data: NDArray[Any], fill: float | None, unit: str, words: str) -> None:
    # Integers get a fill value only where it is needed: readers turn those that have one into floats.
    needed = fill if data.dtype.kind == "f" or np.any(data == fill) else None
    dimensions = ("shot", "candidate", "candidate_sample")[: data.ndim]
    made = file.create_variable(name, dimensions, data=data, fillvalue=needed)
    made.attrs["long_name"] = words
    made.attrs["units"] = unit
