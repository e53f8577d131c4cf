"""Energy campaign: energies of echoes beside closed forms and whole shots, statistics, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from belahil.chunks import work
from belahil.cli.main import main
from belahil.errors import RefusedInput
from belahil.values import Estimate
from procedures import (
    campaign_energy,
    campaign_reflectance,
    energy_parts,
    range_chunks,
    range_ground,
    range_places,
)
from procedures.campaign_energy import EnergyErrorOptions, plan
from procedures.echo_energy import Conversion, PlainPulses, conversion, plain_pulses
from procedures.echo_hits import FALSE_M, corrected_m, echo_hits
from procedures.energy_cells import EnergyCell, EnergyError, energy_cells, energy_draws
from procedures.energy_curves import at_altitude, crossing
from procedures.energy_model import energy_per_volt_second
from procedures.energy_statements import statements
from procedures.energy_statistics import Moments, moments, quantiles, ratio, worth
from procedures.local_draws import LocalDraws, local_draws
from procedures.noise_clusters import LevelLaws, fit_clusters
from procedures.range_ground import GroundKey
from procedures.range_places import footprints
from procedures.range_points import Drawn
from procedures.range_scenes import Condition, base_scene, cell_scene, conditions, noise_scene
from procedures.window_peaks import piece_peaks, refined, window_areas
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.draws import Draws
from sim.link_budget import link_budget
from sim.rfm import RangeFinder
from sim.scene import Scene, as_toml
from sim.shot_rows import ShotRows
from sim.terrain import Surface
from tests.test_paper_statements import ROWS

SIGMAS = 4.5
"""Standard errors within which chance stays, in all but some 1e-5 of cases."""
PLANE = GroundKey("plane")


def steady_scene(altitude_m: float) -> Scene:
    """A laser whose pulses all have the same energy: then the true energy is the link budget's."""
    scene = base_scene(altitude_m)
    return structs.replace(scene, laser=structs.replace(scene.laser, energy_jitter=0.0))


@lru_cache(maxsize=4)
def drawn(altitude_m: float, count: int, repeats: int = 1) -> tuple[Chain, LocalDraws]:
    scene = steady_scene(altitude_m)
    land, at = footprints(asdict(PLANE), 12.5e-6 * altitude_m, (9.0, 11.0), count, Draws(3, 0))
    chain = Chain(scene, Accuracy(1e-3), land.surface)
    late_s = float(range_chunks.correction(scene).at(50e-9))
    return chain, local_draws(chain, at, late_s, Draws(3, 1), repeats)


@lru_cache(maxsize=1)
def plane_conversion() -> Conversion:
    """Of planes from level to steep, without noise."""
    pulses = []
    for altitude_m in (500e3, 1100e3):
        for slope_deg in (0.0, 10.0, 25.0):
            made = range_chunks.plain_echoes(
                as_toml(base_scene(altitude_m)),
                asdict(GroundKey("plane", tilt_deg=slope_deg)),
                (max(0.0, slope_deg - 1), slope_deg + 1),
                40,
                1,
                0,
            )
            pulses.append(PlainPulses(**made))
    return conversion(pulses, base_scene())


# ---- echoes


def test_areas_of_correction_windows_are_trapezoids() -> None:
    finder, pieces = RangeFinder.of(base_scene().receiver_spec), np.random.default_rng(1).normal(size=(6, 90))
    first = np.random.default_rng(2).integers(0, 48, (6, 3))

    found = window_areas(finder, pieces, first)

    for n, k in np.ndindex(first.shape):
        expected = np.trapezoid(pieces[n, first[n, k] : first[n, k] + 42])
        assert found[n, k] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("noise_rms_v", [0.0, 1.5e-3])
def test_hits_have_amplitude_and_area_of_the_peak_that_is_told(noise_rms_v: float) -> None:
    chain, draws = drawn(900e3, 30)
    finder, curve = chain.range_finder, range_chunks.correction(chain.scene)

    hits = echo_hits(draws, 0.17, noise_rms_v, 1e-9, finder, curve)

    # then they are those of the one of all peaks that has the same arrival
    volts = draws.windows(0.17, noise_rms_v)
    peaks = piece_peaks(finder, volts, (draws.middle - 8, draws.middle + 8), 4)
    centre, _, amplitude, first = refined(finder, volts, peaks.lag)
    arrival_s = (draws.first_s - draws.true_s)[draws.of_echo, None] + draws.interval_s * centre
    assert hits.hit[:, 0].any()
    for n in np.flatnonzero(hits.hit[:, 0]):
        k = int(np.argmin(np.abs(arrival_s[n] - hits.arrival_s[n, 0])))
        if abs(arrival_s[n, k] - hits.arrival_s[n, 0]) > 1e-10:
            continue  # beyond the stretch that was searched here
        assert hits.amplitude_v[n, 0] == pytest.approx(amplitude[n, k], rel=1e-5)
        samples = volts[n, int(first[n, k]) : int(first[n, k]) + 42]
        assert hits.area_v_s[n, 0] == pytest.approx(12.5e-9 * np.trapezoid(samples), rel=1e-5, abs=1e-16)
    assert not hits.amplitude_v[~hits.hit].any()


@pytest.mark.parametrize("altitude_m", [500e3, 1200e3])
def test_the_light_has_the_energy_of_the_link_budget(altitude_m: float) -> None:
    chain, draws = drawn(altitude_m, 20)
    white = structs.replace(chain.scene, surface=structs.replace(chain.scene.surface, reflectance=1.0))
    # a beam cut at 4.5 standard deviations has lost 4e-5 of its light
    assert draws.optical_j == pytest.approx(link_budget(white).energy_j, rel=1e-4)


def test_energy_jitter_is_in_the_truth() -> None:
    made = range_chunks.plain_echoes(as_toml(base_scene(500e3)), asdict(PLANE), (9.0, 11.0), 2000, 1, 0)
    spread = made["optical_j"].std() / made["optical_j"].mean()
    assert spread == pytest.approx(0.014, rel=SIGMAS / math.sqrt(2 * 2000))


@pytest.mark.parametrize("altitude_m", [600e3, 900e3])
def test_an_area_tells_the_energy_as_the_closed_form_does(altitude_m: float) -> None:
    # given that a low-pass keeps areas: what one volt second at the cut is in optical energy
    chain, draws = drawn(altitude_m, 20)
    pulses = plain_pulses(draws, chain.range_finder)
    by_area_j = pulses.plain_area_v_s * energy_per_volt_second(chain.scene) / chain.scene.gain
    assert by_area_j == pytest.approx(pulses.optical_j, rel=2e-3)
    # then the calibrated conversions tell it too, to what they leave of single pulses
    convert = plane_conversion()
    given = pulses.plain_amplitude_v, pulses.plain_width_s, pulses.plain_area_v_s
    for integral, most in (("gaussian", 0.01), ("window", 0.003)):
        assert convert.energy_j(integral, *given) == pytest.approx(pulses.optical_j, rel=most)
    # and the published lines lie within their own 14 % and what the scale is worth
    for integral in ("gaussian", "window"):
        assert convert.published_j(integral, *given) == pytest.approx(pulses.optical_j, rel=0.17)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_energies_are_proportional_to_the_pulse(factor: float) -> None:
    chain, draws = drawn(900e3, 20)
    one = plain_pulses(draws, chain.range_finder)
    for integral in ("gaussian", "window"):
        energy_j = plane_conversion().energy_j
        plain = energy_j(integral, one.plain_amplitude_v, one.plain_width_s, one.plain_area_v_s)
        scaled = energy_j(
            integral, factor * one.plain_amplitude_v, one.plain_width_s, factor * one.plain_area_v_s
        )
        assert scaled == pytest.approx(factor * plain, rel=1e-12)


def test_a_calibration_from_nothing_is_refused() -> None:
    empty = np.zeros(0)
    with pytest.raises(RefusedInput, match="from 0 pulses"):
        conversion([PlainPulses(empty, empty, empty, empty)], base_scene())


# ---- statistics


@pytest.mark.parametrize(("repeats", "seed"), [(1, 1), (5, 2)])
def test_moments_have_the_uncertainty_with_which_they_scatter(repeats: int, seed: int) -> None:
    # given errors with a part that all shots of an echo share, and weights
    stream, found = np.random.default_rng(seed), []
    for _ in range(300):
        shared = np.repeat(stream.normal(0.1, 0.2, 150), repeats)
        errors = (shared + stream.normal(0.0, 0.3, shared.size))[:, None]
        made = moments(errors, np.full(errors.shape, 0.3), 150)
        assert made is not None
        found.append((made.rms, made.mean, made.spread))
    # then each is right on the average, and scatters as it tells
    truth = math.hypot(0.2, 0.3)
    for ones, expected in zip(zip(*found, strict=True), (math.hypot(truth, 0.1), 0.1, truth), strict=True):
        values = np.array([one.value for one in ones])
        told = np.mean([one.standard_uncertainty for one in ones])
        assert values.mean() == pytest.approx(expected, abs=SIGMAS * values.std() / math.sqrt(300) + 0.003)
        assert values.std() == pytest.approx(told, rel=SIGMAS / math.sqrt(2 * 300))


def test_a_ratio_of_errors_of_the_same_echoes_is_known_better() -> None:
    stream = np.random.default_rng(4)
    errors, weights = stream.normal(size=(400, 1)), np.ones((400, 1))
    one, twice = moments(errors, weights, 400), moments(2 * errors, weights, 400)
    other = moments(stream.normal(size=(400, 1)), weights, 400)
    assert one is not None
    assert twice is not None
    assert other is not None
    assert ratio(twice, one).value == pytest.approx(2)
    assert ratio(twice, one).standard_uncertainty == pytest.approx(0, abs=1e-9)
    assert ratio(one, other).standard_uncertainty == pytest.approx(math.sqrt(2 / 800), rel=0.2)


@pytest.mark.parametrize(
    ("weights", "expected"), [([1.0] * 8, 8.0), ([1.0] * 7 + [1e-9], 7.0), ([0.0] * 8, 0.0)]
)
def test_few_echoes_have_no_moments(weights: list[float], expected: float) -> None:
    given = np.array(weights)[:, None]
    assert worth(given, 8) == pytest.approx(expected)
    assert (moments(np.arange(8.0)[:, None], given, 8) is None) == (expected < 8)


@given(st.lists(st.integers(1, 6), min_size=1, max_size=30), st.floats(0.01, 0.99))
def test_weighted_quantiles_are_those_of_repeated_values(counts: list[int], level: float) -> None:
    values = np.sin(np.arange(len(counts)))
    found = quantiles(values[:, None], np.array(counts, dtype=float)[:, None], (level,))[0]
    repeated = np.sort(np.repeat(values, counts))
    # the smallest value with at least so many at or below it, but for rounding of the sum
    place = level * repeated.size
    assert found in {repeated[max(0, math.ceil(place + shift) - 1)] for shift in (-1e-9, 1e-9)}


@given(st.floats(0.05, 0.8), st.floats(1e-7, 1e-5))
def test_a_curve_that_is_exponential_crosses_where_it_must(level: float, pace: float) -> None:
    places = np.arange(400e3, 1501e3, 100e3)
    curve = [(float(at), Estimate(0.1 * math.exp(pace * (at - 400e3)), 0.0)) for at in places]
    expected = 400e3 + math.log(level / 0.1) / pace
    found = crossing(curve, level)
    if level <= 0.1:
        assert found.status == "above"
    elif expected > 1500e3:
        assert found.status == "below"
    else:
        assert found.altitude is not None
        assert found.altitude.value == pytest.approx(expected, rel=1e-9)
        again = at_altitude(curve, found.altitude.value)
        assert again is not None
        assert again.value == pytest.approx(level, rel=1e-9)


def test_a_crossing_has_the_uncertainty_with_which_it_scatters() -> None:
    stream, places = np.random.default_rng(5), (500e3, 600e3, 700e3)
    values = np.array([0.1, 0.2, 0.4])
    found = []
    for _ in range(2000):
        noisy = values * np.exp(stream.normal(0.0, 0.02, 3))
        curve = [(at, Estimate(v, 0.02 * v)) for at, v in zip(places, noisy, strict=True)]
        found.append(crossing(curve, 0.3).altitude)
    told = np.array([one.standard_uncertainty for one in found if one is not None])
    scatter = np.std([one.value for one in found if one is not None])
    assert told.mean() == pytest.approx(scatter, rel=SIGMAS / math.sqrt(2 * 2000) + 0.02)


def test_no_curve_has_no_crossing() -> None:
    assert crossing([], 0.3).as_json() == {"status": "not_known", "altitude": None}
    assert at_altitude([], 9e5) is None


# ---- statements


def cell(altitude_m: float, slope_deg: float, light: str, reflectance: float, rms: float) -> EnergyCell:
    """By hand: errors of E_G with a mean of 0.1, those of E_CW twice as large."""
    told = Moments(Estimate(rms, 0.001), Estimate(0.1, 0.001), Estimate(rms - 0.02, 0.001), np.zeros(9))
    one = EnergyError(told, Estimate(0.0, 0.0), 0.0, np.zeros(5))
    condition = Condition("mean", light, reflectance, 1e-3)
    errors = {("gaussian", "own"): one}
    return EnergyCell(altitude_m, slope_deg, condition, Estimate(0.1, 0.0), errors, Estimate(2.0, 0.01))


def test_statements_are_told_from_the_cells() -> None:
    # given errors that grow with the altitude and the slope, on dark ground more
    cells = [
        cell(altitude_m, slope_deg, light, reflectance, base * factor * (1.2 if reflectance < 0.1 else 1.0))
        for altitude_m, base in ((800e3, 0.20), (1000e3, 0.40))
        for slope_deg, factor in ((10.0, 1.0), (20.0, 1.2), (40.0, 1.8))
        for light in ("day", "night")
        for reflectance in (0.08, 0.17, 0.30)
    ]

    rows = statements(cells)

    def of(key: str) -> list[tuple[float, str]]:
        return [(round(one["ours"]["value"], 3), one["verdict"]) for one in rows if one["statement"] == key]

    # then errors between altitudes are interpolated in the logarithm, and spreads stand beside them
    middle = math.sqrt(0.20 * 0.40)
    assert of("E6") == [(round(middle, 3), "agrees"), (round(math.sqrt(0.18 * 0.38), 3), "agrees")]
    assert of("E7")[0] == (round(1.2 * middle, 3), "differs")
    assert [verdict for _, verdict in of("E7")] == ["differs", "differs", *["agrees"] * 4]
    assert of("E8") == [(2.0, "agrees")]
    assert of("E9") == [(1.2, "agrees"), (1.8, "differs")]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_says_what_runs_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given only altitudes of which something is said
    monkeypatch.setattr(campaign_energy, "STUDY_ALTITUDES_M", (500e3, 700e3, 900e3))
    monkeypatch.setattr(campaign_reflectance, "STUDY_ALTITUDES_M", (200e3, 700e3, 900e3))
    found: dict[str, set[str]] = {}
    for name in ("energy", "reflectance"):
        out = tmp_path / name

        assert main(["campaign", name, "--out", str(out), "--quiet"]) == 0

        for one in json.loads((out / "summary.json").read_text())["results"]["statements"]:
            found.setdefault(one["statement"], set()).add(one["verdict"])
    # then the page has the same verdict for all cases of a statement together
    together = {key: verdicts.pop() if len(verdicts) == 1 else "partly" for key, verdicts in found.items()}
    assert together == {f"E{number}": ROWS[f"E{number}"][2] for number in range(6, 13)}


# ---- the fast way against whole shots


def fast_cells(ground: GroundKey, altitude_m: float, cells: tuple[Condition, ...], count: int, seed: int):  # type: ignore[no-untyped-def]
    """The campaign's own way: draws about echoes, and the law of noise peaks."""
    scene = steady_scene(altitude_m)
    levels_v = sorted({one.noise_rms_v for one in cells})
    rows = range_chunks.noise_peaks(as_toml(noise_scene(scene)), levels_v, 150, 98, 0)["score_v"]
    laws = {
        as_toml(noise_scene(scene)): LevelLaws(
            tuple(fit_clusters(row, level) for row, level in zip(rows, levels_v, strict=True))
        )
    }
    made = range_chunks.echo_draws(
        as_toml(scene), asdict(ground), (9.0, 11.0), [asdict(one) for one in cells], count, 4, seed, 0
    )
    return energy_cells(Drawn("energy", "10 deg", scene, (9.0, 11.0), cells, made), laws, plane_conversion())


def whole(ground: GroundKey, altitude_m: float, cell: Condition, count: int, seed: int) -> np.ndarray:
    """Relative errors of E_G of whole shots, with the rule of 10 m; bias left in."""
    scene = structs.replace(cell_scene(steady_scene(altitude_m), cell), seed=seed)
    land, at = footprints(asdict(ground), 12.5e-6 * altitude_m, (9.0, 11.0), count, Draws(seed, 7))
    own = Surface(land.surface.kind, relief=land.surface.relief, albedo=cell.reflectance)
    chain = Chain(scene, Accuracy(1e-3), own)
    found = ShotRows(chain).candidates(np.arange(at.true_s.size), at.centre_m)
    true_s = (at.true_s + chain.kernel.pulse.mean_s)[:, None]
    errors_m = corrected_m(range_chunks.correction(scene), found.arrival_s - true_s, found.fwhm_s)
    errors_m[np.arange(4) >= found.found[:, None]] = np.inf
    best = np.abs(errors_m).argmin(axis=1)
    rows = np.arange(best.size)
    seen = np.abs(errors_m[rows, best]) <= FALSE_M
    pulse = found.amplitude_v[rows, best][seen], found.fwhm_s[rows, best][seen]
    energy_j = plane_conversion().energy_j("gaussian", *pulse, np.zeros(int(seen.sum())))
    return energy_j / link_budget(scene).energy_j - 1


def alike(fast: tuple[Estimate, Estimate], errors: np.ndarray) -> None:
    """Rms and mean of both ways agree within chance."""
    root, mean = fast
    rms = math.sqrt(float((errors**2).mean()))
    rms_u = float((errors**2).std()) / math.sqrt(errors.size) / (2 * rms)
    assert abs(rms - root.value) < SIGMAS * math.hypot(rms_u, root.standard_uncertainty)
    mean_u = float(errors.std()) / math.sqrt(errors.size)
    assert abs(float(errors.mean()) - mean.value) < SIGMAS * math.hypot(mean_u, mean.standard_uncertainty)


@pytest.mark.slow
def test_energies_are_those_of_whole_shots() -> None:
    # given a cell in which every tenth detection is false
    cell = conditions(base_scene(), (0.17,))[1]
    fast = fast_cells(PLANE, 1100e3, (cell,), 500, 5)[0]
    found = fast.errors["gaussian", "own"]

    errors = whole(PLANE, 1100e3, cell, 600, 6)

    assert 0.01 < fast.pfd.value < 0.3
    alike((found.error.rms, found.error.mean), errors - found.bias.value)


def window_errors(altitude_m: float, cell: Condition, shots: int, seed: int) -> np.ndarray:
    """Relative errors of E_CW from whole windows of a level plane's chain, one by one."""
    scene = structs.replace(cell_scene(steady_scene(altitude_m), cell), seed=seed)
    surface = structs.replace(scene.surface, kind="plane", slope_deg=10.0)
    chain = Chain(structs.replace(scene, surface=surface), Accuracy(1e-3))
    curve, energies = range_chunks.correction(scene), []
    for shot in range(shots):
        window = chain.window(shot)
        first_s = chain.first_sample_s(shot, chain.whole_window(shot))
        best, nearest_m = None, FALSE_M
        for one in chain.range_finder.candidates(window, True):
            arrival_s = np.array([first_s + one.arrival_s - chain.kernel.pulse.mean_s])
            off_m = abs(float(corrected_m(curve, arrival_s, np.array([one.fwhm_s]))[0]))
            if off_m <= nearest_m:
                best, nearest_m = one, off_m
        if best is not None:
            volts = (np.array(best.correlation_window) - window.zero_count) * window.volts_per_count
            pulse = [np.array([v]) for v in (best.amplitude_v, best.fwhm_s, 12.5e-9 * np.trapezoid(volts))]
            energies.append(float(plane_conversion().energy_j("window", *pulse)[0]))
    return np.array(energies) / link_budget(scene).energy_j - 1


@pytest.mark.slow
@pytest.mark.parametrize(("altitude_m", "row"), [(700e3, 0), (1000e3, 1)])
def test_energies_of_samples_are_those_of_whole_windows(altitude_m: float, row: int) -> None:
    cell = conditions(base_scene(), (0.17,))[row]
    found = fast_cells(PLANE, altitude_m, (cell,), 800, 5)[0].errors["window", "own"]

    errors = window_errors(altitude_m, cell, 900, 9)

    alike((found.error.rms, found.error.mean), errors - found.bias.value)


@pytest.mark.slow
@pytest.mark.parametrize("altitude_m", [500e3, 800e3, 1100e3])
def test_energies_over_fractals_are_those_of_whole_shots(altitude_m: float) -> None:
    cells = conditions(base_scene(), (0.08, 0.17, 0.30))
    fast = fast_cells(GroundKey(), altitude_m, cells, 60, 5)
    for cell, one in zip(cells, fast, strict=True):
        found = one.errors["gaussian", "own"]
        errors = whole(GroundKey(), altitude_m, cell, 200, 6)
        alike((found.error.rms, found.error.mean), errors - found.bias.value)


# ---- the campaign


def test_options_below_what_statistics_need_are_refused() -> None:
    with pytest.raises(RefusedInput, match="--calibration-echoes 0"):
        EnergyErrorOptions(calibration_echoes=0)


def test_a_plan_has_each_slope_at_each_altitude_and_a_calibration_of_other_places() -> None:
    chunks = plan(EnergyErrorOptions(sets=2)).chunks
    draws = [one for one in chunks if one.work.endswith(":echo_draws")]
    plain = [one for one in chunks if one.work.endswith(":plain_echoes")]
    assert len(draws) == 12 * (2 + 4)
    assert len(plain) == 30
    assert not {one.given["seed"] for one in draws} & {one.given["seed"] for one in plain}
    assert len(chunks) == len({one.key for one in chunks})


def test_draws_are_told_as_energies_relative_to_their_own_light() -> None:
    # given noise that hardly is any
    scene, cell = base_scene(500e3), Condition("mean", "night", 0.17, 1e-6)
    made = work(
        "procedures.range_chunks:echo_draws",
        {
            "scene": as_toml(scene),
            "ground": asdict(PLANE),
            "slopes_deg": [9.0, 11.0],
            "conditions": [asdict(cell)],
            "count": 200,
            "repeats": 1,
            "seed": 1,
            "number": 0,
        },
    )
    draws = energy_draws(Drawn("energy", "10 deg", scene, (9.0, 11.0), (cell,), made), 0, plane_conversion())
    # then what is left by the samples is the shot noise of the echo: F / n of its primary electrons
    from sim.detector import excess_noise_factor

    electrons = 0.17 * made["optical_j"].mean() * scene.detector.quantum_efficiency / 1.86696e-19
    expected = math.sqrt(excess_noise_factor(scene.detector) / electrons)
    left = draws.ratio["window", "own"][:, 0] - 1
    assert left.std() == pytest.approx(expected, rel=SIGMAS / math.sqrt(2 * 200) + 0.03)
    # and jitter of the laser's energy is none of it
    assert draws.plain["window", "own"].std() < 1e-3


def test_the_command_tells_errors_of_energies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given two fractals in the place of eleven, and few points
    monkeypatch.setattr(range_ground, "LEVELS", 2)
    monkeypatch.setattr(campaign_energy, "STUDY_ALTITUDES_M", (400e3, 800e3, 1200e3))
    monkeypatch.setattr(campaign_energy, "SLOPES_DEG", (0.0, 10.0))
    monkeypatch.setattr(energy_parts, "CALIBRATION_ALTITUDES_M", (400e3, 1000e3))
    monkeypatch.setattr(energy_parts, "SLOPES_DEG", (0.0, 20.0))
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()
    out = tmp_path / "energy"
    small = ["--echoes", "8", "--slope-echoes", "4", "--repeats", "2", "--sets", "1"]
    small += ["--noise-windows", "30", "--calibration-echoes", "4", "--workers", "1"]

    assert main(["campaign", "energy", "--out", str(out), *small]) == 0

    told = capsys.readouterr().out
    assert told.count(" km  10 deg") == 18
    results = json.loads((out / "summary.json").read_text())["results"]
    assert len(results["cells"]) == 3 * (12 + 6)
    assert {"E7", "E8"} <= {one["statement"] for one in results["statements"]}
    near, far = (
        next(
            one
            for one in results["cells"]
            if (one["altitude_m"], one["light"], one["reflectance"]) == (altitude_m, "night", 0.3)
        )
        for altitude_m in (400e3, 1200e3)
    )
    assert near["errors"]["gaussian"]["own"]["error"]["value"] < 0.1
    assert far["errors"]["gaussian"]["own"]["error"]["value"] > 0.15
    assert (out / "data.nc").is_file()
    # and going on with a finished campaign tells the same
    assert main(["campaign", "energy", "--resume", str(out)]) == 0
    assert capsys.readouterr().out == told
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()


@pytest.mark.slow
def test_hardly_any_detection_is_told_without_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given one echo on each of two terrains
    monkeypatch.setattr(range_ground, "LEVELS", 2)
    monkeypatch.setattr(campaign_energy, "STUDY_ALTITUDES_M", (1500e3,))
    monkeypatch.setattr(campaign_energy, "SLOPES_DEG", (10.0,))
    monkeypatch.setattr(energy_parts, "CALIBRATION_ALTITUDES_M", (400e3,))
    monkeypatch.setattr(energy_parts, "SLOPES_DEG", (0.0, 20.0))
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()
    out = tmp_path / "energy"
    least = ["--echoes", "1", "--repeats", "1", "--sets", "1", "--noise-windows", "20", "--workers", "1"]

    assert main(["campaign", "energy", "--out", str(out), *least]) == 0

    results = json.loads((out / "summary.json").read_text())["results"]
    assert all(one["errors"] == {"gaussian": {}, "window": {}} for one in results["cells"])
    assert {one["error"]["status"] for one in results["reach"]} == {"not_known"}
    assert results["statements"] == []
    capsys.readouterr()
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()
