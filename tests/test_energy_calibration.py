"""Energies come back from played pulses behind hidden receivers; what cannot be told has a status."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5netcdf
import msgspec
import numpy as np
import pytest
import xarray
from hidden_receivers import InMemory
from test_data_file import keys

from belahil import butterworth
from belahil.bench import open_bench
from belahil.cli.energy_calibration import command
from belahil.cli.main import main
from belahil.config import (
    BenchConfig,
    BenchTable,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    Interleave,
    SmallSignal,
    simulated,
)
from belahil.errors import RefusedInput
from belahil.generators import MODELS
from belahil.outcome import Outcome
from belahil.stimuli import NoSignal, SampledPulse
from belahil.values import Estimate, RangeWindow, Shot
from procedures import energy_calibration
from procedures.energy_calibration import EnergyOptions
from procedures.energy_model import (
    EnergyPoints,
    energy_per_volt_second,
    finder_of,
    footprint_points,
    plane_points,
    played_area_v_s,
)
from procedures.gaussian_pulses import TrainPulse, gaussian_train
from procedures.known_receiver import KnownReceiver, preset_receiver
from procedures.played_pulses import GAUSSIAN_AREA
from procedures.pulse_energy import pulse_energy, window_energy
from sim.chain import Chain
from sim.kernel import Kernel
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape
from sim.scene import load_scene, parse_scene

DOCS = Path(__file__).resolve().parent.parent / "docs"
INTERVAL_S = 12.5e-9
QUICK = EnergyOptions(widths_s=(8e-9, 20e-9, 40e-9, 70e-9, 100e-9), shots=6, altitudes_m=())


def bench_with(seed: int = 1, **receiver: object) -> BenchConfig:
    return msgspec.structs.replace(
        simulated(), emulation=EmulationTable(seed=seed, receiver=EmulatedReceiver(**receiver))
    )


def measured(config: BenchConfig, options: EnergyOptions) -> list[Shot]:
    kept = InMemory([])
    with open_bench(config) as bench:
        energy_calibration.measure(bench, kept, energy_calibration.plan(bench, options))
    return kept.shots


def found(
    config: BenchConfig, options: EnergyOptions = QUICK, change: Callable[[Shot], Shot] = lambda shot: shot
) -> Outcome:
    kept = InMemory([])
    with open_bench(config) as bench:
        plan = energy_calibration.plan(bench, options)
        energy_calibration.measure(bench, kept, plan)
    return energy_calibration.analyse(plan, [change(shot) for shot in kept.shots], config)


def known(config: BenchConfig, **changes: object) -> KnownReceiver:
    """The receiver of a bench without its errors."""
    truth = config.emulation.receiver
    filled = preset_receiver(config)
    cutoff_hz = truth.cutoff_hz or filled.cutoff.value
    return replace(
        filled,
        cutoff=Estimate(cutoff_hz, 1e-3 * cutoff_hz, "Hz"),
        order=truth.order or filled.order,
        highpass=Estimate(truth.highpass_hz, 0.01 * truth.highpass_hz, "Hz") if truth.highpass_hz else None,
        codes=tuple(replace(one, gain=Estimate(one.gain.value, 1e-4)) for one in filled.codes),
        **changes,
    )


# ---- what must come back


@pytest.mark.parametrize(
    ("seed", "truth"),
    [
        (1, {}),
        (2, {"cutoff_hz": 15e6, "order": 4}),
        (3, {"cutoff_hz": 26e6, "order": 2, "clock_ppm": 60.0}),
        (4, {"interleave": Interleave(gain=0.01, offset_v=3e-3, skew_s=150e-12)}),
    ],
)
def test_a_filter_keeps_areas_so_the_window_tells_the_energy_of_any_receiver(
    seed: int, truth: dict[str, object]
) -> None:
    # Given any hidden receiver without AC coupling, of which only gain and filter are known
    config = bench_with(seed, **truth)

    outcome = found(config, replace(QUICK, receiver=known(config)))

    # Then E_CW / gain is the area at the cut: the slope is E_ph / (q eps_qe M R_f G), without intercept
    one = outcome.results["measured"]["window"]
    expected = energy_per_volt_second(load_scene("fractal")) / 5.19
    clock = 1 + 1e-6 * float(truth.get("clock_ppm", 0.0))  # type: ignore[arg-type]
    assert outcome.results["status"] == "ok"
    slope = Estimate(**one["slope"])
    assert abs(slope.value - expected / clock) < 3.5 * slope.standard_uncertainty
    # 1.2e-4 of narrow pulses falls out of the window or between samples, and their line tilts by less
    assert slope.standard_uncertainty < 3e-3 * expected
    offset = Estimate(**one["intercept_by_slope"])
    assert abs(offset.value) < 3.5 * offset.standard_uncertainty + 0.1e-9
    # and both integrals agree with the known receiver, width by width
    for name in ("gaussian", "window"):
        agreement = outcome.results["agreement"][name]
        assert agreement["degrees_of_freedom"] == 5
        assert agreement["chi_square"] < 22  # 1 in 2000 by chance


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_stated_uncertainties_cover() -> None:
    expected = energy_per_volt_second(load_scene("fractal")) / 5.19
    pulls, chi_squares = [], []
    for seed in range(300, 340):
        config = bench_with(seed)
        results = found(config, replace(QUICK, receiver=known(config))).results
        slope, offset = (
            Estimate(**results["measured"]["window"][one]) for one in ("slope", "intercept_by_slope")
        )
        pulls.append(
            [
                (slope.value - expected) / slope.standard_uncertainty,
                offset.value / offset.standard_uncertainty,
            ]
        )
        chi_squares.append([results["agreement"][name]["chi_square"] for name in ("gaussian", "window")])
    # 40 runs: the width of pulls to 11 %, their mean to 0.16; five widths in each chi-square, to 0.5
    assert np.all(np.abs(np.std(pulls, axis=0) - 1) < 0.33)
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.48)
    np.testing.assert_allclose(np.mean(chi_squares, axis=0), 5, atol=1.7)


def test_another_filter_than_the_known_one_is_found_out() -> None:
    config = bench_with(5, cutoff_hz=15e6)

    results = found(config, replace(QUICK, receiver=known(bench_with(5)))).results

    assert results["agreement"]["gaussian"]["chi_square"] > 100
    # which the window alone could not tell, since a filter keeps areas but not heights: x and y move together
    assert results["measured"]["window"]["status"] == "ok"


@pytest.mark.parametrize("highpass_hz", [10e3, 100e3])
def test_ac_coupling_takes_the_share_of_the_window_that_it_must(highpass_hz: float) -> None:
    config = bench_with(6, highpass_hz=highpass_hz)

    results = found(config, replace(QUICK, receiver=known(config))).results

    # About 2 pi f times the 0.26 us from the pulse to the end of the window is missing
    missing = 2 * math.pi * highpass_hz * 0.26e-6
    for one in results["linearity"]:
        assert 1 - one["ratio"]["value"] == pytest.approx(missing, rel=0.25, abs=0.01)
    assert results["agreement"]["window"]["chi_square"] < 22


def test_a_dead_band_shows_in_the_linearity() -> None:
    quiet = bench_with(7, small_signal=SmallSignal(deadband_v=0.5e-3))

    rows = found(quiet, replace(QUICK, receiver=known(quiet))).results["linearity"]

    ratios = [Estimate(**one["ratio"]) for one in rows]
    assert [one["peak_v"] for one in rows] == sorted(one["peak_v"] for one in rows)
    # 0.5 mV off a pulse of 8 mV, over its width
    assert 0.85 < ratios[0].value < 0.95
    assert ratios[0].value < ratios[1].value < ratios[2].value < 1


@pytest.mark.parametrize("trigger", ["generator", "digitizer"])
def test_pulses_are_found_whoever_triggers(trigger: str) -> None:
    config = msgspec.structs.replace(
        bench_with(8),
        bench=BenchTable(trigger=trigger, trigger_delay_s=3.1e-6),  # type: ignore[arg-type]
    )
    results = found(config, replace(QUICK, widths_s=(20e-9, 40e-9, 80e-9), shots=2)).results

    assert results["points"] == {"ok": 18}
    assert results["status"] == "ok"


@pytest.mark.slow
def test_gains_of_photodiode_and_receiver_only_scale(tmp_path: Path) -> None:
    # Given another photodiode gain and another gain code
    scene = tmp_path / "hot.toml"
    scene.write_text("[detector]\nmultiplication = 90.0\n[surface]\nkind = 'fractal'\n")
    config = bench_with(9)
    base = replace(QUICK, receiver=known(config))

    plain = found(config, base).results
    other = found(config, replace(base, scene=str(scene), gain_code=7)).results

    gain = preset_receiver(config).at(7).gain.value
    assert other["scales"] == pytest.approx([48.4 / 90 * 5.19 / gain])
    assert plain["scales"] == pytest.approx([1.0])
    slopes = [Estimate(**one["measured"]["window"]["slope"]) for one in (plain, other)]
    assert slopes[0].value == pytest.approx(slopes[1].value, abs=4 * slopes[0].standard_uncertainty)


# ---- the model


def points_of(fwhm_s: float, poles: tuple[complex, ...]) -> tuple[EnergyPoints, float]:
    shape = PulseShape((PulsePiece(1.0, fwhm_s / FWHM_OF_SIGMA),))
    finder = finder_of(preset_receiver(simulated()), 42)
    times_s = (np.arange(512) - 256) * INTERVAL_S
    pulse = pulse_energy(Kernel(shape, poles).exact(times_s), INTERVAL_S, finder)
    return EnergyPoints.of_pulses([pulse], [1.0]), pulse.arrival_s


@pytest.mark.parametrize("fwhm_s", [25e-9, 40e-9, 70e-9, 105e-9])
def test_both_integrals_of_a_gaussian_are_its_area(fwhm_s: float) -> None:
    points, arrival_s = points_of(fwhm_s, ())

    assert pytest.approx(1.06447, abs=5e-6) == GAUSSIAN_AREA
    assert points.gaussian_s[0] == pytest.approx(GAUSSIAN_AREA * fwhm_s, rel=1e-6)
    # trapezoids of a smooth pulse are exact; the error of a Gaussian is 2 exp(-2 (pi sigma / dt)^2)
    error = 2 * math.exp(-2 * (math.pi * fwhm_s / FWHM_OF_SIGMA / INTERVAL_S) ** 2)
    ends = 2 * math.erfc(20 * INTERVAL_S / (math.sqrt(2) * fwhm_s / FWHM_OF_SIGMA))
    assert points.window_s[0] == pytest.approx(GAUSSIAN_AREA * fwhm_s, rel=error + ends + 1e-9)
    assert points.rectified_s[0] == pytest.approx(points.window_s[0], rel=1e-9)
    assert arrival_s == pytest.approx(256 * INTERVAL_S, abs=1e-12)


def test_behind_the_filter_the_gaussian_fit_is_the_one_that_errs() -> None:
    points, _ = points_of(7e-9, butterworth.poles(19e6, 3, 0.0))

    assert 1 / points.amplitude_v[0] == pytest.approx(points.window_s[0], rel=0.02)
    # the undershoot is not in the Gaussian
    assert points.gaussian_s[0] > 1.05 * points.window_s[0]
    assert points.rectified_s[0] > 1.05 * points.window_s[0]


def test_planes_have_the_line_of_the_responsivity_and_no_intercept() -> None:
    receiver, scene = preset_receiver(simulated()), load_scene("fractal")

    points = plane_points(scene, receiver, finder_of(receiver, 42)).within(20e-9, 110e-9)
    fit = points.fit("window")

    assert fit is not None
    assert fit.slope.value == pytest.approx(energy_per_volt_second(scene) / 5.19, rel=1e-3)
    assert abs(fit.intercept.value / fit.slope.value) < 0.02e-9
    # of the published 14 %: how far the narrowest of these pulses are from the published Gaussian line
    narrow = points.fwhm_s < 23e-9
    printed = 2.94e-7 * points.gaussian_s + 4.62e-16
    assert np.mean(points.energy_j_per_v[narrow] / printed[narrow]) - 1 == pytest.approx(-0.11, abs=0.04)


def test_footprints_are_the_echoes_of_the_chain() -> None:
    # Given rough ground, and the chain as a slow judge: one echo at a time, by its own path
    scene = parse_scene(
        "altitude_m = 800e3\n[laser]\njitter_rad = 0.0\n[surface]\nkind = 'fractal'\nrms_deviation_m = 1.5\n"
    )
    receiver = preset_receiver(simulated())
    finder = finder_of(receiver, 42)

    points = footprint_points(scene, receiver, finder, (800e3,), 40)
    chain = Chain(msgspec.structs.replace(scene, altitude_m=800e3))
    samples = chain.samples(None, chain.correlation_window(0, 512))
    judge = pulse_energy(samples.volts / 5.19, INTERVAL_S, finder)

    # Then the energy of nadir's footprint by the chain lies on the curve of the others
    fit = points.fit("gaussian", np.argsort(np.argsort(points.gaussian_s)) // 8)
    assert fit is not None
    energy_j_per_v = chain.echo().energy_j / (5.19 * judge.amplitude_v)
    expected = fit.energy_per_volt(judge.gaussian_v_s / judge.amplitude_v)
    assert energy_j_per_v == pytest.approx(float(expected), rel=5 * fit.left_rms + 2e-3)
    # and its window holds that energy, which no scatter of shapes changes
    held_j = judge.window_v_s * energy_per_volt_second(scene)
    assert held_j == pytest.approx(chain.echo().energy_j, rel=2e-3)


def test_ground_that_is_no_terrain_model_is_refused() -> None:
    receiver = preset_receiver(simulated())
    with pytest.raises(RefusedInput, match="terrain model"):
        footprint_points(load_scene("plane"), receiver, finder_of(receiver, 42), (500e3,), 4)


def test_the_area_of_a_played_pulse_is_that_of_its_lines_or_steps() -> None:
    volts = np.array([0.0, 1.0, 3.0, 0.5, 0.0])
    lines, steps = (SampledPulse(volts, 1e8, 0.0, how) for how in ("linear", "hold"))  # type: ignore[arg-type]
    times_s = np.linspace(-1e-8, 7e-8, 800_001)

    for pulse in (lines, steps, replace(steps, volts=volts + 0.25)):
        slow = float(np.trapezoid(pulse.at(times_s), times_s))
        assert played_area_v_s(pulse) == pytest.approx(slow, rel=1e-5)


# ---- what cannot be told


def windows_of(change: Callable[[RangeWindow], RangeWindow]) -> Callable[[Shot], Shot]:
    return lambda shot: replace(shot, window=change(shot.window))


def silent(window: RangeWindow) -> RangeWindow:
    return replace(window, counts=np.full(window.counts.size, 2048, np.int16))


def inverted(window: RangeWindow) -> RangeWindow:
    return replace(window, counts=(4096 - window.counts).astype(np.int16))


def short(window: RangeWindow) -> RangeWindow:
    return replace(window, counts=window.counts[:3])


def clipped(window: RangeWindow) -> RangeWindow:
    top = np.int16(window.counts.max() - 1)
    return replace(window, counts=np.minimum(window.counts, top), saturated=1)


SMALL = replace(QUICK, widths_s=(20e-9, 40e-9, 80e-9), peaks_v=(80e-3,), shots=2)


@pytest.mark.parametrize(
    ("change", "status"),
    [(silent, "no_pulse"), (short, "too_few_samples"), (clipped, "saturated")],
)
def test_windows_without_an_energy_have_a_status(
    change: Callable[[RangeWindow], RangeWindow], status: str
) -> None:
    outcome = found(bench_with(), SMALL, windows_of(change))

    assert outcome.results["points"] == {status: 6}
    assert outcome.results["status"] == "no_usable_point"
    assert outcome.results["measured"]["gaussian"]["slope"] is None
    assert outcome.results["agreement"] == {"gaussian": None, "window": None}
    assert outcome.results["linearity"] == []
    assert outcome.figures == {}
    assert json.dumps(outcome.results, allow_nan=False)


def test_a_pulse_upside_down_agrees_with_nothing() -> None:
    # The range finder looks for what rises, and finds the overshoot or noise
    results = found(bench_with(), SMALL, windows_of(inverted)).results

    assert json.dumps(results, allow_nan=False)
    agreement = results["agreement"]["window"]
    assert agreement is None or agreement["chi_square"] > 100


def test_pulses_of_two_widths_have_no_line() -> None:
    def third_is_silent(shot: Shot) -> Shot:
        return windows_of(silent)(shot) if shot.window.shot >= 4 else shot

    results = found(bench_with(), SMALL, third_is_silent).results

    assert results["status"] == "too_few_points"
    assert results["points"] == {"no_pulse": 2, "ok": 4}
    assert results["linearity"][0]["points"] == 4


def test_shots_of_silence_are_left_out_and_no_shots_are_no_points() -> None:
    assert found(bench_with(), SMALL, lambda shot: replace(shot, played=NoSignal())).results["points"] == {}


def test_two_gain_codes_mixed_are_each_taken_with_their_own_gain() -> None:
    config = bench_with(11)
    options = replace(SMALL, shots=6, peaks_v=(40e-3,), receiver=known(config))
    low, high = (measured(config, replace(options, gain_code=code)) for code in (2, 6))
    mixed = low[::2] + high[1::2]
    with open_bench(config) as bench:
        plan = energy_calibration.plan(bench, options)

    results = energy_calibration.analyse(plan, mixed, config).results

    assert len(results["gains"]) == 2
    slope = Estimate(**results["measured"]["window"]["slope"])
    expected = energy_per_volt_second(load_scene("fractal")) / 5.19
    assert slope.value == pytest.approx(expected, abs=4 * slope.standard_uncertainty)
    assert slope.standard_uncertainty < 0.01 * expected


def test_windows_from_another_receiver_or_at_an_unknown_gain_have_no_energy() -> None:
    other = found(bench_with(), SMALL, windows_of(lambda one: replace(one, sample_interval_s=5e-9))).results
    strange = replace(known(bench_with()), codes=(known(bench_with()).codes[3],))
    unknown = found(bench_with(), replace(SMALL, receiver=strange)).results

    assert (other["points"], other["status"]) == ({"another_receiver": 6}, "no_usable_point")
    assert (unknown["points"], unknown["status"]) == ({"not_known": 6}, "no_usable_point")


def test_another_receiver_than_the_bench_file_names_has_no_energy_even_if_it_is_known() -> None:
    # Given windows of a receiver whose characterization is there, but not its bench file, which tells how
    # many samples its correlation windows have
    other = replace(known(bench_with()), sample_interval_s=5e-9)
    change = windows_of(lambda one: replace(one, sample_interval_s=5e-9))
    with open_bench(bench_with()) as bench:
        plan = replace(energy_calibration.plan(bench, SMALL), options=replace(SMALL, receiver=other))
    # When they are analysed, then they are called another receiver's
    shots = [change(shot) for shot in measured(bench_with(), SMALL)]
    assert energy_calibration.analyse(plan, shots, bench_with()).results["points"] == {"another_receiver": 6}


def test_equal_windows_have_no_line() -> None:
    first = measured(bench_with(), SMALL)[0].window

    results = found(bench_with(), SMALL, windows_of(lambda one: replace(first, shot=one.shot))).results

    assert results["status"] == "equal_windows"
    assert results["measured"]["window"]["slope"] is None


def test_two_pulses_in_one_stimulus_have_no_energy() -> None:
    pair = gaussian_train((TrainPulse(20e-9, 0.05, 1e-6), TrainPulse(20e-9, 0.05, 3e-6)), MODELS["33522B"])

    results = found(bench_with(), SMALL, lambda shot: replace(shot, played=pair)).results

    assert results["points"] == {"not_known": 6}


@pytest.mark.parametrize(
    "chosen",
    [
        {"widths_s": (20e-9, 40e-9)},
        {"widths_s": (20e-9, 40e-9, -1e-9)},
        {"peaks_v": ()},
        {"peaks_v": (math.nan,)},
        {"shots": 0},
        {"altitudes_m": (math.inf,)},
    ],
)
def test_options_that_cannot_be_are_refused(chosen: dict[str, object]) -> None:
    with pytest.raises(RefusedInput):
        EnergyOptions(**chosen)  # type: ignore[arg-type]


def test_a_correlation_window_alone_gives_the_same_energy() -> None:
    config = bench_with(12)
    whole = measured(config, SMALL)
    receiver = preset_receiver(config)
    finder = finder_of(receiver, 42)
    for shot in whole:
        window = shot.window
        alone = finder.report(window, "correlation_windows")

        one, other = (window_energy(each, finder, 2, 12) for each in (window, alone))

        assert other.usable
        # 0 V of the receiver is believed: half a count over the window, and a window one sample aside
        slack = 0.5 * window.volts_per_count * 42 * INTERVAL_S + 4e-3 * one.window_v_s
        assert other.window_v_s == pytest.approx(one.window_v_s, abs=slack)


# ---- the command

OPTIONS = ["--widths-ns", "15,30,60", "--peaks-mv", "30,90", "--shots", "2", "--footprints", "12", "--quiet"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("energy") / "run"
    assert main(["energy-calibration", "--bench", "simulated", "--out", str(folder), *OPTIONS]) == 0
    return folder


def test_a_run_and_its_windows_give_equal_results(run: Path, tmp_path: Path) -> None:
    words = ["--windows", str(run / "data.nc"), "--out", str(tmp_path / "again"), *OPTIONS]

    assert main(["energy-calibration", *words]) == 0

    one, two = (json.loads((each / "summary.json").read_text()) for each in (run, tmp_path / "again"))
    assert one["results"] == two["results"]
    assert one["results"]["points"] == {"ok": 12}
    assert (run / "figure-energy.png").is_file()


@pytest.mark.parametrize("name", ["energy-calibration", "tof-linearity"])
def test_a_file_without_pulses_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Given another program's file with dark windows
    with h5netcdf.File(tmp_path / "dark.nc", "w") as file:
        file.dimensions = {"shot": 2, "sample": 600}
        file.create_variable("counts", ("shot", "sample"), data=np.full((2, 600), 2048, np.int16))
        file.create_variable("volts_per_count", (), data=0.5e-3)
        file.create_variable("sample_interval_s", (), data=INTERVAL_S)
        file.attrs.update(digitizer_bits=12, digitizer_converters=2)

    status = main([name, "--windows", str(tmp_path / "dark.nc"), "--out", str(tmp_path / "none")])

    assert status == 2
    assert "no window with a sampled pulse" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_a_pulse_over_the_interlock_is_refused_before_anything_is_played() -> None:
    config = msgspec.structs.replace(bench_with(), generator=GeneratorTable(address="simulated", max_vpp=0.1))
    with pytest.raises(RefusedInput, match="max_vpp"), open_bench(config) as bench:
        energy_calibration.plan(bench, QUICK)


def test_the_pages_name_every_variable_and_key(run: Path) -> None:
    page = (DOCS / "data-file.md").read_text(encoding="utf-8")
    section = page.split("## Of `belahil energy-calibration`")[1].split("\n## ")[0]
    told = dict(re.findall(r"^\| `(\w+)` \| .*? \| .*? \| (.*) \|$", section, re.MULTILINE))
    with xarray.open_dataset(run / "data.nc") as data:
        written = {str(name): str(values.attrs["long_name"]) for name, values in data.variables.items()}
    assert told == {name: text for name, text in written.items() if name in told}
    ours = ("energy_", "plane_", "footprint_")
    assert {name for name in written if name.startswith(ours)} == set(told)

    contract = (DOCS / "energy-calibration.md").read_text(encoding="utf-8").split("## Results")[1]
    named = set(re.findall(r"`(\w+)`", contract))
    results = json.loads((run / "summary.json").read_text())["results"]
    assert keys(results) - named - {"ok", "peak_v"} == set()


def test_options_of_the_command_are_those_of_the_architecture() -> None:
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    (own,) = re.findall(r"^`energy-calibration` takes (.+)$", text, re.MULTILINE)
    made = {option for one in command.params for option in one.opts}
    assert set(re.findall(r"--[a-z-]+", own)) <= made
    assert {
        one for one in made if one.startswith(("--widths", "--peaks", "--shots", "--gain", "--scene"))
    } <= set(re.findall(r"--[a-z-]+", own))
