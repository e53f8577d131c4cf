"""A generator whose output is slow: what is declared of it is in what was played, and in budgets."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.cli.main import main
from belahil.generators import bandwidth_sensitivity, behind_output
from belahil.stimuli import NoSignal, SampledPulse, Sine, TransmittedPulse

SWEEP = ["characterize", "--codes", "4", "--amplitudes-mvpp", "50", "--bench", "lab.toml", "--quiet"]


@given(frequency_hz=st.floats(1e3, 1e8), bandwidth_hz=st.floats(1e6, 1e9))
def test_a_sine_loses_what_one_pole_takes(frequency_hz: float, bandwidth_hz: float) -> None:
    # given a sine behind an output, and behind one that is a little wider
    def amplitude(of_hz: float) -> float:
        played = behind_output(Sine(frequency_hz, 1.0, 0.1), of_hz)
        assert isinstance(played, Sine)
        assert (played.frequency_hz, played.offset_v) == (frequency_hz, 0.1)
        return played.amplitude_vpp

    # then its amplitude is that of the transfer function
    assert amplitude(bandwidth_hz) == pytest.approx(
        abs(1 / (1 + 1j * frequency_hz / bandwidth_hz)), rel=1e-12
    )
    # and the sensitivity is the derivative of its logarithm
    change = math.log(amplitude(bandwidth_hz * 1.0001) / amplitude(bandwidth_hz * 0.9999)) / 2e-4
    assert float(bandwidth_sensitivity(frequency_hz, bandwidth_hz)) == pytest.approx(
        change, rel=1e-3, abs=1e-9
    )


def test_only_a_declared_output_changes_anything() -> None:
    pulse = SampledPulse(np.ones(4), 1e8, poles=(-1e8 + 0j,))
    for stimulus in (NoSignal(), TransmittedPulse(), Sine(1e6, 1.0), pulse):
        assert behind_output(stimulus, math.inf) is stimulus
    assert behind_output(NoSignal(), 1e6) == NoSignal()
    behind = behind_output(pulse, 1e7)
    assert isinstance(behind, SampledPulse)
    assert behind.poles == (-1e8 + 0j, complex(-2e7 * math.pi))
    assert np.all(bandwidth_sensitivity([0.0, 1e6], math.inf) == 0)


@pytest.fixture
def cutoff(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.chdir(tmp_path)

    def measured(name: str, declared: str) -> dict[str, Any]:
        Path("lab.toml").write_text(f"[generator]\n{declared}\n[emulation.generator]\nbandwidth_hz = 45e6\n")
        assert main([*SWEEP, "--out", name]) == 0
        found = json.loads(Path(name, "summary.json").read_text())["results"]["gain_codes"][0]["cutoff"]
        assert isinstance(found, dict)
        return found

    return measured


@pytest.mark.slow
def test_a_declared_output_brings_the_true_cutoff_back_with_its_uncertainty(cutoff: Any) -> None:
    # given a generator with an output of 45 MHz
    # when the bench file says nothing, says so, or says so within 2 %
    silent = cutoff("silent", "")
    known = cutoff("known", "bandwidth_hz = 45e6")
    unsure = cutoff("unsure", "bandwidth_hz = 45e6\nuncertainty = { bandwidth_relative = 0.02 }")
    # then the cut-off is low, or right; and its uncertainty is that of an output 2 % away
    assert silent["value"] < 18.5e6
    assert abs(known["value"] - 19e6) < 5 * known["standard_uncertainty"] < 0.1e6
    assert unsure["value"] == pytest.approx(known["value"], rel=1e-3)
    wider = cutoff("wider", "bandwidth_hz = 45.9e6")
    moved = abs(wider["value"] - known["value"])
    assert unsure["standard_uncertainty"] == pytest.approx(
        math.hypot(known["standard_uncertainty"], moved), rel=0.1
    )
