"""Echoes played into a receiver and compared with their prediction, from scenes to verdicts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from msgspec import structs

from belahil.bench import Bench, open_bench
from belahil.cli.main import main
from belahil.config import BenchConfig, GeneratorUncertainty, Interleave, emulated, simulated
from belahil.errors import LinkClosed, RefusedInput
from belahil.generators import GeneratorModel
from belahil.recorded import read_windows
from belahil.stimuli import SampledPulse
from belahil.values import RangeWindow, Shot, WindowRequest
from procedures.playable import playable
from procedures.pulse_echoes import NamedScene
from procedures.pulse_shape import PulseShapeOptions, analyse, measure, plan, recorded_plan
from procedures.pulse_shape_plan import PulseShapePlan
from sim.chain import Chain
from sim.draws import Draws
from sim.receiver_model import ReceiverModel
from sim.scene import Scene, as_toml, load_scene
from tests.scenes import BARE, NIGHT, with_
from tests.test_data_file import keys, told

IDEAL = GeneratorModel(
    "ideal", "belahil", 1e12, 16e9, 16, 10_000_000, min_amplitude_vpp=1e-9, amplitude_digits=9
)


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.shots: dict[int, Shot] = {}

    def shot(self, request: WindowRequest, measure: Callable[[], Shot], why: Callable[[], str] = str) -> Shot:
        if request.shot not in self.shots:
            self.shots[request.shot] = measure()
        return self.shots[request.shot]


def bench_of(
    seed: int = 1,
    *,
    address: str = "simulated",
    bandwidth_hz: float = 30e6,
    declared_hz: float | None = None,
    attenuation_db: float = 20.0,
    driver: str = "keysight-33500",
    amplitude_error: float = 0.0,
    trigger: str = "generator",
    trigger_delay_s: float = 0.0,
    **receiver: Any,
) -> BenchConfig:
    """A bench with a real profile: 16 bits, 250 MSa/s, and an output of 30 MHz that is declared."""
    config = simulated() if address == "simulated" else emulated()
    truth = structs.replace(
        config.emulation.generator, bandwidth_hz=bandwidth_hz, bits=16, amplitude_error=amplitude_error
    )
    return structs.replace(
        config,
        bench=structs.replace(config.bench, trigger=trigger, trigger_delay_s=trigger_delay_s),
        generator=structs.replace(
            config.generator,
            driver=driver,
            attenuation_db=attenuation_db,
            bandwidth_hz=bandwidth_hz if declared_hz is None else declared_hz,
            uncertainty=GeneratorUncertainty(amplitude_relative=0.005, bandwidth_relative=0.01),
        ),
        emulation=structs.replace(
            config.emulation,
            seed=seed,
            generator=truth,
            receiver=structs.replace(config.emulation.receiver, **receiver),
        ),
    )


def named(scene: Scene, name: str = "scene") -> tuple[NamedScene, ...]:
    return (NamedScene(name, as_toml(scene)),)


def ready(*names: str) -> tuple[NamedScene, ...]:
    return tuple(NamedScene(name, as_toml(load_scene(name))) for name in names)


def measured(config: BenchConfig, options: PulseShapeOptions) -> tuple[PulseShapePlan, list[Shot]]:
    with open_bench(config) as bench:
        made = plan(bench, options)
        kept = Kept()
        measure(bench, kept, made)
    return made, list(kept.shots.values())


def results(config: BenchConfig, options: PulseShapeOptions) -> dict[str, Any]:
    return analyse(*measured(config, options), config).results


def reduced(case: dict[str, Any], kind: str = "played") -> float:
    return float(case[kind]["reduced_chi_square"]["value"])


# ---- a played echo on an ideal generator


@pytest.mark.parametrize(
    ("scene", "shot"),
    [
        (with_(BARE, noise={"dark_rms_v": None}), None),
        (with_(NIGHT, surface={"slope_deg": 3.0}, noise={"dark_rms_v": 0.83e-3}), 7),
        (with_(NIGHT, surface={"slope_deg": 25.0, "azimuth_deg": 40.0}), 8),
        (structs.replace(with_(NIGHT, laser={"jitter_rad": (2e-6, 2e-6)}), seed=5, altitude_m=900e3), 9),
        (load_scene("crater"), None),
    ],
)
def test_an_ideal_generator_gives_the_window_that_the_scene_gives(scene: Scene, shot: int | None) -> None:
    # given the echo of a scene, shot noise and jitter inside where there are any
    chain = Chain(scene)
    index = shot or 0
    request = chain.correlation_window(index)
    wished = chain.stimulus(shot)
    assert isinstance(wished, SampledPulse)
    # when an ideal generator plays it into the receiver of the scene, with the same draws
    found = playable(wished, IDEAL, simulated())
    truth = scene.truth
    if shot is None:
        truth = structs.replace(truth, noise_rms_v_by_code=(0.0,) * 16)
    receiver = ReceiverModel(truth, scene.receiver_spec.digitizer)
    played = receiver.window(found.played, request, Draws(scene.seed, index))
    # then the window is the one that the chain gives directly, but where rounding tips over; shot noise is
    # the chain's up to the rate of its steps, which differs by a part of a count
    direct = chain.window(shot, request)
    if shot is None:
        # The mean shot of a chain is taken at phase 0, a played one where its draw says.
        first_s = (Draws(scene.seed, index).uniform("sampling_phase") + receiver.edges(request)) * 12.5e-9
        curve = chain.curve(None, first_s - chain.gate_s, 12.5e-9, request.sample_count)
        direct = receiver.digitized(curve, request)
    difference = np.abs(played.counts.astype(int) - direct.counts)
    assert difference.max() <= 1
    assert np.count_nonzero(difference) <= 3
    assert np.ptp(direct.counts) > 10


@pytest.mark.parametrize("address", ["simulated", "emulated"])
def test_a_bench_with_a_fast_generator_gives_the_window_that_the_scene_gives(address: str) -> None:
    # given a bench whose generator plays 1 GSa/s, and a scene with the noise of its receiver, of equal seeds
    config = bench_of(3, address=address, bandwidth_hz=math.inf, driver="keysight-33600")
    noise_v = load_scene("night").receiver_spec.noise_rms_v_by_code[4]
    scene = structs.replace(with_(NIGHT, noise={"dark_rms_v": noise_v}), seed=3)
    chain = Chain(scene)
    worst = 0
    with open_bench(config) as bench:
        for shot in range(6):
            wished = chain.stimulus(shot)
            assert isinstance(wished, SampledPulse)
            found = playable(wished, bench.generator_model, config)
            # when each shot's realization is played
            request = chain.correlation_window(shot)
            window = bench.measure(found.stimulus, request).window
            # then its counts are those of the chain to one: 14 bits and lines of 1 ns leave a part of one
            difference = np.abs(window.counts.astype(int) - chain.window(shot, request).counts)
            assert difference.max() <= 1
            worst += int(np.count_nonzero(difference))
    assert worst <= 25  # of 252


# ---- a real profile


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("shot_noise", ["absent", "inside"])
def test_the_prediction_for_what_was_played_holds_and_for_what_was_wished_fails(
    seed: int, shot_noise: Any
) -> None:
    # given a generator of 16 bits, 250 MSa/s and 30 MHz, and an echo as it comes or as its mean
    config = bench_of(100 + seed)
    shots = 200 if shot_noise == "absent" else 60
    options = PulseShapeOptions(ready("night"), shots=shots, shot_noise=shot_noise)
    # when it is played and its windows are compared
    found = results(config, options)
    # then with the noise measured in the same run the prediction for what was played holds
    (case,) = found["cases"]
    assert case["played"]["degrees_of_freedom"] == shots * 41
    assert 0.9 < reduced(case) < 1.1
    assert abs(reduced(case) - 1) < 4 * case["played"]["reduced_chi_square"]["standard_uncertainty"]
    assert (case["verdict"], case["status"], case["played"]["failed"]) == ("agrees", "ok", [])
    # and that for what was wished fails, since the generator's output is slower
    assert reduced(case, "wished") > 1.2
    assert case["wished"]["verdict"] == "differs"
    assert (found["verdict"], found["shot_noise"]) == ("agrees", shot_noise)


def test_a_prediction_that_does_not_know_the_shot_noise_in_the_waveform_fails() -> None:
    # given windows of realizations with shot noise
    config = bench_of(5)
    made, shots = measured(config, PulseShapeOptions(ready("night"), shots=60, shot_noise="inside"))
    knows = analyse(made, shots, config).results["cases"][0]
    # when the prediction takes the mean echo for what was played in each
    mean, _ = measured(config, PulseShapeOptions(ready("night"), shots=2))
    played = mean.cases[0].pulses[0].played
    blind = [
        replace(shot, played=played) if isinstance(shot.played, SampledPulse) else shot for shot in shots
    ]
    ignorant = analyse(made, blind, config).results["cases"][0]
    # then it fails, where the prediction that knows each waveform holds
    assert knows["verdict"] == "agrees"
    assert ignorant["verdict"] == "differs"
    assert reduced(ignorant) > reduced(knows) + 0.1


@pytest.mark.parametrize(
    ("wrong", "fails"),
    [
        ({"amplitude_error": 0.06}, "numbers"),
        ({"cutoff_hz": 17.5e6}, "numbers"),
        ({"declared_hz": math.inf}, "shape"),
        ({"order": 4}, "shape"),
        ({"interleave": Interleave(gain=0.06)}, "shape"),
    ],
)
def test_a_hidden_difference_is_found(wrong: dict[str, Any], fails: str) -> None:
    # given a bench that hides something that neither its file nor the receiver's preset says
    config = bench_of(11, **wrong)
    # when an echo is played
    (case,) = results(config, PulseShapeOptions(ready("night"), shots=200))["cases"]
    # then the prediction differs
    assert case["verdict"] == "differs"
    if fails == "numbers":
        assert fails in case["played"]["failed"]


def test_steps_between_points_are_predicted_as_steps() -> None:
    # given a generator that holds its points
    config = bench_of(7)
    # when an echo is played so
    options = PulseShapeOptions(ready("night"), slopes_deg=(0.0,), shots=60, interpolation="hold")
    made, shots = measured(config, options)
    assert shots[-1].played == made.cases[0].pulses[0].played
    assert made.cases[0].pulses[0].played.interpolation == "hold"
    # then the prediction for what was played holds
    (case,) = analyse(made, shots, config).results["cases"]
    assert case["verdict"] == "agrees"


@pytest.mark.parametrize(("trigger", "delay_s"), [("generator", 130e-9), ("digitizer", 75e-9)])
def test_the_trigger_may_come_late(trigger: str, delay_s: float) -> None:
    # given a bench on which the other side is triggered later, as its file says
    config = bench_of(2, trigger=trigger, trigger_delay_s=delay_s)
    # when an echo is played
    (case,) = results(config, PulseShapeOptions(ready("night"), shots=40))["cases"]
    # then it lies where it is expected, within half a sample
    assert case["verdict"] == "agrees"
    assert abs(case["trigger_delay"]["value"]) < 2.5e-9


def test_a_receiver_without_noise_shows_its_residuals_beside_the_steps_of_its_converter() -> None:
    # given a bench without any noise
    config = bench_of(1, noise_rms_v_by_code=(0.0,) * 16)
    # when an echo is played
    (case,) = results(config, PulseShapeOptions(ready("night"), shots=20))["cases"]
    # then nothing tells the law of the noise, and the residuals are those of rounding
    assert (case["status"], case["verdict"], case["played"]) == ("noise_no_signal", "undecided", None)
    assert 0.4 < case["residual_largest_counts"] < 0.6
    assert 0 < case["residual_rms"]["value"] < 2.0 / 4096 / math.sqrt(12)


# ---- campaigns


def test_slopes_and_azimuths_of_several_scenes_are_one_plan() -> None:
    # given two scenes, two slopes and three azimuths
    options = PulseShapeOptions(
        ready("night", "plane"),
        slopes_deg=(0.0, 20.0),
        azimuths_deg=(-30.0, 0.0, 45.0),
        shots=3,
        dark_windows=1,
    )
    # when they are measured
    made, shots = measured(bench_of(), options)
    # then every combination is there once, in order, with shots of its own after the silent ones
    assert len(made.cases) == 12
    assert made.cases[1].name == "night slope 0 azimuth 0"
    assert made.cases[11].name == "plane slope 20 azimuth 45"
    assert [shot.window.shot for shot in shots] == list(range(1 + 12 * 3))
    assert [case.members[0] for case in made.cases] == list(range(1, 37, 3))
    # and a slope makes the played echo longer and lower
    peaks = [case.pulses[0].played.volts.max() for case in made.cases]
    assert peaks[0] > 1.3 * peaks[3]
    # and another echo is another plan
    other = measured(
        bench_of(), PulseShapeOptions(ready("night"), slopes_deg=(0.1,), shots=3, dark_windows=1)
    )
    assert other[0].as_json()["cases"][0]["pulses"] != made.as_json()["cases"][0]["pulses"]


def test_two_gain_codes_have_silent_windows_of_their_own() -> None:
    # given a scene for gain code 4 and one for 7
    scenes = (
        *named(load_scene("night"), "four"),
        *named(structs.replace(load_scene("night"), gain_code=7), "seven"),
    )
    # when they are played
    found = results(bench_of(4), PulseShapeOptions(scenes, shots=60))
    # then each is judged by its own noise and gain
    assert [row["code"] for row in found["noise"]] == [4, 7]
    assert found["noise"][1]["rms"]["value"] > 1.3 * found["noise"][0]["rms"]["value"]
    assert [case["verdict"] for case in found["cases"]] == ["agrees", "agrees"]


# ---- what cannot be


@pytest.mark.parametrize(
    ("options", "config", "words"),
    [
        (PulseShapeOptions(), bench_of(), "name at least one SCENE"),
        (PulseShapeOptions(ready("gala-like")), bench_of(), 'is for receiver = "gala-like"'),
        (PulseShapeOptions(ready("crater"), slopes_deg=(1.0,)), bench_of(), "set on planes only"),
        (PulseShapeOptions(ready("night"), gain_code=16), bench_of(), "gain code 16"),
        (
            PulseShapeOptions(named(structs.replace(BARE, altitude_m=3000e3))),
            bench_of(attenuation_db=0.0),
            r"makes at least 0.001 Vpp; put 60 dB before the cut .* \[generator\] attenuation_db = 60",
        ),
    ],
)
def test_a_campaign_that_cannot_be_is_refused_in_one_line(
    options: PulseShapeOptions, config: BenchConfig, words: str
) -> None:
    with open_bench(config) as bench, pytest.raises(RefusedInput, match=words) as refused:
        plan(bench, options)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"shots": 1},
        {"dark_windows": 0},
        {"slopes_deg": (90.0,)},
        {"azimuths_deg": (400.0,)},
        {"slopes_deg": ()},
        {"tolerance": 2.0},
    ],
)
def test_options_that_no_campaign_has_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(RefusedInput):
        PulseShapeOptions(ready("night"), **wrong)


def test_an_echo_too_faint_for_the_generator_has_a_status_beside_others_that_are_played() -> None:
    # given an echo that can be played without an attenuator, and one from far away that cannot
    scenes = (*ready("night"), *named(structs.replace(BARE, altitude_m=3000e3), "far"))
    config = bench_of(attenuation_db=0.0)
    # when both are asked for
    outcome = analyse(*measured(config, PulseShapeOptions(scenes, shots=10)), config)
    # then the first is measured, the other says why not, and the attenuator that serves both is named
    near, far = outcome.results["cases"]
    assert near["status"] == "ok"
    assert (far["status"], far["verdict"], far["windows"]) == ("echo_too_faint", "undecided", 0)
    assert outcome.results["attenuation_db"]["advised"] == 50.0
    assert any("50 dB" in note for note in outcome.notes)
    # and with it both are played
    better = bench_of(attenuation_db=50.0)
    assert results(better, PulseShapeOptions(scenes, shots=10))["cases"][1]["windows"] == 10


def changed(shots: list[Shot], edit: Callable[[RangeWindow], RangeWindow]) -> list[Shot]:
    return [
        Shot(one.played, edit(one.window), one.date, one.attempt)
        if isinstance(one.played, SampledPulse)
        else one
        for one in shots
    ]


def with_counts(window: RangeWindow, counts: Any) -> RangeWindow:
    return replace(window, counts=np.asarray(counts, dtype=np.int16))


def test_degenerate_windows_have_statuses() -> None:
    # given a good run
    config = bench_of(6)
    made, shots = measured(config, PulseShapeOptions(ready("night"), shots=30))
    silent = next(one.window.counts for one in shots if not isinstance(one.played, SampledPulse))
    pulse = next(one.window for one in shots if isinstance(one.played, SampledPulse))

    def status(edit: Callable[[RangeWindow], RangeWindow]) -> str:
        outcome = analyse(made, changed(shots, edit), config)
        (case,) = outcome.results["cases"]
        assert case["verdict"] == ("agrees" if case["status"] == "ok" else "undecided")
        json.dumps(outcome.results, allow_nan=False)
        for draw in outcome.figures.values():
            draw()
        return str(case["status"])

    # when its windows are left alone, or spoiled in one way or another
    # then each way has its word
    assert status(lambda one: one) == "ok"
    assert status(lambda one: with_counts(one, silent[37 * one.shot : 37 * one.shot + 42])) == "no_pulse"
    assert status(lambda one: replace(one, saturated=2)) == "saturated"
    assert status(lambda one: with_counts(one, pulse.counts)) == "equal_windows"
    assert status(lambda one: replace(one, gain_code=4 + one.shot % 2)) == "mixed_gain_codes"
    assert status(lambda one: replace(one, sample_interval_s=5e-9)) == "another_receiver"
    assert status(lambda one: with_counts(one, np.full(42, 2048))) == "equal_windows"


def test_a_pulse_far_below_the_noise_has_a_status() -> None:
    # given an echo that the generator can play and the receiver cannot see in one window
    far = named(structs.replace(BARE, altitude_m=4000e3), "far")
    # when it is played
    (case,) = results(bench_of(attenuation_db=60.0), PulseShapeOptions(far, shots=20))["cases"]
    # then no place can be found for it
    assert (case["status"], case["verdict"]) == ("pulse_below_noise", "undecided")


# ---- the command


REAL = """
[generator]
attenuation_db = 20.0
bandwidth_hz = 30e6
[emulation.generator]
bandwidth_hz = 30e6
[limits]
reduced_chi_square = [0.5, 1.5]
"""


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(REAL)
    return path


def summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return found


GRID = ["pulse-shape", "night", "plane", "--slopes-deg", "5,15", "--azimuths-deg", "0,-30", "--shots", "20"]


def test_an_interrupted_campaign_goes_on_to_the_same_results(
    tmp_path: Path, bench_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a campaign of two scenes on a grid, once whole
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    words = [*GRID, "--bench", str(bench_file), "--dark-windows", "4", "--quiet"]
    assert main([*words, "--out", str(whole)]) == 0
    # and once with a link that goes away in the middle
    measure_one = Bench.measure

    def failing(self: Bench, stimulus: Any, request: WindowRequest) -> Shot:
        if request.shot == 77:
            raise LinkClosed("the cable was pulled")
        return measure_one(self, stimulus, request)

    monkeypatch.setattr(Bench, "measure", failing)
    assert main([*words, "--out", str(broken)]) == 3
    monkeypatch.undo()
    # when it is continued
    assert main(["pulse-shape", "--resume", str(broken), "--quiet"]) == 0
    # then the results are the same
    assert summary(broken)["results"] == summary(whole)["results"]
    assert len(summary(whole)["results"]["cases"]) == 8
    assert (whole / "figure-cases.png").is_file()
    # and its own checks stand beside those of the bench file
    limits = [check["limit"] for check in summary(whole)["checks"]]
    assert limits == ["tests_failed"] * 8 + ["reduced_chi_square"] * 8
    assert summary(whole)["verdict"] == "pass"


@pytest.mark.slow
def test_recorded_windows_say_the_same(tmp_path: Path, bench_file: Path) -> None:
    # given a finished campaign of two echoes
    live, again = tmp_path / "live", tmp_path / "again"
    words = ["pulse-shape", "night", "--slopes-deg", "5,15", "--shots", "25", "--quiet"]
    assert main([*words, "--bench", str(bench_file), "--out", str(live)]) == 0
    # when its file is analysed, which holds the pulses as played
    file = live / "data.nc"
    assert main(["pulse-shape", "--windows", str(file), "--out", str(again), "--quiet"]) == 0
    # then every echo has the same chi-square; what was wished is not in the file
    for one, other in zip(summary(live)["results"]["cases"], summary(again)["results"]["cases"], strict=True):
        assert reduced(other) == pytest.approx(reduced(one), rel=1e-9)
        assert other["wished"] is None
        assert other["windows"] == 25
    # and scenes beside the file are refused
    assert main(["pulse-shape", "night", "--windows", str(file), "--out", str(tmp_path / "no")]) == 2


def test_the_pages_list_every_variable_key_and_status(tmp_path: Path, bench_file: Path) -> None:
    # given a run
    words = ["pulse-shape", "night", "--shots", "10", "--bench", str(bench_file), "--quiet"]
    main([*words, "--out", str(tmp_path / "run")])
    # when its data file is opened
    with xarray.open_dataset(tmp_path / "run/data.nc") as data:
        written = sorted(
            (
                str(name),
                ", ".join(map(str, values.dims)),
                str(values.attrs.get("units", values.encoding.get("units", "flags"))),
                str(values.attrs["long_name"]),
            )
            for name, values in data.variables.items()
            if not str(name).startswith("housekeeping_")
        )
    # then every variable is on the page of data files, and every key of the results on that of the command
    headings = ("Of every shot", "Of shots with sampled pulses", "Of `belahil pulse-shape`")
    assert sorted(row for heading in headings for row in told(heading)) == written
    page = (Path(__file__).parent.parent / "docs/pulse-shape.md").read_text(encoding="utf-8")
    for key in keys(summary(tmp_path / "run")["results"]) - {"value", "standard_uncertainty", "unit"}:
        assert f"`{key}`" in page, key


def test_a_file_of_mixed_codes_and_one_of_another_receiver_have_statuses(
    tmp_path: Path, bench_file: Path
) -> None:
    # given a recorded run
    live = tmp_path / "live"
    words = ["pulse-shape", "night", "--shots", "25", "--bench", str(bench_file), "--quiet"]
    assert main([*words, "--out", str(live)]) == 0
    options = PulseShapeOptions()

    def status(edit: Callable[[Any], None]) -> str:
        path = tmp_path / "edited.nc"
        path.write_bytes((live / "data.nc").read_bytes())
        with h5py.File(path, "r+") as file:
            edit(file)
        recorded = read_windows(path)
        made = recorded_plan(recorded, options)
        (case,) = analyse(made, recorded, bench_of()).results["cases"]
        assert case["verdict"] == ("agrees" if case["status"] == "ok" else "undecided")
        return str(case["status"])

    def other_code(file: Any) -> None:
        file["gain_code"][-5:] = 7

    def other_rate(file: Any) -> None:
        file["sample_interval_s"][:] = 5e-9
        file.attrs["digitizer_sample_rate_hz"] = 200e6

    def no_silence(file: Any) -> None:
        file["stimulus"][:16] = 3

    # when it is left alone, or its codes are mixed, or it says another rate, or has no silent window
    # then each has its word
    assert status(lambda file: None) == "ok"
    assert status(other_code) == "mixed_gain_codes"
    assert status(other_rate) == "another_receiver"
    assert status(no_silence) == "too_few_samples"


def test_a_file_without_pulses_is_refused(tmp_path: Path) -> None:
    assert (
        main(["noise", "--codes", "4", "--dark-windows", "1", "--out", str(tmp_path / "dark"), "--quiet"])
        == 0
    )
    recorded = read_windows(tmp_path / "dark/data.nc")
    with pytest.raises(RefusedInput, match="holds no window of a sampled pulse"):
        recorded_plan(recorded, PulseShapeOptions())


def test_a_difference_fails_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given a bench whose generator is slower than its file says
    path = tmp_path / "bench.toml"
    path.write_text("[emulation.generator]\nbandwidth_hz = 30e6\n")
    # when an echo is played
    status = main(
        ["pulse-shape", "night", "--shots", "60", "--bench", str(path), "--out", str(tmp_path / "run")]
    )
    # then the command fails and says what
    said = capsys.readouterr().out
    assert status == 1
    assert "night: differs" in said
    assert "fail: tests_failed (night)" in said


def test_a_wrong_list_of_angles_is_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pulse-shape", "night", "--slopes-deg", "1,steep"]) == 2
    assert "write angles with commas between" in capsys.readouterr().err


@pytest.mark.slow
def test_true_predictions_are_seldom_called_different() -> None:
    # given 60 campaigns whose predictions are true
    found = [
        results(bench_of(1000 + seed), PulseShapeOptions(ready("night")))["cases"][0] for seed in range(60)
    ]
    # then at most one is called different: 0.27 % of them should be
    assert sum(case["verdict"] == "differs" for case in found) <= 1
    # and the reduced chi-square has the scatter that it claims, to five standard errors of a variance of 60
    spread = np.std([reduced(case) for case in found], ddof=1)
    claimed = found[0]["played"]["reduced_chi_square"]["standard_uncertainty"]
    assert 0.6 < (spread / claimed) ** 2 < 1.9
    assert all(0.9 < reduced(case) < 1.1 for case in found)
