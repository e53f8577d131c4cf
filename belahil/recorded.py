"""Windows out of a data file, as shots: what a procedure analyses in place of measuring.

The layout is that of the data file of a run, `docs/data-file.md`. Another program needs only a few of its
variables; what is read, and what stands for the rest, is listed there.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.errors import RefusedInput
from belahil.export import NO_COUNT, SAID, STIMULI
from belahil.export_pulses import INTERPOLATIONS
from belahil.export_tables import NO_FLOAT
from belahil.receiver import DigitizerSpec
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from belahil.values import PRODUCTS, Candidate, Products, RangeWindow, Shot, WindowRequest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

NEEDED = ("counts", "volts_per_count", "sample_interval_s")
_DEFAULTS = {
    "zero_count": 0.0,
    "start_s": 0.0,
    "saturated": 0,
    "gain_code": -1,
    "stimulus": 0,
    "date": 0,
    "attempt": 1,
    "laser_firing": 0,
}
"""What stands for a variable that a file does not have; `stimulus` 0 is no signal."""

_LAST_MS = 253_402_300_799_999
"""Of the year 9999, ms since 1970."""

_BATCH = 64
"""Windows that are read at once: 2 MB of the longest BELA windows."""


@dataclass(frozen=True, eq=False)
class RecordedWindows:
    """Shots of a data file, read from the disk a few at a time, as often as asked.

    Parameters
    ----------
    path : Path
        The file.
    source : str
        ``emulated``, ``simulated``, ``hardware`` or ``replay``, as the file says; ``hardware`` when silent.
    spec : DigitizerSpec
        Of the receiver that digitized.
    pulses : tuple of SampledPulse
        Those that were played.
    instruments : mapping of str to str
        Who answered, by part, as the file says.
    columns : mapping of str to ndarray
        All that is not windows, by variable.
    """

    path: Path
    source: str
    spec: DigitizerSpec
    pulses: tuple[SampledPulse, ...]
    instruments: Mapping[str, str]
    columns: Mapping[str, NDArray[Any]] = field(repr=False)

    def __len__(self) -> int:
        return int(self.columns["sample_count"].size)

    def __iter__(self) -> Iterator[Shot]:
        for first in range(0, len(self), _BATCH):
            with _opened(self.path) as file:
                counts = file["counts"][first : first + _BATCH]
            for place, row in enumerate(counts, start=first):
                yield self._shot(place, row)

    def request(self, place: int) -> WindowRequest:
        """Return what the shot in a row of the file answers.

        Parameters
        ----------
        place : int
            Row; it becomes the index of the shot.
        """
        column, played = self.columns, self.played(place)
        silent = isinstance(played, (NoSignal, Sine))
        return WindowRequest(
            shot=place,
            gain_code=self._code(place),
            sample_count=int(column["sample_count"][place]) or self.spec.max_sample_count,
            delay_s=float(column["start_s"][place]),
            trigger="digitizer" if column["laser_firing"][place] else "immediate" if silent else "generator",
            source="transmit" if isinstance(played, TransmittedPulse) else "return",
            products=self._products(place),
        )

    def _products(self, place: int) -> Products:
        if self.columns["sample_count"][place]:
            found = "candidate_count" in self.columns and self.columns["candidate_count"][place]
            return "window_and_candidates" if found else "window"
        return "correlation_windows" if "candidate_counts" in self.columns else "candidates"

    def _code(self, place: int) -> int | None:
        code = int(self.columns["gain_code"][place])
        return None if code < 0 else code

    def _shot(self, place: int, row: NDArray[np.int16]) -> Shot:
        column = self.columns
        window = RangeWindow(
            counts=np.array(row[: column["sample_count"][place]], np.int16),
            volts_per_count=float(column["volts_per_count"][place]),
            zero_count=float(column["zero_count"][place]),
            sample_interval_s=float(column["sample_interval_s"][place]),
            start_s=float(column["start_s"][place]),
            gain_code=self._code(place),
            shot=place,
            saturated=int(column["saturated"][place]),
            candidates=tuple(self._candidates(place)),
            housekeeping={
                name.removeprefix("housekeeping_"): float(values[place])
                for name, values in column.items()
                if name.startswith("housekeeping_") and not _missing(values[place])
            },
        )
        return Shot(
            self.played(place), window, _utc(int(column["date"][place])), int(column["attempt"][place])
        )

    def played(self, place: int) -> Stimulus:
        """Return the stimulus of the shot in a row of the file."""
        column = self.columns
        kind = STIMULI[int(column["stimulus"][place])]
        if kind is Sine:
            names = ("frequency_hz", "amplitude_vpp", "offset_v")
            return Sine(*(float(column[name][place]) for name in names))
        if kind is SampledPulse:
            return self.pulses[int(column["pulse_of_shot"][place])]
        return TransmittedPulse() if kind is TransmittedPulse else NoSignal()

    def _candidates(self, place: int) -> Iterator[Candidate]:
        column = self.columns
        for one in range(int(column["candidate_count"][place]) if "candidate_count" in column else 0):
            first = int(column["candidate_first_sample"][place, one])
            counts: tuple[int, ...] = ()
            if "candidate_counts" in column:
                row = column["candidate_counts"][place, one]
                counts = tuple(int(count) for count in row if count != NO_COUNT)
            names = ("candidate_arrival_s", "candidate_fwhm_s", "candidate_amplitude_v")
            arrival_s, fwhm_s, amplitude_v = (float(column[name][place, one]) for name in names)
            yield Candidate(arrival_s, fwhm_s, amplitude_v, counts, first)


def read_windows(path: str | Path) -> RecordedWindows:
    """Open a data file for its windows.

    Parameters
    ----------
    path : str or Path
        ``data.nc`` of a run, or another program's file of the same layout.

    Raises
    ------
    RefusedInput
        No such file, or not one of this layout: the line names what is missing.
    """
    path = Path(path)
    with _opened(path) as file:
        missing = [name for name in NEEDED if name not in file]
        if missing:
            raise RefusedInput(
                f"--windows {path}: has no {', '.join(missing)}; needed are {', '.join(NEEDED)}"
            )
        counts = file["counts"]
        if counts.ndim != 2 or counts.dtype != np.int16 or not counts.shape[0]:
            raise RefusedInput(
                f"--windows {path}: counts are {counts.dtype} of shape {counts.shape}; "
                "needed is int16, one window a row, at least one"
            )
        columns = _columns(file, path)
        spec = _spec(file, columns, path)
        said = {name: _text(value) for name, value in file.attrs.items() if isinstance(value, (str, bytes))}
    mark = "instrument_"
    return RecordedWindows(
        path=path,
        source=said.get("bench", "hardware") if said.get("bench") in SAID else "hardware",
        spec=spec,
        pulses=_pulses(columns, path),
        instruments={name.removeprefix(mark): text for name, text in said.items() if name.startswith(mark)},
        columns=columns,
    )


def _columns(file: Any, path: Path) -> dict[str, NDArray[Any]]:
    """Read all that a shot needs beside its counts; a variable of one value stands for every shot."""
    rows, samples = file["counts"].shape
    wanted = (*NEEDED[1:], *_DEFAULTS, "sample_count", "frequency_hz", "amplitude_vpp", "offset_v")
    columns = {name: np.asarray(file[name][()]) for name in wanted if name in file}
    for name, value in {**_DEFAULTS, "sample_count": samples}.items():
        columns.setdefault(name, np.asarray(value))
    for name, values in columns.items():
        if values.shape not in ((), (rows,)) or values.dtype.kind not in "iuf":
            raise RefusedInput(
                f"--windows {path}: {name} has the shape {values.shape}; needed is ({rows},) or ()"
            )
        columns[name] = np.broadcast_to(values, (rows,))
    for name in NEEDED[1:]:
        if not np.all((columns[name] > 0) & (columns[name] < math.inf)):
            raise RefusedInput(
                f"--windows {path}: volts_per_count and sample_interval_s must be finite and above zero"
            )
    for name in ("zero_count", "start_s"):
        if not np.all(np.isfinite(columns[name])):
            raise RefusedInput(f"--windows {path}: {name} must be finite")
    if not np.all((columns["date"] >= 0) & (columns["date"] <= _LAST_MS)):
        raise RefusedInput(f"--windows {path}: date must be ms since 1970, up to the year 9999")
    if not np.all((columns["sample_count"] >= 0) & (columns["sample_count"] <= samples)):
        raise RefusedInput(f"--windows {path}: sample_count must be from 0 to {samples}")
    kinds = columns["stimulus"]
    if not np.all((kinds >= 0) & (kinds < len(STIMULI))):
        raise RefusedInput(f"--windows {path}: stimulus must be from 0 to {len(STIMULI) - 1}")
    more = [name for name in file if name.startswith(("candidate_", "pulse_", "housekeeping_"))]
    for name in more:
        values = np.asarray(file[name][()])
        columns[name] = values if values.ndim else np.broadcast_to(values, (rows,))
    _check_candidates(columns, rows, path)
    for kind, names in ((Sine, ("frequency_hz", "amplitude_vpp", "offset_v")), (SampledPulse, _PULSE)):
        lacking = [name for name in names if name not in columns]
        if lacking and np.any(kinds == STIMULI.index(kind)):
            raise RefusedInput(
                f"--windows {path}: has shots of a {kind.__name__}, but no {', '.join(lacking)}"
            )
    return columns


def _check_candidates(columns: Mapping[str, NDArray[Any]], rows: int, path: Path) -> None:
    """Refuse candidates that are not there, or are no numbers, where their count says that there are some."""
    for name, values in columns.items():
        of_shots = name.startswith("housekeeping_") or name in (
            "candidate_count",
            "candidate_counts",
            *_CANDIDATE,
        )
        if of_shots and values.shape[:1] != (rows,):
            raise RefusedInput(
                f"--windows {path}: {name} has the shape {values.shape}; needed are {rows} rows"
            )
    if "candidate_count" not in columns:
        return
    lacking = [name for name in _CANDIDATE if name not in columns]
    if lacking:
        raise RefusedInput(f"--windows {path}: has candidate_count, but no {', '.join(lacking)}")
    tables = [columns[name] for name in (*_CANDIDATE, "candidate_counts") if name in columns]
    if [table.ndim for table in tables] != [2, 2, 2, 2, 3][: len(tables)]:
        raise RefusedInput(
            f"--windows {path}: candidate_* must be by shot and candidate, counts by sample too"
        )
    most = min(table.shape[1] for table in tables)
    count = columns["candidate_count"]
    if count.ndim != 1 or not np.all((count >= 0) & (count <= most)):
        raise RefusedInput(f"--windows {path}: candidate_count must be from 0 to {most} for each window")
    there = np.arange(most) < count[:, None]
    for name, table in zip(_CANDIDATE, tables, strict=False):
        if not np.all(np.isfinite(table[:, :most][there])):
            raise RefusedInput(f"--windows {path}: {name} must be finite for each candidate")


_CANDIDATE = tuple(f"candidate_{name}" for name in ("arrival_s", "fwhm_s", "amplitude_v", "first_sample"))
_PULSE = tuple(
    f"pulse_{name}"
    for name in ("of_shot", "volts", "sample_count", "sample_rate_hz", "start_s", "interpolation")
)


def _spec(file: Any, columns: Mapping[str, NDArray[Any]], path: Path) -> DigitizerSpec:
    attributes = file.attrs
    missing = [name for name in ("digitizer_bits", "digitizer_converters") if name not in attributes]
    if missing:
        raise RefusedInput(f"--windows {path}: needs the global attributes {', '.join(missing)} (integers)")
    bits, converters = (int(_number(attributes[f"digitizer_{name}"])) for name in ("bits", "converters"))
    if not 1 <= bits <= 16 or converters < 1:
        raise RefusedInput(
            f"--windows {path}: {bits} bits and {converters} converters; 1 to 16, 1 or more are allowed"
        )
    intervals_s = np.unique(columns["sample_interval_s"])
    if intervals_s.size > 1:
        raise RefusedInput(
            f"--windows {path}: sample intervals {intervals_s[:3]} s: windows of one receiver are needed"
        )
    codes = np.unique(columns["gain_code"])
    told = ("window", *_text(attributes.get("digitizer_products", "")).split())
    known = attributes.get("digitizer_gain_codes", codes[codes >= 0])
    return DigitizerSpec(
        sample_rate_hz=_number(attributes.get("digitizer_sample_rate_hz", 1 / intervals_s[0])),
        bits=bits,
        converters=converters,
        max_sample_count=int(_number(attributes.get("digitizer_max_sample_count", file["counts"].shape[1]))),
        gain_codes=tuple(int(code) for code in np.atleast_1d(known)) or None,
        products=tuple(one for one in PRODUCTS if one in told),
    )


def _pulses(columns: Mapping[str, NDArray[Any]], path: Path) -> tuple[SampledPulse, ...]:
    played = columns["stimulus"] == STIMULI.index(SampledPulse)
    if "pulse_volts" not in columns or not played.any():
        return ()
    volts, sizes = columns["pulse_volts"], columns["pulse_sample_count"]
    which = columns["pulse_of_shot"]
    if which.shape != played.shape or not np.all((which >= 0) & (which < len(volts)) | ~played):
        raise RefusedInput(
            f"--windows {path}: pulse_of_shot names a pulse beyond the {len(volts)} of the file"
        )
    for name, least, most in (
        ("sample_count", 2, volts.shape[-1]),
        ("interpolation", 0, len(INTERPOLATIONS) - 1),
    ):
        numbers = columns[f"pulse_{name}"]
        if numbers.shape != (len(volts),) or not np.all((numbers >= least) & (numbers <= most)):
            raise RefusedInput(
                f"--windows {path}: pulse_{name} must be from {least} to {most} for each pulse"
            )
    try:
        return tuple(_pulse(columns, place, int(size)) for place, size in enumerate(sizes))
    except RefusedInput as error:
        raise RefusedInput(f"--windows {path}: {error}") from error


def _pulse(columns: Mapping[str, NDArray[Any]], place: int, size: int) -> SampledPulse:
    poles: tuple[complex, ...] = ()
    if "pulse_pole_real" in columns:
        parts = np.stack([columns[f"pulse_pole_{part}"][place] for part in ("real", "imaginary")], axis=1)
        poles = tuple(complex(*map(float, pole)) for pole in parts if pole[0] != NO_FLOAT)
    return SampledPulse(
        volts=columns["pulse_volts"][place, :size],
        sample_rate_hz=float(columns["pulse_sample_rate_hz"][place]),
        start_s=float(columns["pulse_start_s"][place]),
        interpolation=INTERPOLATIONS[int(columns["pulse_interpolation"][place])],
        poles=poles,
    )


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    import h5py

    try:
        file = h5py.File(path)
    except OSError as error:
        why = "there is no such file" if not path.is_file() else "it is no NetCDF-4 file"
        raise RefusedInput(f"--windows {path}: {why}; needed is the data.nc of a run") from error
    with file:
        yield file


def _number(attribute: Any) -> float:
    # Attributes come as arrays of one number from some programs.
    return float(np.asarray(attribute).reshape(-1)[0])


def _text(value: str | bytes) -> str:
    return value.decode() if isinstance(value, bytes) else value


def _missing(value: float) -> bool:
    return value == NO_FLOAT or value != value


def _utc(milliseconds: int) -> str:
    return datetime.fromtimestamp(milliseconds / 1000, UTC).isoformat(timespec="milliseconds")
