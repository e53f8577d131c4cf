"""The shape of the beam across, D_T(x, y): Gaussian, elliptical, or an image.

What this does not model: the change of the beam's size with the height of the ground (2e-4 for 100 m at
500 km), and a spot on the ground that is stretched because the beam points off nadir (1e-8 at 100 urad).
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.scene_tables import Laser


def beam_weights(
    laser: Laser, altitude_m: float, x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how brightly the beam lights the ground, on any scale.

    Parameters
    ----------
    laser : Laser
        Its pointing displaces the beam.
    altitude_m : float
        Above zero.
    x_m, y_m : ndarray of float64
        Places on the ground from nadir, of shapes that broadcast.

    Returns
    -------
    ndarray of float64
        Of the broadcast shape: 1 at the peak of a Gaussian or ellipse; an image in its own units, zero
        outside.

    Raises
    ------
    ConfigError
        The image cannot be used.
    """
    along = x_m - altitude_m * math.tan(laser.pointing_rad[0])
    across = y_m - altitude_m * math.tan(laser.pointing_rad[1])
    if laser.beam == "image":
        image = beam_image(laser)
        return image.at(along / altitude_m, across / altitude_m)
    major_m, minor_m = beam_sigma_m(laser, altitude_m)
    if laser.beam == "elliptical":
        angle = math.radians(laser.beam_azimuth_deg)
        along, across = (
            math.cos(angle) * along + math.sin(angle) * across,
            math.cos(angle) * across - math.sin(angle) * along,
        )
    with np.errstate(under="ignore"):
        return np.asarray(np.exp(-0.5 * ((along / major_m) ** 2 + (across / minor_m) ** 2)))


def beam_sigma_m(laser: Laser, altitude_m: float) -> tuple[float, float]:
    """Return the standard deviations of the lit spot along its major and minor axis, m.

    A quarter of the full 1/e^2 angle is one standard deviation: sigma = H tan(divergence / 4).
    """
    if laser.beam == "image":
        major_rad, minor_rad = beam_image(laser).sigma_rad
        return altitude_m * major_rad, altitude_m * minor_rad
    sigma_m = altitude_m * math.tan(laser.divergence_rad / 4)
    if laser.beam == "gaussian":
        return sigma_m, sigma_m
    stretch = math.sqrt(1 - laser.ellipticity)
    return sigma_m / stretch, sigma_m * stretch


_LINEAR = 1 / 6
"""Variance that a single pixel has by linear interpolation, pixels^2: no beam is narrower."""


class BeamImage:
    """A measured profile; its centroid is the axis of the beam.

    Parameters
    ----------
    pixels : ndarray of float64, shape (rows, columns)
        Brightness, not negative. The first row is at the top, towards +y.
    pixel_rad : float
        Angle from one pixel to the next.

    Raises
    ------
    ConfigError
        Not a picture of at least 2 x 2 finite pixels, or no light in it.
    """

    def __init__(self, pixels: NDArray[np.float64], pixel_rad: float) -> None:
        if pixels.ndim != 2 or min(pixels.shape) < 2:
            raise ConfigError(f"an image of shape {pixels.shape}: must be one grey picture, 2 x 2 or more")
        if not (np.all(np.isfinite(pixels)) and pixels.min() >= 0 and pixels.max() > 0):
            raise ConfigError("an image: pixels must be finite, not negative, and somewhere positive")
        # Dark pixels about it: brightness falls to zero over one pixel, and no light is cut off.
        self.pixels = pixels = np.pad(pixels, 1)
        self.pixel_rad = pixel_rad
        share = pixels / pixels.sum()
        rows, columns = np.arange(pixels.shape[0]), np.arange(pixels.shape[1])
        self._row, self._column = float(share.sum(axis=1) @ rows), float(share.sum(axis=0) @ columns)
        down, right = rows - self._row, columns - self._column
        spread = np.array(
            [
                [share.sum(axis=0) @ right**2, -(down @ share @ right)],
                [-(down @ share @ right), share.sum(axis=1) @ down**2],
            ]
        )
        minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(spread), _LINEAR)) * pixel_rad
        self.sigma_rad = (float(major), float(minor))

    def at(self, along_rad: NDArray[np.float64], across_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the brightness at angles from the axis, linear between pixels, zero a pixel outside."""
        column = self._column + np.asarray(along_rad) / self.pixel_rad
        row = self._row - np.asarray(across_rad) / self.pixel_rad
        last_row, last_column = self.pixels.shape[0] - 1, self.pixels.shape[1] - 1
        inside = (row >= 0) & (row <= last_row) & (column >= 0) & (column <= last_column)
        i = np.clip(np.floor(row), 0, last_row - 1).astype(np.intp)
        j = np.clip(np.floor(column), 0, last_column - 1).astype(np.intp)
        down, right = row - i, column - j
        value = (1 - down) * ((1 - right) * self.pixels[i, j] + right * self.pixels[i, j + 1]) + down * (
            (1 - right) * self.pixels[i + 1, j] + right * self.pixels[i + 1, j + 1]
        )
        return np.asarray(np.where(inside, value, 0.0))


def beam_image(laser: Laser) -> BeamImage:
    """Return the image of a laser's beam, read once for as long as its file does not change.

    Raises
    ------
    ConfigError
        The file cannot be read, or is no image of a beam.
    """
    try:
        changed = Path(laser.image).stat().st_mtime_ns
        return _read_image(laser.image, laser.image_pixel_rad, changed)
    except (OSError, ValueError) as error:
        raise ConfigError(f"[laser] image = {laser.image}: cannot be read ({error})") from error
    except ConfigError as error:
        raise ConfigError(f"[laser] image = {laser.image}: {error}") from error


@lru_cache(maxsize=4)
def _read_image(path: str, pixel_rad: float, changed: int) -> BeamImage:
    suffix = Path(path).suffix.lower()
    if suffix == ".npy":
        pixels = np.load(path, allow_pickle=False)
    elif suffix == ".png":
        from matplotlib.image import imread

        pixels = imread(path)
    elif suffix in (".csv", ".txt"):
        pixels = np.loadtxt(path, delimiter="," if suffix == ".csv" else None, ndmin=2)
    else:
        raise ConfigError(f'"{suffix}" is unknown; allowed: .npy, .png, .csv, .txt')
    return BeamImage(np.asarray(pixels, dtype=np.float64), pixel_rad)
