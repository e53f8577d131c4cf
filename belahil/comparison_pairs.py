"""The results of two runs, matched name by name: objects by key, rows of lists by what identifies them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    Statuses = tuple[str | None, str | None]

_MEASURED = {"value", "standard_uncertainty", "unit"}


@dataclass(frozen=True, slots=True)
class Pair:
    """One entry of two results.

    Parameters
    ----------
    name : str
        ``gain_codes[code=4].gain``.
    first, second : object
        A measured number as in ``summary.json``, a word, a whole number, or None.
    statuses : tuple of (str or None)
        The ``status`` nearest to it in either run.
    """

    name: str
    first: Any
    second: Any
    statuses: Statuses


def is_measured(told: Any) -> bool:
    """Tell whether an entry of results is a measured number."""
    return isinstance(told, dict) and told.keys() >= _MEASURED and _is_number(told["value"])


def pairs(first: Any, second: Any, name: str = "", statuses: Statuses = (None, None)) -> Iterator[Pair]:
    """Go through two results side by side.

    Parameters
    ----------
    first, second : object
        As in ``summary.json``, or None.
    name : str
        Of what is gone through.
    statuses : tuple of (str or None)
        Of what it is in.

    Yields
    ------
    Pair
        Measured numbers, words, whole numbers and truth values. Numbers with a fraction but without an
        uncertainty, and lists of plain values, are passed over: nothing says when they differ.

    Examples
    --------
    >>> [(pair.name, pair.first, pair.second) for pair in pairs({"best": 4}, {"best": 5})]
    [('best', 4, 5)]
    """
    both = (first, second)
    if any(map(is_measured, both)) or not any(isinstance(one, dict | list) for one in both):
        if not any(isinstance(one, float) for one in both):
            yield Pair(name, first, second, statuses)
    elif all(one is None or isinstance(one, dict) for one in both):
        yield from _of_tables(first or {}, second or {}, name, statuses)
    elif all(one is None or isinstance(one, list) for one in both):
        yield from _of_rows(first or [], second or [], name, statuses)


def _of_tables(
    first: dict[str, Any], second: dict[str, Any], name: str, statuses: Statuses
) -> Iterator[Pair]:
    inner = first.get("status", statuses[0]), second.get("status", statuses[1])
    for key in dict.fromkeys([*first, *second]):
        whole = f"{name}.{key}" if name else key
        yield from pairs(first.get(key), second.get(key), whole, inner)


def _of_rows(first: list[Any], second: list[Any], name: str, statuses: Statuses) -> Iterator[Pair]:
    if not all(isinstance(row, dict) for row in (*first, *second)):
        return
    keys = _identifying(first, second)
    ones, others = (
        {_label(place, row, keys): row for place, row in enumerate(rows)} for rows in (first, second)
    )
    for label in dict.fromkeys([*ones, *others]):
        one, other = ones.get(label), others.get(label)
        for pair in pairs(one, other, f"{name}[{label}]", statuses):
            # Of a row that is not there, it is enough to tell which measured numbers are missing.
            if None not in (one, other) or is_measured(pair.first) or is_measured(pair.second):
                yield pair


def _label(place: int, row: dict[str, Any], keys: tuple[str, ...] | None) -> str:
    if keys is None:
        return str(place)
    return ",".join(f"{key}={part}" for key, part in zip(keys, _identity(row, keys), strict=True))


def _identifying(first: list[dict[str, Any]], second: list[dict[str, Any]]) -> tuple[str, ...] | None:
    """Return the fewest leading keys with plain values that tell all rows of either list apart."""
    keys: list[str] = []
    for key in (first or second or [{}])[0]:
        if all(key in row and _is_plain(row[key]) for row in (*first, *second)):
            keys.append(key)
            if all(len({_identity(row, keys) for row in rows}) == len(rows) for rows in (first, second)):
                return tuple(keys)
    return None


def _identity(row: dict[str, Any], keys: list[str] | tuple[str, ...]) -> tuple[str, ...]:
    # Seven figures: a setting that generators round differently is the same setting.
    return tuple(f"{row[key]:.7g}" if isinstance(row[key], float) else str(row[key]) for key in keys)


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
