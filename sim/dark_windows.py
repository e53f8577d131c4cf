"""Dark noise as a receiver recorded it, interference included: arrays of windows, one drawn for a shot.

What this does not model: noise that follows the laser's firing at a fixed place in the window keeps that
place only where a window is used from its first sample; shorter stretches begin anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.draws import Draws


@dataclass(frozen=True, slots=True, eq=False)
class DarkWindows:
    """Recorded windows of nothing but noise.

    Parameters
    ----------
    volts : ndarray of float32, shape (windows, samples)
        At the converter, V. Read-only.
    """

    volts: NDArray[np.float32]

    @property
    def rms_v(self) -> float:
        """Rms about the mean of each window, over all windows, V."""
        return float(np.sqrt(np.mean(np.var(self.volts, axis=1, dtype=np.float64))))

    def draw(self, draws: Draws, sample_count: int) -> NDArray[np.float32]:
        """Return a stretch of one window, shape (sample_count,); the draw is "dark".

        Raises
        ------
        ConfigError
            The recorded windows are shorter.
        """
        windows, recorded = self.volts.shape
        if sample_count > recorded:
            raise ConfigError(
                f"[noise] dark_windows: the recorded windows have {recorded} samples; "
                f"{sample_count} are asked for"
            )
        stream = draws.stream("dark")
        window, first = stream.integers(windows), stream.integers(recorded - sample_count + 1)
        return self.volts[window, first : first + sample_count]


def read_dark_windows(path: str, gain_code: int, laser: str = "") -> DarkWindows:
    """Read recorded windows, once for as long as the file does not change.

    Parameters
    ----------
    path : str
        A .npy array of V with one window a row, taken at the gain code that is meant; or the ``data.nc`` of a
        run, of which the windows without a stimulus at that code are used.
    gain_code : int
        Of the scene.
    laser : {"", "off", "firing"}
        Of a run that tells in which windows the laser fired: those to use. "": with the laser firing where
        there are some, since an echo comes in such a window.

    Raises
    ------
    ConfigError
        The file cannot be read or holds no such windows.
    """
    try:
        return _read(path, gain_code, laser, Path(path).stat().st_mtime_ns)
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"[noise] dark_windows = {path}: cannot be read ({error})") from error
    except ConfigError as error:
        raise ConfigError(f"[noise] dark_windows = {path}: {error}") from error


@lru_cache(maxsize=2)
def _read(path: str, gain_code: int, laser: str, changed: int) -> DarkWindows:
    suffix = Path(path).suffix.lower()
    if suffix not in (".npy", ".nc"):
        raise ConfigError(f'"{suffix}" is unknown; allowed: .npy of V, or data.nc of a run')
    if suffix == ".npy" and laser:
        raise ConfigError(
            f'dark_laser = "{laser}": an array does not tell when the laser fired; leave it out'
        )
    volts = np.load(path, allow_pickle=False) if suffix == ".npy" else _of_a_run(path, gain_code, laser)
    if volts.dtype.kind != "f" or volts.ndim > 2 or volts.size == 0 or not np.all(np.isfinite(volts)):
        raise ConfigError(
            f"{volts.dtype} of shape {volts.shape}: needs finite floating-point volts, one window a row"
        )
    volts = np.atleast_2d(volts).astype(np.float32)
    volts.setflags(write=False)
    return DarkWindows(volts)


def _of_a_run(path: str, gain_code: int, laser: str) -> NDArray[np.float32]:
    import h5py

    with h5py.File(path) as file:
        words = file["stimulus"].attrs["flag_meanings"].split()
        usable = (file["stimulus"][:] == words.index("no_signal")) & (file["gain_code"][:] == gain_code)
        if not usable.any():
            raise ConfigError(f"no window without a stimulus at gain code {gain_code}")
        firing = np.zeros(usable.size, dtype=np.bool_)
        if "laser_firing" in file:
            firing |= file["laser_firing"][:] == 1
        wanted = usable & (~firing if laser == "off" else firing)
        if laser and not wanted.any():
            raise ConfigError(f'dark_laser = "{laser}": no such window at gain code {gain_code}')
        dark = np.flatnonzero(wanted if wanted.any() else usable)
        size = int(file["sample_count"][:][dark].min())
        counts = file["counts"][dark, :size].astype(np.float32)
        zero, scale = file["zero_count"][:][dark], file["volts_per_count"][:][dark]
    return np.asarray((counts - zero[:, None]) * scale[:, None], dtype=np.float32)
