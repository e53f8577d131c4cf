"""The data file of a run: NetCDF-4 with CF attributes, written from the journal when the run ends.

Dimensions are ``shot`` and ``sample``; tables of results add theirs, and a variable for each column.
Windows shorter than the longest are filled up; ``sample_count`` says where they end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from belahil.export_candidates import FoundCandidates
from belahil.export_pulses import PlayedPulses
from belahil.export_tables import NO_FLOAT, write_numbers, write_table
from belahil.stimuli import NoSignal, SampledPulse, Sine, TransmittedPulse, largest_volts
from belahil.storage import replacing, reserve

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from belahil.outcome import Number, Table
    from belahil.receiver import DigitizerSpec
    from belahil.values import Shot

CONVENTIONS = "CF-1.11"
NO_COUNT = -32768
STIMULI = (NoSignal, Sine, SampledPulse, TransmittedPulse)
STIMULUS_WORDS = "no_signal sine sampled_pulse transmitted_pulse"
BATCH = 64  # windows a write: 2 MB of the longest BELA windows
SLACK_BYTES = 1 << 20  # names and attributes
UNIT_OF_SUFFIX = {"v": "V", "a": "A", "s": "s", "hz": "Hz", "k": "K", "c": "degree_Celsius", "w": "W"}
SAID = {
    "emulated": "EMULATED DATA: emulated instruments behind the real drivers; no hardware was measured",
    "simulated": "SIMULATED DATA: computed instruments; no hardware was measured",
    "hardware": "measured on hardware",
    "replay": "REPLAYED DATA: read again from the recording of an earlier session",
}


class ManyShots(Protocol):
    """Shots that can be counted, and read as often as asked."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Shot]: ...


@dataclass(frozen=True, slots=True)
class _Variable:
    name: str
    dtype: str
    units: str
    long_name: str
    of: Callable[[Shot], Any]
    fill: Any = None


def _milliseconds(date: str) -> int:
    return round(datetime.fromisoformat(date).timestamp() * 1000)


def _of_sine(name: str) -> Callable[[Shot], float]:
    return lambda shot: getattr(shot.played, name) if isinstance(shot.played, Sine) else NO_FLOAT


_VARIABLES = (
    _Variable("shot", "i8", "1", "index of the shot in the plan", lambda shot: shot.window.shot),
    _Variable(
        "sample_count", "i4", "1", "digitized samples of the window", lambda shot: shot.window.counts.size
    ),
    _Variable(
        "gain_code",
        "i2",
        "1",
        "gain code of the receiver",
        lambda shot: -1 if shot.window.gain_code is None else shot.window.gain_code,
        -1,
    ),
    _Variable(
        "volts_per_count",
        "f8",
        "V",
        "size of one count at the converter",
        lambda shot: shot.window.volts_per_count,
    ),
    _Variable("zero_count", "f8", "1", "count of zero volts", lambda shot: shot.window.zero_count),
    _Variable(
        "sample_interval_s",
        "f8",
        "s",
        "nominal time between samples",
        lambda shot: shot.window.sample_interval_s,
    ),
    _Variable("start_s", "f8", "s", "first sample after the trigger", lambda shot: shot.window.start_s),
    _Variable("saturated", "i4", "1", "number of clipped samples", lambda shot: shot.window.saturated),
    _Variable("stimulus", "i1", "", "kind of the stimulus", lambda shot: STIMULI.index(type(shot.played))),
    _Variable(
        "frequency_hz", "f8", "Hz", "frequency of a sine as played", _of_sine("frequency_hz"), NO_FLOAT
    ),
    _Variable(
        "amplitude_vpp",
        "f8",
        "V",
        "amplitude of a sine at the cut, peak to peak",
        _of_sine("amplitude_vpp"),
        NO_FLOAT,
    ),
    _Variable("offset_v", "f8", "V", "offset of a sine at the cut", _of_sine("offset_v"), NO_FLOAT),
    _Variable(
        "largest_v",
        "f8",
        "V",
        "largest magnitude of the stimulus at the cut",
        lambda shot: largest_volts(shot.played),
    ),
    _Variable(
        "date",
        "i8",
        "milliseconds since 1970-01-01T00:00:00Z",
        "date of the measurement",
        lambda shot: _milliseconds(shot.date),
    ),
    _Variable("attempt", "i2", "1", "attempt that succeeded", lambda shot: shot.attempt),
)


def write_data(
    path: Path,
    shots: ManyShots,
    tables: Mapping[str, Table],
    summary: Mapping[str, Any],
    numbers: Mapping[str, Number] | None = None,
    digitizer: DigitizerSpec | None = None,
) -> None:
    """Write the data file; memory holds a few windows at a time.

    Parameters
    ----------
    path : Path
        Replaced as a whole.
    shots : ManyShots
        Read twice.
    tables : mapping of str to Table
        Results by name.
    summary : mapping
        As ``summary.json`` says it; title, source and history are taken from it.
    numbers : mapping of str to (Estimate or None, what it is), or None
        Results that are a single number; each is a variable without dimension.
    digitizer : DigitizerSpec or None
        What the receiver reported of itself; global attributes of the file.

    Raises
    ------
    StorageError
        The file could not be written.
    """
    import h5netcdf

    found, pulses = FoundCandidates(), PlayedPulses()
    scalars, housekeeping, longest, ragged = _collected(shots, found, pulses)
    held = (
        found.nbytes
        + pulses.nbytes
        + sum(data.nbytes for data in [*scalars.values(), *housekeeping.values()])
    )
    held += sum(column[0].nbytes for table in tables.values() for column in table.columns.values())
    with replacing(path) as temporary:
        # A full disk must be found now: HDF5 crashes when it cannot write what it still holds at its end.
        reserve(temporary, int(1.02 * (2 * len(shots) * longest + held)) + SLACK_BYTES)
        with h5netcdf.File(temporary, "w") as file:
            file.attrs.update(_attributes(summary) | _of_digitizer(digitizer))
            file.dimensions = {"shot": len(shots), "sample": max(longest, 1)}
            _write_scalars(file, scalars, housekeeping)
            _write_counts(file, shots, max(longest, 1), ragged)
            found.write(file, NO_COUNT)
            pulses.write(file)
            for name, table in tables.items():
                write_table(file, name, table)
            write_numbers(file, numbers or {})


def _write_scalars(
    file: Any, scalars: Mapping[str, NDArray[Any]], housekeeping: Mapping[str, NDArray[np.float64]]
) -> None:
    for variable in _VARIABLES:
        data = scalars[variable.name]
        if variable.fill == NO_FLOAT and np.all(data == NO_FLOAT):
            continue  # of sines, and no shot has one
        # Only where it is needed: readers turn integers that have a fill value into floats.
        fill = variable.fill if np.any(data == variable.fill) else None
        made = file.create_variable(variable.name, ("shot",), data=data, fillvalue=fill)
        made.attrs["long_name"] = variable.long_name
        if variable.units:
            made.attrs["units"] = variable.units
    file["stimulus"].attrs["flag_values"] = np.arange(len(STIMULI), dtype=np.int8)
    file["stimulus"].attrs["flag_meanings"] = STIMULUS_WORDS
    file["date"].attrs["standard_name"] = "time"
    for name, values in housekeeping.items():
        made = file.create_variable(f"housekeeping_{name}", ("shot",), "f8", data=values, fillvalue=NO_FLOAT)
        made.attrs["long_name"] = f"{name}, as the receiver reports it"
        made.attrs["units"] = UNIT_OF_SUFFIX.get(name.rpartition("_")[2], "1")


def _collected(
    shots: ManyShots, found: FoundCandidates, pulses: PlayedPulses
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[np.float64]], int, bool]:
    """Read all but the counts: per-shot values, housekeeping, longest window, whether lengths differ.

    Candidates go to `found`, sampled pulses to `pulses`.
    """
    columns: dict[str, list[Any]] = {variable.name: [] for variable in _VARIABLES}
    housekeeping: dict[str, NDArray[np.float64]] = {}
    for row, shot in enumerate(shots):
        for variable in _VARIABLES:
            columns[variable.name].append(variable.of(shot))
        found.add(shot.window.candidates)
        pulses.add(shot.played)
        for name, value in shot.window.housekeeping.items():
            housekeeping.setdefault(name, np.full(len(shots), NO_FLOAT))[row] = value
    lengths = set(columns["sample_count"])
    scalars = {variable.name: np.array(columns[variable.name], variable.dtype) for variable in _VARIABLES}
    return scalars, housekeeping, max(lengths, default=0), len(lengths) > 1


def _write_counts(file: Any, shots: Iterable[Shot], longest: int, ragged: bool) -> None:
    counts = file.create_variable(
        "counts",
        ("shot", "sample"),
        "i2",
        chunks=(1, longest),
        fillvalue=NO_COUNT if ragged else None,
    )
    counts.attrs["long_name"] = "converter counts; volts are (counts - zero_count) * volts_per_count"
    counts.attrs["units"] = "1"
    coordinates = ("gain_code", "frequency_hz", "amplitude_vpp", "date")
    counts.attrs["coordinates"] = " ".join(name for name in coordinates if name in file.variables)
    batch = np.full((BATCH, longest), NO_COUNT, np.int16)
    first = held = 0
    for shot in shots:
        size = shot.window.counts.size
        batch[held, :size] = shot.window.counts
        batch[held, size:] = NO_COUNT
        held += 1
        if held == BATCH:
            counts[first : first + held] = batch
            first, held = first + held, 0
    if held:
        counts[first : first + held] = batch[:held]


def _attributes(summary: Mapping[str, Any]) -> dict[str, str]:
    instruments = ", ".join(f"{part} {identity}" for part, identity in summary["instruments"].items())
    said = SAID[summary["source"]]
    definitions = summary.get("results", {}).get("definitions", {})
    return {
        "Conventions": CONVENTIONS,
        "title": f"belahil {summary['procedure']}: range windows and results",
        "source": f"{said}; {instruments}",
        "history": f"{summary['finished']} belahil {summary['software']['belahil']} "
        f"{summary['procedure']}, begun {summary['started']}; {said}",
        "comment": f"{said}. Voltages of stimuli are voltages at the cut, the receiver's input connector.",
        "verdict": summary["verdict"],
        "bench": summary["source"],
        **{f"instrument_{part}": identity for part, identity in summary["instruments"].items()},
        **{f"definition_of_{name}": told for name, told in definitions.items()},
    }


def _of_digitizer(spec: DigitizerSpec | None) -> dict[str, Any]:
    if spec is None:
        return {}
    names = ("sample_rate_hz", "bits", "converters", "max_sample_count")
    found: dict[str, Any] = {f"digitizer_{name}": getattr(spec, name) for name in names}
    found["digitizer_products"] = " ".join(spec.products)
    return found if spec.gain_codes is None else found | {"digitizer_gain_codes": list(spec.gain_codes)}
