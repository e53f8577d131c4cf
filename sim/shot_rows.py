"""Many shots over a terrain model: from footprints to the candidates of whole windows, in compiled rows.

What `sim.chain.Chain` does for one shot with NumPy's generator, this does for rows of shots, with the keyed
generator of `sim.keyed` or with NumPy's: echoes from the posts in one compiled call, noise as a moving
average, and the receiver's own range finder on every window. A shot's numbers are found by (seed, shot,
effect), so a shot is the same alone and in any row.

What this does not model: what `sim.echo.GridEcho` leaves out, and the tilt that a wandering beam adds to the
wavefront (a slope of as many radians as it wanders).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from sim.chain_noise import PoleFilter
from sim.draws import Draws
from sim.echo import GridEcho
from sim.keyed import loops
from sim.optical_echo import lasting_s
from sim.receiver_model import small_signal_effects
from sim.relief_tiles import ReliefTiles
from sim.rows_noise import RowNoise, steps_between
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from sim.chain import Chain

_GENERATORS = ("keyed", "numpy")

_ROW = 64
"""Shots in a compiled call."""


@dataclass(frozen=True, eq=False)
class FoundShots:
    """What the range finder found in the windows of many shots.

    Parameters
    ----------
    shots : ndarray of int64, shape (n,)
        Their numbers.
    found : ndarray of int64, shape (n,)
        Candidates of each shot; the rows below are zero beyond them.
    arrival_s : ndarray of float64, shape (n, most)
        From each shot's gate in true time, whatever the receiver's clock does, s; best first.
    fwhm_s, amplitude_v : ndarray of float64, shape (n, most)
        Full width, s; amplitude at the converter, V.
    reflectance : ndarray of float64, shape (n,)
        Weighted by the whole beam, unknown ground as black; 0: no light came back.
    saturated : ndarray of int64, shape (n,)
        Samples beyond the converter's range.
    noise : str
        Where the stationary noise came from, to be told beside any figure made of it.
    """

    shots: NDArray[np.int64]
    found: NDArray[np.int64]
    arrival_s: NDArray[np.float64]
    fwhm_s: NDArray[np.float64]
    amplitude_v: NDArray[np.float64]
    reflectance: NDArray[np.float64]
    saturated: NDArray[np.int64]
    noise: str


class ShotRows:
    """Rows of shots of a chain.

    Parameters
    ----------
    chain : Chain
        Over a terrain model, without skew between the converters, with a receiver of poles.
    pool_windows : int
        0: every shot has noise of its own. Else so many windows of stationary noise are drawn once, 68 kB
        each, and a shot takes one of them from a random place on. Shots that share a window are correlated: a
        share of false detections is then known no better than from so many independent windows.
    generator : {"keyed", "numpy"}
        Of the random numbers: `sim.keyed`, or NumPy's as `sim.draws` keys it. Without shot noise and beam
        jitter the latter gives the shots of `Chain` one by one, else shots of the same distribution.

    Raises
    ------
    RefusedInput
        A chain that needs another path: `Chain.candidates` serves every scene, a shot at a time; or a pool of
        fewer than no windows.
    """

    def __init__(
        self, chain: Chain, pool_windows: int = 0, generator: Literal["keyed", "numpy"] = "keyed"
    ) -> None:
        if generator not in _GENERATORS:
            raise RefusedInput(f"generator {generator!r}: allowed are {', '.join(_GENERATORS)}")
        if pool_windows < 0:
            raise RefusedInput(f"a pool of {pool_windows} windows: 0 (no pool) or more are allowed")
        scene = chain.scene
        self._chain, relief = chain, _relief(chain)
        self._interval_s = chain.receiver.grid.interval_s
        # The range finder counts in nominal intervals.
        self._true_interval = self._interval_s / chain.receiver.spec.sample_interval_s
        place = (scene.laser, scene.altitude_m, chain.plan)
        self._echo = GridEcho(chain.surface, *place, chain.kernel, self._interval_s, 1)
        self._gain, mismatch = scene.gain, scene.truth.interleave
        self._factors = (1 + mismatch.gain / 2, 1 - mismatch.gain / 2)
        self._offsets_v = (mismatch.offset_v / 2, -mismatch.offset_v / 2)
        self._small = small_signal_effects(scene.truth)
        self._noise = RowNoise(chain, pool_windows, generator)
        if self._small and self._noise.has_light:
            raise RefusedInput("rows of shots: sunlight before a small-signal effect needs Chain.candidates")
        self._tiles = ReliefTiles(relief)

    def candidates(self, shots: ArrayLike, centres_m: ArrayLike | None = None) -> FoundShots:
        """Find the candidates of many shots.

        Parameters
        ----------
        shots : array_like of int, shape (n,)
            Not negative: keys of their random numbers.
        centres_m : array_like of float, shape (n, 2), or None
            x and y of nadir, m; None: the origin for all.

        Returns
        -------
        FoundShots
        """
        given = np.atleast_1d(np.asarray(shots))
        if given.ndim != 1 or (given.size and (given.dtype.kind not in "iu" or given.min() < 0)):
            raise RefusedInput(
                f"shots of type {given.dtype} and shape {given.shape}: "
                "a row of whole numbers from 0 on is allowed"
            )
        numbers = given.astype(np.int64)
        places = np.zeros((numbers.size, 2))
        places += 0.0 if centres_m is None else np.asarray(centres_m, dtype=np.float64)
        if not np.isfinite(places).all():
            raise RefusedInput("centres_m of rows of shots: every number must be finite")
        most = self._chain.range_finder.candidate_count
        rows, counts = np.zeros((numbers.size, most, 3)), np.zeros(numbers.size, dtype=np.int64)
        lit, saturated = np.zeros(numbers.size), np.zeros(numbers.size, dtype=np.int64)
        for begin in range(0, numbers.size, _ROW):
            part = slice(begin, begin + _ROW)
            lit[part] = self._row(numbers[part], places[part], rows[part], counts[part], saturated[part])
        return FoundShots(
            numbers, counts, rows[..., 0], rows[..., 1], rows[..., 2], lit, saturated, self.noise
        )

    def _row(
        self,
        shots: NDArray[np.int64],
        places_m: NDArray[np.float64],
        rows: NDArray[np.float64],
        counts: NDArray[np.int64],
        saturated: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        chain, laser = self._chain, self._chain.scene.laser
        first_s = self._noise.uniforms(shots, "sampling_phase") * self._interval_s - chain.gate_s
        centres_m = places_m
        if any(laser.jitter_rad):
            wandered = self._noise.normals(shots, "pointing", 2) * np.array(laser.jitter_rad)
            centres_m = places_m + chain.scene.altitude_m * np.tan(wandered)
        energy = np.ones(shots.size)
        if laser.energy_jitter:
            energy += laser.energy_jitter * self._noise.normals(shots, "energy", 1)[:, 0]
        early_s, late_s = self._tiles.spread_s(centres_m, chain.plan.radius_m, chain.scene.altitude_m)
        size = chain.receiver.spec.max_sample_count
        low, high = steps_between(lasting_s(chain.kernel), early_s, late_s, first_s, self._interval_s)
        width = int((high - low).max())
        volts, lit = self._echo.samples(centres_m, first_s + low * self._interval_s, width)
        volts *= energy[:, None]
        if self._noise.shot_noise is not None:
            self._noise.add_shot_noise(volts, low, (early_s, late_s), centres_m, first_s, energy, shots)
        pooled = self._noise.places_in_pool(shots)
        for k in range(shots.size):
            for effect in self._small:
                effect(volts[k], Draws(chain.scene.seed, int(shots[k])))
            volts[k] *= self._gain
            begin, end = max(0, int(low[k])), min(size, int(low[k]) + width)
            inside = volts[k, begin - int(low[k]) : max(end, begin) - int(low[k])]
            window, saturated[k] = self._window(int(shots[k]), pooled[k], inside, min(begin, size), size)
            found = chain.range_finder.search(window)
            counts[k] = len(found)
            rows[k, : len(found)] = found[:, :3]
            rows[k, : len(found), 0] *= self._true_interval
            rows[k, : len(found), 0] += first_s[k]
        return lit

    @property
    def noise(self) -> str:
        """Where the stationary noise comes from."""
        return self._noise.source

    def _window(
        self, shot: int, place: NDArray[np.int64], echo_v: NDArray[np.float64], begin: int, size: int
    ) -> tuple[NDArray[np.float64], int]:
        """Digitized volts of a whole window."""
        quantizer = self._chain.receiver.quantizer
        return loops().digitized(
            self._noise.stationary(shot, place, size),
            echo_v,
            begin,
            self._factors,
            self._offsets_v,
            quantizer.volts_per_count,
            quantizer.bits,
        )


def _relief(chain: Chain) -> Grid:
    scene = chain.scene
    for wanted, why in (
        (isinstance(chain.surface.relief, Grid), "ground that is no terrain model"),
        (isinstance(chain.passed, PoleFilter), "a Gaussian filter"),
        (not scene.truth.interleave.skew_s, "skew between the converters"),
        (not scene.noise.dark_windows, "recorded dark noise"),
        (not any(scene.laser.pointing_rad), "a beam off nadir"),
        (not chain.has_factor, "light that a field of view or a law of scattering weighs"),
    ):
        if not wanted:
            raise RefusedInput(f"rows of shots: {why} needs Chain.candidates")
    assert isinstance(chain.surface.relief, Grid)
    return chain.surface.relief
