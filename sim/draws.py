"""Random draws that are keyed, never counted.

A draw is found by (seed, shot, effect). So a repeated or resumed shot repeats its draws, shot 500 is the same
alone or in a row, and a new effect does not reshuffle the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from belahil.values import check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.pole_response import SampledNoise


@dataclass(frozen=True, slots=True)
class Draws:
    """The random draws of one shot.

    Parameters
    ----------
    seed : int
        Of the emulation or the scene; not negative.
    shot : int
        Index in the plan; not negative.

    Raises
    ------
    RefusedInput
        A shot that is no whole number, or negative.
    """

    seed: int
    shot: int

    def __post_init__(self) -> None:
        check_whole("shot", self.shot, 0)

    def stream(self, effect: str) -> np.random.Generator:
        """Return the generator of one effect, at its beginning.

        Parameters
        ----------
        effect : str
            Any name; two names give independent streams (up to a collision of their CRC-32).
        """
        key = np.random.SeedSequence(self.seed, spawn_key=(self.shot, crc32(effect.encode())))
        # SFC64: the fastest of numpy's bit generators at normal deviates, and a window needs 16 064 of them.
        return np.random.Generator(np.random.SFC64(key))

    def uniform(self, effect: str) -> float:
        """Return one number in [0, 1): the first of that effect's stream."""
        return float(self.stream(effect).random())

    def normals(self, effect: str, first: int, count: int) -> NDArray[np.float64]:
        """Return normal deviates, shape (count,): the first of that effect's stream, whatever `first` is."""
        return self.stream(effect).standard_normal(count)

    def coloured(self, effect: str, noise: SampledNoise, count: int) -> NDArray[np.float32]:
        """Return a stretch of noise of unit rms, shape (count,)."""
        return noise.draw(self.stream(effect), count).astype(np.float32)
