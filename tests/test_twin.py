"""A twin of a characterized receiver measures like the original, within the uncertainties of both."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hidden_receivers import found, hidden
from scipy.special import ndtri

from belahil.cli.main import main
from belahil.comparison import RunSide, compare
from belahil.config import (
    BenchConfig,
    DigitizerTable,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    SmallSignal,
    check_bench,
    load_bench,
    parse_bench,
    simulated,
)
from belahil.errors import RefusedInput
from belahil.oscilloscopes import scope_spec
from belahil.receiver import BELA_GRM, DigitizerSpec, receiver_preset
from belahil.twin import Twin, twin_of
from procedures.characterize import GainOptions

STEP_V = 2.0 / 4096
SWEEP = GainOptions(codes=(3, 11), amplitudes_vpp=(13e-3, 50e-3))
BENT = GainOptions(codes=(4, 6))


def summary(results: dict[str, Any], **words: Any) -> dict[str, Any]:
    return {"procedure": "characterize", "started": "2030", "instruments": {}, "results": results} | words


def made(
    results: dict[str, Any], config: BenchConfig, seed: int, spec: DigitizerSpec = BELA_GRM.digitizer
) -> Twin:
    return twin_of(summary(results), config, spec, STEP_V, seed)


def beside_its_twin(config: BenchConfig, options: GainOptions, seed: int) -> dict[str, list[float]]:
    """Characterize, make a twin, characterize it: z of everything that both have, by quantity."""
    first = found(config, options).results
    twin = made(first, config, seed).config
    # The simulated bench gives the integers of the emulated one, sooner.
    quick = msgspec.structs.replace(
        twin,
        generator=msgspec.structs.replace(twin.generator, address="simulated"),
        digitizer=msgspec.structs.replace(twin.digitizer, link="simulated"),
    )
    second = found(quick, options).results
    collected: dict[str, list[float]] = {}
    for one in compare(RunSide("run", summary(first)), RunSide("twin", summary(second))).tested:
        assert one.z is not None
        collected.setdefault(one.name.rpartition("]")[2] or one.name, []).append(one.z)
    return collected


def pooled(cases: list[dict[str, list[float]]]) -> dict[str, np.ndarray[Any, Any]]:
    return {
        name: np.array([z for case in cases for z in case.get(name, ())]) for name in cases[0] | cases[-1]
    }


def check(zs: dict[str, np.ndarray[Any, Any]], least: int) -> None:
    # Where the twin's truth is the measured number, z has one of the two scatters: variance 1/2.
    assert sum(map(len, zs.values())) >= least
    # One of all these numbers is beyond this by chance once in a thousand tests: 4.5 for 150, 4.7 for 400.
    limit = float(ndtri(1 - 0.5e-3 / sum(map(len, zs.values()))))
    for name, values in zs.items():
        assert np.max(np.abs(values)) < limit, (name, np.sort(values))


@pytest.mark.timeout(900)
@pytest.mark.parametrize("numbers", [range(3), pytest.param(range(3, 33), marks=pytest.mark.slow)])
def test_a_twin_measures_like_its_original(numbers: range) -> None:
    # given hidden receivers with every imperfection of a linear one
    cases = [beside_its_twin(hidden(number), SWEEP, 1000 + number) for number in numbers]
    # when they and their twins are characterized, then everything agrees
    zs = pooled(cases)
    check(zs, 20 * len(numbers))
    # and the truth of the twin is what was measured: the mean square is that of one scatter, not of none or
    # of a bias. For n values it scatters by 0.5 sqrt(2 / n); four of these.
    for names in (
        (".gain", ".cutoff"),
        (".noise_rms",),
        ("clock_ppm", "interleave.skew_s", "interleave.gain"),
    ):
        values = np.concatenate([zs[name] for name in names])
        assert abs(np.mean(values**2) - 0.5) < 4 * 0.5 * np.sqrt(2 / values.size), (names, values)


_BENT = (SmallSignal(deadband_v=0.1e-3), SmallSignal(cubic_per_v2=-3.0), SmallSignal(1.5, 30e-6))


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("small", "seeds"),
    [
        (_BENT[2], range(1)),
        *(pytest.param(small, range(1, 9), marks=pytest.mark.slow) for small in _BENT),
    ],
)
def test_a_twin_is_bent_like_its_original(small: SmallSignal, seeds: range) -> None:
    # given a receiver with dead zone, cubic term or both
    cases = []
    for seed in seeds:
        receiver = EmulatedReceiver(small_signal=small, highpass_hz=8e3)
        config = msgspec.structs.replace(
            simulated(), emulation=EmulationTable(seed=seed + 100, receiver=receiver)
        )
        cases.append(beside_its_twin(config, BENT, 2000 + seed))
    # then its twin's gains by amplitude, small-signal numbers and filter agree with its own
    zs = pooled(cases)
    check(zs, 35 * len(seeds))
    wanted = {
        "small_signal.cubic_per_v2",
        "small_signal.deadband_v",
        ".small_signal.highpass",
        ".small_signal.gain",
    }
    assert wanted <= set(zs)


def test_a_bench_that_is_no_twin_is_seen() -> None:
    """The comparison can fail: a receiver whose gain is 0.1 % off is no twin."""
    config = hidden(3)
    first = found(config, SWEEP).results
    truth = config.emulation.receiver
    assert truth.gain_by_code is not None
    other = msgspec.structs.replace(truth, gain_by_code=tuple(1.001 * gain for gain in truth.gain_by_code))
    off = msgspec.structs.replace(config, emulation=EmulationTable(seed=77, receiver=other))
    second = found(off, SWEEP).results
    differing = compare(RunSide("a", summary(first)), RunSide("b", summary(second))).differing
    assert "gain_codes[code=3].gain" in [one.name for one in differing]


# ---- single numbers, from results written by hand


def one(value: float, spread: float = 0.1, unit: str = "1") -> dict[str, Any]:
    return {"value": value, "standard_uncertainty": spread, "unit": unit}


def row(code: int | None, **words: Any) -> dict[str, Any]:
    small = {"gain": None, "cutoff": None, "highpass": None, "status": "not_significant"}
    base = {"code": code, "gain": one(5.0), "cutoff": one(20e6, 1e3, "Hz"), "highpass": None, "status": "ok"}
    return (
        base
        | {"order": {"free": one(3.0), "integer": 3}, "noise_rms": one(1e-3, 1e-5, "V")}
        | ({"small_signal": small} | words)
    )


def results(*rows: dict[str, Any], **words: Any) -> dict[str, Any]:
    none = {"cubic_per_v2": None, "deadband_v": None, "status": "too_few_amplitudes"}
    twins = {"gain": None, "offset_v": None, "skew_s": None}
    return {"gain_codes": list(rows), "small_signal": none, "clock_ppm": None, "interleave": twins} | words


def truth_of(*rows: dict[str, Any], config: BenchConfig | None = None, **words: Any) -> EmulatedReceiver:
    return made(results(*rows, **words), config or simulated(), 1).config.emulation.receiver


def test_what_was_not_measured_is_the_presets_and_is_told() -> None:
    twin = made(results(row(4), row(5, noise_rms=None)), simulated(), 1)
    receiver = twin.config.emulation.receiver
    assert receiver.gain_by_code is not None
    assert receiver.noise_rms_v_by_code is not None
    assert receiver.gain_by_code[4:6] == (5.0, 5.0)
    assert receiver.gain_by_code[:4] == BELA_GRM.gain_by_code[:4]
    assert receiver.noise_rms_v_by_code[4:6] == (1e-3, BELA_GRM.noise_rms_v_by_code[5])
    assert (receiver.clock_ppm, receiver.interleave.skew_s, receiver.highpass_hz) == (0.0, 0.0, 0.0)
    said = "\n".join(twin.told)
    assert "gain_by_code: preset bela-grm at gain code 0, 1, 2, 3, 6," in said
    assert "noise_rms_v_by_code: preset bela-grm at gain code 0, 1, 2, 3, 5, 6" in said
    for line in (
        "clock_ppm: 0, not measured",
        "interleave.skew_s: 0, not measured",
        "highpass_hz: none was seen",
        "small_signal: none (too_few_amplitudes)",
    ):
        assert line in twin.told


def test_codes_share_cutoff_and_highpass_by_their_weights() -> None:
    # weights 4 and 1: (4 * 20 + 1 * 20.01) / 5 MHz
    rows = (
        row(3, cutoff=one(20e6, 1e4, "Hz")),
        row(4, cutoff=one(20.01e6, 2e4, "Hz"), highpass=one(7e3, 10, "Hz")),
    )
    receiver = truth_of(*rows)
    assert receiver.cutoff_hz == pytest.approx(20.002e6, rel=1e-12)
    assert receiver.highpass_hz == 7e3
    # and codes that cannot have one cut-off are told
    rows = row(3), row(4, cutoff=one(21e6, 1e3, "Hz"))
    assert any("differ by more than chance" in line for line in made(results(*rows), simulated(), 1).told)


def test_a_bent_receiver_has_the_gain_of_its_linear_part() -> None:
    own = {"cubic_per_v2": one(-2.9, 0.1, "V-2"), "deadband_v": one(0.0, 1e-8, "V"), "status": "ok"}
    small = own | {"gain": one(5.2), "cutoff": one(21e6, 1e3, "Hz"), "highpass": None}
    bent = {"cubic_per_v2": one(-3.0, 0.1, "V-2"), "deadband_v": one(-1e-9, 1e-8, "V"), "status": "ok"}
    receiver = truth_of(row(4, small_signal=small), small_signal=bent)
    assert receiver.gain_by_code is not None
    assert (receiver.gain_by_code[4], receiver.cutoff_hz) == (5.2, 21e6)
    # and where all codes together are bent more than this one is, its gains by amplitude stay as they were:
    # at 200 mVpp the cubic terms take 0.75 * 2.9 * 0.1^2 and 0.75 * 3.0 * 0.1^2
    rows = [{"code": 4, "amplitude_vpp": 0.2, "sine_fit": one(5.0)}]
    moved = truth_of(row(4, small_signal=small), small_signal=bent, gain_by_amplitude=rows).gain_by_code
    assert moved is not None
    assert moved[4] == pytest.approx(5.2 * (1 - 0.02175) / (1 - 0.0225), rel=1e-12)
    # a dead zone below zero cannot be emulated
    assert receiver.small_signal == SmallSignal(-3.0, 0.0)
    # and what is not significant is left out, with the gain of all amplitudes
    receiver = truth_of(row(4, small_signal=small), small_signal=bent | {"status": "not_significant"})
    assert receiver.gain_by_code is not None
    assert (receiver.gain_by_code[4], receiver.small_signal) == (5.0, SmallSignal())


def test_the_bench_of_a_twin_is_emulated_and_has_the_originals_load() -> None:
    real = BenchConfig(
        bench=msgspec.structs.replace(BenchConfig().bench, settle_s=0.05),
        generator=GeneratorTable(
            address="GPIB::7", attenuation_db=6.0, bandwidth_hz=60e6, visa_library="@py"
        ),
        digitizer=DigitizerTable(link="serial:COM3", input_ohm=75.0),
    )
    twin = made(results(row(4)), real, 5).config
    assert (twin.source, twin.generator.attenuation_db, twin.generator.visa_library) == ("emulated", 6.0, "")
    assert (twin.bench.settle_s, twin.emulation.seed) == (0.0, 5)
    assert (twin.emulation.receiver.input_ohm, twin.emulation.generator.bandwidth_hz) == (75.0, 60e6)
    assert (twin.emulation.receiver.adc_full_scale_v, twin.emulation.receiver.adc_bits) == (2.0, 12)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"procedure": "noise"}, "a twin of a run of noise"),
        ({"results": results(row(4, gain=None))}, "without any gain code"),
        ({"results": results(row(4), clock_ppm=one(400.0))}, "clock error 400 ppm"),
    ],
)
def test_what_cannot_be_a_twin_is_refused(words: dict[str, Any], said: str) -> None:
    with pytest.raises(RefusedInput, match=said):
        twin_of(summary(results(row(4))) | words, simulated(), BELA_GRM.digitizer, STEP_V)


def test_a_receiver_of_another_kind_than_its_preset_is_refused() -> None:
    slow = DigitizerSpec(40e6, 12, 2, 16064, tuple(range(16)))
    with pytest.raises(RefusedInput, match=r"40 MSa/s.*preset bela-grm.*80 MSa/s"):
        made(results(row(4)), simulated(), 1, slow)


_SCOPE = '[digitizer]\ndriver="keysight-infiniivision"\nlink="simulated"\nreceiver="analog"\n'


def test_an_oscilloscope_stays_the_bench_files(tmp_path: Path) -> None:
    config = parse_bench(_SCOPE + '[generator]\naddress="simulated"\n')
    spec = scope_spec(config.digitizer, receiver_preset("analog"))
    twin = made(results(row(None)), config, 1, spec).config
    assert (twin.digitizer.driver, twin.digitizer.link) == ("keysight-infiniivision", "emulated:visa")
    assert (twin.emulation.receiver.adc_bits, twin.emulation.receiver.adc_full_scale_v) == (None, None)
    assert twin.emulation.receiver.gain_by_code == (5.0,)
    check_bench(twin)


@pytest.mark.parametrize("bench", ["", pytest.param(_SCOPE, marks=pytest.mark.slow)])
def test_the_command_makes_a_bench_that_can_be_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bench: str
) -> None:
    # given a small characterization, with the receiver's own converters or with an oscilloscope
    lab, run, file = tmp_path / "lab.toml", tmp_path / "run", tmp_path / "twin.toml"
    lab.write_text(bench + ('[generator]\naddress="simulated"\n' if bench else ""))
    few = [
        "--amplitudes-mvpp",
        "50,200",
        "--frequencies-mhz",
        "1,5,11,19,25",
        "--quiet",
        "--dark-windows",
        "2",
    ]
    if not bench:
        few += ["--codes", "4"]
    assert main(["characterize", "--bench", str(lab), "--out", str(run), *few]) == 0
    # when a twin is made, then it says where it is from and can be measured
    assert main(["bench", "twin", str(run), str(file), "--seed", "8"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1].startswith(f"bench file: {file}")
    config = load_bench(str(file))
    gain = json.loads((run / "summary.json").read_text())["results"]["gain_codes"][0]["gain"]["value"]
    assert config.emulation.receiver.gain_by_code is not None
    assert config.emulation.receiver.gain_by_code[0 if bench else 4] == gain
    assert (config.source, config.emulation.seed) == ("emulated", 8)
    assert "# gain_by_code: 1 of" in file.read_text()
    assert main(["characterize", "--bench", str(file), "--out", str(tmp_path / "again"), *few]) == 0
    assert main(["compare", str(run), str(tmp_path / "again"), "--differing"]) == 0
    # and no file is written over
    assert main(["bench", "twin", str(run), str(file)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_a_folder_without_a_run_has_no_twin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "twin", str(tmp_path), str(tmp_path / "twin.toml")]) == 2
    assert "there is no finished run" in capsys.readouterr().err
