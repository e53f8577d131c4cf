"""The compiled loops of keyed noise; what each does, and its NumPy form, is in `sim.reference_noise`.

The quantile of the normal distribution at p, for p up to 1/2, is ``(1 - 2 p) P(w)`` with
``w = -ln(4 p (1 - p))``, as for the inverse error function (Giles, "Approximating the erfinv function", GPU
Computing Gems, 2011). P is smooth in ``sqrt(w + 6)``: one polynomial serves the whole range. Both polynomials
are fits at Chebyshev nodes; a test holds them to the quantile.

Each loop does one thing to short rows, and reads no row that it writes under another name: only so are they
vectorized.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from sim.keyed import LANES, TILE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.keyed import Key

_F, _U, _I = np.float32, np.uint32, np.int32
_ROUNDING = {"contract", "nsz", "reassoc"}
_ROW = 4 * TILE
_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = _U(0x9E3779B9), _U(0xBB67AE85)
_32, _31, _23 = np.uint64(32), _U(31), _I(23)
_LOW_31, _MANTISSA, _ROOT_HALF = _U(0x7FFFFFFF), _I(0x7FFFFF), _I(0x3F3504F3)
_HALF, _1, _4, _STEP, _LN2 = _F(0.5), _F(1), _F(4), _F(2.0**-32), _F(np.log(2))
_LOG = tuple(_F(c) for c in (
    1, -0.499999881, 0.333333254, -0.250015855, 0.200020716,
    -0.166091263, 0.141800791, -0.132408425, 0.129141703, -0.0763859227,
))  # fmt: skip
"""Of ln(1 + v) / v, for v from sqrt(1/2) - 1 to sqrt(2) - 1."""
_TAIL = tuple(_F(c) for c in (
    3.95730662, 2.56453609, -0.269934148, 0.10985323, -0.00070683402,
    -0.0746587738, 0.131438598, -0.151371196, 0.0356141627, 0.12181551,
    -0.086228095, -0.0278520789, 0.0281474963,
))  # fmt: skip
"""Of P, in the place of sqrt(w + 6) between its ends at w = 0 and at the smallest p, from -1 to 1."""
_SIX, _SCALE, _SHIFT = _F(6), _F(0.715981439), _F(-2.75378919)


def normals(key: Key, first: int, count: int) -> NDArray[np.float32]:
    """As `sim.reference_noise.normals`."""
    out = np.empty(count, dtype=np.float32)
    _normals(out, *key, first)
    return out


def coloured(key: Key, taps: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """As `sim.reference_noise.coloured`."""
    out = np.zeros(count, dtype=np.float32)
    # Eight taps a pass.
    padded = np.zeros(-(-taps.size // 8) * 8, dtype=np.float32)
    padded[: taps.size] = taps[::-1]
    _coloured(out, *key, padded, taps.size)
    return out


@njit(cache=True, nogil=True)
def _coloured(
    out: NDArray[np.float32],
    low: int,
    high: int,
    effect: int,
    shot_low: int,
    shot_high: int,
    taps: NDArray[np.float32],
    count: int,
) -> None:
    white = np.zeros(out.size + taps.size, dtype=np.float32)
    _normals(white[: out.size + count - 1], low, high, effect, shot_low, shot_high, 0)
    for begin in range(0, taps.size, 8):
        _eight(out, white[begin:], taps[begin : begin + 8])


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _eight(out: NDArray[np.float32], white: NDArray[np.float32], taps: NDArray[np.float32]) -> None:
    size = out.size
    c0, c1, c2, c3, c4, c5, c6, c7 = taps[0], taps[1], taps[2], taps[3], taps[4], taps[5], taps[6], taps[7]
    w0, w1, w2, w3 = white[:size], white[1:][:size], white[2:][:size], white[3:][:size]
    w4, w5, w6, w7 = white[4:][:size], white[5:][:size], white[6:][:size], white[7:][:size]
    for i in range(size):
        early = c0 * w0[i] + c1 * w1[i] + c2 * w2[i] + c3 * w3[i]
        out[i] += early + c4 * w4[i] + c5 * w5[i] + c6 * w6[i] + c7 * w7[i]


@njit(cache=True, nogil=True)
def _normals(
    out: NDArray[np.float32], low: int, high: int, effect: int, shot_low: int, shot_high: int, first: int
) -> None:
    words = np.empty((4, _ROW // 4), dtype=np.uint32)
    flat = np.empty(_ROW, dtype=np.uint32)
    level, mantissa = np.empty(_ROW, dtype=np.float32), np.empty(_ROW, dtype=np.float32)
    odd, exponent = np.empty(_ROW, dtype=np.float32), np.empty(_ROW, dtype=np.float32)
    row = np.empty(_ROW, dtype=np.float32)
    level_bits, mantissa_bits = level.view(np.int32), mantissa.view(np.int32)
    skip = first % TILE
    done, block = 0, first // TILE * LANES
    while done < out.size:
        _philox(words, low, high, block, effect, shot_low, shot_high)
        for tile in range(_ROW // TILE):
            for word in range(4):
                at = tile * TILE + word * LANES
                flat[at : at + LANES] = words[word, tile * LANES : (tile + 1) * LANES]
        _levels(flat, level, odd)
        _exponents(level_bits, mantissa_bits, exponent)
        _quantiles(mantissa, exponent, odd, row)
        size = min(_ROW - skip, out.size - done)
        out[done : done + size] = row[skip : skip + size]
        done += size
        block += _ROW // 4
        skip = 0


@njit(cache=True, nogil=True)
def _philox(
    words: NDArray[np.uint32],
    low: int,
    high: int,
    block: int,
    effect: int,
    shot_low: int,
    shot_high: int,
) -> None:
    row0, row1, row2, row3 = words[0], words[1], words[2], words[3]
    for lane in range(words.shape[1]):
        x0, x1, x2, x3 = _U(block + lane), _U(effect), _U(shot_low), _U(shot_high)
        left, right = _U(low), _U(high)
        for _ in range(10):
            first, second = _M0 * np.uint64(x0), _M1 * np.uint64(x2)
            x0, x1 = _U(second >> _32) ^ x1 ^ left, _U(second)
            x2, x3 = _U(first >> _32) ^ x3 ^ right, _U(first)
            left, right = _U(left + _W0), _U(right + _W1)
        row0[lane], row1[lane], row2[lane], row3[lane] = x0, x1, x2, x3


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _levels(words: NDArray[np.uint32], level: NDArray[np.float32], odd: NDArray[np.float32]) -> None:
    """4 p (1 - p), and 1 - 2 p with the sign of the deviate."""
    for i in range(words.size):
        p = (_F(_I(words[i] & _LOW_31)) + _HALF) * _STEP
        level[i] = _4 * p * (_1 - p)
        odd[i] = (_1 - p - p) * _F(1 - 2 * _I(words[i] >> _31))


@njit(cache=True, nogil=True)
def _exponents(level: NDArray[np.int32], mantissa: NDArray[np.int32], exponent: NDArray[np.float32]) -> None:
    """Take floats apart, so that the mantissa lies about 1."""
    for i in range(level.size):
        above = level[i] - _ROOT_HALF
        exponent[i] = _F(above >> _23)
        mantissa[i] = (above & _MANTISSA) + _ROOT_HALF


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _quantiles(
    mantissa: NDArray[np.float32],
    exponent: NDArray[np.float32],
    odd: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    a, c = _LOG, _TAIL
    for i in range(out.size):
        v = mantissa[i] - _1
        high = a[5] + v * (a[6] + v * (a[7] + v * (a[8] + v * a[9])))
        log = v * (a[0] + v * (a[1] + v * (a[2] + v * (a[3] + v * (a[4] + v * high)))))
        k = np.sqrt(_SIX - (log + exponent[i] * _LN2)) * _SCALE + _SHIFT
        far = c[7] + k * (c[8] + k * (c[9] + k * (c[10] + k * (c[11] + k * c[12]))))
        near = c[0] + k * (c[1] + k * (c[2] + k * (c[3] + k * (c[4] + k * (c[5] + k * (c[6] + k * far))))))
        out[i] = odd[i] * near


def digitized(
    noise: NDArray[np.float32],
    echo_v: NDArray[np.float64],
    low: int,
    factors: tuple[float, float],
    offsets_v: tuple[float, float],
    volts_per_count: float,
    bits: int,
) -> tuple[NDArray[np.float64], int]:
    """As `sim.reference_noise.digitized`."""
    volts = np.empty(noise.size)
    counts = 2.0 ** (bits - 1)
    even = factors[0] == factors[1] == 1 and offsets_v[0] == offsets_v[1] == 0
    saturated = _digitized(volts, noise, echo_v, low, even, factors, offsets_v, volts_per_count, counts)
    return volts, saturated


@njit(cache=True, nogil=True)
def _digitized(
    volts: NDArray[np.float64],
    noise: NDArray[np.float32],
    echo_v: NDArray[np.float64],
    low: int,
    even: bool,
    factors: tuple[float, float],
    offsets_v: tuple[float, float],
    volts_per_count: float,
    counts: float,
) -> int:
    for i in range(volts.size):
        volts[i] = noise[i]
    for i in range(echo_v.size):
        volts[low + i] += echo_v[i]
    if not even:
        for i in range(volts.size):
            volts[i] = volts[i] * factors[i % 2] + offsets_v[i % 2]
    beyond = 0
    for i in range(volts.size):
        count = np.rint(volts[i] / volts_per_count)
        beyond += count < -counts or count > counts - 1
        volts[i] = min(max(count, -counts), counts - 1) * volts_per_count
    return beyond
