"""The volatile memory of arbitrary waveforms of one generator channel."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

from belahil.generators import FULL_CODE, GeneratorModel, dac_codes
from sim.devices.scpi.numeric import read_number
from sim.devices.scpi.parameters import Report
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.devices.scpi.parser import Token

# A point in memory; the converter may have fewer (assumed: attributes are those of the memory).
MEMORY_BITS = 16
BUILT_IN = r"INT:\BUILTIN\EXP_RISE.ARB"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,11}")

# Device-specific errors; 781, 785 and 800 as in the vendor's older manuals, 783 assumed.
_TEXTS = {
    781: "Not enough memory to store new arb waveform",
    783: "Arb waveform name already exists or is not allowed",
    785: "Specified arb waveform does not exist",
    800: "Block length must be even",
}


def _problem(code: int) -> ScpiError:
    return ScpiError(code, _TEXTS[code])


class ArbMemory:
    """Named waveforms as DAC codes, and one built-in waveform that is always there.

    Parameters
    ----------
    model : GeneratorModel
        Gives the length limits.
    """

    def __init__(self, model: GeneratorModel) -> None:
        self._model = model
        # The shape is assumed: one time constant per fifth of 200 points.
        rise = 1 - np.exp(-np.arange(200) / 40)
        self._built_in = dac_codes(2 * rise / rise[-1] - 1, MEMORY_BITS)
        self._volatile: dict[str, NDArray[np.int16]] = {}

    def clear(self) -> None:
        """Forget all waveforms but the built-in one."""
        self._volatile.clear()

    def codes(self, name: str) -> NDArray[np.int16]:
        """Return a waveform.

        Raises
        ------
        ScpiError
            +785 when there is none of that name.
        """
        if name == BUILT_IN:
            return self._built_in
        if name not in self._volatile:
            raise _problem(785)
        return self._volatile[name]

    def catalog(self) -> str:
        """Quoted names of all waveforms."""
        return ",".join(f'"{name}"' for name in (BUILT_IN, *self._volatile))

    def free_points(self) -> int:
        """Points that still fit."""
        return self._model.max_points - sum(codes.size for codes in self._volatile.values())

    def store(self, name: str, relative: NDArray[np.float64], report: Report) -> None:
        """Keep a waveform; the plant rounds it to the grid of the DAC when it is played.

        Parameters
        ----------
        name : str
            A letter, then up to 11 letters, digits and underscores; case does not count.
        relative : ndarray of float64, shape (n,)
            -1 to 1; what lies outside becomes the limit, and -222 is reported.
        report : callable
            Takes that error.
        """
        name = name.upper()
        if name in self._volatile or not _NAME.fullmatch(name):
            raise _problem(783)
        if relative.size < self._model.min_points:
            raise ScpiError(-222, f"an arb has at least {self._model.min_points} points")
        if relative.size > self.free_points():
            raise _problem(781)
        if np.any(np.isnan(relative)):
            raise ScpiError(-230)
        if np.max(np.abs(relative)) > 1:
            report(ScpiError(-222, "arb values clipped"))
        self._volatile[name] = dac_codes(np.clip(relative, -1, 1), MEMORY_BITS)


def read_points(tokens: tuple[Token, ...], dac: bool, swapped: bool) -> NDArray[np.float64]:
    """Read the points of a waveform as fractions of full scale.

    Parameters
    ----------
    tokens : tuple of Token
        One block of int16 (`dac`) or float32, or numbers.
    dac : bool
        Whether full scale is 32767 instead of 1.
    swapped : bool
        Whether the block has its least significant byte first (``FORM:BORD SWAP``).

    Returns
    -------
    ndarray of float64, shape (n,)
        Nominally -1 to 1.
    """
    if len(tokens) == 1 and tokens[0].kind == "block":
        block, size = tokens[0].block, 2 if dac else 4
        if len(block) % size:
            raise _problem(800) if dac else ScpiError(-161, "float32 takes 4 bytes")
        kind = ("<" if swapped else ">") + ("i2" if dac else "f4")
        with np.errstate(invalid="ignore"):  # a signalling NaN; `store` refuses it
            points = np.frombuffer(block, kind).astype(np.float64)
    else:
        points = np.array([read_number(token).value for token in tokens])
        points = np.rint(points) if dac else points
    return points / FULL_CODE if dac else points


def average(codes: NDArray[np.int16]) -> float:
    """Mean in fractions of full scale: the sum of the codes over 32767 times their number."""
    return int(codes.sum(dtype=np.int64)) / (FULL_CODE * codes.size)


def peak_to_peak(codes: NDArray[np.int16]) -> float:
    """Largest code less smallest code, divided by 32767; 2 for a waveform that fills the converter."""
    return (int(codes.max()) - int(codes.min())) / FULL_CODE


def crest_factor(codes: NDArray[np.int16]) -> float:
    """Largest magnitude divided by the root mean square; not a number for a waveform of zeros."""
    wide = codes.astype(np.int64)
    squares = int(np.sum(wide * wide))
    return int(np.max(np.abs(wide))) / math.sqrt(squares / codes.size) if squares else math.nan
