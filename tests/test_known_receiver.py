"""What an analysis may assume of a receiver: the preset, or what a characterization found."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec import convert

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import BenchConfig, DigitizerTable, simulated
from belahil.errors import RefusedInput
from belahil.fingerprint import plain
from belahil.receiver import BELA_GRM, RECEIVERS
from procedures.known_receiver import KnownReceiver, characterized_receiver, preset_receiver
from procedures.pulse_echoes import NamedScene
from sim.scene import as_toml, load_scene

HIDDEN = """
[generator]
address = "simulated"
[digitizer]
link = "simulated"
[emulation.receiver]
cutoff_hz = {cutoff_hz}
clock_ppm = 12.0
interleave = {{ gain = 0.004, offset_v = 1e-3, skew_s = 40e-12 }}
"""
NIGHT = NamedScene("night", as_toml(load_scene("night")))
SWEEP = ["--codes", "3,6", "--amplitudes-mvpp", "30,100", "--frequencies-mhz", "1,5,12,19,24,29", "--quiet"]


@pytest.mark.parametrize("name", sorted(RECEIVERS))
def test_the_preset_is_assumed_to_a_percent(name: str) -> None:
    spec = RECEIVERS[name]
    known = preset_receiver(BenchConfig(digitizer=DigitizerTable(receiver=name)))
    digitizer = spec.digitizer
    assert (known.order, known.bits, known.converters) == (spec.order, digitizer.bits, digitizer.converters)
    assert known.cutoff.standard_uncertainty == pytest.approx(0.01 * spec.cutoff_hz)
    assert [one.gain.value for one in known.codes] == list(spec.gain_by_code)
    assert known.true_interval_s == known.sample_interval_s == 1 / spec.digitizer.sample_rate_hz
    assert (len(known.poles), known.zeros) == (spec.order, 0)


def test_it_is_plain_values_for_a_resume() -> None:
    known = preset_receiver(simulated())
    assert convert(plain(known), KnownReceiver) == known


def test_a_code_that_is_not_known_is_refused() -> None:
    known = preset_receiver(simulated())
    assert known.at(4).gain.value == 5.19
    with pytest.raises(RefusedInput, match="gain code 16: preset bela-grm knows"):
        known.at(16)


@pytest.mark.parametrize("cutoff_hz", [16e6, pytest.param(21e6, marks=pytest.mark.slow)])
def test_a_characterization_gives_the_hidden_receiver(tmp_path: Path, cutoff_hz: float) -> None:
    # given a bench with another receiver than the preset, characterized
    bench, run = tmp_path / "bench.toml", tmp_path / "run"
    bench.write_text(HIDDEN.format(cutoff_hz=cutoff_hz), encoding="utf-8")
    assert main(["characterize", "--bench", str(bench), *SWEEP, "--out", str(run)]) == 0
    # when it is read, then it is that receiver within 4 standard uncertainties
    known = characterized_receiver(run)
    told: list[tuple[Any, float]] = [
        (known.cutoff, cutoff_hz),
        (known.at(3).gain, BELA_GRM.gain_by_code[3]),
        (known.at(6).gain, BELA_GRM.gain_by_code[6]),
        (known.clock_ppm, 12.0),
        (known.interleave_gain, 0.004),
        (known.interleave_skew, 40e-12),
    ]
    for estimate, truth in told:
        assert abs(estimate.value - truth) < 4 * estimate.standard_uncertainty
    assert known.order == 3
    assert known.true_interval_s == pytest.approx(12.5e-9 / (1 + 12e-6), rel=1e-6)
    assert (known.bits, known.converters, known.zeros) == (12, 2, 0)


BENT = [
    *SWEEP[:2],
    "--amplitudes-mvpp",
    "3,13,50,200",
    "--frequencies-mhz",
    "0.1,1,5,12,17,19,24,29",
    "--quiet",
]


@pytest.mark.parametrize(
    ("bend", "highpass_hz"),
    [
        ("deadband_v = 0.2e-3", 60e3),
        pytest.param("deadband_v = 0.2e-3", 0.0, marks=pytest.mark.slow),
        pytest.param("cubic_per_v2 = -2.0", 0.0, marks=pytest.mark.slow),
        pytest.param("", 60e3, marks=pytest.mark.slow),
    ],
)
def test_what_depends_on_the_amplitude_is_in_neither_gain_nor_filter(
    tmp_path: Path, bend: str, highpass_hz: float
) -> None:
    # given a receiver that is not linear, or one that is, characterized
    bench, run = tmp_path / "bench.toml", tmp_path / "run"
    more = f"highpass_hz = {highpass_hz}\nsmall_signal = {{ {bend} }}\n"
    bench.write_text(HIDDEN.format(cutoff_hz=17e6) + more, encoding="utf-8")
    assert main(["characterize", "--bench", str(bench), *BENT, "--out", str(run)]) == 0
    # when it is read, then gain and filter are those of small signals, to the digits that the points tell
    known = characterized_receiver(run)
    for code in (3, 6):
        gain, true = known.at(code).gain, BELA_GRM.gain_by_code[code]
        assert abs(gain.value - true) < 4 * gain.standard_uncertainty < 4e-3 * true
    assert abs(known.cutoff.value - 17e6) < 4 * known.cutoff.standard_uncertainty < 4e-4 * 17e6
    assert (known.highpass is None) == (highpass_hz == 0)
    if known.highpass is not None:
        assert (
            abs(known.highpass_hz - highpass_hz)
            < 4 * known.highpass.standard_uncertainty
            < 0.04 * highpass_hz
        )
    # and those of the pooled fit where dead zone and cubic term explain nothing, or an old run is mute
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    rows = summary["results"]["gain_codes"]
    rows[0]["small_signal"]["status"] = "inconsistent"
    del rows[1]["small_signal"]["cutoff"]
    (run / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    pooled = characterized_receiver(run)
    assert [one.gain.as_json() for one in pooled.codes] == [row["gain"] for row in rows]
    assert (pooled.cutoff, pooled.highpass) != (known.cutoff, known.highpass)


def test_what_is_no_characterization_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedInput, match="no finished run"):
        characterized_receiver(tmp_path)
    (tmp_path / "summary.json").write_text('{"procedure": "noise"}', encoding="utf-8")
    with pytest.raises(RefusedInput, match="a run of noise"):
        characterized_receiver(tmp_path)
    row = {"gain": None, "cutoff": None, "order": {"integer": None}}
    empty = {"procedure": "characterize", "results": {"gain_codes": [row]}}
    (tmp_path / "summary.json").write_text(json.dumps(empty), encoding="utf-8")
    with pytest.raises(RefusedInput, match="no gain code has"):
        characterized_receiver(tmp_path)


@pytest.mark.parametrize(
    ("procedure", "options", "needed"),
    [
        ("noise", "NoiseOptions", {}),
        ("digitizer", "DigitizerOptions", {}),
        ("energy_calibration", "EnergyOptions", {}),
        ("rfm_parity", "ParityOptions", {}),
        ("tof_linearity", "TofOptions", {}),
        ("arrival_time", "ArrivalOptions", {"footprints": 0}),
        ("pulse_shape", "PulseShapeOptions", {"scenes": (NIGHT,)}),
        ("tx_delay", "TxDelayOptions", {}),
    ],
)
def test_a_characterization_of_another_receiver_is_refused_at_once(
    procedure: str, options: str, needed: dict[str, Any]
) -> None:
    module = importlib.import_module(f"procedures.{procedure}")
    chosen = partial(getattr(module, options), **needed)
    gala = preset_receiver(BenchConfig(digitizer=DigitizerTable(receiver="gala-like", link="simulated")))
    with open_bench("simulated") as bench:
        module.plan(bench, chosen(receiver=preset_receiver(bench.config)))
        for other in (gala, replace(preset_receiver(bench.config), bits=14)):
            with pytest.raises(RefusedInput, match=f"sample every 12.5 ns; {other.origin}: .* bit"):
                module.plan(bench, chosen(receiver=other))
