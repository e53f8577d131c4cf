"""Gaussian and log-stable fields by Fourier synthesis on a torus.

Functions of distance on a torus are even, so one quadrant of ``posts / 2 + 1`` values a side holds them, and
their Fourier transform is the cosine transform of the quadrant.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_MOST_POSTS = 8192  # of the torus, a side: each array of it then takes 0.5 GB
_SCALES_PER_OCTAVE = 2


def fractional_brownian(count: int, hurst: float, stream: np.random.Generator) -> Array:
    """Draw a fractional Brownian surface.

    Parameters
    ----------
    count : int
        Posts a side, at least 2.
    hurst : float
        H, above 0 and below 1.
    stream : numpy.random.Generator
        Drawn from.

    Returns
    -------
    ndarray of float64, shape (count, count)
        Gaussian, and over many draws ``mean((z(a) - z(b))**2) = |a - b|**(2 H)`` with the distance in posts,
        for every pair.

    Raises
    ------
    RefusedInput
        When H is not allowed or the grid is too large.
    """
    torus = _torus(count, hurst)
    white = stream.standard_normal((torus.posts, torus.posts))
    return torus.cut_out(white, np.sqrt(torus.power)) + torus.slope(stream)


@lru_cache(maxsize=1)
def _torus(count: int, hurst: float) -> Torus:
    """Surfaces that differ by their seed alone share it; a third of the time that a draw takes."""
    return Torus(count, hurst)


def integrated_flux(count: int, hurst: float, alpha: float, c1: float, stream: np.random.Generator) -> Array:
    """Draw a fractionally integrated flux (Schertzer and Lovejoy, 1987).

    Parameters
    ----------
    count, stream
        As for `fractional_brownian`.
    hurst : float
        Order of the integration. ``H - K(2) / 2`` must be above 0 and below 1.
    alpha, c1 : float
        Of the flux, see `moment_exponent`; C1 above 0.

    Returns
    -------
    ndarray of float64, shape (count, count)
        Over many draws ``mean((z(a) - z(b))**2) = |a - b|**(2 H - K(2))`` with the distance in posts, for
        every pair.

    Raises
    ------
    RefusedInput
        When a parameter is not allowed or the grid is too large.

    Notes
    -----
    The Fourier transform of the flux is not divided by ``k**H``, but by the root of the ratio of its own
    spectrum, which is known exactly, to that of the law above. Between spacing and extent both are the same;
    at the ends only the second keeps the law.
    """
    if not c1 > 0:
        raise RefusedInput(f"c1 = {c1:g}: a flux that varies needs it above 0")
    torus = Torus(count, hurst - moment_exponent(2.0, alpha, c1) / 2)
    cascade = LogStableCascade(torus.posts, alpha, c1)
    amplitude = np.sqrt(torus.power / cascade.power)
    amplitude[0, 0] = 0.0  # the mean height is free
    return torus.cut_out(cascade.draw(stream), amplitude) + torus.slope(stream)


def moment_exponent(order: float, alpha: float, c1: float) -> float:
    """K(q) of a universal multifractal, ``C1 (q**alpha - q) / (alpha - 1)``.

    Parameters
    ----------
    order : float
        q, not negative.
    alpha : float
        Index, 0.5 to 2 and not within 0.01 of 1; 2 is log-normal.
    c1 : float
        Codimension of the mean, not negative.

    Raises
    ------
    RefusedInput
        For an alpha or a C1 that is not allowed.
    """
    if not (0.5 <= alpha <= 2 and abs(alpha - 1) >= 0.01 and 0 <= c1 < np.inf):
        raise RefusedInput(
            f"alpha = {alpha:g}, c1 = {c1:g}: alpha must be 0.5 to 2 and not within 0.01 of 1, "
            "c1 must not be negative"
        )
    return float(c1 * (order**alpha - order) / (alpha - 1))


class Torus:
    """The torus on which increments of one power law are embedded exactly (Stein, 2002).

    Parameters
    ----------
    count : int
        Posts a side of the square to be cut out.
    hurst : float
        The root mean square increment grows with the distance to this power.

    Attributes
    ----------
    posts : int
        Of the torus, a side.
    power : ndarray of float64, shape (posts / 2 + 1, posts / 2 + 1)
        Transform of the covariance that, with `slope`, has the law at all distances up to the diagonal of
        the square.
    """

    def __init__(self, count: int, hurst: float) -> None:
        if not (0 < hurst < 1 and count >= 2):
            raise RefusedInput(
                f"an exponent of {hurst:g} on {count} posts: the RMS deviation must grow with a power above "
                "0 and below 1, on at least 2 posts"
            )
        from scipy.fft import dctn, next_fast_len

        # Stein's covariance: the power law to distance 1, then a tail that ends at `reach`.
        power = 2 * hurst
        reach, tail = (2.0, power * (2 - power) / 18) if power > 1.5 else (1.0, 0.0)
        square = (power - tail * (reach - 1) ** 2 * (reach + 2)) / 2
        half = next_fast_len(int(np.ceil(reach * np.sqrt(2) * (count - 1))) + 1)
        self.count, self.posts = count, 2 * half
        if self.posts > _MOST_POSTS:
            raise RefusedInput(
                f"{count} posts a side need a torus of {self.posts}; allowed are {_MOST_POSTS}, "
                "so make extent_m smaller or spacing_m larger"
            )
        unit = half / reach  # posts in distance 1, at least the diagonal
        r = quadrant_distance(self.posts) / unit
        far = np.maximum(r, 1.0)
        inside = tail * (reach - 1) ** 3 + 1 - square - r**power + square * r * r
        outside = tail * np.maximum(reach - far, 0.0) ** 3 / far
        scale = unit**power / 2  # so that the mean square increment over one post is 1
        # Not negative but for rounding, which is Stein's theorem.
        self.power: Array = np.maximum(dctn(scale * np.where(r <= 1, inside, outside), type=1), 0.0)
        self._slope_rms = float(np.sqrt(2 * square * scale) / unit)

    def cut_out(self, field: Array, amplitude: Array) -> Array:
        """Filter a field on the torus by an even amplitude, shape as `power`, and cut the square out."""
        from scipy.fft import ifft, irfft, rfft2

        spectrum, half = rfft2(field), self.posts // 2
        spectrum[: half + 1] *= amplitude
        spectrum[half + 1 :] *= amplitude[half - 1 : 0 : -1]
        # Back along the columns first: of their rows only those of the square need to go back as well.
        rows = ifft(spectrum, axis=0, norm="forward", overwrite_x=True)[: self.count]
        square: Array = irfft(rows, n=self.posts, axis=1, norm="forward")[:, : self.count]
        return square * (1 / self.posts**2)

    def slope(self, stream: np.random.Generator) -> Array:
        """Draw the plane that stands for all relief longer than the torus; shape (count, count)."""
        along_rows, along_columns = self._slope_rms * stream.standard_normal(2)
        posts = np.arange(self.count)
        plane: Array = along_rows * posts[:, None] + along_columns * posts
        return plane


class LogStableCascade:
    """A multiplicative cascade, continuous in scale and isotropic, on a torus.

    The logarithm is a sum of independent extremal stable noises, one for each scale, each summed over a
    disc of that diameter (infinitely divisible cascades: Schmitt and Marsan, 2001; Chainais, 2006). The
    smallest disc is one post. The largest, half the torus, holds one e-fold more, which keeps the law of
    the two-point moments up to a fourth of the torus.

    Parameters
    ----------
    posts : int
        Of the torus, a side; even.
    alpha, c1 : float
        As for `moment_exponent`.

    Attributes
    ----------
    log_ratio : float
        Natural logarithm of the effective ratio of scales: the mean of ``flux**q`` is
        ``exp(log_ratio K(q))`` exactly.
    power : ndarray of float64, shape (posts / 2 + 1, posts / 2 + 1)
        Transform of the covariance of the flux, exactly.
    """

    def __init__(self, posts: int, alpha: float, c1: float) -> None:
        from scipy.fft import dctn, idctn

        self._posts, self._alpha, self._c1 = posts, alpha, c1
        self.log_ratio = float(np.log(posts / 2)) + 1
        r = quadrant_distance(posts)
        self._discs: list[tuple[Array, float]] = []
        overlap = np.zeros_like(r)
        for diameter, share in _scales(posts / 2):
            transform: Array = dctn((r <= diameter / 2).astype(np.float64), type=1)
            area = float(transform[0, 0])
            self._discs.append((transform, share / area))
            overlap += share / area * transform * transform
        common = idctn(overlap, type=1)
        self.power: Array = dctn(np.expm1(moment_exponent(2.0, alpha, c1) * common), type=1)

    def draw(self, stream: np.random.Generator) -> Array:
        """Draw the flux, shape (posts, posts): positive, and 1 in the mean over many draws."""
        from scipy.fft import irfft2, rfft2

        alpha, size = self._alpha, (self._posts, self._posts)
        spectrum = np.zeros((self._posts, self._posts // 2 + 1), dtype=np.complex128)
        for transform, density in self._discs:
            strength = (density * self._c1 / abs(alpha - 1)) ** (1 / alpha)
            noise = rfft2(strength * extremal_stable(alpha, size, stream), overwrite_x=True)
            noise *= transform[_folded(self._posts)]
            spectrum += noise
        logarithm: Array = irfft2(spectrum, s=size, overwrite_x=True)
        logarithm -= self.log_ratio * self._c1 / (alpha - 1)
        return np.exp(logarithm)


def extremal_stable(alpha: float, size: tuple[int, ...], stream: np.random.Generator) -> Array:
    """Draw stable numbers X whose long tail is the negative one.

    Their Laplace transform is ``mean(exp(q X)) = exp(sign(alpha - 1) q**alpha)`` for q >= 0.

    Notes
    -----
    Kanter (1975) and Chambers, Mallows and Stuck (1976), with the angle measured from the end where the tail
    is short: there the usual form takes the cosine of nearly a right angle and loses its digits.
    """
    angle = np.pi * (1 - stream.random(size))
    waiting = stream.standard_exponential(size)
    numbers: Array = np.sin(alpha * angle) / np.sin(angle) ** (1 / alpha)
    numbers *= (waiting / np.sin(abs(alpha - 1) * angle)) ** ((alpha - 1) / alpha)
    return numbers if alpha > 1 else -numbers


def quadrant_distance(posts: int) -> Array:
    """Distance from the first post on a torus, in posts, shape (posts / 2 + 1, posts / 2 + 1)."""
    along = np.arange(posts // 2 + 1, dtype=np.float64)
    return np.hypot(along[:, None], along)


def _scales(largest: float) -> list[tuple[float, float]]:
    """Diameters in posts and the share of ``ln(largest) + 1`` that belongs to each."""
    steps = max(round(np.log2(largest) * _SCALES_PER_OCTAVE), 1)
    step = float(np.log(largest)) / steps
    diameters = np.exp(step * (np.arange(steps) + 0.5))
    one_post = [step for diameter in diameters if diameter < 2]
    larger = [(float(diameter), step) for diameter in diameters if diameter >= 2]
    return [(1.0, sum(one_post)), *larger, (largest, 1.0)]


def _folded(posts: int) -> NDArray[np.int64]:
    """Row of a quadrant for each row of a transform."""
    rows = np.arange(posts)
    return np.minimum(rows, posts - rows)
