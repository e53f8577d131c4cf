"""Results as tables for a reader: one unit a column, uncertainties in parentheses."""

from __future__ import annotations

import itertools
import math
import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.uncertainty import prefix_power, prefixed, written

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

SUFFIXES = {
    "hz": "Hz",
    "v": "V",
    "m": "m",
    "deg": "deg",
    "v2": "V2",
    "vpp": "Vpp",
    "s": "s",
    "j": "J",
    "ppm": "ppm",
    "db": "dB",
    "ohm": "ohm",
}
MISSING = "\N{EN DASH}"


@dataclass(frozen=True, slots=True)
class Grid:
    """A table of texts.

    Parameters
    ----------
    title : str
        Its heading.
    columns : tuple of str
        Heading of each column, with its unit.
    rows : tuple of tuple of str
        One text a cell.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Span:
    """Both ends of an interval.

    Parameters
    ----------
    low, high : float
        In `unit`.
    unit : str
        SI unit, without a prefix.
    """

    low: float
    high: float
    unit: str

    @property
    def size(self) -> float:
        """Of the larger end."""
        return max(abs(self.low), abs(self.high))

    def text(self, power: int) -> str:
        """Write both ends over a power of ten, with three digits of what lies between.

        Examples
        --------
        >>> Span(19.0592e-9, 19.53e-9, "s").text(-9), Span(-0.2, 1.0, "1").text(0)
        ('19.059 to 19.530', '-0.20 to 1.00')
        """
        low, high = self.low / 10.0**power, self.high / 10.0**power
        if not (math.isfinite(low) and math.isfinite(high) and high > low):
            return f"{low:.4g} to {high:.4g}"
        places = min(max(2 - math.floor(math.log10(high - low)), 0), 9)
        return f"{low:.{places}f} to {high:.{places}f}"


def grids(results: dict[str, Any]) -> list[Grid]:
    """Lay out the results of any procedure: a table for each list of objects, one more for all the rest.

    A list of objects within an object is a table too, and so is one within the objects of a list: its first
    columns tell where a row belongs.

    Parameters
    ----------
    results : dict
        As in ``summary.json``.
    """
    flat = _flat(results)
    lists = {key: value for key, value in flat.items() if _is_table(value)}
    rest = tuple(_row(key, value) for key, value in _without(flat, lists).items())
    found = [Grid("Results", ("quantity", "value"), rest)] if rest else []
    for key, rows in lists.items():
        found += _tables(named(key), [_flat(row) for row in rows])
    return found


def named(key: str, value: Any = None) -> str:
    """Turn a key into words; a unit in it goes into parentheses, or away where `value` brings its own.

    Examples
    --------
    >>> named("best_code"), named("amplitude_vpp", 0.003)
    ('best code', 'amplitude (Vpp)')
    >>> named("skew_s", {"value": 1e-12, "standard_uncertainty": 1e-13, "unit": "s"})
    'skew'
    """
    front, _, last = key.rpartition("_")
    if not front or last not in SUFFIXES:
        return key.replace("_", " ")
    words = front.replace("_", " ")
    return words if value is None or _is_measured(value) else f"{words} ({SUFFIXES[last]})"


def one_text(value: Any) -> str:
    """Write one result with its unit.

    Examples
    --------
    >>> one_text({"value": -1e-15, "standard_uncertainty": 65e-12, "unit": "s"})
    '0(65) ps'
    >>> one_text({"value": 5.96e-9, "standard_uncertainty": 0.4e-9, "unit": "V2"})
    '0.00596(40) mV2'
    """
    if _is_measured(value):
        power = prefix_power(_size(value), value["unit"])
        return f"{_cell(value, power)} {unit_text(value['unit'], power)}".strip()
    return _cell(value, 0)


def counted(points: Mapping[str, int]) -> str:
    """Write how many windows have each status.

    Examples
    --------
    >>> counted({"ok": 25, "saturated": 11})
    '25 ok, 11 saturated'
    """
    return ", ".join(f"{count} {status}" for status, count in points.items())


def span_text(key: str, low: float, high: float) -> str:
    """Write the limits of a key of ``[limits]``, all their digits, in the unit that the key names.

    Examples
    --------
    >>> span_text("cutoff_hz", 18.0e6, 20.0e6), span_text("input_noise_rms_v", 0.0, 3e-4)
    ('18 to 20 MHz', '0 to 300 µV')
    >>> span_text("gain", 4.9, 5.5), span_text("gain", -math.inf, math.inf)
    ('4.9 to 5.5', 'whatever is measured')
    """
    if low == -math.inf and high == math.inf:
        return "whatever is measured"
    unit = SUFFIXES.get(key.rpartition("_")[2], "1")
    sizes = [abs(limit) for limit in (low, high) if math.isfinite(limit)]
    power = prefix_power(max(sizes, default=0.0), unit)
    ends = (f"{limit / 10.0**power:.12g}" for limit in (low, high))
    return f"{' to '.join(ends)} {unit_text(unit, power)}".strip()


def unit_text(unit: str, power: int) -> str:
    """Write a unit with the prefix for a power of ten; a dimensionless one is empty, 1e-6 is ppm."""
    plain = {"1": "", "1e-6": "ppm"}
    return plain[unit] if unit in plain else prefixed(unit, power)


def _is_table(value: Any) -> bool:
    objects = isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)
    return objects and not all(_is_measured(row) for row in value)


def _is_measured(value: Any) -> bool:
    return isinstance(value, dict) and value.keys() >= {"value", "standard_uncertainty", "unit"}


def _size(measured: dict[str, Any]) -> float:
    """Size by which a measured number gets its prefix: one that may be zero has that of its uncertainty."""
    value, spread = abs(measured["value"]), measured["standard_uncertainty"]
    return float(max(value, spread) if math.isfinite(spread) else value)


def _flat(row: dict[str, Any], before: str = "") -> dict[str, Any]:
    cells: dict[str, Any] = {}
    for key, value in row.items():
        name = f"{before}{key}"
        span = _span(row, key)
        if span is not None:
            covered = value.get("coverage") if isinstance(value, dict) else None
            cells[name if covered is None else f"{name} at {100 * covered:g} %"] = span
        elif key.endswith("_unit") and _span(row, key.removesuffix("_unit")):
            continue
        elif isinstance(value, dict) and not _is_measured(value):
            cells |= _flat(value, f"{name} ")
        else:
            cells[name] = value
    return cells


def _span(row: dict[str, Any], key: str) -> Span | None:
    """Return the interval that a row has under a key, where a unit is told or is that of the number it is of.

    ``delay_interval`` is of ``delay``, and ``interval`` of ``measured``.
    """
    ends: Any = row.get(key)
    if isinstance(ends, dict):
        ends = [ends.get("low"), ends.get("high")]
    if not isinstance(ends, list) or [type(end) for end in ends] != [float, float]:
        return None
    unit = row.get(f"{key}_unit")
    if unit is None and key.endswith("interval"):
        of: Any = row.get(key.removesuffix("interval").rstrip("_") or "measured")
        unit = of["unit"] if _is_measured(of) else None
    return None if unit is None else Span(ends[0], ends[1], unit)


def _without(row: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in names}


def _tables(title: str, rows: list[dict[str, Any]], carried: int = 0) -> list[Grid]:
    """Lay out flat rows, then the objects in their cells; the first `carried` columns are of rows above."""
    within = dict.fromkeys(name for row in rows for name, value in row.items() if _is_table(value))
    found = [_grid(title, [_without(row, within) for row in rows])]
    for name in within:
        found += _tables(f"{title}, {named(name)}", _inner(rows, name, within, carried), carried + 1)
    return found


def _inner(
    rows: list[dict[str, Any]], name: str, within: Iterable[str], carried: int
) -> list[dict[str, Any]]:
    """Lay out the objects in one cell of each row as rows that begin with what their own row begins with."""
    found = []
    for row in rows:
        first = dict(itertools.islice(_without(row, within).items(), carried + 1))
        found += [first | _flat(one) for one in row.get(name) or ()]
    return found


def _grid(title: str, rows: list[dict[str, Any]]) -> Grid:
    keys = list(dict.fromkeys(key for row in rows for key in row))
    # Where an object is null its parts are missing, and have their dashes.
    null = {key for key in keys if all(row.get(key) is None for row in rows)}
    keys = [key for key in keys if key not in null or not any(one.startswith(f"{key} ") for one in keys)]
    rows = [row | {key: _apart(row.get(key), rows, key) for key in keys} for row in rows]
    powers: dict[str, int] = {}
    headings = []
    for key in keys:
        filled = [row[key] for row in rows if row.get(key) is not None]
        measured = [cell for cell in filled if _is_measured(cell)]
        spans = [cell for cell in filled if isinstance(cell, Span)]
        unit = measured[0]["unit"] if measured else spans[0].unit if spans else _plain_unit(key)
        sizes = [_size(cell) for cell in measured] + [cell.size for cell in spans]
        # A zero among plain numbers, such as no noise, says nothing of the size of the others.
        if all(isinstance(cell, float) for cell in filled):
            sizes = [abs(cell) for cell in filled if cell]
        powers[key] = prefix_power(statistics.median_high(sizes), unit) if sizes else 0
        shown = unit_text(unit, powers[key])
        name = named(key) if shown else named(key, filled[0] if filled else None)
        headings.append(f"{name} ({shown})" if shown else name)
    cells = tuple(tuple(_cell(row.get(key), powers[key]) for key in keys) for row in rows)
    return Grid(title, tuple(headings), cells)


def _apart(cell: Any, rows: list[dict[str, Any]], key: str) -> Any:
    """Write a measured number with a unit of its own where its column has several, else the cell."""
    if not _is_measured(cell):
        return cell
    units = {row[key]["unit"] for row in rows if _is_measured(row.get(key))}
    return one_text(cell) if len(units) > 1 else cell


def _row(key: str, value: Any) -> tuple[str, str]:
    """Name and text of one result, a plain number with the prefix of its size."""
    if isinstance(value, Span):
        power = prefix_power(value.size, value.unit)
        return named(key), f"{value.text(power)} {unit_text(value.unit, power)}".strip()
    unit = _plain_unit(key)
    if unit == "1" or not isinstance(value, float):
        return named(key, value), one_text(value)
    power = prefix_power(value, unit)
    return named(key), f"{_cell(value, power)} {unit_text(unit, power)}"


def _plain_unit(key: str) -> str:
    """Return the unit in a key, "1" where there is none or none that takes a prefix."""
    front, _, last = key.rpartition("_")
    return SUFFIXES[last] if front and last in SUFFIXES and last not in ("ppm", "db") else "1"


def _cell(value: Any, power: int) -> str:
    if value is None:
        return MISSING
    if _is_measured(value):
        return written(value["value"], value["standard_uncertainty"], power)
    if isinstance(value, Span):
        return value.text(power)
    if isinstance(value, float):
        return f"{value / 10.0**power:.4g}"
    if isinstance(value, list):
        return ", ".join(one_text(item) for item in value) or MISSING
    if isinstance(value, dict):
        return "; ".join(" ".join(_row(key, one)) for key, one in _flat(value).items()) or MISSING
    return str(value)
