"""Orbit campaign: shares of time beside direct sampling and closed forms, its copies, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec import structs

from belahil.chunks import work
from belahil.cli.main import main
from belahil.errors import RefusedInput
from procedures import energy_parts, range_ground, range_places
from procedures.campaign_orbit import DRIFTED, LOWERED, NOMINAL, OrbitOptions, plan
from procedures.energy_cells import energy_cells
from procedures.energy_parts import read_results
from procedures.orbit_crossings import crossing
from procedures.orbit_curves import COPIES, LEAST_PFD, Nodes, along, logit, nodes, probability
from procedures.orbit_points import SUN_PARTS, sun_conditions, sun_level_v
from procedures.orbit_shares import (
    LEVELS,
    LIGHTS,
    Arc,
    numbers,
    share_below,
    sun_parts,
    weighted_quantiles,
)
from procedures.range_scenes import DISTANCES_AU, base_scene, text_dark_rms_v
from procedures.range_table import cells
from sim.chain import Chain
from sim.draws import Draws
from sim.orbit import Orbit
from sim.scene_tables import Sun

if TYPE_CHECKING:
    from collections.abc import Iterator

ORBIT = Orbit(480e3, 1500e3)
LEVEL_V = np.array([sun_level_v(0.8e-3, 1.5e-3, part) for part in SUN_PARTS])
SIGMAS = 4.5


def logits_at(altitude_m: np.ndarray, level_v: np.ndarray, middle_m: float = 1000e3) -> np.ndarray:
    """A logit that grows by 1 in 60 km, and is straight in the noise: 100 km lower for 0.5 mV more."""
    return np.asarray((altitude_m - middle_m) / 60e3 + (level_v - 0.8e-3) * (100e3 / 0.5e-3) / 60e3)


def log_errors_at(altitude_m: np.ndarray) -> np.ndarray:
    return np.log(0.2) + np.asarray(altitude_m - 500e3) / 400e3


def log_energies_at(altitude_m: np.ndarray) -> np.ndarray:
    return np.log(0.1) + np.asarray(altitude_m - 500e3) / 300e3


def made(middle_m: float = 1000e3, altitude_m: np.ndarray | None = None, scatter: float = 0.0) -> Nodes:
    """Curves as these, the logit of each copy moved as a whole."""
    at_m = np.arange(200e3, 1501e3, 50e3) if altitude_m is None else altitude_m
    curve = logits_at(at_m[:, None], LEVEL_V, middle_m)
    moved = scatter * np.random.default_rng(1).standard_normal(COPIES)
    every = curve + np.concatenate([[0.0], moved])[:, None, None]
    errors = np.broadcast_to(log_errors_at(at_m)[:, None], (1 + COPIES, *curve.shape))
    energies = np.broadcast_to(log_energies_at(at_m)[:, None], (1 + COPIES, *curve.shape))
    return Nodes(at_m, LEVEL_V, every, errors, energies, np.ones(LEVEL_V.size, dtype=bool))


def whole(orbit: Orbit = ORBIT) -> Arc:
    return Arc(orbit, orbit.apoapsis_m)


# ---- shares


@pytest.mark.parametrize("light", ["day", "night"])
@pytest.mark.parametrize("top_m", [1500e3, 900e3])
def test_shares_are_those_of_equal_times(light: str, top_m: float) -> None:
    # given a turn in a hundred thousand equal times
    mean_rad = (np.arange(100_000) + 0.5) * (2 * np.pi / 100_000)
    at_m = ORBIT.altitude_m(mean_rad)
    false = probability(logits_at(at_m, LEVEL_V[0 if light == "night" else -1]))
    fired = at_m < top_m

    told = numbers(Arc(ORBIT, top_m), made(), light).told()

    # then each number is a plain mean; with 240 steps of time a trapezoid is some 1e-5 off
    for level, one in zip(LEVELS, told.below, strict=True):
        assert one.value == pytest.approx(np.mean(fired & (false < level)), abs=1e-4)
    assert one.unit == told.good.unit == "1"
    precise = fired & (np.exp(log_energies_at(at_m)) < 0.3)
    assert told.energy.value == pytest.approx(precise.mean(), abs=1e-4)
    good = np.where(fired, 1 - false, 0.0)
    assert told.good.value == pytest.approx(good.mean(), abs=1e-4)
    errors_m = np.exp(log_errors_at(at_m))
    assert told.error is not None
    assert told.error.value == pytest.approx(math.sqrt((good @ errors_m**2) / good.sum()), rel=1e-3)
    order = np.argsort(errors_m)
    reached = np.cumsum(good[order]) / good.sum()
    for part, one in zip((0.5, 0.9), told.error_below, strict=True):
        direct_m = errors_m[order][np.searchsorted(reached, part)]
        # (an error at one of the times, and 1 % is a step of them)
        assert one.value == pytest.approx(direct_m, rel=0.02)


@pytest.mark.parametrize("latitude_deg", [0.0, 35.0, -90.0])
def test_the_mean_over_local_times_is_that_of_random_ones(latitude_deg: float) -> None:
    # given an orbit in space, over the poles, and the Sun anywhere over the equator
    draw = np.random.default_rng(7)
    count = 100_000
    mean_rad = draw.uniform(0, 2 * np.pi, count)
    along_rad = ORBIT.true_anomaly_rad(mean_rad) + math.radians(latitude_deg)
    below = np.stack([np.cos(along_rad), np.zeros(count), np.sin(along_rad)])
    sun_rad = draw.uniform(0, 2 * np.pi, count)
    towards = np.stack([np.cos(sun_rad), np.sin(sun_rad), np.zeros(count)])
    lit = np.maximum((below * towards).sum(axis=0), 0.0)
    level_v = np.sqrt(LEVEL_V[0] ** 2 + lit * (LEVEL_V[-1] ** 2 - LEVEL_V[0] ** 2))
    false = probability(logits_at(ORBIT.altitude_m(mean_rad), level_v))

    arc = Arc(ORBIT, 1500e3, math.radians(latitude_deg))
    told = numbers(arc, made(), "local time").told()

    chance = SIGMAS * 0.5 / math.sqrt(count)
    for level, one in zip(LEVELS, told.below, strict=True):
        # 24 places of the Sun hold more than 1e-3 together
        assert one.value == pytest.approx(np.mean(false < level), abs=chance + 1e-3)
    assert told.good.value == pytest.approx(np.mean(1 - false), abs=chance + 1e-3)
    # and half of the time is night
    assert (lit == 0).mean() == pytest.approx(0.5, abs=chance)
    assert sun_parts(arc).mean() == pytest.approx(lit[lit > 0].mean(), rel=0.02)


@pytest.mark.parametrize("light", ["day", "night"])
def test_a_share_is_the_time_below_its_crossing(light: str) -> None:
    curves = made()

    told = numbers(whole(), curves, light).told()

    for level, share in zip(LEVELS, told.below, strict=True):
        found = crossing(curves, light, level)
        assert found.status == "crosses"
        assert found.altitude is not None
        noise_v = LEVEL_V[0 if light == "night" else -1]
        true_m = 1000e3 + 60e3 * float(logit(level)) - (noise_v - 0.8e-3) * 100e3 / 0.5e-3
        # straight in logit, as the curve is
        assert found.altitude.value == pytest.approx(true_m, abs=1.0)
        assert share.value == pytest.approx(ORBIT.time_below(true_m), abs=1e-4)


def test_what_moves_a_curve_moves_its_crossing_and_its_share() -> None:
    # given copies whose logit is moved by 0.3, which is 18 km
    curves = made(scatter=0.3)
    spread = float((curves.logit[1:, 0, 0] - curves.logit[0, 0, 0]).std())

    found, told = crossing(curves, "night", 0.5), numbers(whole(), curves, "night").told()

    assert found.altitude is not None
    assert found.altitude.standard_uncertainty == pytest.approx(60e3 * spread, rel=1e-3)
    slope = (ORBIT.time_below(1001e3) - ORBIT.time_below(999e3)) / 2e3
    assert told.below[1].standard_uncertainty == pytest.approx(slope * 60e3 * spread, rel=0.02)


def test_interpolation_over_few_altitudes_tells_what_it_leaves_open() -> None:
    # given a logit that bends, computed in steps of 200 km
    def bent(altitude_m: np.ndarray) -> np.ndarray:
        return np.asarray(8 * np.log(altitude_m / 900e3))

    at_m = np.arange(300e3, 1501e3, 200e3)
    curves = replace(made(altitude_m=at_m), logit=np.broadcast_to(bent(at_m)[:, None], (49, 7, 5)))

    told = numbers(whole(), curves, "night").told()

    for level, one in zip(LEVELS, told.below, strict=True):
        true_m = 900e3 * math.exp(float(logit(level)) / 8)
        off = one.value - ORBIT.time_below(true_m)
        assert one.standard_uncertainty > 0
        # three times as much as the uncertainty, which knows no bend but that of the points
        assert abs(off) <= 3 * one.standard_uncertainty + 1e-4


def test_differences_of_orbits_are_told_copy_by_copy() -> None:
    curves = made(scatter=0.3)
    nominal, lowered = (numbers(whole(one), curves, "night") for one in (ORBIT, Orbit(200e3, 1500e3)))

    added = lowered.less(nominal).told()

    assert added.good.value == pytest.approx(lowered.told().good.value - nominal.told().good.value, rel=1e-12)
    # what moves both together is not counted twice
    assert added.good.standard_uncertainty < 0.3 * nominal.told().good.standard_uncertainty


# ---- degenerate inputs


@pytest.mark.parametrize(("altitude_m", "share"), [(700e3, 1.0), (1300e3, 0.0)])
def test_a_circular_orbit_is_of_one_kind(altitude_m: float, share: float) -> None:
    circle = Orbit(altitude_m, altitude_m)

    for curves in (made(), made(altitude_m=np.array([altitude_m]))):
        told = numbers(whole(circle), curves, "night").told()

        assert [one.value for one in told.below[:2]] == [share, share]
        assert told.good.value == pytest.approx(1 - probability(logits_at(altitude_m, LEVEL_V[0])), rel=1e-6)
        assert told.error is not None
        assert told.error.value == pytest.approx(math.exp(log_errors_at(altitude_m)), rel=1e-6)


@pytest.mark.parametrize(
    ("middle_m", "status", "share"), [(9e6, "always_below", 1.0), (-9e6, "always_above", 0.0)]
)
def test_a_curve_that_never_crosses_has_a_status(middle_m: float, status: str, share: float) -> None:
    curves = made(middle_m)
    curves = replace(curves, logit=np.clip(curves.logit, logit(0.0), logit(1.0)))

    for level in LEVELS:
        found = crossing(curves, "day", level)
        assert (found.status, found.altitude) == (status, None)
    for light in LIGHTS:
        told = numbers(whole(), curves, light).told()
        assert [one.value for one in told.below] == [pytest.approx(share, abs=1e-15)] * 3
        assert max(one.standard_uncertainty for one in told.below) < 1e-15


def test_a_curve_that_comes_back_is_below_in_two_parts() -> None:
    curves = made(altitude_m=np.array([400e3, 800e3, 1100e3, 1600e3]))
    logits = np.array([-4.0, 3.0, -4.0, 4.0])[:, None]
    curves = replace(curves, logit=np.broadcast_to(logits, (1 + COPIES, 4, LEVEL_V.size)))

    found, told = crossing(curves, "night", 0.5), numbers(whole(), curves, "night").told()

    assert found.status == "crosses_more_than_once"
    mean_rad = (np.arange(50_000) + 0.5) * (np.pi / 50_000)
    direct = along(curves.altitude_m, curves.logit[:1], ORBIT.altitude_m(mean_rad))[0, :, 0] < 0
    assert told.below[1].value == pytest.approx(direct.mean(), abs=1e-3)
    assert told.below[1].value < 0.9


def test_without_detections_there_is_no_error() -> None:
    curves = replace(made(), known=np.zeros(LEVEL_V.size, dtype=bool))

    told = numbers(whole(), curves, "day").told()

    assert told.error is None
    assert told.error_below == ()
    assert told.energy.value == 0


def test_a_limit_below_the_orbit_leaves_nothing() -> None:
    told = numbers(Arc(ORBIT, 300e3), made(), "day").told()

    assert [one.value for one in (*told.below, told.good)] == [0.0] * 4
    assert told.error is None


@pytest.mark.parametrize(
    ("values", "share"), [([0, 0, 0], 0.0), ([-1, -1, -1], 1.0), ([-1, 1, 1], 0.25), ([-1, 3, -1], 0.25)]
)
def test_parts_below_zero(values: list[float], share: float) -> None:
    assert share_below(np.array(values, dtype=float), 0.0) == pytest.approx(share)


def test_quantiles_follow_weights() -> None:
    values, weights = np.array([[3.0, 1.0, 2.0]]), np.array([[8.0, 1.0, 1.0]])

    assert weighted_quantiles(values, weights, (0.05, 0.15, 0.5))[:, 0].tolist() == [1.0, 2.0, 3.0]


# ---- curves out of draws


@pytest.mark.parametrize("sun", ["mean", "perihelion"])
@pytest.mark.parametrize("part", [0.25, 0.75])
def test_the_noise_under_a_low_sun_is_that_of_its_chain(part: float, sun: str) -> None:
    found = {(one.light, one.reflectance): one.noise_rms_v for one in sun_conditions((0.17, 0.3), sun)}

    base, dark_v = base_scene(), text_dark_rms_v(base_scene(), sun)
    scene = structs.replace(
        base,
        sun=Sun(distance_au=DISTANCES_AU[sun], incidence_deg=math.degrees(math.acos(part))),
        surface=structs.replace(base.surface, kind="plane", reflectance=0.3),
        noise=structs.replace(base.noise, dark_rms_v=dark_v),
    )
    assert found["night", 0.3] == found["night", 0.17] == pytest.approx(dark_v, rel=1e-12)
    assert found[f"sun {part:g}", 0.3] == pytest.approx(Chain(scene).noise_rms_v, rel=1e-6)


@pytest.fixture
def two_terrains(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Two fractals in the place of eleven, and a calibration of the energy from few places."""
    monkeypatch.setattr(range_ground, "LEVELS", 2)
    monkeypatch.setattr(energy_parts, "CALIBRATION_ALTITUDES_M", (400e3, 1200e3))
    monkeypatch.setattr(energy_parts, "SLOPES_DEG", (0.0, 20.0))
    forget_grounds()
    yield
    forget_grounds()


def forget_grounds() -> None:
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()


def test_copies_scatter_as_the_uncertainties_say(two_terrains: None) -> None:
    # given points at two altitudes
    options = OrbitOptions(
        1100.0,
        1100.0,
        800.0,
        slopes_deg=(10.0,),
        reflectances=(0.17,),
        echoes=40,
        repeats=2,
        noise_windows=60,
        step_km=500.0,
    )
    assert options.altitudes_m == (800e3, 1000e3, 1400e3)
    whole_plan = plan(options)
    chunks = whole_plan.chunks[1:]
    results = [work(one.work, one.given) for one in chunks]
    found, convert = read_results(replace(whole_plan, chunks=chunks), results)
    laws, points = found.laws(), found.of("orbit")
    told = [list(zip(cells(one, laws), energy_cells(one, laws, convert), strict=True)) for one in points]

    curves = nodes(points, told, laws, 0.17, Draws(1, 0))

    assert curves.altitude_m.tolist() == [800e3, 1000e3, 1400e3]
    # then copies have the spread that each cell has, to what 48 of them tell
    allowed = SIGMAS / math.sqrt(2 * (COPIES - 1))
    for at, row in enumerate(told):
        for level, (cell, energy) in enumerate(row):
            false = probability(curves.logit[:, at, level])
            assert false[0] == pytest.approx(np.clip(cell.pfd.value, LEAST_PFD, 1 - LEAST_PFD), rel=1e-9)
            if 0.05 < cell.pfd.value < 0.95:
                assert false[1:].std() == pytest.approx(cell.pfd.standard_uncertainty, rel=allowed)
            assert cell.spread is not None
            relative = cell.spread.standard_uncertainty / cell.spread.value
            assert curves.log_error[0, at, level] == pytest.approx(math.log(cell.spread.value))
            assert curves.log_error[1:, at, level].std() == pytest.approx(relative, rel=allowed)
            error = energy.error()
            assert error is not None
            assert curves.log_energy[0, at, level] == pytest.approx(math.log(error.value))
            relative = error.standard_uncertainty / error.value
            assert curves.log_energy[1:, at, level].std() == pytest.approx(relative, rel=allowed)
    # and by day more is false than by night
    assert (np.diff(curves.logit[0, 1:, :], axis=1) > 0).all()


# ---- options, plan and command


def test_the_lowered_orbits_keep_period_or_apoapsis() -> None:
    orbits = OrbitOptions().orbits()

    assert list(orbits) == [NOMINAL, DRIFTED, LOWERED]
    assert orbits[DRIFTED] == Orbit(200e3, 1780e3)
    assert orbits[DRIFTED].period_s == pytest.approx(orbits[NOMINAL].period_s, rel=1e-15)
    assert orbits[LOWERED] == Orbit(200e3, 1500e3)
    assert list(OrbitOptions(200.0, 400.0).orbits()) == [NOMINAL]


def test_altitudes_hold_the_ends_of_all_orbits() -> None:
    assert OrbitOptions().altitudes_m == (*(100e3 * n for n in range(2, 18)), 1780e3)
    assert OrbitOptions(180.0, 180.0).altitudes_m == (180e3,)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"periapsis_km": 1500.0, "apoapsis_km": 480.0}, "1500 x 480 km: the periapsis must"),
        ({"periapsis_km": 100.0}, "periapsis-km 100: allowed is 150 to 3000"),
        ({"apoapsis_km": 2900.0}, "apoapsis-km 3180"),
        ({"lowered_periapsis_km": 480.0}, "must be below the nominal one"),
        ({"rate_hz": 0.0}, "rate-hz"),
        ({"reflectances": ()}, "at least one"),
        ({"reflectances": (1.5,)}, "reflectances 1.5"),
        ({"slopes_deg": (-1.0,)}, "slopes-deg -1"),
        ({"sun": "aphelion"}, "mean, perihelion"),
        ({"echoes": 0}, "echoes 0"),
        ({"limits_km": (math.nan,)}, "limits-km nan"),
        ({"periapsis_latitude_deg": 91.0}, "latitude"),
    ],
)
def test_options_that_cannot_be_are_refused(given: dict[str, object], why: str) -> None:
    with pytest.raises(RefusedInput, match=why):
        OrbitOptions(**given)  # type: ignore[arg-type]


def test_the_command_tells_shares_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], two_terrains: None
) -> None:
    out = tmp_path / "orbit"
    small = "--step-km 500 --slopes-deg 10 --reflectances 0.17 --echoes 12 --repeats 2 --noise-windows 30"
    small += " --calibration-echoes 10"

    assert main(["campaign", "orbit", "--out", str(out), "--workers", "1", *small.split()]) == 0

    told = capsys.readouterr().out
    assert "nominal: 480 x 1500 km, 2.361 h, 85012 shots a turn" in told
    results = json.loads((out / "summary.json").read_text())["results"]
    assert len(results["shares"]) == 9
    day, night, mean = (one for one in results["shares"] if one["orbit"] == NOMINAL)
    # by day fewer than by night, and the mean over local times between them; none above all shots
    for key in ("below_5", "below_50", "good"):
        assert 0 < day[key]["value"] < mean[key]["value"] < night[key]["value"] <= 1
    for one in results["shares"]:
        assert one["below_5"]["value"] <= one["below_50"]["value"] <= one["below_90"]["value"]
        assert one["good"]["standard_uncertainty"] > 0
        assert one["ranges"]["value"] == pytest.approx(
            one["good"]["value"] * 10 * Orbit(*(1e3 * x for x in SIZES[one["orbit"]])).period_s
        )
    assert 0 < day["energy_below_30"]["value"] < night["energy_below_30"]["value"] <= 1
    limit = results["limits"][0]
    assert limit["time_share"] == pytest.approx(ORBIT.time_below(1050e3))
    assert results["limited"][0]["good"]["value"] < day["good"]["value"]
    assert not results["converter"]["clips"]
    assert (out / "figure-orbit.png").stat().st_size > 10_000
    # and going on with a finished campaign tells the same
    assert main(["campaign", "orbit", "--resume", str(out)]) == 0
    assert capsys.readouterr().out == told


SIZES = {NOMINAL: (480.0, 1500.0), DRIFTED: (200.0, 1780.0), LOWERED: (200.0, 1500.0)}


def test_a_periapsis_above_the_apoapsis_is_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "campaign",
        "orbit",
        "--periapsis-km",
        "1500",
        "--apoapsis-km",
        "480",
        "--out",
        str(tmp_path / "no"),
    ]

    assert main(words) == 2
    assert "1500 x 480 km" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()
