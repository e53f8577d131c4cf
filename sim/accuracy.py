"""How exactly a scene is to be computed: one number, handed down as a value, and its shares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from belahil.errors import RefusedInput

FLOOR: Final = 1e-10
"""Below it the sums of a footprint, of up to a million terms, cannot promise anything in double precision."""

_CUT, _DEPOSIT, _KERNEL = 0.25, 0.2, 0.05
# What is left belongs to the spacing of the pixels, which costs most: halving it makes four times the pixels.
_SPACING = 1 - _CUT - _DEPOSIT - _KERNEL


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The largest error that is allowed in a sample, relative to the peak of the echo.

    Parameters
    ----------
    tolerance : float
        max |dV| / peak, at the converter, without noise; from `FLOOR` to below 1. It binds the arithmetic:
        what the spacing of a terrain model leaves out is told apart.

    Raises
    ------
    RefusedInput
        Outside its range.
    """

    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        if not FLOOR <= self.tolerance < 1:
            raise RefusedInput(
                f"tolerance {self.tolerance!r}: must be below 1 and at least {FLOOR:g}, "
                "the floor of double precision here"
            )

    @property
    def beam_cut(self) -> float:
        """Share of the beam's edge, which is left out."""
        return _CUT * self.tolerance

    @property
    def deposit(self) -> float:
        """Share of the time bins."""
        return _DEPOSIT * self.tolerance

    @property
    def kernel(self) -> float:
        """Share of the tables of the receiver's response."""
        return _KERNEL * self.tolerance

    @property
    def spacing(self) -> float:
        """Share of the spacing between pixels."""
        return _SPACING * self.tolerance
