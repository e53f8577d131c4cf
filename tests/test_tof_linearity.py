"""The hidden clock comes back, and with it wobble and range walk; what has no two pulses has a status."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
import xarray
from hidden_receivers import InMemory
from hypothesis import given, settings
from hypothesis import strategies as st
from test_data_file import keys

from belahil import butterworth
from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.cli.tof_linearity import command
from belahil.config import (
    BenchConfig,
    BenchTable,
    DigitizerTable,
    EmulatedReceiver,
    EmulationTable,
    Interleave,
    SmallSignal,
    simulated,
)
from belahil.errors import RefusedInput
from belahil.generators import MODELS
from belahil.outcome import Outcome
from belahil.pole_response import SampledNoise, response
from belahil.pulse_bound import filtered_noise_covariance
from belahil.pulse_fit import gaussian_fit
from belahil.stimuli import NoSignal, SampledPulse
from belahil.values import Estimate, RangeWindow, Shot
from procedures import tof_linearity
from procedures.gaussian_pulses import TrainPulse, gaussian_train
from procedures.known_receiver import preset_receiver
from procedures.played_pulses import played_pulses
from procedures.pulse_pairs import fitted, noise_covariance
from procedures.tof_fit import TofFit, fit_pairs, harmonics
from procedures.tof_linearity import TofOptions, distances_s
from procedures.tof_results import receiver_delay_s

DOCS = Path(__file__).resolve().parent.parent / "docs"
INTERVAL_S = 12.5e-9
QUICK = TofOptions(widths_s=(20e-9, 60e-9), peaks_v=(15e-3, 60e-3), separations=6)
SMALL = TofOptions(widths_s=(40e-9,), peaks_v=(60e-3,), separations=3, shots=1)


def bench_with(seed: int = 1, **receiver: object) -> BenchConfig:
    truth = EmulatedReceiver(**receiver)  # type: ignore[arg-type]
    return msgspec.structs.replace(simulated(), emulation=EmulationTable(seed=seed, receiver=truth))


def found(
    config: BenchConfig, options: TofOptions = QUICK, change: Callable[[Shot], Shot] = lambda shot: shot
) -> Outcome:
    kept = InMemory([])
    with open_bench(config) as bench:
        plan = tof_linearity.plan(bench, options)
        tof_linearity.measure(bench, kept, plan)
    return tof_linearity.analyse(plan, [change(shot) for shot in kept.shots], config)


def pull(told: dict[str, object], truth: float) -> float:
    one = Estimate(**told)  # type: ignore[arg-type]
    return (one.value - truth) / one.standard_uncertainty


# ---- what must come back


@pytest.mark.parametrize(
    ("seed", "ppm", "more"),
    [
        (1, -180.0, {}),
        pytest.param(
            2,
            7.3,
            {"interleave": Interleave(gain=0.02, offset_v=4e-3, skew_s=300e-12)},
            marks=pytest.mark.slow,
        ),
        pytest.param(3, 55.0, {"cutoff_hz": 16e6, "order": 4}, marks=pytest.mark.slow),
        pytest.param(4, 0.0, {"highpass_hz": 20e3}, marks=pytest.mark.slow),
    ],
)
def test_a_hidden_clock_comes_back(seed: int, ppm: float, more: dict[str, object]) -> None:
    results = found(bench_with(seed, clock_ppm=ppm, **more)).results

    assert results["status"] == "ok"
    assert abs(pull(results["clock_ppm"], ppm)) < 3.5
    # two pulses of 100 and more times the noise, 0.2 ms apart
    assert results["clock_ppm"]["standard_uncertainty"] < 0.5
    assert results["fit"]["birge"] == 1.0
    # nothing is left that depends on the distance: 8 bins, 1 in 1000 by chance
    assert results["linearity"]["chi_square"] < 26


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_stated_uncertainty_covers() -> None:
    pulls, walks = [], []
    for seed in range(60):
        ppm = float(np.random.default_rng(seed).uniform(-240, 240))
        config = bench_with(100 + seed, clock_ppm=ppm)
        results = found(config).results
        pulls.append(pull(results["clock_ppm"], ppm))
        walks.append(results["agreement"]["chi_square"])
    # 60 draws: the width of the pulls to 9 %, their mean to 0.13; three kinds each in the chi-square
    assert 0.7 < np.std(pulls) < 1.3
    assert abs(np.mean(pulls)) < 0.45
    assert np.mean(walks) == pytest.approx(3, abs=3 * math.sqrt(2 * 3 / 60))


@pytest.mark.slow
def test_delays_of_width_are_those_of_the_known_filter() -> None:
    results = found(bench_with(5), replace(QUICK, widths_s=(20e-9, 40e-9, 90e-9))).results

    assert results["agreement"]["degrees_of_freedom"] == 5
    assert results["agreement"]["chi_square"] < 20
    rows = {(round(1e9 * one["width_s"]), round(1e3 * one["peak_v"])): one for one in results["range_walk"]}
    assert rows[40, 60]["delay"]["standard_uncertainty"] == 0  # the reference
    # a filter delays narrow pulses more, and one-way range is c / 2 of that
    narrow, wide = rows[20, 60]["delay"]["value"], rows[90, 60]["delay"]["value"]
    assert narrow > 0 > wide
    assert rows[20, 60]["range"]["value"] == pytest.approx(299_792_458 / 2 * narrow)
    assert rows[20, 60]["by_amplitude"] is None
    assert abs(pull(rows[20, 15]["by_amplitude"], 0.0)) < 3.5


@pytest.mark.slow
def test_with_few_pairs_the_wobble_counts_as_scatter() -> None:
    # Given fewer pairs than the wobble has numbers, of pulses that wobble by 250 ps
    options = TofOptions(widths_s=(8e-9, 40e-9), peaks_v=(40e-3, 90e-3), separations=3, shots=1)
    chi_squares = []
    for seed in range(12):
        results = found(bench_with(20 + seed), options).results
        assert [one["rms"] for one in results["wobble"]] == [None, None]
        chi_squares.append(results["agreement"]["chi_square"])
    # 12 runs with three delays each: their mean to 0.7
    assert np.mean(chi_squares) == pytest.approx(3, abs=2.1)


@pytest.mark.slow
def test_another_filter_than_the_known_one_is_found_out() -> None:
    # At 20 and 60 ns a filter of 13 MHz delays alike by chance; three widths tell it
    results = found(bench_with(6, cutoff_hz=11e6), replace(QUICK, widths_s=(20e-9, 40e-9, 90e-9))).results

    assert results["agreement"]["degrees_of_freedom"] == 5
    assert results["agreement"]["chi_square"] > 50
    assert abs(pull(results["clock_ppm"], 0.0)) < 3.5


def test_the_walk_with_amplitude_of_a_dead_band_comes_back() -> None:
    # Given a receiver that swallows what is below 1.5 mV, by which weak narrow pulses lose their foot
    deadband_v, poles = 1.5e-3, butterworth.poles(19e6, 3, 0.0)
    options = TofOptions(widths_s=(20e-9,), peaks_v=(12e-3, 90e-3), separations=16, shots=3)

    rows = found(bench_with(7, small_signal=SmallSignal(deadband_v=deadband_v)), options).results[
        "range_walk"
    ]

    # Then the delay is that of the same pulse, filtered, cut and fitted: an oracle without any procedure
    def delay_s(peak_v: float) -> float:
        pulse = gaussian_train((TrainPulse(20e-9, peak_v, 1e-6),), MODELS["33522B"])
        found_s = []
        for phase in np.arange(16) / 16:
            times_s = 1e-6 + (np.arange(42) - 20 + phase) * INTERVAL_S
            volts = response(pulse.volts, pulse.sample_rate_hz, pulse.start_s, "linear", poles, times_s)
            cut = np.sign(volts) * np.maximum(np.abs(volts) - deadband_v, 0)
            fit = gaussian_fit(cut, INTERVAL_S).pulse
            assert fit is not None
            found_s.append(times_s[0] + fit.arrival_s)
        return float(np.mean(found_s))

    expected_s = delay_s(12e-3) - delay_s(90e-3)
    weak = next(one for one in rows if one["peak_v"] < 50e-3)
    assert abs(expected_s) > 50e-12
    assert abs(pull(weak["by_amplitude"], expected_s)) < 3.5
    assert weak["by_amplitude"]["standard_uncertainty"] < 0.7 * abs(expected_s)


@pytest.mark.slow
def test_the_wobble_of_narrow_pulses_is_the_expected_one() -> None:
    options = TofOptions(widths_s=(6e-9, 40e-9), peaks_v=(90e-3,), separations=30, shots=3)

    narrow, wide = found(bench_with(8), options).results["wobble"]

    # the filter makes 6 ns 21 ns wide, and a Gaussian does not fit that at every phase alike
    assert narrow["detected_width_s"] == pytest.approx(21e-9, rel=0.05)
    assert narrow["expected_rms_s"] > 200e-12
    assert abs(pull(narrow["rms"], narrow["expected_rms_s"])) < 3.5
    assert narrow["rms"]["value"] > 10 * wide["rms"]["value"]


@pytest.mark.parametrize("trigger", ["generator", "digitizer"])
def test_pulses_are_found_whoever_triggers(trigger: str) -> None:
    config = msgspec.structs.replace(
        bench_with(9),
        bench=BenchTable(trigger=trigger, trigger_delay_s=2.7e-6),  # type: ignore[arg-type]
    )
    assert found(config, SMALL).results["points"] == {"ok": 3}


def test_a_receiver_with_shorter_windows_gets_shorter_distances() -> None:
    config = msgspec.structs.replace(
        bench_with(10, clock_ppm=40.0),
        digitizer=DigitizerTable(link="simulated", receiver="gala-like"),
    )
    results = found(config, replace(QUICK, widths_s=(20e-9, 40e-9))).results

    assert set(results["points"]) == {"ok"}
    assert abs(pull(results["clock_ppm"], 40.0)) < 3.5


# ---- the parts


@given(
    ppm=st.floats(-300, 300),
    delays_s=st.lists(st.floats(-2e-9, 2e-9), min_size=1, max_size=4),
    converters=st.integers(1, 2),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=30)
def test_a_fit_without_noise_gives_what_went_in(
    ppm: float, delays_s: list[float], converters: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    count = 60 * (len(delays_s) + 1)
    distance_s = rng.uniform(1e-6, 199e-6, count)
    kinds = np.stack([np.zeros(count, np.int64), np.arange(count) % (len(delays_s) + 1)], axis=1)
    widths = (kinds > 0).astype(np.int64)
    places = rng.uniform(0, 16000, (count, 2))
    wobble = 1e-10 * rng.normal(size=(2, harmonics(places[:, 0], converters).shape[1]))
    delay_s = np.array([0.0, *delays_s])
    excess_s = ppm * 1e-6 * distance_s + delay_s[kinds[:, 1]] - delay_s[kinds[:, 0]]
    for side, sign in ((1, 1.0), (0, -1.0)):
        columns = harmonics(places[:, side], converters)
        excess_s = excess_s + sign * np.sum(columns * wobble[widths[:, side]], axis=1)

    fit = fit_pairs(
        distance_s, excess_s, np.full(count, 1e-10), places, kinds, widths, converters, np.zeros(count)
    )

    assert fit is not None
    assert fit.scale_ppm.value == pytest.approx(ppm, abs=1e-8)
    assert [one.value for one in fit.delays] == pytest.approx([0.0, *delays_s], abs=1e-17)
    np.testing.assert_allclose(fit.wobble, wobble, atol=1e-17)
    assert fit.chi_square < 1e-6


def noisy_fit(rng: np.random.Generator, scatter_s: float) -> TofFit:
    count = 120
    distance_s = rng.uniform(1e-6, 199e-6, count)
    places = rng.uniform(0, 16000, (count, 2))
    kinds = np.zeros((count, 2), np.int64)
    kinds[:, 1] = np.arange(count) % 2
    excess_s = 3e-6 * distance_s + 5e-10 * kinds[:, 1] + scatter_s * rng.normal(size=count)
    fit = fit_pairs(distance_s, excess_s, np.full(count, 1e-10), places, kinds, kinds, 2, np.zeros(count))
    assert fit is not None
    return fit


def test_uncertainties_are_those_of_repetitions_and_grow_where_the_scatter_is_more() -> None:
    rng = np.random.default_rng(3)
    fits = [noisy_fit(rng, 1e-10) for _ in range(300)]
    # 300 draws tell a width to 4 %
    for pulls in (
        [(one.scale_ppm.value - 3) / one.scale_ppm.standard_uncertainty for one in fits],
        [(one.delays[1].value - 5e-10) / one.delays[1].standard_uncertainty for one in fits],
    ):
        assert np.std(pulls) == pytest.approx(1, abs=0.16)
        assert abs(np.mean(pulls)) < 0.24
    assert np.mean([one.chi_square / one.degrees_of_freedom for one in fits]) == pytest.approx(1, abs=0.04)
    # no wobble is there; its rms is not made of noise
    rms = [one.wobble_rms(0) for one in fits]
    assert np.mean([one.value < 3 * one.standard_uncertainty for one in rms]) > 0.95
    assert noisy_fit(rng, 3e-10).birge == pytest.approx(3, rel=0.3)


def test_pairs_that_determine_nothing_have_no_fit() -> None:
    one = np.array([1e-6])
    kinds = np.zeros((1, 2), np.int64)
    assert fit_pairs(one, one, one, np.ones((1, 2)), kinds, kinds, 2, one) is None
    nothing = np.zeros(0)
    assert fit_pairs(nothing, nothing, nothing, np.zeros((0, 2)), kinds[:0], kinds[:0], 2, nothing) is None
    # unequal pulses at one distance: scale and delay are one number
    many = np.full(9, 1e-4)
    kinds = np.tile([0, 1], (9, 1))
    places = np.random.default_rng(1).uniform(0, 9, (9, 2))
    assert fit_pairs(many, many, many, places, kinds, kinds, 2, many) is None


@pytest.mark.parametrize("fwhm_s", [8e-9, 40e-9, 80e-9])
@pytest.mark.parametrize("snr", [50.0, 400.0])
def test_the_uncertainty_of_an_arrival_is_its_spread_in_coloured_noise(fwhm_s: float, snr: float) -> None:
    poles = butterworth.poles(19e6, 3, 0.0)
    pulse = gaussian_train((TrainPulse(fwhm_s, 1.0, 1e-6),), MODELS["33622A"])
    times_s = 1e-6 + (np.arange(120) - 60.3) * INTERVAL_S
    clean = response(pulse.volts, pulse.sample_rate_hz, pulse.start_s, "linear", poles, times_s)
    rms = clean.max() / snr
    noise, rng = SampledNoise(poles, 0, INTERVAL_S), np.random.default_rng(int(snr))
    covariance = filtered_noise_covariance(poles, 0, INTERVAL_S, 42, rms)
    found_s, stated_s = [], []
    for _ in range(300):
        status, one, uncertainty_s = fitted(clean + rms * noise.draw(rng, 120), 42, INTERVAL_S, covariance)
        assert status == "ok"
        assert one is not None
        found_s.append(one.arrival_s)
        stated_s.append(uncertainty_s)
    # 300 draws tell it to 4 %
    assert np.std(found_s) == pytest.approx(np.mean(stated_s), rel=0.16)


def test_the_covariance_of_a_quiet_stretch_is_that_of_its_noise() -> None:
    poles = butterworth.poles(19e6, 3, 0.0)
    quiet = 2e-3 * SampledNoise(poles, 0, INTERVAL_S).draw(np.random.default_rng(4), 200_000)
    made = noise_covariance(quiet, 42, 0.5e-3)
    expected = filtered_noise_covariance(poles, 0, INTERVAL_S, 42, 2e-3)
    # 200 000 samples, some 100 000 of them independent
    np.testing.assert_allclose(made, expected, atol=5 * 4e-6 / math.sqrt(100_000))
    # a converter that sees no noise still rounds
    silent = noise_covariance(np.zeros(1000), 42, 0.5e-3)
    np.testing.assert_allclose(silent, np.eye(42) * 0.5e-3**2 / 12)


@pytest.mark.parametrize("model", ["33522B", "33622A"])
@pytest.mark.parametrize("offset_s", [0.0, 1.3e-9, 2.0e-9])
def test_moments_of_played_pulses_do_not_depend_on_the_grid(model: str, offset_s: float) -> None:
    wished = (TrainPulse(8e-9, 0.09, 1e-6 + offset_s), TrainPulse(50e-9, 0.01, 150e-6 + 3 * offset_s))

    first, second = played_pulses(gaussian_train(wished, MODELS[model]))

    for one, wish in ((first, wished[0]), (second, wished[1])):
        # the train ends where its last pulse is below a quarter of a step, at 4.5 standard deviations
        assert one.centre_s == pytest.approx(wish.centre_s, abs=5e-13)
        assert one.width_s == pytest.approx(wish.fwhm_s, rel=2e-3)
        assert one.peak_v == pytest.approx(wish.peak_v, rel=2e-3)
    steps = SampledPulse(np.array([0.0, 1.0, 1.0, 0.0]), 1e8, 0.0, "hold")
    assert played_pulses(steps)[0].centre_s == pytest.approx(20e-9)
    assert played_pulses(SampledPulse(np.zeros(4), 1e8)) == ()
    assert played_pulses(SampledPulse(np.array([0.0, 1.0, -1.0, 0.0]), 1e8)) == ()


def test_all_places_between_samples_are_met() -> None:
    for count in (6, 16, 40):
        found_s = np.array(distances_s(count, 199e-6, 25e-9))
        assert found_s[0] < 1.03e-6
        assert found_s[-1] == pytest.approx(199e-6)
        phases = np.sort(found_s[:-1] % 25e-9)
        gaps = np.diff(np.concatenate([phases, phases[:1] + 25e-9]))
        assert gaps.max() < 3 * 25e-9 / count


@pytest.mark.parametrize(("cutoff_hz", "order"), [(19e6, 3), (8e6, 5)])
def test_the_delay_at_zero_frequency(cutoff_hz: float, order: int) -> None:
    receiver = preset_receiver(simulated())
    receiver = replace(receiver, cutoff=Estimate(cutoff_hz, 0.0, "Hz"), order=order)
    frequency_hz = np.array([1e3])
    expected_s = -butterworth.phase(frequency_hz, cutoff_hz, order, 0.0)[0] / (2 * np.pi * 1e3)
    assert receiver_delay_s(receiver) == pytest.approx(expected_s, rel=1e-6)
    with_highpass = replace(receiver, highpass=Estimate(20e3, 1.0, "Hz"))
    assert receiver_delay_s(with_highpass) == pytest.approx(expected_s, rel=1e-9)


# ---- what cannot be told


def windows_of(change: Callable[[RangeWindow], RangeWindow]) -> Callable[[Shot], Shot]:
    return lambda shot: replace(shot, window=change(shot.window))


def one_pulse(window: RangeWindow) -> RangeWindow:
    counts = window.counts.copy()
    counts[90:] = 2048
    return replace(window, counts=counts)


@pytest.mark.parametrize(
    ("change", "status"),
    [
        (lambda one: replace(one, counts=np.full(one.counts.size, 2048, np.int16)), "not_two_pulses"),
        (one_pulse, "not_two_pulses"),
        (lambda one: replace(one, counts=one.counts[:30]), "not_two_pulses"),
        (lambda one: replace(one, saturated=3), "saturated"),
        (lambda one: replace(one, sample_interval_s=5e-9), "another_receiver"),
    ],
)
def test_windows_without_two_pulses_have_a_status(
    change: Callable[[RangeWindow], RangeWindow], status: str
) -> None:
    outcome = found(bench_with(), SMALL, windows_of(change))

    results = outcome.results
    assert results["points"] == {status: 3}
    assert results["status"] == "no_usable_point"
    assert results["clock_ppm"] is None
    assert outcome.figures == {}
    assert json.dumps(results, allow_nan=False)


def test_stimuli_that_are_not_two_pulses_have_a_status() -> None:
    single = gaussian_train((TrainPulse(40e-9, 0.05, 1e-6),), MODELS["33522B"])

    alone = found(bench_with(), SMALL, lambda shot: replace(shot, played=single)).results
    silent = found(bench_with(), SMALL, lambda shot: replace(shot, played=NoSignal())).results

    assert alone["points"] == {"not_two_pulses": 3}
    assert (silent["points"], silent["status"]) == ({}, "no_usable_point")


def test_equal_windows_and_too_few_have_no_scale() -> None:
    kept = InMemory([])
    config = bench_with(12)
    with open_bench(config) as bench:
        plan = tof_linearity.plan(bench, replace(SMALL, shots=2))
        tof_linearity.measure(bench, kept, plan)
    first = kept.shots[0]

    equal = tof_linearity.analyse(plan, [first, replace(first, attempt=2), first], config).results
    single = tof_linearity.analyse(plan, [first], config).results

    assert (equal["status"], equal["clock_ppm"]) == ("equal_windows", None)
    assert (single["status"], single["clock_ppm"]) == ("too_few_points", None)


@pytest.mark.slow
def test_two_gain_codes_are_not_mixed_and_one_can_be_named() -> None:
    config = bench_with(13, clock_ppm=-30.0)
    shots: list[Shot] = []
    for code in (2, 5):
        kept = InMemory([])
        with open_bench(config) as bench:
            plan = tof_linearity.plan(bench, replace(QUICK, gain_code=code))
            tof_linearity.measure(bench, kept, plan)
        shots += kept.shots

    mixed = tof_linearity.analyse(replace(plan, options=QUICK), shots, config).results
    named = tof_linearity.analyse(plan, shots, config).results

    assert (mixed["status"], mixed["clock_ppm"]) == ("mixed_gain_codes", None)
    assert named == tof_linearity.analyse(plan, kept.shots, config).results
    assert abs(pull(named["clock_ppm"], -30.0)) < 3.5


@pytest.mark.parametrize(
    "chosen",
    [
        {"widths_s": ()},
        {"peaks_v": (0.0,)},
        {"widths_s": (200e-9,)},
        {"separations": 1},
        {"shots": 0},
        {"peaks_v": (math.nan,)},
    ],
)
def test_options_that_cannot_be_are_refused(chosen: dict[str, object]) -> None:
    with pytest.raises(RefusedInput):
        TofOptions(**chosen)  # type: ignore[arg-type]


# ---- the command


OPTIONS = ["--widths-ns", "30,60", "--peaks-mv", "50", "--separations", "4", "--shots", "1", "--quiet"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tof") / "run"
    assert main(["tof-linearity", "--bench", "simulated", "--out", str(folder), *OPTIONS]) == 0
    return folder


def test_a_run_and_its_windows_give_equal_results(run: Path, tmp_path: Path) -> None:
    words = ["--windows", str(run / "data.nc"), "--out", str(tmp_path / "again"), *OPTIONS]

    assert main(["tof-linearity", *words]) == 0

    one, two = (json.loads((each / "summary.json").read_text()) for each in (run, tmp_path / "again"))
    assert one["results"] == two["results"]
    assert one["results"]["points"] == {"ok": 8}
    assert (run / "figure-tof-linearity.png").is_file()


def test_the_pages_name_every_variable_and_key(run: Path) -> None:
    page = (DOCS / "data-file.md").read_text(encoding="utf-8")
    section = page.split("## Of `belahil tof-linearity`")[1].split("\n## ")[0]
    told = dict(re.findall(r"^\| `(\w+)` \| .*? \| .*? \| (.*) \|$", section, re.MULTILINE))
    with xarray.open_dataset(run / "data.nc") as data:
        written = {str(name): str(values.attrs["long_name"]) for name, values in data.variables.items()}
    assert told == {name: text for name, text in written.items() if name in told}
    assert {name for name in written if name.startswith(("tof_", "clock_"))} == set(told)

    contract = (DOCS / "tof-linearity.md").read_text(encoding="utf-8").split("## Results")[1]
    named = set(re.findall(r"`(\w+)`", contract))
    results = json.loads((run / "summary.json").read_text())["results"]
    assert keys(results) - named == set()


def test_options_of_the_command_are_those_of_the_architecture() -> None:
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    (own,) = re.findall(r"^`tof-linearity` takes (.+)$", text, re.MULTILINE)
    made = {option for one in command.params for option in one.opts}
    common = set(re.findall(r"^\| .*", text, re.MULTILINE)) and {
        "--bench", "--out", "--resume", "--seed", "--record", "--quiet", "--json", "--version",
    }  # fmt: skip
    assert set(re.findall(r"--[a-z-]+", own)) == made - common
