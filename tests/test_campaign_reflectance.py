"""Reflectance campaign: separation beside closed forms and draws, ageing, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from belahil.cli.main import main
from belahil.errors import RefusedInput
from belahil.values import Estimate
from procedures import campaign_reflectance, energy_parts, range_chunks, range_ground, range_places
from procedures.campaign_reflectance import ReflectanceOptions, plan
from procedures.class_separation import Measured, shots_needed, wrong_share
from procedures.energy_cells import energy_draws
from procedures.noise_clusters import LevelLaws, fit_clusters
from procedures.range_points import Drawn
from procedures.range_scenes import base_scene, conditions, noise_scene
from procedures.reflectance_kinds import AGEING, CONTRASTS, KINDS, Contrast
from procedures.reflectance_reach import ageing, highest, mixing, scale_known, shot_budget, statements
from procedures.reflectance_results import (
    ContrastCell,
    KindCell,
    MixtureCell,
    ReflectanceCells,
    allowed_scale_u,
    crossovers_needed,
)
from sim.scene import as_toml
from tests.test_campaign_energy import PLANE, plane_conversion, steady_scene, whole

SIGMAS = 4.5
"""Standard errors within which chance stays, in all but some 1e-5 of cases."""


def normal(mean: float, spread: float, count: int = 20_000) -> Measured:
    """A normal distribution without chance: its quantiles."""
    from scipy.special import ndtri

    values = mean + spread * ndtri((np.arange(count) + 0.5) / count)
    return Measured(values[:, None], np.ones((count, 1)))


# ---- separation


@pytest.mark.parametrize(("low", "high"), [(0.02, 0.02), (0.01, 0.04), (0.05, 0.03)])
@pytest.mark.parametrize("shots", [1, 2, 7, 40, 200])
def test_normal_distributions_are_confused_as_the_closed_form_says(
    low: float, high: float, shots: int
) -> None:
    found = wrong_share(normal(0.17, low), normal(0.19, high), shots)
    expected = float(ndtr(-0.02 * math.sqrt(shots) / (low + high)))
    # 2e-4 of a distribution lies in one of its 20 000 points or beyond the drawn ends
    assert found == pytest.approx(expected, rel=0.01, abs=2e-4)


@pytest.mark.parametrize("shots", [1, 3, 10])
def test_skewed_distributions_are_confused_as_often_as_in_draws(shots: int) -> None:
    # given measured reflectances with a tail, as faint echoes have
    stream = np.random.default_rng(shots)
    dark, bright = 0.08 + stream.gamma(2.0, 0.02, 4000), 0.12 + stream.gamma(3.0, 0.02, 4000)

    found = wrong_share(*(Measured(one[:, None], np.ones((4000, 1))) for one in (dark, bright)), shots)

    # then a threshold at its own place confuses as many means of drawn shots of both
    means = [stream.choice(one, (40_000, shots)).mean(axis=1) for one in (dark, bright)]
    threshold = np.quantile(means[0], 1 - found)
    misses = (means[1] <= threshold).mean()
    assert misses == pytest.approx(found, abs=SIGMAS * 2 * math.sqrt(found / 40_000) + 0.002)


@given(st.integers(1, 40), st.floats(0.2, 3.0))
def test_weights_count_as_repeated_values(seed: int, apart: float) -> None:
    stream = np.random.default_rng(seed)
    values, counts = stream.normal(size=(2, 60)), stream.integers(0, 4, (2, 60))
    values[1] += apart
    counts[:, 0] += 1
    weighted = [Measured(v[:, None], n[:, None].astype(float)) for v, n in zip(values, counts, strict=True)]
    repeated = [
        Measured(np.repeat(v, n)[:, None], np.ones((int(n.sum()), 1)))
        for v, n in zip(values, counts, strict=True)
    ]
    assert wrong_share(*weighted) == pytest.approx(wrong_share(*repeated), abs=1e-12)
    assert weighted[0].mean == pytest.approx(repeated[0].mean)
    assert weighted[0].spread == pytest.approx(repeated[0].spread)


@pytest.mark.parametrize(("spread", "apart"), [(0.02, 0.1), (0.02, 0.02), (0.02, 0.005), (0.02, 0.001)])
def test_as_many_shots_are_needed_as_separate_and_no_fewer(spread: float, apart: float) -> None:
    pair = normal(0.17, spread), normal(0.17 + apart, spread)
    needed = shots_needed(*pair)
    assert needed is not None
    assert needed == pytest.approx(max((1.64485 * 2 * spread / apart) ** 2, 1), rel=0.01, abs=1)
    assert wrong_share(*pair, needed) <= 0.05
    assert needed == 1 or wrong_share(*pair, needed - 1) > 0.05


def test_no_number_of_shots_separates_the_same_or_the_wrong_way_round() -> None:
    one = normal(0.17, 0.02)
    assert shots_needed(one, one) is None
    assert shots_needed(normal(0.2, 0.02), one) is None
    assert shots_needed(one, normal(0.17 + 1e-6, 0.02)) is None


def test_groups_of_echoes_are_left_out_with_all_their_shots() -> None:
    values = np.arange(24.0).reshape(12, 2)
    left = Measured(values, np.ones((12, 2))).without(1, 2, 6)
    # six echoes of two shots each: the odd ones are gone
    assert np.array_equal(left.values, values[[0, 1, 4, 5, 8, 9]])


@pytest.mark.slow
@pytest.mark.parametrize("altitude_m", [700e3, 900e3])
def test_kinds_are_confused_as_often_as_whole_shots_are(altitude_m: float) -> None:
    # given dark ground and regolith by night, by the campaign's own way
    pair = conditions(base_scene(), (0.08, 0.17))[2:]
    levels_v = sorted({one.noise_rms_v for one in pair})
    scene = steady_scene(altitude_m)
    key = as_toml(noise_scene(scene))
    peaks = range_chunks.noise_peaks(key, levels_v, 300, 98, 0)["score_v"]
    law = LevelLaws(tuple(fit_clusters(row, level) for row, level in zip(peaks, levels_v, strict=True)))
    made = range_chunks.echo_draws(
        as_toml(scene), asdict(PLANE), (9.0, 11.0), [asdict(one) for one in pair], 600, 4, 5, 0
    )
    drawn = Drawn("reflectance", "10 deg", scene, (9.0, 11.0), pair, made)
    fast = []
    for row, one in enumerate(pair):
        draws = energy_draws(drawn, row, plane_conversion())
        values = one.reflectance * draws.ratio["gaussian", "own"]
        fast.append(Measured(values, draws.hits.weights(law.at(one.noise_rms_v))))

    # when whole shots are told as reflectances
    brute = []
    for one in pair:
        values = one.reflectance * (1 + whole(PLANE, altitude_m, one, 1500, 6))
        brute.append(Measured(values[:, None], np.ones((values.size, 1))))

    # then both confuse as many, as far as the fewer of them tell
    found, expected = wrong_share(*fast), wrong_share(*brute)
    count = min(one.values.size for one in brute)
    assert abs(found - expected) < SIGMAS * math.sqrt(2 * expected * (1 - expected) / count)
    assert expected > 0.005


# ---- what follows


def cells() -> ReflectanceCells:
    """By hand: confusions that grow tenfold from 500 to 900 km, and shots twofold."""
    estimate = Estimate(0.01, 0.001)
    contrasts = []
    for one in CONTRASTS:
        for altitude_m, wrong, shots in ((500e3, 0.01, 1.0), (700e3, 0.03, 6.0), (900e3, 0.10, 24.0)):
            told = Estimate(shots, 0.1 * shots)
            for light in ("day", "night"):
                contrasts.append(
                    ContrastCell(one, altitude_m, light, Estimate(wrong, 0.05 * wrong), told, told, 1.2)
                )
    mixtures = [
        MixtureCell(name, altitude_m, "night", Estimate(share_u, 0.01 * share_u), estimate)
        for name in ("areal", "intimate")
        for altitude_m, share_u in ((200e3, 0.05), (400e3, 0.2))
    ]
    kinds = [
        KindCell("regolith", altitude_m, "night", estimate, 0.17, 0.17 * spread)
        for altitude_m, spread in ((500e3, 0.1), (900e3, 0.2))
    ]
    return ReflectanceCells(tuple(kinds), tuple(contrasts), tuple(mixtures))


def test_altitudes_are_where_curves_reach_their_levels() -> None:
    found = cells()
    one = highest(found, "dark and regolith", "night", 1).altitude
    assert one is not None
    assert one.value == pytest.approx(700e3 + 200e3 * math.log(0.05 / 0.03) / math.log(0.10 / 0.03))
    ten = highest(found, "dark and regolith", "night", 10).altitude
    assert ten is not None
    assert 700e3 < ten.value < 900e3
    assert highest(found, "dark and regolith", "night", 100).status == "below"
    share = next(row for row in mixing(found) if (row["mixture"], row["light"]) == ("areal", "night"))
    assert share["shots_1"]["altitude"]["value"] == pytest.approx(300e3)
    assert share["shots_100"]["status"] == "below"
    assert mixing(found)[0]["shots_1"]["status"] == "not_known"


def test_statements_are_told_from_the_cells() -> None:
    rows = {(row["statement"], row["says"][:12]): row["verdict"] for row in statements(cells())}
    assert rows["E10", "confusions o"] == "differs"
    assert rows["E11", "rise by 15 %"] == "agrees"
    assert rows["E12", "share of ice"] == "agrees"


def test_a_scale_known_as_allowed_confuses_one_time_in_twenty() -> None:
    # given a scale with an error as large as is allowed, and no other error
    contrast = Contrast("regolith", "fresh")
    scale = np.exp(allowed_scale_u(contrast) * np.random.default_rng(1).normal(size=200_000))
    threshold = math.sqrt(KINDS["regolith"] * KINDS["fresh"])
    alarms = (KINDS["regolith"] * scale > threshold).mean()
    assert alarms == pytest.approx(0.05, abs=SIGMAS * math.sqrt(0.05 / 200_000))


def test_cross_overs_tell_the_scale_as_well_as_they_scatter() -> None:
    stream, spread, albedo_u = np.random.default_rng(2), 0.2, 0.05
    count = round(crossovers_needed(spread, albedo_u, 0.02))
    told = []
    for _ in range(1500):
        early, late = 1 + spread * stream.normal(size=(2, count))
        told.append((late - early + albedo_u * stream.normal(size=count)).mean())
    assert np.std(told) == pytest.approx(0.02, rel=SIGMAS / math.sqrt(2 * 1500) + 1 / count)


def test_ageing_is_a_bias_of_the_product_of_what_is_kept() -> None:
    told = ageing(cells())
    assert told["bias_uncorrected"]["both"] == pytest.approx(-0.2904)
    assert told["regolith_told_as"]["shots"] == pytest.approx(0.136)
    assert set(told["bias_uncorrected"]) == {*AGEING, "both"}
    # shots with twice the spread need four times the cross-overs, but for the ground's own share
    near, far = (row["needed"]["0.01"] for row in told["crossovers"])
    assert near == pytest.approx((2 * 0.1**2 + 0.05**2) / 1e-4)
    assert far == pytest.approx((2 * 0.2**2 + 0.05**2) / 1e-4)


def test_a_budget_adds_up_to_the_spread() -> None:
    lines = [line for line in shot_budget(cells()) if line.quantity.endswith("900 km")]
    assert math.hypot(*(line.value for line in lines)) == pytest.approx(0.2, rel=1e-6)
    assert sum(line.share for line in lines) == pytest.approx(1)
    # a photodiode that is 0.1 K warmer breaks down 0.24 V later, with 1.5 % of its gain for a volt
    by_temperature = next(value for name, value in scale_known().items() if "temperature" in name)
    assert by_temperature == pytest.approx(0.24 * 0.0124 / 1.0, rel=0.05)


# ---- the campaign


def test_options_that_nothing_can_be_made_of_are_refused() -> None:
    with pytest.raises(RefusedInput, match="--noise-windows 5"):
        ReflectanceOptions(noise_windows=5)
    with pytest.raises(RefusedInput, match="--sun far: allowed are mean, perihelion"):
        ReflectanceOptions(sun="far")


def test_the_sun_at_perihelion_makes_days_and_nights_noisier() -> None:
    def levels(sun: str) -> list[float]:
        chunk = next(
            one for one in plan(ReflectanceOptions(sun=sun)).chunks if one.work.endswith("echo_draws")
        )
        return [one["noise_rms_v"] for one in chunk.given["conditions"]]

    near, mean = levels("perihelion"), levels("mean")
    assert len(near) == 2 * len(KINDS)
    assert all(a > b for a, b in zip(near, mean, strict=True))


def test_the_command_tells_what_is_separate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given two fractals in the place of eleven, and few points
    monkeypatch.setattr(range_ground, "LEVELS", 2)
    monkeypatch.setattr(campaign_reflectance, "STUDY_ALTITUDES_M", (200e3, 700e3, 900e3))
    monkeypatch.setattr(energy_parts, "CALIBRATION_ALTITUDES_M", (400e3, 1000e3))
    monkeypatch.setattr(energy_parts, "SLOPES_DEG", (0.0, 20.0))
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()
    out = tmp_path / "reflectance"
    small = ["--echoes", "40", "--repeats", "3", "--sets", "1", "--noise-windows", "30"]
    small += ["--calibration-echoes", "4", "--workers", "1"]

    assert main(["campaign", "reflectance", "--out", str(out), *small]) == 0

    told = capsys.readouterr().out
    assert "E12 share of ice" in told
    results = json.loads((out / "summary.json").read_text())["results"]
    assert len(results["contrasts"]) == 3 * 4 * 2
    # and dark ground is told from regolith from low, by every shot
    lowest = results["contrasts"][0]
    assert lowest["shots"]["value"] == 1.0
    assert lowest["wrong"]["value"] < 0.01
    assert (out / "data.nc").is_file()
    assert (out / "report.html").is_file()
    # and going on with a finished campaign tells the same
    assert main(["campaign", "reflectance", "--resume", str(out)]) == 0
    assert capsys.readouterr().out == told
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()
