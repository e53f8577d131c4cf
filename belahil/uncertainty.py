"""Uncertainties after JCGM 100:2008 (GUM): combination, budget, and numbers as they are written.

Equation and clause numbers are those of JCGM 100:2008.
"""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from typing import TYPE_CHECKING

from belahil.outcome import BudgetLine

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

UNLIKELY = 1e-3
PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n", -12: "p", -15: "f"}


def combined(parts: Iterable[float]) -> float:
    """Combine independent standard uncertainties of one quantity: the root of their sum of squares (eq. 10).

    Parameters
    ----------
    parts : iterable of float
        Each already multiplied by its sensitivity, in the unit of the quantity.

    Examples
    --------
    >>> combined([3.0, 4.0])
    5.0
    """
    return math.hypot(*parts)


def budget(quantity: str, unit: str, parts: Mapping[str, float]) -> list[BudgetLine]:
    """List what each source adds to the uncertainty of one result, the largest first.

    Parameters
    ----------
    quantity : str
        The result, for example ``gain, code 4``.
    unit : str
        Its SI unit.
    parts : mapping of str to float
        Source and standard uncertainty it would give alone, in `unit`.

    Examples
    --------
    >>> [(line.source, round(line.share, 3)) for line in budget("gain", "1", {"noise": 1.0, "pad": 3.0})]
    [('pad', 0.9), ('noise', 0.1)]
    """
    whole = combined(parts.values()) or 1.0
    return [
        BudgetLine(quantity, source, value, unit, (value / whole) ** 2)
        for source, value in sorted(parts.items(), key=lambda part: -part[1])
    ]


def by_chance(chi_square: float, degrees_of_freedom: int) -> bool:
    """Tell whether chance makes a chi-square this large more often than once in a thousand times.

    Examples
    --------
    >>> by_chance(11.2, 11), by_chance(31.2, 11), by_chance(31.3, 11)
    (True, True, False)
    """
    from scipy.special import chdtrc

    return bool(chdtrc(degrees_of_freedom, chi_square) >= UNLIKELY)


def prefix_power(size: float, unit: str) -> int:
    """Power of ten, a multiple of three, that writes a number of this size with one to three digits.

    A unit that begins with a number or a power ("1", "1e-6", "V-2") takes no prefix, nor do decibels and
    degrees; metres take none above kilo, since nobody reads an altitude of 1.2 Mm at once. A squared one
    ("V2") takes one whose square is meant, so that numbers begin at the third decimal.

    Examples
    --------
    >>> prefix_power(19e6, "Hz"), prefix_power(0.83e-3, "V"), prefix_power(1234.0, "1")
    (6, -6, 0)
    >>> prefix_power(1.232e6, "m"), prefix_power(0.23, "deg")
    (3, 0)
    >>> prefix_power(0.31e-6, "J V-1 s-1"), prefix_power(0.31e-6, "V-2")
    (-9, 0)
    >>> prefix_power(5.96e-9, "V2"), prefix_power(999e-6, "V2"), prefix_power(1e-3, "V2")
    (-6, -6, 0)
    """
    if _squared(unit) and 0 < size < math.inf:
        sixes = math.floor(math.log10(size) / 6 + 0.5 + 1e-12)
        return 2 * min(max(3 * sixes, min(PREFIXES)), max(PREFIXES))
    if any(map(str.isdigit, unit.partition(" ")[0])) or unit in ("dB", "deg"):
        return 0
    if size == 0 or not math.isfinite(size):
        return 0
    largest = 3 if unit == "m" else max(PREFIXES)
    return min(max(3 * math.floor(math.log10(abs(size)) / 3 + 1e-12), min(PREFIXES)), largest)


def _squared(unit: str) -> bool:
    first = unit.partition(" ")[0]
    return first.endswith("2") and first[:-1].isalpha()


def prefixed(unit: str, power: int) -> str:
    """Write a unit with the prefix for a power of ten from `prefix_power`.

    Examples
    --------
    >>> prefixed("V", -6), prefixed("V2", -6), prefixed("V2", 0)
    ('µV', 'mV2', 'V2')
    """
    return PREFIXES[power // 2 if _squared(unit) else power] + unit


def sized(value: float, unit: str, digits: int = 6) -> str:
    """Write a number without uncertainty to so many figures, three or more, with the prefix of its size.

    Far beyond the prefixes there are, femto to giga, it has none and an exponent.

    Examples
    --------
    >>> sized(19e6, "Hz"), sized(-0.83e-3, "V", 3), sized(0.99996, "V", 4)
    ('19 MHz', '-830 µV', '1 V')
    >>> sized(0.0, "V"), sized(0.24e-15, "J"), sized(2e-20, "J"), sized(4e13, "Hz")
    ('0 V', '0.24 fJ', '2e-20 J', '4e+13 Hz')
    """
    # Rounded first: it may carry into the next prefix.
    rounded = float(f"{value:.{digits}g}")
    within = 10.0 ** (min(PREFIXES) - 3) <= abs(rounded) < 10.0 ** (max(PREFIXES) + 3)
    power = prefix_power(rounded, unit) if within else 0
    return f"{rounded / 10.0**power:.{digits}g} {prefixed(unit, power)}"


_LEAST = 1e-40
"""Of a number: an uncertainty below that is the rounding of a sum, and would take forty figures to write."""


def written(value: float, standard_uncertainty: float, power: int = 0) -> str:
    """Write a result with its standard uncertainty in parentheses (7.2.2), to two figures of it (7.2.6).

    Parameters
    ----------
    value, standard_uncertainty : float
        In the same unit; the uncertainty is not negative.
    power : int
        Written in units of ten to this power.

    Examples
    --------
    >>> written(19.01234e6, 3456.0, power=6)
    '19.0123(35)'
    >>> written(5.2, 1.26), written(1234.5, 321.0), written(5.19, 0.0)
    ('5.2(1.3)', '1230(320)', '5.19')
    >>> written(-1e-4, 0.064)
    '0.000(64)'
    >>> written(2.3, 6e-119)  # as good as none
    '2.3'
    """
    if 0 < standard_uncertainty < _LEAST * abs(value):
        standard_uncertainty = 0.0
    if not (math.isfinite(value) and math.isfinite(standard_uncertainty)) or standard_uncertainty <= 0:
        return f"{value / 10**power:.6g}" if standard_uncertainty == 0 else f"{value / 10**power:.6g}(?)"
    number, spread = (Decimal(repr(float(part))).scaleb(-power) for part in (value, standard_uncertainty))
    # Rounding may carry into a new figure (0.0996 to 0.10), hence twice.
    spread = _rounded(spread, spread.adjusted() - 1)
    place = spread.adjusted() - 1
    spread, number = _rounded(spread, place), _rounded(number, place)
    if place >= 0:
        return f"{int(number)}({int(spread)})"
    number = number or abs(number)  # no "-0.00"
    inside = f"{spread:f}" if spread >= 1 else str(int(spread.scaleb(-place)))
    return f"{number:f}({inside})"


def _rounded(number: Decimal, place: int) -> Decimal:
    with localcontext(prec=80):
        return number.quantize(Decimal(1).scaleb(place))
