"""Which loops run: the compiled ones, or where numba cannot be imported those of the reference."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Protocol, cast

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Loops(Protocol):
    """What `sim.compiled` and `sim.reference` both have; `sim.reference` says what each does."""

    def grid_echo(
        self,
        height_m: NDArray[np.float64],
        brightness: NDArray[np.float64],
        corner_m: tuple[float, float],
        spacing_m: float,
        centres_m: NDArray[np.float64],
        sigma_m: tuple[float, float],
        reach: float,
        altitude_m: float,
        origins_s: NDArray[np.float64],
        bin_s: float,
        bins: int,
        taps: NDArray[np.float64],
        offset: int,
        stride: int,
        count: int,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As in `sim.reference`."""
        ...


@cache
def loops() -> Loops:
    """Return the compiled loops where numba can be imported."""
    try:
        from sim import compiled
    except ImportError:
        from sim import reference

        return cast(Loops, reference)
    return cast(Loops, compiled)
