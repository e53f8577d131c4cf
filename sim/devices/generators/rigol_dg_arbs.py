"""The volatile waveform of a channel of a DG1000Z: uploads, and how it is read back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.devices.generator_commands import ChannelCommands, Tokens
from sim.devices.scpi.numeric import read_number
from sim.devices.scpi.parameters import read_integer, read_name
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel
    from sim.devices.generators.rigol_dg import DgChannel
    from sim.devices.scpi.parser import Token

ZERO_CODE = 8192  # as in the public guide's example; that 0 V is no half step beside it is assumed
_TOP_CODE = 16383
_PACKAGE_BYTES = 16384  # "#9000016384" in the public guide


class Volatile:
    """Points about zero, and what was sent of the next waveform.

    Parameters
    ----------
    model : GeneratorModel
        Gives the length limits and the span of the codes.
    """

    period_points = 8192
    """Points of a waveform in frequency mode."""

    def __init__(self, model: GeneratorModel) -> None:
        self._model = model
        # The shape is assumed: ten lobes.
        lobes = np.sinc(np.linspace(-5, 5, self.period_points))
        self.codes: NDArray[np.int16] = np.rint(lobes * model.full_code).astype(np.int16)
        self.was_uploaded = False
        self.part: list[NDArray[np.int16]] = []

    def hold(self, points: NDArray[np.int16], extended: bool) -> None:
        """Keep a waveform; `extended` makes `period_points` of fewer, by straight lines (assumed)."""
        if extended and points.size < self.period_points:
            places = np.linspace(0, points.size - 1, self.period_points)
            points = np.rint(np.interp(places, np.arange(points.size), points)).astype(np.int16)
        self.codes, self.was_uploaded, self.part = points, True, []

    def centred(self, codes: NDArray[np.float64]) -> NDArray[np.int16]:
        """Return codes of 0 to 16383 as codes about zero.

        Raises
        ------
        ScpiError
            -222 for a number of points or a code that is not allowed.
        """
        least, most = self._model.min_points, self._model.max_points
        if not least <= codes.size <= most:
            raise ScpiError(-222, f"{least} to {most} points")
        if not np.all((codes >= 0) & (codes <= _TOP_CODE)):
            raise ScpiError(-222, "codes are 0 to 16383")
        full = self._model.full_code
        centred: NDArray[np.int16] = np.clip(np.rint(codes) - ZERO_CODE, -full, full).astype(np.int16)
        return centred

    def packages(self) -> list[bytes]:
        """Codes as they are read back, least significant byte first.

        Raises
        ------
        ScpiError
            -224 when no waveform was uploaded.
        """
        if not self.was_uploaded:
            raise ScpiError(-224, "the output is no volatile waveform")
        data = (self.codes.astype(np.int32) + ZERO_CODE).astype("<u2").tobytes()
        return [data[start : start + _PACKAGE_BYTES] for start in range(0, len(data), _PACKAGE_BYTES)]


def add_volatile_commands(commands: ChannelCommands[DgChannel], most_points: int) -> None:
    """Add uploads and how they are read back."""
    data = "[SOURce#:][TRACe:]DATA"
    takes = (2, most_points + 1)
    commands.add(f"{data}[:DATA]", _upload_relative, takes=takes)
    commands.add(f"{data}:DAC", _upload_codes, takes=takes)
    commands.add(f"{data}:DAC16", _upload_part, takes=(3, 3))
    commands.add(f"{data}:LOAD", query=_loaded, asks=1)
    commands.add(f"{data}:POINts", query=lambda channel, _: str(channel.arb_codes.size), asks=2)
    commands.add(f"{data}:VALue", query=_value, asks=2)
    commands.add(f"{data}:CATalog", query=lambda channel, _: ",".join(['""'] * 10))


def _check_name(token: Token) -> None:
    if read_name(token).upper() != "VOLATILE":
        raise ScpiError(-224, "VOLATILE is the only waveform that can be edited")


def _upload_relative(channel: DgChannel, tokens: Tokens) -> None:
    _check_name(tokens[0])
    relative = np.array([read_number(token).value for token in tokens[1:]])
    if not np.all(np.abs(relative) <= 1):
        raise ScpiError(-222, "points are -1 to 1")
    channel.take(channel.volatile.centred(relative * channel.full_code + ZERO_CODE))


def _block(token: Token) -> NDArray[np.float64]:
    if token.kind != "block":
        raise ScpiError(-104)
    if len(token.block) % 2:
        raise ScpiError(-161, "each point has two bytes")
    return np.frombuffer(token.block, "<u2").astype(np.float64)


def _upload_codes(channel: DgChannel, tokens: Tokens) -> None:
    _check_name(tokens[0])
    if tokens[1].kind == "block" and len(tokens) == 2:
        codes = _block(tokens[1])
    else:
        codes = np.array([read_number(token).value for token in tokens[1:]])
    channel.take(channel.volatile.centred(codes))


def _upload_part(channel: DgChannel, tokens: Tokens) -> None:
    """Take a package; the last one, END, makes a waveform that is played by its sample rate."""
    _check_name(tokens[0])
    flag = read_name(tokens[1]).upper()
    if flag not in ("CON", "END"):
        raise ScpiError(-224, flag)
    channel.volatile.part.append(channel.volatile.centred(_block(tokens[2])))
    if flag == "END":
        channel.take(np.concatenate(channel.volatile.part), keeps_mode=False)


def _loaded(channel: DgChannel, tokens: Tokens) -> str:
    packages = channel.volatile.packages()
    if not tokens:
        raise ScpiError(-109)
    if tokens[0].kind == "character":
        _check_name(tokens[0])
        return str(len(packages))
    package = packages[read_integer(tokens[0], 1, len(packages)) - 1]
    return f"#9{len(package):09d}" + package.decode("latin-1")


def _value(channel: DgChannel, tokens: Tokens) -> str:
    if len(tokens) != 2:
        raise ScpiError(-109)
    _check_name(tokens[0])
    codes = channel.arb_codes
    return str(int(codes[read_integer(tokens[1], 1, codes.size) - 1]) + ZERO_CODE)
