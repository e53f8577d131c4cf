"""The arbitrary waveforms of a 33220A: one that is uploaded, copies of it, and built-in ones."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sim.devices.generator_commands import ChannelCommands, Tokens
from sim.devices.scpi.numeric import answer_number, read_number
from sim.devices.scpi.parameters import Report, read_name
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel
    from sim.devices.generators.agilent_33220 import UserChannel
    from sim.devices.scpi.parser import Token

EXP_RISE, VOLATILE = "EXP_RISE", "VOLATILE"
_COPIES = 4
_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,11}")
# Device-specific errors, as in the vendor's older manuals; 786 to 788 assumed.
_TEXTS = {
    781: "Not enough memory to store new arb waveform; use DATA:DELETE",
    783: "Arb waveform name too long",
    785: "Specified arb waveform does not exist",
    786: "Cannot delete a built-in arb waveform",
    787: "Cannot delete the currently selected active arb waveform",
    788: "Cannot copy to VOLATILE arb waveform",
    800: "Block length must be even",
}


def _problem(code: int) -> ScpiError:
    return ScpiError(code, _TEXTS[code])


class UserMemory:
    """Waveforms by name, as codes.

    Parameters
    ----------
    model : GeneratorModel
        Gives the length limits and the span of the codes.
    """

    def __init__(self, model: GeneratorModel) -> None:
        self._model = model
        # The shapes are assumed: one time constant per fifth of 200 points, ten lobes of a sinc.
        rise = 1 - np.exp(-np.arange(200) / 40)
        sinc = np.sinc(np.linspace(-5, 5, 200))
        shapes = {
            EXP_RISE: 2 * rise / rise[-1] - 1,
            "EXP_FALL": 1 - 2 * rise / rise[-1],
            "NEG_RAMP": np.linspace(1, -1, 200),
            "SINC": sinc,
        }
        self._built_in = {name: self._coded(shape) for name, shape in shapes.items()}
        self._copies: dict[str, NDArray[np.int16]] = {}
        self._volatile: NDArray[np.int16] | None = None

    def _coded(self, relative: NDArray[np.float64]) -> NDArray[np.int16]:
        return np.rint(relative * self._model.full_code).astype(np.int16)

    def _held(self) -> dict[str, NDArray[np.int16]]:
        volatile = {} if self._volatile is None else {VOLATILE: self._volatile}
        return volatile | self._built_in | self._copies

    def codes(self, name: str) -> NDArray[np.int16]:
        """Return a waveform.

        Raises
        ------
        ScpiError
            +785 when there is none of that name.
        """
        if name not in self._held():
            raise _problem(785)
        return self._held()[name]

    def catalog(self) -> str:
        """Quoted names of all waveforms."""
        return ",".join(f'"{name}"' for name in self._held())

    def stored(self) -> str:
        """Quoted names of the copies, an empty one when there are none."""
        return ",".join(f'"{name}"' for name in self._copies) or '""'

    def free(self) -> int:
        """Copies that still fit."""
        return _COPIES - len(self._copies)

    def store(self, codes: NDArray[np.float64], report: Report) -> None:
        """Keep an uploaded waveform; codes outside of the span become its ends, and -222 is reported."""
        if not self._model.min_points <= codes.size <= self._model.max_points:
            raise ScpiError(-222, f"{self._model.min_points} to {self._model.max_points} points")
        if np.any(np.isnan(codes)):
            raise ScpiError(-230)
        full = self._model.full_code
        if np.max(np.abs(codes)) > full:
            report(ScpiError(-222, "arb values clipped"))
        self._volatile = np.rint(np.clip(codes, -full, full)).astype(np.int16)

    def copy(self, name: str) -> None:
        """Keep the uploaded waveform under a name."""
        if name == VOLATILE:
            raise _problem(788)
        if not _NAME.fullmatch(name) or name in self._built_in:
            raise _problem(783)
        if name not in self._copies and not self.free():
            raise _problem(781)
        self._copies[name] = self.codes(VOLATILE)

    def delete(self, name: str, selected: str) -> None:
        """Forget a waveform that is not `selected`."""
        self.codes(name)
        if name in self._built_in:
            raise _problem(786)
        if name == selected:
            raise _problem(787)
        if name == VOLATILE:
            self._volatile = None
        else:
            del self._copies[name]


class _Attribute(Protocol):
    def __call__(self, codes: NDArray[np.int16], full_code: int) -> str:
        """Write it."""
        ...


def _average(codes: NDArray[np.int16], full_code: int) -> str:
    return answer_number(int(codes.sum(dtype=np.int64)) / (full_code * codes.size))


def _peak(codes: NDArray[np.int16], full_code: int) -> str:
    """Largest magnitude in fractions of full scale: +1 says that all of the amplitude is there (assumed)."""
    return answer_number(int(np.max(np.abs(codes.astype(np.int32)))) / full_code)


def _crest(codes: NDArray[np.int16], full_code: int) -> str:
    wide = codes.astype(np.float64)
    power = float(np.mean(wide * wide))
    return answer_number(float(np.max(np.abs(wide))) / power**0.5 if power else float("nan"))


_ATTRIBUTES: dict[str, _Attribute] = {
    "AVERage": _average,
    "CFACtor": _crest,
    "POINts": lambda codes, full_code: f"{codes.size:+d}",
    "PTPeak": _peak,
}


def add_user_commands(
    commands: ChannelCommands[UserChannel], most_points: int, swapped: Callable[[], bool]
) -> None:
    """Add upload, copies, catalog and attributes; `swapped` tells whether low bytes come first."""

    def upload(dac: bool) -> Callable[[UserChannel, Tokens], None]:
        def store(channel: UserChannel, tokens: Tokens) -> None:
            if read_name(tokens[0]).upper() != VOLATILE:
                raise ScpiError(-224, "VOLATILE is the only waveform that can be uploaded")
            points = _read(tokens[1:], swapped(), blocks=dac)
            channel.memory.store(points if dac else points * channel.full_code, channel.report)

        return store

    takes = (2, most_points + 1)
    source = "[SOURce#:]"
    commands.add(f"{source}DATA", upload(dac=False), takes=takes)
    commands.add(f"{source}DATA:DAC", upload(dac=True), takes=takes)
    commands.add(f"{source}DATA:COPY", _copy, takes=(1, 2))
    commands.add(f"{source}DATA:DELete[:NAME]", _delete)
    commands.add(f"{source}DATA:CATalog", query=lambda channel, _: channel.memory.catalog())
    commands.add(f"{source}DATA:NVOLatile:CATalog", query=lambda channel, _: channel.memory.stored())
    commands.add(f"{source}DATA:NVOLatile:FREE", query=lambda channel, _: f"{channel.memory.free():+d}")
    commands.add(f"{source}FUNCtion:USER", _select, lambda channel, _: channel.user_name)
    for name, attribute in _ATTRIBUTES.items():
        commands.add(f"{source}DATA:ATTRibute:{name}", query=_asked(attribute), asks=1)


def _read(tokens: tuple[Token, ...], swapped: bool, blocks: bool) -> NDArray[np.float64]:
    if blocks and len(tokens) == 1 and tokens[0].kind == "block":
        if len(tokens[0].block) % 2:
            raise _problem(800)
        return np.frombuffer(tokens[0].block, "<i2" if swapped else ">i2").astype(np.float64)
    return np.array([read_number(token).value for token in tokens])


def _select(channel: UserChannel, tokens: Tokens) -> None:
    name = read_name(tokens[0]).upper()
    channel.memory.codes(name)
    channel.user_name = name


def _copy(channel: UserChannel, tokens: Tokens) -> None:
    if len(tokens) == 2 and read_name(tokens[1]).upper() != VOLATILE:
        raise ScpiError(-224, "only VOLATILE can be copied")
    channel.memory.copy(read_name(tokens[0]).upper())


def _delete(channel: UserChannel, tokens: Tokens) -> None:
    channel.memory.delete(read_name(tokens[0]).upper(), channel.user_name)


def _asked(attribute: _Attribute) -> Callable[[UserChannel, Tokens], str]:
    """Return the query of one attribute, of the named waveform or the selected one."""

    def answer(channel: UserChannel, tokens: Tokens) -> str:
        name = read_name(tokens[0]).upper() if tokens else channel.user_name
        return attribute(channel.memory.codes(name), channel.full_code)

    return answer
