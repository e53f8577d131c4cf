"""The arbitrary waveforms of an AFG: an edit memory per channel, and copies of it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from sim.devices.scpi.numeric import read_number
from sim.devices.scpi.parameters import read_block, read_integer
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call, HeaderTree

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel
    from sim.devices.scpi.parameters import Report
    from sim.devices.scpi.parser import Token

_NAME = re.compile(r"(EMEM|EMEMORY|USER)([1-4]?)")
_FIRST_POINTS = 1000


def memory_name(token: Token, channel: int = 1) -> str:
    """Return the waveform that a word means, empty for none; ``EMEM`` is that of `channel`."""
    found = _NAME.fullmatch(token.text.upper()) if token.kind == "character" else None
    if found is None:
        return ""
    return f"USER{found[2] or 1}" if found[1] == "USER" else f"EMEM{found[2] or channel}"


def _edited(token: Token) -> str:
    name = memory_name(token)
    if not name.startswith("EMEM"):
        raise ScpiError(-224, token.text)
    return name


class EditMemory:
    """Waveforms by name, as codes from -8191 to 8191.

    Parameters
    ----------
    model : GeneratorModel
        Gives the length limits and the span of the codes.
    """

    def __init__(self, model: GeneratorModel) -> None:
        self._model = model
        first = np.zeros(_FIRST_POINTS, dtype=np.int16)
        self._held = {f"EMEM{number}": first for number in range(1, model.channels + 1)}

    @property
    def names(self) -> tuple[str, ...]:
        """All waveforms."""
        return tuple(self._held)

    def codes(self, name: str) -> NDArray[np.int16]:
        """Return a waveform.

        Raises
        ------
        ScpiError
            -224 when there is none of that name.
        """
        if name not in self._held:
            raise ScpiError(-224, f"{name} is empty")
        return self._held[name]

    def define(self, name: str, points: int) -> None:
        """Make a waveform of zeros."""
        self.codes(name)
        self._held[name] = np.zeros(points, dtype=np.int16)

    def resize(self, name: str, points: int) -> None:
        """Cut a waveform, or add zeros."""
        codes = self.codes(name)[:points]
        self._held[name] = np.pad(codes, (0, points - codes.size))

    def store(self, name: str, words: NDArray[np.float64], report: Report) -> None:
        """Keep uploaded words, 8191 for zero; words above 16382 become that, and -222 is reported."""
        self.codes(name)
        if not self._model.min_points <= words.size <= self._model.max_points:
            raise ScpiError(-222, f"{self._model.min_points} to {self._model.max_points} points")
        full = self._model.full_code
        if np.max(words) > 2 * full or np.min(words) < 0:
            report(ScpiError(-222, "arb values clipped"))
        self._held[name] = (np.rint(np.clip(words, 0, 2 * full)) - full).astype(np.int16)

    def set_point(self, name: str, place: int, word: float, report: Report) -> None:
        """Change the point that is the `place`-th, counted from 1."""
        words = self.words(name).astype(np.float64)
        words[place - 1] = word
        self.store(name, words, report)

    def words(self, name: str) -> NDArray[np.int32]:
        """Return a waveform as it is uploaded."""
        return self.codes(name).astype(np.int32) + self._model.full_code

    def copy(self, name: str, source: str) -> None:
        """Copy a waveform."""
        if name.startswith("EMEM"):
            self.codes(name)
        self._held[name] = self.codes(source)

    def delete(self, name: str) -> None:
        """Forget a copy."""
        self.codes(name)
        del self._held[name]

    @property
    def span(self) -> tuple[int, int]:
        """Fewest and most points."""
        return self._model.min_points, self._model.max_points


def add_memory_commands(
    tree: HeaderTree, memory: EditMemory, report: Report, selected: Callable[[], list[str]]
) -> None:
    """Add upload and what is asked about waveforms, under both of their names.

    Parameters
    ----------
    tree : HeaderTree
        Where to.
    memory : EditMemory
        Of all channels.
    report : callable
        Takes an error that does not stop a command.
    selected : callable
        Names of what the channels play.
    """

    def points_of(call: Call) -> int:
        return read_integer(call.parameters[1], *memory.span) if len(call.parameters) > 1 else _FIRST_POINTS

    def store(call: Call) -> None:
        block = read_block(call.parameters[1])
        if len(block) % 2:
            raise ScpiError(-161, "a point is two bytes")
        memory.store(_edited(call.parameters[0]), np.frombuffer(block, ">u2").astype(np.float64), report)

    def stored(call: Call) -> str:
        data = memory.words(_known(call)).astype(">u2").tobytes()
        length = str(len(data))
        return f"#{len(length)}{length}" + data.decode("latin-1")

    def place_of(call: Call) -> int:
        return read_integer(call.parameters[1], 1, memory.codes(_known(call)).size)

    def set_point(call: Call) -> None:
        name, word = _edited(call.parameters[0]), read_number(call.parameters[2]).value
        memory.set_point(name, place_of(call), word, report)

    def copy(call: Call) -> None:
        source = memory_name(call.parameters[1]) if len(call.parameters) > 1 else "EMEM1"
        memory.copy(_known(call), source or call.parameters[1].text)

    def delete(call: Call) -> None:
        name = _known(call)
        if name.startswith("EMEM") or name in selected():
            raise ScpiError(-224, "an edit memory stays, and so does what is played")
        memory.delete(name)

    for data in ("DATA", "TRACe"):
        tree.add(
            f"{data}:DEFine",
            Action(lambda call: memory.define(_edited(call.parameters[0]), points_of(call)), 1, 2),
        )
        tree.add(f"{data}[:DATA]", Action(store, 2, 2), Action(stored, 1, 1))
        value = Action(lambda call: str(memory.words(_known(call))[place_of(call) - 1]), 2, 2)
        tree.add(f"{data}[:DATA]:VALue", Action(set_point, 3, 3), value)
        tree.add(
            f"{data}:POINts",
            Action(lambda call: memory.resize(_edited(call.parameters[0]), points_of(call)), 1, 2),
            Action(lambda call: str(memory.codes(_known(call)).size), 1, 1),
        )
        tree.add(f"{data}:COPY", Action(copy, 1, 2))
        tree.add(f"{data}:DELete[:NAME]", Action(delete, 1, 1))
        names = Action(lambda call: ",".join(f'"{name}"' for name in memory.names))
        tree.add(f"{data}:CATalog", query=names)


def _known(call: Call) -> str:
    name = memory_name(call.parameters[0])
    if not name:
        raise ScpiError(-224, call.parameters[0].text)
    return name
