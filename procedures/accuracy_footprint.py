"""Footprint to 42 samples: planned pixels, closed form, compiled loop, and relief between the posts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from msgspec import structs

from belahil import butterworth
from belahil.receiver import BELA_GRM
from procedures.accuracy_rows import Measured, Setting, short
from sim.accuracy import Accuracy
from sim.echo import GridEcho, echo, posts_error
from sim.footprint import FootprintPlan, delays, plan_footprint
from sim.kernel import Kernel
from sim.laser import Laser, beam_sigma_m, pulse_shape
from sim.reference import plane_echo
from sim.terrain import Surface, gradient_of, plane
from sim.terrain_dtm import from_array
from sim.terrain_fractal import monofractal

if TYPE_CHECKING:
    from numpy.typing import NDArray

ALTITUDE_M = 500e3
SAMPLES = 42
INTERVAL_S = BELA_GRM.digitizer.sample_interval_s
LASER = Laser()
SIGMA_M = beam_sigma_m(LASER, ALTITUDE_M)[0]
BEFORE_S = 250e-9
"""From the first sample to the mean of the delays."""

TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
UNIT = "of the peak"
PLANE_REFERENCE = "Fourier integration of pulse, filter and delays of a plane, without pixels and poles"
_FINE_M = 0.25
_EXTENT_M = 144.0  # a whole number of all the spacings below
_BATCH = 100
_SPEED_OF_LIGHT = 299792458.0

Deposit = Literal["lag4", "cic"]


def kernel(tolerance: float) -> Kernel:
    """Pulse and receiver, with tables as good as a tolerance asks for."""
    poles = butterworth.poles(BELA_GRM.cutoff_hz, BELA_GRM.order)
    return Kernel(pulse_shape(LASER), poles, tolerance=Accuracy(tolerance).kernel)


def footprint_settings() -> Iterator[Setting]:
    """List what is measured."""
    for slope_deg in (0.0, 10.0, 30.0, 60.0):
        case = f"plane, {slope_deg:g} deg"
        for tolerance in TOLERANCES:
            yield _planned(case, "planned pixels", tolerance, partial(_grid, tolerance, slope_deg, "lag4"))
        if slope_deg == 10:
            yield from _other_ways(case, slope_deg)
    yield _planned("plane, 89 deg", "planned pixels", 1e-4, partial(_grid, 1e-4, 89.0, "lag4"))
    yield _planned("plane, 89 deg", "closed form", 1e-4, partial(_closed, 1e-4, 89.0))
    for every in (2, 4, 6, 12):
        yield Setting(
            "footprint",
            "relief between posts",
            "posts as read",
            f"every {every * _FINE_M:g} m",
            f"the same made relief with posts every {_FINE_M:g} m; rms of nine places",
            UNIT,
            partial(_between_posts, every),
        )


def _other_ways(case: str, slope_deg: float) -> Iterator[Setting]:
    for tolerance in TOLERANCES[1:5]:
        yield _planned(case, "linear deposit", tolerance, partial(_grid, tolerance, slope_deg, "cic"))
    for tolerance in TOLERANCES[1:]:
        yield _planned(case, f"posts, {_BATCH} at once", tolerance, partial(_posts, tolerance))
    for tolerance in (1e-4, 1e-7):
        yield _planned(case, "closed form", tolerance, partial(_closed, tolerance, slope_deg))


def one_shot() -> NDArray[np.float64]:
    """Plan and compute one echo of a slope at the default tolerance, as a program for one shot would."""
    one, surface = kernel(1e-4), plane(10.0, 0.0, reflectance=1.0)
    plan = plan_footprint(Accuracy(1e-4), one, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    return _samples(one, surface, plan, (0.0, 0.0), -BEFORE_S, "lag4")


def first_compiled_shot() -> None:
    """Call the compiled loop once: in a fresh process this loads or compiles it."""
    posts_of_plane(1e-4)[0].samples(np.zeros((1, 2)), np.array([-BEFORE_S]))


def _planned(case: str, method: str, tolerance: float, measure: Callable[[], Measured]) -> Setting:
    setting = f"tolerance {short(tolerance, 0)}"
    return Setting("footprint", case, method, setting, PLANE_REFERENCE, UNIT, measure, tolerance)


def _grid(tolerance: float, slope_deg: float, deposit: Deposit) -> Measured:
    one = kernel(tolerance)
    surface = plane(slope_deg, 0.0, reflectance=1.0)
    plan = plan_footprint(Accuracy(tolerance), one, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    return Measured(
        _worst_of_directions(one, plan, slope_deg, deposit),
        partial(_samples, one, surface, plan, (0.0, 0.0), -BEFORE_S, deposit),
        predicted=plan.predicted_error,
        work=_work(plan),
    )


def _closed(tolerance: float, slope_deg: float) -> Measured:
    one, surface = kernel(tolerance), plane(slope_deg, 0.0, reflectance=1.0)
    plan = plan_footprint(Accuracy(tolerance), one, LASER, ALTITUDE_M, surface, INTERVAL_S, "closed form")
    return Measured(
        _worst_of_directions(one, plan, slope_deg, "lag4"),
        partial(_samples, one, surface, plan, (0.0, 0.0), -BEFORE_S, "lag4"),
        predicted=plan.predicted_error,
    )


def _work(plan: FootprintPlan) -> dict[str, int]:
    return {"pixels": plan.pixels, "bins a sample": round(INTERVAL_S / plan.bin_s)}


def _samples(
    one: Kernel,
    surface: Surface,
    plan: FootprintPlan,
    pointing_rad: tuple[float, float],
    first_s: float,
    deposit: Deposit,
) -> NDArray[np.float64]:
    light = delays(surface, LASER, ALTITUDE_M, plan, pointing_rad, align_s=first_s, deposit=deposit)
    return echo(one, light, first_s, INTERVAL_S, SAMPLES)


def _worst_of_directions(one: Kernel, plan: FootprintPlan, slope_deg: float, deposit: Deposit) -> float:
    """Worst error of slopes along the grid twice, across it, and anyhow, each at another place and phase."""
    draw = np.random.default_rng(1)
    worst = 0.0
    for azimuth_deg in (0.0, 0.0, 45.0, float(draw.uniform(0, 90))):
        gradient = gradient_of(slope_deg, azimuth_deg)
        aside_m = draw.uniform(0, 1, 2) * (plan.pixel_m or 1.0)
        below_s = -2 / _SPEED_OF_LIGHT * float(np.dot(gradient, aside_m))
        first_s = below_s - BEFORE_S + float(draw.uniform()) * INTERVAL_S
        pointing_rad = (math.atan(aside_m[0] / ALTITUDE_M), math.atan(aside_m[1] / ALTITUDE_M))
        surface = plane(slope_deg, azimuth_deg, reflectance=1.0)
        got = _samples(one, surface, plan, pointing_rad, first_s, deposit)
        centre_m = (float(aside_m[0]), float(aside_m[1]))
        worst = max(worst, _off(got, one, gradient, centre_m, first_s))
    return worst


def _off(
    got: NDArray[np.float64],
    one: Kernel,
    gradient: tuple[float, float],
    centre_m: tuple[float, float],
    first_s: float,
) -> float:
    """Return max |dV| / peak against the echo of a plane; the peak may lie between samples."""
    times_s = first_s + INTERVAL_S * np.arange(SAMPLES, dtype=np.float64)
    true = plane_echo(one, gradient, centre_m, SIGMA_M, ALTITUDE_M, times_s)
    about_s = times_s[np.abs(true).argmax()] + INTERVAL_S * np.linspace(-1, 1, 33)
    peak = np.abs(plane_echo(one, gradient, centre_m, SIGMA_M, ALTITUDE_M, about_s)).max()
    return float(np.abs(got - true).max() / peak)


def posts_of_plane(tolerance: float) -> tuple[GridEcho, FootprintPlan]:
    """Give a plane of 10 degrees by posts as coarse as a tolerance allows."""
    one, wanted = kernel(tolerance), Accuracy(tolerance)
    everywhere = plane(10.0, 0.0, reflectance=1.0)
    coarse = plan_footprint(wanted, one, LASER, ALTITUDE_M, everywhere, INTERVAL_S, "grid")
    spacing_m = 0.999 * coarse.pixel_m  # a little below, so that the plan does not halve it
    half = math.ceil(coarse.radius_m / spacing_m) + 4
    along_m = gradient_of(10.0)[0] * spacing_m * np.arange(-half, half + 1)
    surface = from_array(np.tile(along_m, (2 * half + 1, 1)), spacing_m, reflectance=1.0)
    plan = plan_footprint(wanted, one, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    return GridEcho(surface, LASER, ALTITUDE_M, plan, one, INTERVAL_S, SAMPLES), plan


def _posts(tolerance: float) -> Measured:
    """Many shots in one call of the compiled loop."""
    loop, plan = posts_of_plane(tolerance)
    gradient = gradient_of(10.0)
    draw = np.random.default_rng(2)
    centres_m = draw.uniform(-0.5, 0.5, (_BATCH, 2)) * plan.pixel_m
    below_s = -2 / _SPEED_OF_LIGHT * gradient[0] * centres_m[:, 0]
    first_s = below_s - BEFORE_S + draw.uniform(size=_BATCH) * INTERVAL_S
    got, _ = loop.samples(centres_m, first_s)
    # Each shot is seen from above its own place: a plane through the origin, so much lower.
    errors = [
        _off(got[shot], kernel(tolerance), gradient, (0.0, 0.0), float(first_s[shot] - below_s[shot]))
        for shot in range(4)
    ]
    return Measured(
        max(errors),
        lambda: loop.samples(centres_m, first_s),
        _BATCH,
        plan.predicted_error,
        _work(plan),
    )


def _between_posts(every: int) -> Measured:
    """What is lost when only some posts of a relief are known: by the model, not by the arithmetic."""
    one, wanted = kernel(1e-4), Accuracy(1e-4)
    fine = _relief()
    x_m = np.arange(fine.bounds[0], fine.bounds[1] + _FINE_M / 2, every * _FINE_M)
    heights_m = fine.height(x_m[None, :], x_m[:, None])
    coarse = from_array(heights_m, every * _FINE_M, reflectance=1.0)
    plans = [
        plan_footprint(wanted, one, LASER, ALTITUDE_M, ground, INTERVAL_S, "grid")
        for ground in (fine, coarse)
    ]
    missed, foretold = [], []
    for x, y in itertools.product((-19.3, 0.4, 18.8), repeat=2):
        place = structs.replace(LASER, pointing_rad=(x / ALTITUDE_M, y / ALTITUDE_M))
        first_s = -2 / _SPEED_OF_LIGHT * float(fine.height(x, y)) - BEFORE_S
        true, got = (
            echo(one, delays(ground, place, ALTITUDE_M, plan, align_s=first_s), first_s, INTERVAL_S, SAMPLES)
            for ground, plan in zip((fine, coarse), plans, strict=True)
        )
        missed.append(float(np.abs(got - true).max() / np.abs(true).max()))
        foretold.append(posts_error(coarse, place, ALTITUDE_M, plans[1], one, INTERVAL_S))
    return Measured(
        float(np.sqrt(np.mean(np.square(missed)))),
        partial(_samples, one, coarse, plans[1], (0.0, 0.0), -BEFORE_S, "lag4"),
        predicted=float(np.sqrt(np.mean(np.square(foretold)))),
        work=_work(plans[1]),
    )


@lru_cache(maxsize=1)
def _relief() -> Surface:
    return monofractal(extent_m=_EXTENT_M, spacing_m=_FINE_M, slope_deg=5.0, reflectance=1.0)
