"""All settings as one message, which ``*LRN?`` answers; the places where ``*SAV`` keeps them for ``*RCL``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Call, patterns_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim.devices.scpi.tree import HeaderTree

EMPTY_PLACE = 810
"""State has not been stored: the number in the manual of the 33120A; assumed for the others."""


@dataclass(slots=True)
class Memory:
    """Places for settings.

    Parameters
    ----------
    places : tuple of int and int
        First and last; 0 to 4 on Keysight's generators, assumed for others.
    states : dict of int to object
        What was kept.
    """

    places: tuple[int, int] = (0, 4)
    states: dict[int, object] = field(default_factory=dict)

    def state(self, place: int) -> object:
        """Return what was kept.

        Raises
        ------
        ScpiError
            810 where nothing was.
        """
        if place not in self.states:
            raise ScpiError(EMPTY_PLACE, "State has not been stored")
        return self.states[place]


def learned(tree: HeaderTree, first: tuple[str, ...], without: frozenset[str]) -> str:
    """Write each setting as it is now behind its header, with ``*RST`` before all.

    Parameters
    ----------
    tree : HeaderTree
        A setting is a header that takes one parameter, and answers without any.
    first : tuple of str
        Patterns that come before the others, which have the order in which they were added.
    without : frozenset of str
        Patterns that are left out.
    """
    rest = [pattern for pattern in tree.actions if pattern not in first]
    units = ["*RST"]
    for pattern in (*first, *rest):
        if pattern not in without and pattern[0] != "*" and not pattern.startswith("STATus"):
            units += _settings(tree, pattern)
    return ";".join(units)


def _settings(tree: HeaderTree, pattern: str) -> Iterator[str]:
    command, query = tree.actions[pattern]
    if command is None or query is None or query.least or not command.least <= 1 <= command.most:
        return
    for header, suffixes in patterns_of(pattern, tree.largest_suffix):
        try:
            yield f":{header} {query.run(Call(suffixes, ()))}"
        except ScpiError:
            continue
