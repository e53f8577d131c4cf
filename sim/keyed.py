"""Random numbers found by their key alone: any number of any stream, without those before it.

The words are those of Philox 4x32 with 10 rounds (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as
easy as 1, 2, 3", SC 2011), a published function of a key and a counter that passes all of TestU01's BigCrush.

- Key: the low and the high 32 bits of the seed.
- Counter: number of the block, CRC-32 of the effect's name, low and high 32 bits of the shot.
- Word n of a stream lies in tile ``t = n // 256``, at ``j = n % 256``: word ``j // 64`` of the four of block
  ``64 t + j % 64``. So loops write whole vectors, and a longer draw begins as a shorter one.
- Uniform number: word / 2^32.
- Normal deviate, in single precision: with m the low 31 bits of the word, minus the quantile of the normal
  distribution at ``(m + 1/2) / 2^32``, with the opposite sign where the highest bit is set. Compiled loops
  come within 1e-5 of the exact quantile; the largest deviate is 6.34.

Seeds and shots are below 2^64. Two effects share a stream only if their CRC-32 is the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Protocol, cast
from zlib import crc32

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from belahil.pole_response import SampledNoise

TILE, LANES = 256, 64
_ROUNDS = 10
_MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_STEPS = 0x9E3779B9, 0xBB67AE85
_LOW, _HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
_WORD = 2**32


class Loops(Protocol):
    """What `sim.compiled_noise` and `sim.reference_noise` both have; the latter says what each does."""

    def normals(self, key: Key, first: int, count: int) -> NDArray[np.float32]:
        """As in `sim.reference_noise`."""
        ...

    def coloured(self, key: Key, taps: NDArray[np.float32], count: int) -> NDArray[np.float32]:
        """As in `sim.reference_noise`."""
        ...

    def digitized(
        self,
        noise: NDArray[np.float32],
        echo_v: NDArray[np.float64],
        low: int,
        factors: tuple[float, float],
        offsets_v: tuple[float, float],
        volts_per_count: float,
        bits: int,
    ) -> tuple[NDArray[np.float64], int]:
        """As in `sim.reference_noise`."""
        ...


@cache
def loops() -> Loops:
    """Return the compiled loops where numba can be imported."""
    try:
        from sim import compiled_noise
    except ImportError:
        from sim import reference_noise

        return cast(Loops, reference_noise)
    return cast(Loops, compiled_noise)


Key = tuple[int, int, int, int, int]
"""Seed, low and high; effect; shot, low and high: each below 2^32."""


def key_of(seed: int, shot: int, effect: str) -> Key:
    """Return the key of a stream.

    Raises
    ------
    RefusedInput
        A seed or a shot that is negative, or not below 2^64.
    """
    for name, number in (("seed", seed), ("shot", shot)):
        if not 0 <= number < _WORD**2:
            raise RefusedInput(f"{name} {number}: 0 to 2^64 - 1 are allowed for keyed random numbers")
    return seed % _WORD, seed // _WORD, crc32(effect.encode()), shot % _WORD, shot // _WORD


def philox(key: tuple[int, int], counter: tuple[ArrayLike, ...]) -> NDArray[np.uint32]:
    """Return the words of Philox 4x32-10.

    Parameters
    ----------
    key : tuple of int
        Two words.
    counter : tuple of array_like
        Four words, integers below 2^32 of shapes that broadcast to some shape s.

    Returns
    -------
    ndarray of uint32, shape (4, *s)
    """
    x0, x1, x2, x3 = np.broadcast_arrays(*(np.asarray(word, dtype=np.uint64) for word in counter))
    for number in range(_ROUNDS):
        left, right = (np.uint64((key[k] + number * _STEPS[k]) % _WORD) for k in (0, 1))
        first, second = _MULTIPLIERS[0] * x0, _MULTIPLIERS[1] * x2
        x0, x1 = (second >> _HALF) ^ x1 ^ left, second & _LOW
        x2, x3 = (first >> _HALF) ^ x3 ^ right, first & _LOW
    return np.stack([x0, x1, x2, x3]).astype(np.uint32)


def first_words(seed: int, shots: ArrayLike, effect: str, count: int = 1) -> NDArray[np.uint32]:
    """Return the first few words of the streams of many shots.

    Parameters
    ----------
    seed, effect
        As in `key_of`.
    shots : array_like of int, shape (n,)
        Not negative, below 2^63.
    count : int
        At most 64.

    Returns
    -------
    ndarray of uint32, shape (n, count)
    """
    numbers = np.asarray(shots, dtype=np.uint64)[:, None]
    low, high, name, _, _ = key_of(seed, 0, effect)
    return np.asarray(philox((low, high), (np.arange(count), name, numbers & _LOW, numbers >> _HALF))[0])


def first_uniforms(seed: int, shots: ArrayLike, effect: str) -> NDArray[np.float64]:
    """Return the first uniform number of the streams of many shots, shape (n,); as `first_words`."""
    return first_words(seed, shots, effect)[:, 0] / _WORD


def first_normals(seed: int, shots: ArrayLike, effect: str, count: int) -> NDArray[np.float64]:
    """Return the first few normal deviates of many shots, shape (n, count); as `first_words`."""
    from sim.reference_noise import normal_of

    return normal_of(first_words(seed, shots, effect, count)).astype(np.float64)


class KeyedStream:
    """One effect's numbers of one shot; what of `numpy.random.Generator` the models use.

    Each call goes on at the tile after those that the calls before have touched.

    Parameters
    ----------
    key : Key
        From `key_of`.
    """

    def __init__(self, key: Key) -> None:
        self._key, self._next = key, 0

    def standard_normal(self, size: int | None = None) -> NDArray[np.float64]:
        """Return normal deviates, shape (size,); without a size one, shape ().

        Up to 64 of them are exact quantiles, as those of `first_normals`.
        """
        from sim.reference_noise import normal_of

        count = 1 if size is None else size
        first = self._advanced(count)
        if count <= LANES:
            row = normal_of(words(self._key, first, count))
        else:
            row = loops().normals(self._key, first, count)
        return row.astype(np.float64).reshape(() if size is None else size)

    def random(self) -> float:
        """Return a number in [0, 1)."""
        return float(words(self._key, self._advanced(1), 1)[0]) / _WORD

    def integers(self, high: int) -> int:
        """Return a whole number from 0 to ``high - 1``; high is small against 2^32."""
        return int(words(self._key, self._advanced(1), 1)[0]) * high // _WORD

    def _advanced(self, count: int) -> int:
        first = self._next
        self._next += -(-count // TILE) * TILE
        return first


@dataclass(frozen=True, slots=True)
class KeyedDraws:
    """The random draws of one shot, from this generator; in the place of `sim.draws.Draws`.

    Parameters
    ----------
    seed, shot : int
        Below 2^64.
    """

    seed: int
    shot: int

    def stream(self, effect: str) -> KeyedStream:
        """Return the numbers of one effect, at their beginning."""
        return KeyedStream(key_of(self.seed, self.shot, effect))

    def uniform(self, effect: str) -> float:
        """Return one number in [0, 1): the first of that effect's stream."""
        return self.stream(effect).random()

    def normals(self, effect: str, first: int, count: int) -> NDArray[np.float64]:
        """Return normal deviates by their numbers in the stream, the first at least 0; shape (count,)."""
        return loops().normals(key_of(self.seed, self.shot, effect), first, count).astype(np.float64)

    def coloured(self, effect: str, noise: SampledNoise, count: int) -> NDArray[np.float32]:
        """Return a stretch of noise of unit rms, shape (count,).

        A moving average of the stream's deviates where `noise.taps` says that the filter forgets soon enough,
        else the filter's recursion.
        """
        taps = noise.taps
        if taps is None:
            return noise.draw(cast("np.random.Generator", self.stream(effect)), count).astype(np.float32)
        key = key_of(self.seed, self.shot, effect)
        return loops().coloured(key, taps, count)


def words(key: Key, first: int, count: int) -> NDArray[np.uint32]:
    """Return words of a stream by their numbers, from the first on, shape (count,)."""
    number = np.arange(first, first + count)
    within = number % TILE
    block = number // TILE * LANES + within % LANES
    found = philox(key[:2], (block, *key[2:]))
    return np.asarray(found[within // LANES, np.arange(count)])
