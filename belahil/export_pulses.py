"""Sampled pulses as they were played, in the data file, each once; nothing there where none was played."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from belahil.export_tables import NO_FLOAT
from belahil.stimuli import Interpolation, SampledPulse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.stimuli import Stimulus

NO_PULSE = -1
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
_VOLTS = "break points at the cut"
_POLES = "poles that the waveform has passed, all-pole and of unit gain"


@dataclass
class PlayedPulses:
    """The distinct sampled pulses of many shots, gathered one shot after the other."""

    _place: dict[SampledPulse, int] = field(default_factory=dict)
    _of_shot: list[int] = field(default_factory=list)

    def add(self, played: Stimulus) -> None:
        """Take that of the next shot."""
        place = NO_PULSE
        if isinstance(played, SampledPulse):
            place = self._place.setdefault(played, len(self._place))
        self._of_shot.append(place)

    @property
    def nbytes(self) -> int:
        """Octets that they take in the file."""
        return 4 * len(self._of_shot) + len(self._place) * (8 * self._longest + 64 + 16 * self._most_poles)

    @property
    def _longest(self) -> int:
        return max((one.volts.size for one in self._place), default=0)

    @property
    def _most_poles(self) -> int:
        return max((len(one.poles) for one in self._place), default=0)

    def write(self, file: Any) -> None:
        """Write the variables to a file that is open for writing, with its dimension ``shot``."""
        pulses = list(self._place)
        if not pulses:
            return
        file.dimensions["pulse"] = len(pulses)
        file.dimensions["pulse_sample"] = self._longest
        of_shot = np.array(self._of_shot, np.int32)
        _write(file, "pulse_of_shot", ("shot",), of_shot, "1", "pulse that was played; -1 for other stimuli")
        volts = np.full((len(pulses), self._longest), NO_FLOAT)
        for row, one in zip(volts, pulses, strict=True):
            row[: one.volts.size] = one.volts
        _write(file, "pulse_volts", ("pulse", "pulse_sample"), volts, "V", _VOLTS)
        sizes = np.array([one.volts.size for one in pulses], np.int32)
        _write(file, "pulse_sample_count", ("pulse",), sizes, "1", "break points of a pulse")
        for name, unit, words in (
            ("sample_rate_hz", "Hz", "break points per second"),
            ("start_s", "s", "first break point after the trigger"),
        ):
            numbers = np.array([getattr(one, name) for one in pulses])
            _write(file, f"pulse_{name}", ("pulse",), numbers, unit, words)
        kinds = np.array([INTERPOLATIONS.index(one.interpolation) for one in pulses], np.int8)
        _write(file, "pulse_interpolation", ("pulse",), kinds, "", "between break points")
        kind = file["pulse_interpolation"].attrs
        kind["flag_values"] = np.arange(len(INTERPOLATIONS), dtype=np.int8)
        kind["flag_meanings"] = " ".join(INTERPOLATIONS)
        self._write_poles(file, pulses)

    def _write_poles(self, file: Any, pulses: list[SampledPulse]) -> None:
        most = self._most_poles
        if not most:
            return
        file.dimensions["pulse_pole"] = most
        poles = np.full((2, len(pulses), most), NO_FLOAT)
        for place, one in enumerate(pulses):
            poles[:, place, : len(one.poles)] = np.real(one.poles), np.imag(one.poles)
        for part, name in zip(poles, ("real", "imaginary"), strict=True):
            words = f"{_POLES}, {name} part"
            _write(file, f"pulse_pole_{name}", ("pulse", "pulse_pole"), part, "rad s-1", words)


def _write(
    file: Any, name: str, dimensions: tuple[str, ...], data: NDArray[Any], unit: str, words: str
) -> None:
    fill = NO_FLOAT if data.dtype.kind == "f" and data.ndim == 2 else None
    made = file.create_variable(name, dimensions, data=data, fillvalue=fill)
    made.attrs["long_name"] = words
    if unit:
        made.attrs["units"] = unit
