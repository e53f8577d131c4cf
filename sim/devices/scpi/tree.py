"""The tree of command headers: long and short forms, optional nodes, numeric suffixes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from sim.devices.scpi.parser import Token
from sim.devices.scpi.status import ScpiError

_PATTERN_NODE = re.compile(r"(\[)?:?([A-Za-z][A-Za-z0-9_]*)(#)?:?\]?")
_HEADER = re.compile(r"(:?)([A-Z][A-Z0-9_]*(?::[A-Z][A-Z0-9_]*)*)(\??)")
_COMMON = re.compile(r"(\*[A-Z]+)(\??)")
_LONGEST_MNEMONIC = 12


class Call(NamedTuple):
    """What a handler is given: the numeric suffixes of its pattern's ``#`` nodes, and the parameters."""

    suffixes: tuple[int, ...]
    parameters: tuple[Token, ...]


Handler = Callable[[Call], str | None]


class Action(NamedTuple):
    """A handler and how many parameters it takes; after one that ends its message no query may follow."""

    run: Handler
    least: int = 0
    most: int = 0
    ends_message: bool = False


@dataclass(slots=True, eq=False)
class Node:
    """One place in the tree."""

    children: dict[str, Node] = field(default_factory=dict)
    largest_suffix: int = 1
    command: Action | None = None
    query: Action | None = None
    # For each suffix that the handlers expect: where in the path it stands, None when it was left out.
    suffix_places: tuple[int | None, ...] = ()


class Branch(NamedTuple):
    """Where in the tree the last header stood, with the suffixes on the way."""

    node: Node
    suffixes: tuple[int, ...]


class Found(NamedTuple):
    """The handler of a header, its suffixes, and the branch that the next header starts from."""

    action: Action
    suffixes: tuple[int, ...]
    is_query: bool
    branch: Branch


def forms(name: str) -> tuple[str, str]:
    """Short and long form of a mnemonic written like ``FREQuency``."""
    return "".join(itertools.takewhile(lambda letter: not letter.islower(), name)), name.upper()


def patterns_of(pattern: str, largest_suffix: int) -> list[tuple[str, tuple[int, ...]]]:
    """Return the short header of a pattern with each numeric suffix, beside what its handler is given.

    All ``#`` of a pattern get the same number.
    """
    nodes = _PATTERN_NODE.findall(pattern)
    numbers = range(1, largest_suffix + 1) if "#" in pattern else (1,)
    return [
        (
            ":".join(forms(name)[0] + (str(number) if mark else "") for _, name, mark in nodes),
            tuple(number for _, _, mark in nodes if mark),
        )
        for number in numbers
    ]


def header_of(pattern: str, suffixes: tuple[int, ...], full: bool) -> str:
    """Return the header of a pattern with the numbers of its ``#``, in short or in full."""
    numbers = iter(suffixes)
    return ":".join(
        forms(name)[full] + (str(next(numbers)) if mark else "")
        for _, name, mark in _PATTERN_NODE.findall(pattern)
    )


class HeaderTree:
    """Finds the handler of a header.

    Parameters
    ----------
    largest_suffix : int
        Largest number allowed where a pattern has ``#``; elsewhere only 1 is.
    """

    def __init__(self, largest_suffix: int = 1) -> None:
        self.largest_suffix = largest_suffix
        self.actions: dict[str, tuple[Action | None, Action | None]] = {}
        self._common: dict[str, Node] = {}
        self.root = Branch(Node(), ())
        self.find = lru_cache(maxsize=2048)(self._search)

    def add(self, pattern: str, command: Action | None = None, query: Action | None = None) -> None:
        """Enter a header.

        Parameters
        ----------
        pattern : str
            ``*NAME``, or nodes such as ``[SOURce#:]BURSt[:STATe]``: capitals are the short form, brackets
            make a node optional, ``#`` allows a numeric suffix.
        command, query : Action, optional
            What runs without and with a question mark.
        """
        self.actions[pattern] = command, query
        if pattern.startswith("*"):
            self.find.cache_clear()
            self._common[pattern] = Node(command=command, query=query)
            return
        nodes = _PATTERN_NODE.findall(pattern)
        ways = itertools.product(*((True, False) if optional else (True,) for optional, _, _ in nodes))
        for present in ways:
            node, depth = self.root.node, 0
            places: list[int | None] = []
            for here, (_, name, numbered) in zip(present, nodes, strict=True):
                if numbered:
                    places.append(depth if here else None)
                if here:
                    node, depth = self._below(node, name, bool(numbered)), depth + 1
            node.command, node.query, node.suffix_places = command, query, tuple(places)
        self.find.cache_clear()

    def _below(self, node: Node, name: str, numbered: bool) -> Node:
        short, full = forms(name)
        child = node.children.setdefault(full, Node())
        node.children[short] = child
        if numbered:
            child.largest_suffix = self.largest_suffix
        return child

    def _search(self, header: str, branch: Branch) -> Found:
        """Find a header as it was sent, seen from a branch; ``;:`` and common headers do not depend on it.

        Raises
        ------
        ScpiError
            -101 or -102 for what is no header, -112, -113, -114.
        """
        upper = header.upper() if header.isascii() else ""
        common = _COMMON.fullmatch(upper)
        suffixes: tuple[int, ...] = ()
        if common:
            node, query = self._common.get(common[1], Node()), common[2]
        else:
            node, suffixes, branch, query = self._walk(header, upper, branch)
        action = node.query if query else node.command
        if action is None:
            raise ScpiError(-113, header)
        picked = tuple(1 if place is None else suffixes[place] for place in node.suffix_places)
        return Found(action, picked, bool(query), branch)

    def _walk(self, header: str, upper: str, branch: Branch) -> tuple[Node, tuple[int, ...], Branch, str]:
        parts = _HEADER.fullmatch(upper)
        if parts is None:
            raise ScpiError(-102 if header.isascii() and header.isprintable() else -101)
        node, suffixes = self.root if parts[1] else branch
        above = branch
        for mnemonic in parts[2].split(":"):
            above = Branch(node, suffixes)
            node, number = _child(node, mnemonic)
            suffixes = (*suffixes, number)
        return node, suffixes, above, parts[3]


def _child(node: Node, mnemonic: str) -> tuple[Node, int]:
    child, number = node.children.get(mnemonic), 1
    if child is None:
        name = mnemonic.rstrip("0123456789")
        if len(name) > _LONGEST_MNEMONIC:
            raise ScpiError(-112, name)
        if name != mnemonic:
            child, number = node.children.get(name), int(mnemonic[len(name) :][:9])
    if child is None:
        raise ScpiError(-113, mnemonic)
    if not 1 <= number <= child.largest_suffix:
        raise ScpiError(-114, mnemonic)
    return child, number
