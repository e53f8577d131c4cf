"""What a receiver delays the arrival of a pulse by, as a function of the width that is detected.

The fitted centre of a narrow pulse comes later behind the filter than that of a wide one, by some 1.7 ns. A
polynomial of the detected width corrects it. Powers of the width are a basis that loses all digits (their
condition is 5e11 in ns, 1e38 in s), and three printed digits of their coefficients leave 0.3 ns at 110 ns. So
the coefficients here are those of Legendre polynomials on the range of widths, at full digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Legendre, Polynomial, legendre

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

NARROWEST_S, WIDEST_S = 20e-9, 110e-9
"""Detected widths for which a correction is known (paper, below the equation of t_shift)."""

_WORST_CONDITION = 1e3

_PUBLISHED = (-8.13, 9.37e-1, -2.18e-3, 3.81e-5, -3.27e-7, 1.01e-9)
_PROBABLE = (-8.13, 9.37e-2, -2.18e-3, 3.81e-5, -3.27e-7, 1.01e-9)


@dataclass(frozen=True)
class DelayCurve:
    """A polynomial of the detected width, within a range of widths.

    Parameters
    ----------
    coefficients_s : tuple of float
        Of the Legendre polynomials of degree 0, 1, ... on the range, s.
    narrowest_s, widest_s : float
        The range, s.

    Raises
    ------
    RefusedInput
        A range that is empty, or coefficients that are missing or not finite.
    """

    coefficients_s: tuple[float, ...]
    narrowest_s: float = NARROWEST_S
    widest_s: float = WIDEST_S

    def __post_init__(self) -> None:
        if not 0 < self.narrowest_s < self.widest_s < math.inf:
            raise RefusedInput(
                f"widths from {self.narrowest_s!r} to {self.widest_s!r} s: must be a range above 0"
            )
        if not self.coefficients_s or not all(map(math.isfinite, self.coefficients_s)):
            raise RefusedInput(f"coefficients {self.coefficients_s}: at least one, all finite, are needed")

    def at(self, widths_s: ArrayLike) -> NDArray[np.float64]:
        """Return the delay, s, with the shape of `widths_s`.

        Raises
        ------
        RefusedInput
            A width outside the range, or not a number: a polynomial says nothing there.
        """
        place = _places(np.asarray(widths_s, dtype=np.float64), self.narrowest_s, self.widest_s)
        return np.asarray(legendre.legval(place, self.coefficients_s))


def fit_delay_curve(
    widths_s: ArrayLike,
    delays_s: ArrayLike,
    degree: int = 5,
    narrowest_s: float = NARROWEST_S,
    widest_s: float = WIDEST_S,
) -> DelayCurve:
    """Fit a delay curve by least squares.

    Parameters
    ----------
    widths_s, delays_s : array_like of float, shape (n,)
        Detected widths, all within the range, and delays, s.
    degree : int
        Of the polynomial.
    narrowest_s, widest_s : float
        Range that the curve is to serve, s.

    Raises
    ------
    RefusedInput
        Shapes that differ, widths outside the range, delays that are not finite, or widths that leave a part
        of the range so empty that the polynomial is not determined there.
    """
    widths, delays = np.asarray(widths_s, dtype=np.float64), np.asarray(delays_s, dtype=np.float64)
    if widths.ndim != 1 or widths.shape != delays.shape or not np.all(np.isfinite(delays)):
        raise RefusedInput(f"widths {widths.shape} and delays {delays.shape}: two equal rows, all finite")
    if not 0 <= degree < widths.size:
        raise RefusedInput(f"degree {degree} from {widths.size} widths: must be from 0 to below their number")
    columns = legendre.legvander(_places(widths, narrowest_s, widest_s), degree)
    condition = float(np.linalg.cond(columns))
    if not condition < _WORST_CONDITION:
        raise RefusedInput(
            f"a polynomial of degree {degree} through widths from {widths.min():.4g} to {widths.max():.4g} s "
            f"has a condition of {condition:.2g} on {narrowest_s:.4g} to {widest_s:.4g} s: below "
            f"{_WORST_CONDITION:g} is allowed; widths over the whole range are needed"
        )
    found = np.linalg.lstsq(columns, delays, rcond=None)[0]
    return DelayCurve(tuple(found.tolist()), narrowest_s, widest_s)


def published_curve(*, as_printed: bool = False) -> DelayCurve:
    """Return t_shift of the paper: transmitted less received delay, to its three digits.

    Parameters
    ----------
    as_printed : bool
        With the printed linear coefficient of 0.937 ns per ns, by which the correction would grow to 88 ns.
        Else it is 0.0937, with which the curve is that of a Butterworth filter of 19 MHz to 0.1 ns: probably
        a misprint.

    Notes
    -----
    For comparison only; three digits of powers are 0.34 ns at 110 ns.
    """
    powers_ns = Polynomial(_PUBLISHED if as_printed else _PROBABLE)
    series_ns = powers_ns.convert(domain=(NARROWEST_S * 1e9, WIDEST_S * 1e9), kind=Legendre)
    return DelayCurve(tuple(1e-9 * float(one) for one in series_ns.coef))


def _places(widths_s: NDArray[np.float64], narrowest_s: float, widest_s: float) -> NDArray[np.float64]:
    """Map the range to -1 ... 1."""
    place = (2 * widths_s - narrowest_s - widest_s) / (widest_s - narrowest_s)
    outside = ~(np.abs(place) <= 1 + 1e-12)
    if outside.any():
        raise RefusedInput(
            f"a detected width of {float(widths_s[outside].flat[0])!r} s: delays are known from "
            f"{narrowest_s:.4g} to {widest_s:.4g} s"
        )
    return place
