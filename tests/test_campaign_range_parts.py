"""Parts of the range campaign beside its table: budget, ladder, bias, corrections, mixture, other ground."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from belahil.cli.main import main
from belahil.delay_curve import published_curve
from belahil.errors import RefusedInput
from belahil.values import Estimate
from procedures import range_budget, range_ground, range_parts, range_places, range_variants
from procedures.campaign_range import RangeOptions, plan
from procedures.error_mixture import REACH_M, fit_mixture
from procedures.noise_clusters import NoiseClusters
from procedures.noise_colour import autocorrelation, unit_noise
from procedures.range_budget import BASE, BudgetCell, Shift, budget_points
from procedures.range_chunks import correction
from procedures.range_constants import CONSTANTS, OTHER_GROUND
from procedures.range_corrections import NAMES, _corrected_m
from procedures.range_parts import points
from procedures.range_scenes import base_scene, text_dark_rms_v
from procedures.range_statistics import CellDraws, LinearSpread, fast_pfd, influences, weighted_rms
from procedures.range_table import Cell
from procedures.range_variants import LADDER, bias_points, rung_scene
from sim.detector import multiplication
from sim.laser import beam_sigma_m
from sim.rfm import RangeFinder

SIGMAS = 4.5


# ---- mixture


@pytest.mark.parametrize(("share", "width", "seed"), [(0.9, 0.5, 1), (0.5, 2.0, 2), (0.1, 1.0, 3)])
def test_a_mixture_is_told_apart(share: float, width: float, seed: int) -> None:
    # given true detections, and noise anywhere in a window
    draws, count = np.random.default_rng(seed), 20000
    true = draws.random(count) < share
    errors = np.where(true, 0.2 + width * draws.standard_normal(count), draws.uniform(-3e3, 3e3, count))

    found = fit_mixture(errors)

    assert found is not None
    assert abs(1 - found.pfd.value - share) < SIGMAS * max(found.pfd.standard_uncertainty, 1e-3)
    assert abs(found.spread.value - width) < SIGMAS * found.spread.standard_uncertainty
    assert abs(found.mean_m - 0.2) < SIGMAS * width / np.sqrt(count * share)


def test_the_width_of_a_mixture_is_as_uncertain_as_it_scatters() -> None:
    # given many runs of 1100 shots of which a twentieth are true
    rng = np.random.default_rng(3)
    found = []
    for _ in range(300):
        true = rng.random(1100) < 0.05
        off = np.abs(rng.uniform(-15e3, 15e3, (1100, 4))).min(axis=1) * rng.choice([-1, 1], 1100)
        found.append(fit_mixture(np.where(true, rng.normal(0.0, 3.0, 1100), off)))
    spreads = [one.spread for one in found if one is not None]
    assert len(spreads) > 290

    # then told and real agree, to the 4 % that 300 tell of a scatter, three times
    ratio = np.median([one.standard_uncertainty for one in spreads]) / np.std([one.value for one in spreads])
    assert ratio == pytest.approx(1.0, abs=0.12)


def test_noise_alone_and_few_errors_are_no_mixture() -> None:
    assert fit_mixture(np.full(500, math.inf)) is None
    assert fit_mixture(np.linspace(-1, 1, 19)) is None
    # and noise alone leaves hardly a normal part
    alone = fit_mixture(np.random.default_rng(5).uniform(-REACH_M, REACH_M, 3000))
    assert alone is None or alone.pfd.value > 0.5


# ---- budget


def some_draws(seed: int, factor: float = 1.0) -> CellDraws:
    draws = np.random.default_rng(seed)
    errors = factor * draws.standard_normal((600, 2))
    hit = np.stack([draws.random(600) < 0.9, np.zeros(600, dtype=bool)], axis=1)
    score = 5.5 + draws.standard_normal((600, 2))
    return CellDraws(hit, score, np.zeros((600, 2), dtype=np.int64), errors, np.ones(600), 200)


LAW = NoiseClusters(1.0, 7.4, 0.5, 0.0, 0.0, 0.0, 100)


def test_influences_add_up_to_the_uncertainties_of_a_cell() -> None:
    draws = some_draws(1)
    (log_spread, of_spread), (pfd, of_pfd) = influences(draws, LAW)
    whole, spread = fast_pfd(draws, LAW), weighted_rms(draws.error_m, draws.weights(LAW), draws.echoes)
    assert spread is not None
    assert math.exp(log_spread) == pytest.approx(spread.value)
    assert pfd == pytest.approx(whole.value)
    assert np.sqrt(of_pfd @ of_pfd) == pytest.approx(whole.standard_uncertainty, rel=1e-9)
    relative = spread.standard_uncertainty / spread.value
    assert np.sqrt(of_spread @ of_spread) == pytest.approx(relative, rel=1e-3)
    # and what is the same in two cells with the same draws leaves no uncertainty
    (_, moved), _ = influences(some_draws(1, 3.0), LAW)
    assert moved == pytest.approx(of_spread, abs=1e-12)


def some_cell() -> Cell:
    spread = LinearSpread(0.0, 0.0, 0.0, 0.0, 1.0)
    return Cell(
        5e5,
        base_conditions()[0],
        Estimate(0.5, 0.01, "1"),
        Estimate(2.0, 0.01, "m"),
        *(None,) * 3,
        Estimate(0.0, 0.0, "m"),
        None,
        spread,
    )


def test_an_interval_joins_half_ranges_upwards_and_downwards() -> None:
    def one(value: float) -> tuple[Estimate, Estimate]:
        return Estimate(value, 0.0, "1"), Estimate(value, 0.0, "1")

    cell = some_cell()
    shifts = (Shift(CONSTANTS[0], one(-0.1), one(0.3)), Shift(CONSTANTS[1], one(0.4), one(0.2)))
    budget = BudgetCell(cell, shifts)
    up, down = 2 * math.sqrt((0.3**2 + 0.4**2) / 3), 2 * math.sqrt(0.1**2 / 3)
    assert budget.interval(1) == pytest.approx((0.5 - down, min(0.5 + up, 1.0)))
    assert budget.interval(0) == pytest.approx((2 * math.exp(-down), 2 * math.exp(up)))
    # and a derivative is the change over the range by its width
    assert shifts[0].derivative(1).value == pytest.approx(0.4 / 10.0)


def base_conditions():  # type: ignore[no-untyped-def]
    from procedures.range_scenes import conditions

    return conditions(base_scene())


def test_constants_change_what_they_name_and_the_dark_noise_follows() -> None:
    options = RangeOptions(("budget",), study_echoes=1)
    every = {one.label: one for one in budget_points(options, 1) if one.scene.altitude_m == 5e5}
    base = every[f"500 km, {BASE}"]
    for one in CONSTANTS:
        for end in ("low", "high"):
            value = getattr(one, end)
            label = f"500 km, {one.name}, {end}"
            assert (label in every) is (value != one.assumed)
            if label not in every:
                continue
            point = every[label]
            changed = (point.scene, point.ground, point.conditions) != (
                base.scene,
                base.ground,
                base.conditions,
            )
            assert changed
            assert (point.seed, point.tilt, point.echoes) == (base.seed, base.tilt, base.echoes)
            if one.dark_follows:
                assert point.scene.noise.dark_rms_v == pytest.approx(text_dark_rms_v(point.scene))


def test_the_assumed_values_are_those_of_the_scene() -> None:
    scene = base_scene()
    for one in CONSTANTS:
        if math.isfinite(one.assumed) and one.name != "dark noise by itself":
            same = one.scene(scene, one.assumed)
            assert one.ground(range_ground.GroundKey(), one.assumed) == range_ground.GroundKey()
            assert one.reflectances(one.assumed) == (0.08, 0.17, 0.30)
            for made, given in ((same.laser, scene.laser), (same.detector, scene.detector)):
                # An ellipse of none is a round beam, and a gain by itself the one by Miller's equation.
                for key in set(given.__struct_fields__) - {"beam", "ellipticity", "multiplication"}:
                    number = getattr(given, key)
                    expected = pytest.approx(number) if isinstance(number, float) else number
                    assert getattr(made, key) == expected
            assert beam_sigma_m(same.laser, 1.0) == pytest.approx(beam_sigma_m(scene.laser, 1.0))
            assert multiplication(same.detector) == pytest.approx(multiplication(scene.detector), rel=1e-3)
            finders = [RangeFinder.of(made.receiver_spec, made.range_finder) for made in (same, scene)]
            assert finders[0].bank.widths == pytest.approx(finders[1].bank.widths)
            assert replace(finders[0], bank=finders[1].bank) == finders[1]
            assert same.truth == scene.truth


def test_no_constant_is_at_both_ends_what_it_is() -> None:
    for one in CONSTANTS:
        if one.name != OTHER_GROUND:
            assert one.low <= one.assumed <= one.high
        assert one.low < one.high
        assert one.why


@pytest.mark.slow
def test_other_grounds_widen_an_interval_to_both_sides_by_what_one_ground_scatters() -> None:
    # given many triples of grounds that have one scatter: the assumed one and two others
    other = next(one for one in CONSTANTS if one.name == OTHER_GROUND)
    grounds = np.random.default_rng(4).normal(0.0, 0.02, (4000, 3))

    def ends(value: float) -> tuple[Estimate, Estimate]:
        return Estimate(value, 0.0, "1"), Estimate(value, 0.0, "1")

    widths = []
    for assumed, low, high in grounds:
        budget = BudgetCell(some_cell(), (Shift(other, ends(low - assumed), ends(high - assumed)),))
        widths.append(np.array(budget.interval(1)) - 0.5)

    # then the mean square of either half is that of two standard deviations, 5 standard errors
    squares = np.mean(np.square(widths), axis=0)
    assert squares == pytest.approx((2 * 0.02) ** 2, rel=0.1)


def test_shares_of_the_variance_are_those_of_the_interval() -> None:
    def ends(low: float, high: float) -> list[tuple[Estimate, Estimate]]:
        return [(Estimate(0.0, 0.0, "1"), Estimate(value, 0.0, "1")) for value in (low, high)]

    moved = (ends(-0.1, 0.1), ends(0.2, 0.1), ends(0.0, 0.0))
    shifts = tuple(Shift(one, *pair) for one, pair in zip(CONSTANTS, moved, strict=False))
    whole = BudgetCell(some_cell(), shifts)
    low, high = whole.interval(1)
    variance = ((0.5 - low) / 2) ** 2 + ((high - 0.5) / 2) ** 2
    # given constants one by one, their intervals make up the whole
    for shift, share in zip(shifts, whole.shares(1), strict=True):
        alone = BudgetCell(some_cell(), (shift,)).interval(1)
        part = ((0.5 - alone[0]) / 2) ** 2 + ((alone[1] - 0.5) / 2) ** 2
        assert share == pytest.approx(part / variance)
    assert sum(whole.shares(1)) == pytest.approx(1.0)
    assert whole.shares(0) == (0.0, 0.0, 0.0)


# ---- ladder, bias, other ground


def test_the_ladder_ends_at_the_campaigns_own_scene() -> None:
    rungs = [rung_scene(8e5, rung) for rung in range(len(LADDER))]
    assert rungs[-1] == base_scene(8e5)
    assert all(one != other for one, other in itertools.pairwise(rungs[:3]))
    assert multiplication(rungs[0].detector) == pytest.approx(1.25 * multiplication(rungs[1].detector))
    assert rungs[1].laser.pulse == "gaussian"
    assert rungs[2].laser.pulse == "tailed"
    assert rungs[3].laser.jitter_rad == (0.0, 0.0) != rungs[4].laser.jitter_rad
    assert rungs[4].filter == "gaussian"


def test_gains_follow_bias_and_temperature() -> None:
    every = list(bias_points(RangeOptions(("bias",)), 1))
    by_bias = [
        one for one in every if one.scene.altitude_m == 8e5 and one.scene.detector.apd_temperature_c == 20
    ]
    gains = [multiplication(one.scene.detector) for one in by_bias]
    assert gains == sorted(gains)
    assert pytest.approx(gains[[one.scene.detector.bias_v for one in by_bias].index(320.0)]) == 48.4
    warm = [one for one in every if one.scene.altitude_m == 8e5 and one.scene.detector.bias_v == 320]
    warm.sort(key=lambda one: one.scene.detector.apd_temperature_c)
    cooling = [multiplication(one.scene.detector) for one in warm]
    assert cooling == sorted(cooling, reverse=True)
    # and where sunlight is multiplied more, the day is noisier
    days = [next(c.noise_rms_v for c in one.conditions if c.light == "day") for one in by_bias]
    assert days == sorted(days)


@pytest.mark.parametrize("kind", ["butterworth", "gaussian"])
def test_noise_has_the_autocorrelation_that_is_told(kind: str) -> None:
    from msgspec import structs

    scene = structs.replace(base_scene(), filter=kind)
    drawn = unit_noise(scene).draw(np.random.default_rng(3), 200_000)
    expected = autocorrelation(scene, 6)
    found = [float(drawn[: drawn.size - lag] @ drawn[lag:]) / drawn.size for lag in range(6)]
    assert found == pytest.approx(expected, abs=SIGMAS * 1.5 / np.sqrt(200_000))


def test_every_correction_is_the_arrival_and_its_own_shift() -> None:
    own = correction(base_scene())
    arrival_s, width_s = np.array([17e-9, 30e-9]), np.array([40e-9, 90e-9])
    metres = 149896229.0
    expected = {
        NAMES[0]: arrival_s - own.at(width_s),
        NAMES[1]: arrival_s + published_curve().at(width_s),
        NAMES[2]: arrival_s + published_curve(as_printed=True).at(width_s),
        NAMES[3]: arrival_s,
    }
    for name, seconds in expected.items():
        assert _corrected_m(name, own, arrival_s, width_s) == pytest.approx(metres * seconds)
    # and the slope of the printed one lets the width in, that of the others hardly
    slopes = {
        name: np.ptp(_corrected_m(name, own, np.full(2, 17e-9), width_s)) / metres / 50e-9 for name in NAMES
    }
    assert slopes[NAMES[2]] > 0.8
    assert max(slopes[NAMES[0]], slopes[NAMES[1]]) < 0.05


def test_a_part_that_is_none_is_refused() -> None:
    with pytest.raises(RefusedInput, match="table, altitude, map"):
        RangeOptions(("tabel",))


def test_no_two_chunks_of_all_parts_are_alike_and_parts_share_no_seed() -> None:
    options = RangeOptions(shots=0, terrain=None)
    chunks = plan(options).chunks
    assert len({one.name for one in chunks}) == len(chunks)
    seeds = {part: {one.seed for one in points(RangeOptions((part,)))} for part in range_parts.PARTS}
    assert all(len(one) == 1 for one in seeds.values())
    assert len(set().union(*seeds.values())) == len(seeds)


@pytest.mark.slow
def test_all_parts_together_by_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given two fractals and few points
    monkeypatch.setattr(range_ground, "LEVELS", 2)
    monkeypatch.setattr(range_variants, "LEVELS", 2)
    for module in (range_parts, range_budget, range_variants):
        if hasattr(module, "ALTITUDES_M"):
            monkeypatch.setattr(module, "ALTITUDES_M", (500e3, 1400e3))
    monkeypatch.setattr(range_variants, "BIAS_ALTITUDES_M", (1100e3,))
    monkeypatch.setattr(range_parts, "STUDY_ALTITUDES_M", (500e3,))
    few = (
        "effective R_f",
        "reflectance of ice",
        "extra pole of the amplifier",
        "number of templates",
        OTHER_GROUND,
    )
    monkeypatch.setattr(range_budget, "CONSTANTS", [one for one in CONSTANTS if one.name in few])
    out = tmp_path / "range"
    arguments = ["--parts", "altitude,budget,ladder,bias,columns", "--study-echoes", "6", "--repeats", "2"]
    grounds = (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes)
    for one in grounds:
        one.cache_clear()

    status = main(
        [
            "campaign",
            "range",
            "--out",
            str(out),
            *arguments,
            "--noise-windows",
            "20",
            "--workers",
            "1",
            "--quiet",
        ]
    )

    for one in grounds:
        one.cache_clear()
    assert status == 0
    results = json.loads((out / "summary.json").read_text())["results"]
    assert {"altitude", "corrections", "budget", "ladder", "bias", "columns"} <= results.keys()
    assert len(results["budget"]["cells"]) == 2 * 6
    assert len(results["ladder"]) == 2 * 6 * 6
    assert len(results["bias"]) == 12 * 2
    # and the resistor hardly changes what is seen: signal, sunlight and dark noise all grow with it
    for cell in results["budget"]["cells"]:
        by_name = {one["constant"]: one for one in cell["constants"]}
        ends = [abs(one["value"]) for one in by_name["effective R_f"]["error_relative"]]
        if cell["altitude_m"] == 500e3:
            assert max(ends) < 0.1
    for name in ("tornado", "ladder", "bias", "corrections", "altitude", "histograms"):
        assert (out / f"figure-range-{name}.png").is_file()
