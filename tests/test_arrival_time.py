"""The arrival curve of a bench comes back from hidden receivers, and says so when the model is another."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from belahil.bench import open_bench
from belahil.cli.arrival_time import _land_lines
from belahil.cli.main import main
from belahil.config import BenchConfig, Interleave, simulated
from belahil.errors import InterlockRefused, LimitExceeded, RefusedInput
from belahil.outcome import STATUSES, Outcome
from belahil.recorded import read_windows
from belahil.values import Estimate, Shot
from procedures import arrival_time
from procedures.arrival_points import WidthPoint, measure_points, relative_to_model
from procedures.arrival_time import ArrivalOptions, ArrivalPlan
from procedures.known_receiver import KnownReceiver, preset_receiver
from tests.hidden_receivers import InMemory

NS = 1e-9
FEW = {"footprints": 0, "widths": 8, "windows": 6}


def bench(
    seed: int = 1,
    receiver: dict[str, Any] | None = None,
    generator: dict[str, Any] | None = None,
    **tables: dict[str, Any],
) -> BenchConfig:
    """A simulated bench with this hidden truth and these keys of its tables."""
    config, put = simulated(), msgspec.structs.replace
    emulation = put(
        config.emulation,
        seed=seed,
        receiver=put(config.emulation.receiver, **(receiver or {})),
        generator=put(config.emulation.generator, **(generator or {})),
    )
    changed = {name: put(getattr(config, name), **keys) for name, keys in tables.items()}
    return put(config, emulation=emulation, **changed)


@dataclass(frozen=True)
class Measured:
    plan: ArrivalPlan
    shots: list[Shot]
    outcome: Outcome

    @property
    def bench(self) -> dict[str, Any]:
        found: dict[str, Any] = self.outcome.results["bench"]
        return found


def measured(config: BenchConfig, known: KnownReceiver | None = None, **chosen: Any) -> Measured:
    options = ArrivalOptions(**(FEW | chosen), receiver=known)
    run = InMemory([])
    with open_bench(config) as opened:
        plan = arrival_time.plan(opened, options)
        arrival_time.measure(opened, run, plan)
    return Measured(plan, run.shots, arrival_time.analyse(plan, run.shots, config))


@pytest.fixture(scope="module")
def plain() -> Measured:
    return measured(bench(seed=2))


# ---- what comes back


def test_bench_and_model_agree_and_both_agree_with_the_published_shape(plain: Measured) -> None:
    found = plain.bench
    assert found["status"] == found["curve_status"] == "ok"
    assert found["agreement"]["status"] == found["agreement"]["constant_status"] == "agree"
    assert found["agreement"]["curves_rms_s"] < 0.05 * NS
    assert all(row["status"] == "ok" for row in found["points"])
    for row in (found["published"][0], plain.outcome.results["model"]["published"][0]):
        assert row["linear_coefficient"] == 0.0937
        assert row["rms_s"] < 0.15 * NS
        constant = row["constant"]
        assert abs(constant["value"] - 11.84 * NS) < 3 * constant["standard_uncertainty"] + 0.02 * NS
    assert found["published"][1]["rms_s"] > 20 * NS
    assert any("misprint" in note for note in plain.outcome.notes)


def hidden(number: int) -> tuple[BenchConfig, KnownReceiver]:
    """A hidden receiver, and a model that knows its filter to 0.1 %."""
    rng = np.random.default_rng([11, number])
    cutoff_hz, order = float(rng.uniform(15e6, 25e6)), int(rng.integers(2, 5))
    highpass_hz = float(rng.choice([0.0, rng.uniform(5e3, 30e3)]))
    receiver = {
        "cutoff_hz": cutoff_hz * (1 + 1e-3 * float(rng.standard_normal())),
        "order": order,
        "highpass_hz": highpass_hz,
        "clock_ppm": float(rng.uniform(-50, 50)),
        "interleave": Interleave(
            gain=float(rng.uniform(-0.01, 0.01)),
            offset_v=float(rng.uniform(-2e-3, 2e-3)),
            skew_s=float(rng.uniform(-50e-12, 50e-12)),
        ),
    }
    trigger = {
        "trigger": ("generator", "digitizer")[number % 2],
        "trigger_delay_s": float(rng.choice([0.0, 2.3456e-6])),
    }
    known = replace(
        preset_receiver(simulated()),
        cutoff=Estimate(cutoff_hz, 1e-3 * cutoff_hz, "Hz"),
        order=order,
        highpass=Estimate(highpass_hz, 1e-3 * highpass_hz, "Hz") if highpass_hz else None,
    )
    return bench(seed=number, receiver=receiver, bench=trigger), known


@pytest.mark.parametrize("number", [0, *(pytest.param(one, marks=pytest.mark.slow) for one in range(1, 6))])
def test_the_curve_of_a_hidden_receiver_is_that_of_its_model(number: int) -> None:
    # given a receiver with mismatched converters, a wrong clock, and either trigger
    config, known = hidden(number)
    # when
    found = measured(config, known).bench
    # then shape and constant are those of its filter, and its clock comes along
    assert found["status"] == "ok"
    assert found["agreement"]["probability"] > 1e-4
    constant = found["agreement"]["constant"]
    assert abs(constant["value"]) < 4 * constant["standard_uncertainty"]
    clock = found["clock_ppm"]
    truth = config.emulation.receiver.clock_ppm
    assert abs(clock["value"] - truth) < 4 * clock["standard_uncertainty"]


@pytest.mark.slow
def test_chi_square_and_constant_have_their_distributions() -> None:
    # given many seeds
    probabilities, pulls = [], []
    for seed in range(40):
        found = measured(bench(seed=1000 + seed), widths=14, windows=20).bench
        probabilities.append(found["agreement"]["probability"])
        apart = found["reference_delay"]["value"] - found["reference_model"]["value"]
        pulls.append(apart / found["reference_delay"]["standard_uncertainty"])
    # then probabilities are spread over 0 to 1, and stated uncertainties cover
    assert 0.3 < np.mean(probabilities) < 0.75
    assert np.mean(np.array(probabilities) < 0.05) <= 0.15
    assert np.mean(np.abs(pulls) < 2) >= 0.9


# ---- a model that is another


@pytest.mark.parametrize(
    ("receiver", "generator"),
    [({"cutoff_hz": 22e6}, {}), ({"order": 2}, {}), ({}, {"bandwidth_hz": 30e6})],
    ids=["cut-off", "order", "generator's bandwidth"],
)
def test_another_filter_than_the_model_is_told(receiver: dict[str, Any], generator: dict[str, Any]) -> None:
    found = measured(bench(seed=3, receiver=receiver, generator=generator)).bench

    assert found["status"] == "ok"
    assert found["agreement"]["status"] == "differ"


def test_a_declared_bandwidth_of_the_generator_is_no_part_of_the_receiver() -> None:
    config = bench(seed=3, generator={"bandwidth_hz": 30e6})
    config = msgspec.structs.replace(
        config, generator=msgspec.structs.replace(config.generator, bandwidth_hz=30e6)
    )
    found = measured(config).bench

    assert found["agreement"]["status"] == found["agreement"]["constant_status"] == "agree"


# ---- degenerate windows


def analysed(plain: Measured, shots: list[Shot], known: KnownReceiver | None = None) -> dict[str, Any]:
    made = known or preset_receiver(simulated())
    plan = replace(plain.plan, options=replace(plain.plan.options, receiver=made))
    found: dict[str, Any] = arrival_time.analyse(plan, shots, simulated()).results["bench"]
    json.dumps(found, allow_nan=False)
    return found


def changed(shot: Shot, **keys: Any) -> Shot:
    return replace(shot, window=replace(shot.window, **keys))


def test_clipped_pulses_have_a_status() -> None:
    found = measured(bench(), code=15, peak_v=0.1).bench

    assert found["status"] == "too_few_points"
    assert {row["status"] for row in found["points"]} == {"clipped"}
    assert found["agreement"] is found["curve"] is found["reference_delay"] is None
    assert found["curve_status"] == "too_few_points"


def test_windows_without_a_pulse_have_a_status(plain: Measured) -> None:
    rng = np.random.default_rng(1)
    dark = [
        changed(shot, counts=rng.integers(-3, 4, shot.window.counts.size).astype(np.int16))
        for shot in plain.shots
    ]
    empty = [changed(shot, counts=shot.window.counts[:5]) for shot in plain.shots]

    assert {row["status"] for row in analysed(plain, dark)["points"]} == {"no_pulse"}
    assert {row["status"] for row in analysed(plain, empty)["points"]} == {"no_pulse"}
    assert analysed(plain, [])["status"] == "no_pulse"


def test_equal_windows_have_a_status(plain: Measured) -> None:
    count = plain.plan.options.windows
    equal = [
        changed(shot, counts=plain.shots[k // count * count].window.counts)
        for k, shot in enumerate(plain.shots)
    ]

    found = analysed(plain, equal)

    assert found["status"] == "too_few_points"
    assert {row["status"] for row in found["points"]} == {"equal_windows"}


def test_a_few_bad_windows_are_counted_and_left_out(plain: Measured) -> None:
    count = plain.plan.options.windows
    some = [changed(shot, saturated=7) if k < count - 2 else shot for k, shot in enumerate(plain.shots)]
    some[-1] = changed(some[-1], counts=np.zeros_like(some[-1].window.counts))

    found = analysed(plain, some)

    assert found["status"] == "ok"
    assert (found["points"][0]["status"], found["points"][0]["delay"]) == ("clipped", None)
    assert (found["points"][-1]["status"], found["points"][-1]["windows_not_used"]) == ("ok", 1)
    assert all(row["status"] in STATUSES for row in found["points"])


def test_two_gain_codes_mixed_have_a_status_unless_one_is_chosen(plain: Measured) -> None:
    mixed = [changed(shot, gain_code=5) if k % 2 else shot for k, shot in enumerate(plain.shots)]

    assert analysed(plain, mixed)["status"] == "mixed_gain_codes"
    known = preset_receiver(simulated())
    one = measure_points(mixed, known, 0.0, 4, 12, chosen=True)
    assert (one.status, {point.windows for point in one.points}) == ("too_few_points", {3})


def test_windows_of_another_receiver_have_a_status(plain: Measured) -> None:
    other = [changed(shot, sample_interval_s=5 * NS) for shot in plain.shots]

    assert analysed(plain, other)["status"] == "another_receiver"


def test_a_wrong_cutoff_moves_all_widths_together() -> None:
    # given points that are off just as two standard deviations of the cut-off would make them
    factors_s = np.array([-10, -5, 3, 8, 12]) * 1e-12
    points = tuple(
        WidthPoint(
            30 * NS,
            "ok",
            width=Estimate(35 * NS, 0.0, "s"),
            delay=Estimate(1 * NS + 2 * float(one), 1e-12, "s"),
            model_delay_s=1 * NS,
            model_u_s=float(one),
        )
        for one in factors_s
    )
    # when
    common, freedom = relative_to_model(points)
    alone, _ = relative_to_model(tuple(replace(one, model_u_s=0.0) for one in points))
    # then that costs nearly four, by Sherman and Morrison, and far more where no cut-off allows it
    power = float(factors_s @ factors_s) / 1e-24
    assert freedom == 5
    assert common == pytest.approx(4 * power / (1 + power))
    assert alone == pytest.approx(4 * power)


# ---- what is asked for


@pytest.mark.parametrize(
    ("chosen", "words"),
    [
        ({"widths": 7}, "8 to 200"),
        ({"windows": 4}, "at least 5"),
        ({"peak_v": 0.0}, "above zero"),
        ({"footprints": -1}, "0 \\(none\\)"),
        ({"altitudes_m": ()}, "at least one"),
        ({"altitudes_m": (5.0,)}, "1 km"),
        ({"ground_seed": -1}, "negative"),
    ],
)
def test_options_that_cannot_be_are_refused(chosen: dict[str, Any], words: str) -> None:
    with pytest.raises(RefusedInput, match=words):
        ArrivalOptions(**chosen)


@pytest.mark.parametrize(
    ("chosen", "error"),
    [
        ({"code": 16}, (LimitExceeded, RefusedInput)),
        ({"peak_v": 0.3}, InterlockRefused),
        ({"terrain": "no-such.tif", "footprints": 3}, RefusedInput),
        ({"terrain": "plane", "footprints": 3}, RefusedInput),
    ],
)
def test_what_the_bench_cannot_do_is_refused_before_anything_is_measured(
    chosen: dict[str, Any], error: type[Exception]
) -> None:
    with open_bench(bench()) as opened, pytest.raises(error):
        arrival_time.plan(opened, ArrivalOptions(**(FEW | chosen)))


def test_a_filter_that_is_too_slow_is_refused() -> None:
    known = replace(preset_receiver(simulated()), cutoff=Estimate(3e6, 3e4, "Hz"))
    with open_bench(bench()) as opened, pytest.raises(RefusedInput, match="a curve has widths from"):
        arrival_time.plan(opened, ArrivalOptions(**FEW, receiver=known))


@pytest.mark.slow
def test_a_faster_receiver_has_its_own_curve() -> None:
    found = measured(bench(digitizer={"receiver": "gala-like"}))

    # another filter says nothing of the published one
    assert not any("misprint" in note for note in found.outcome.notes)
    assert found.bench["agreement"]["status"] == "agree"
    widths_s = [row["fwhm"]["value"] for row in found.bench["points"]]
    assert min(widths_s) == pytest.approx(20 * NS, abs=0.5 * NS)
    assert max(widths_s) == pytest.approx(110 * NS, abs=0.5 * NS)


# ---- the command


BENCH = '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n'
SMALL = ["--widths", "8", "--pulse-windows", "5", "--footprints", "3", "--altitudes-km", "500,900", "--quiet"]


def test_the_command_writes_a_run_and_takes_recorded_windows(tmp_path: Path, capsys: Any) -> None:
    # given a run
    (tmp_path / "bench.toml").write_text(BENCH)
    land = tmp_path / "land.toml"
    land.write_text("[surface]\nkind = 'fractal'\nextent_m = 110\nspacing_m = 2\n")
    at = ["--bench", str(tmp_path / "bench.toml"), "--terrain", str(land)]
    assert main(["arrival-time", *at, *SMALL, "--out", str(tmp_path / "first")]) == 0
    first = json.loads((tmp_path / "first/summary.json").read_text())
    assert first["procedure"] == "arrival-time"
    assert first["results"]["footprints"]["altitudes_m"] == [500e3, 900e3]
    assert first["results"]["footprints"]["status"] == "too_few_points"  # 18 footprints
    assert (tmp_path / "first/figure-arrival.png").is_file()
    # when its windows are analysed again
    data = tmp_path / "first/data.nc"
    recorded = read_windows(data)
    assert len({recorded.played(row) for row in range(len(recorded))}) == 8
    again = ["arrival-time", "--windows", str(data), "--footprints", "0", "--quiet"]
    assert main([*again, "--out", str(tmp_path / "second")]) == 0
    # then the bench's results are the same, and windows of another code are refused
    second = json.loads((tmp_path / "second/summary.json").read_text())
    assert second["results"]["bench"] == first["results"]["bench"]
    assert second["results"]["footprints"] is None
    assert main([*again, "--gain-code", "7", "--out", str(tmp_path / "third")]) == 2
    assert "no comb of pulses at gain code 7" in capsys.readouterr().err


@pytest.mark.parametrize(("value", "words"), [(-0.246, "246(21) mm too near"), (0.1, "100(21) mm too far")])
def test_the_terminal_says_near_or_far(value: float, words: str) -> None:
    metres = {"value": value, "standard_uncertainty": 0.021, "unit": "m"}
    land = {
        "status": "ok", "footprints_inside": 9, "footprints": 9, "curve": {}, "bias": metres,
        "bias_fwhm_s": 100 * NS, "residual": metres, "residual_largest": metres,
    }  # fmt: skip
    assert words in "".join(_land_lines({"footprints": land}))
    few = _land_lines({"footprints": {**land, "status": "too_few_points", "curve": None}})
    assert "--footprints" in few[-1]


def test_a_file_without_combs_is_refused(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    at = ["--bench", str(tmp_path / "bench.toml"), "--quiet"]
    assert main(["noise", *at, "--codes", "4", "--dark-windows", "1", "--out", str(tmp_path / "noise")]) == 0

    windows = ["--windows", str(tmp_path / "noise/data.nc"), "--out", str(tmp_path / "none"), "--quiet"]
    assert main(["arrival-time", *windows]) == 2
    assert "has no comb of pulses" in capsys.readouterr().err
