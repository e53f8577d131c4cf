"""Dead zone and cubic term: from the definition, and back from a bench that hides them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hidden_receivers import found, hidden
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from belahil.butterworth import magnitude
from belahil.cli.main import main
from belahil.config import (
    BenchConfig,
    EmulatedGenerator,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    GeneratorUncertainty,
    SmallSignal,
    simulated,
)
from procedures.butterworth_fit import fit_order
from procedures.characterize import GainOptions
from procedures.small_signal import first_harmonic, fit_small_signal

SWEEP_HZ, SWEEP_VPP = (
    np.tile(np.geomspace(0.1e6, 38e6, 24), 5),
    np.repeat([3e-3, 13e-3, 30e-3, 50e-3, 200e-3], 24),
)


@settings(max_examples=50, deadline=None)
@given(
    peak_v=st.floats(1e-4, 1.0), part=st.floats(0.0, 1.3), cubic=st.floats(-2.0, 2.0), turned=st.booleans()
)
def test_the_first_harmonic_is_that_of_the_distorted_sine(
    peak_v: float, part: float, cubic: float, turned: bool
) -> None:
    deadband_v = part * peak_v
    if turned:
        # a negative dead zone adds what a positive one takes
        both = [first_harmonic(np.array([peak_v]), one, 0.0)[0] for one in (deadband_v, -deadband_v)]
        assert sum(both) == pytest.approx(2.0, abs=1e-12)
        return

    def integrand(angle: float) -> float:
        w = max(peak_v * math.sin(angle) - deadband_v, 0.0)
        return (w + cubic * w**3) * math.sin(angle) * 4 / math.pi / peak_v

    begin = math.asin(min(part, 1.0))
    direct = quad(integrand, begin, math.pi / 2)[0]
    assert first_harmonic(np.array([peak_v]), deadband_v, cubic)[0] == pytest.approx(direct, abs=1e-8)


def bent(number: int, small: SmallSignal) -> BenchConfig:
    base = hidden(number)
    receiver = msgspec.structs.replace(base.emulation.receiver, small_signal=small)
    return msgspec.structs.replace(base, emulation=msgspec.structs.replace(base.emulation, receiver=receiver))


def pull(told: dict[str, Any], true: float) -> float:
    return float((told["value"] - true) / told["standard_uncertainty"])


@pytest.mark.slow
def test_hidden_dead_zones_and_cubic_terms_come_back() -> None:
    pulls = []
    for number in range(6):
        # given a random receiver with one or both, filter, clock, pad and converters random too
        rng = np.random.default_rng([77, number])
        small = SmallSignal(
            cubic_per_v2=float(rng.uniform(0.3, 1.5) * rng.choice([-1, 1])) if number % 3 else 0.0,
            deadband_v=float(rng.uniform(1e-5, 1e-4)) if number % 2 else 0.0,
        )
        # when it is characterized
        results = found(bent(number, small), GainOptions(codes=(2, 9))).results
        told = results["small_signal"]
        # then it is told, or said to be linear
        assert told["status"] == ("ok" if small != SmallSignal() else "not_significant")
        pulls.append([pull(told[name], getattr(small, name)) for name in ("cubic_per_v2", "deadband_v")])
        # and each code has the gain of signals that neither reaches, and the filter
        truth = bent(number, small).emulation.receiver
        assert truth.gain_by_code is not None
        for row in results["gain_codes"]:
            fit = row["small_signal"]
            assert abs(pull(fit["gain"], truth.gain_by_code[row["code"]])) < 4
            assert abs(pull(fit["cutoff"], truth.cutoff_hz)) < 4
            assert (
                abs(pull(fit["highpass"], truth.highpass_hz)) < 4
                if truth.highpass_hz
                else not fit["highpass"]
            )
    assert np.max(np.abs(pulls)) < 4
    assert abs(np.mean(pulls)) < 4 / math.sqrt(12)
    assert 0.6 < math.sqrt(float(np.mean(np.square(pulls)))) < 1.5


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_sixty_of_them_come_back() -> None:
    pulls = []
    for number in range(60):
        rng = np.random.default_rng([78, number])
        small = SmallSignal(float(rng.uniform(-1.5, 1.5)), float(rng.uniform(0, 1.5e-4)))
        told = found(bent(number, small), GainOptions(codes=(2, 6, 12))).results["small_signal"]
        pulls.append([pull(told[name], getattr(small, name)) for name in ("cubic_per_v2", "deadband_v")])
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(60))
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=3.5 / math.sqrt(120))


def test_a_linear_receiver_is_said_to_be_linear() -> None:
    told = [
        found(hidden(number), GainOptions(codes=(4,))).results["small_signal"]["status"]
        for number in range(6)
    ]
    assert told == ["not_significant"] * 6


@pytest.mark.parametrize(
    ("amplitudes_vpp", "status"), [((13e-3, 50e-3), "too_few_amplitudes"), ((3e-3,), "too_few_amplitudes")]
)
def test_too_few_amplitudes_are_told(amplitudes_vpp: tuple[float, ...], status: str) -> None:
    results = found(simulated(), GainOptions(codes=(4,), amplitudes_vpp=amplitudes_vpp)).results
    assert results["small_signal"] == {"cubic_per_v2": None, "deadband_v": None, "status": status}
    assert results["gain_codes"][0]["small_signal"]["status"] == status


def test_without_a_filter_there_is_no_amplitude_behind_it() -> None:
    # given two frequencies far below the cut-off
    options = GainOptions(codes=(4,), frequencies_hz=(1e6, 2e6))
    results = found(simulated(), options).results
    assert results["small_signal"]["status"] == "not_identified"
    json.dumps(results, allow_nan=False)


@pytest.mark.slow
def test_a_generator_that_errs_by_range_is_inside_what_is_declared() -> None:
    # given a generator whose amplitudes are off by a constant, which looks like a dead zone, and says so
    declared = GeneratorUncertainty(amplitude_v=0.1e-3, amplitude_relative=0.01)
    config = msgspec.structs.replace(
        simulated(),
        generator=GeneratorTable(address="simulated", uncertainty=declared),
        emulation=EmulationTable(
            generator=EmulatedGenerator(amplitude_error=0.01),
            receiver=EmulatedReceiver(small_signal=SmallSignal(deadband_v=0.02e-3)),
        ),
    )
    one, told = (
        found(config, GainOptions(codes=codes)).results["small_signal"] for codes in ((4,), (2, 3, 4, 5))
    )
    # then the dead zone has an uncertainty that no number of codes makes less
    assert told["deadband_v"]["standard_uncertainty"] == pytest.approx(
        one["deadband_v"]["standard_uncertainty"], rel=0.2
    )
    assert told["deadband_v"]["standard_uncertainty"] > 0.01e-3
    assert abs(pull(told["deadband_v"], 0.02e-3)) < 2
    assert told["status"] == "not_significant"


@pytest.mark.parametrize("number", range(4))
def test_a_declared_error_moves_the_result_by_what_is_stated(number: int) -> None:
    # given gains of a known receiver, and the same with one standard uncertainty of a declared error in them
    rng = np.random.default_rng([79, number])
    frequency_hz = np.tile(np.geomspace(0.1e6, 38e6, 24), 4)
    played_vpp = np.repeat([3e-3, 13e-3, 50e-3, 200e-3], 24)
    shape = magnitude(frequency_hz, 19e6, 3)
    small = SmallSignal(float(rng.uniform(-1, 1)), float(rng.uniform(0, 5e-5)))
    gain = 5.19 * shape * first_harmonic(played_vpp / 2 * shape, small.deadband_v, small.cubic_per_v2)
    gain_u = 1e-6 / played_vpp
    shift = 1e-6 / played_vpp
    whole = fit_order(frequency_hz, gain, gain_u, 3)
    plain = fit_small_signal(whole, frequency_hz, played_vpp, gain, gain_u, [shift])
    moved = fit_small_signal(whole, frequency_hz, played_vpp, gain * (1 + shift), gain_u)
    for name, place in (("cubic_per_v2", 0), ("deadband_v", 1)):
        told, other = getattr(plain, name), getattr(moved, name)
        # then it is found exactly, moves by what is stated, and that is in its uncertainty
        assert told.value == pytest.approx(getattr(small, name), rel=1e-4, abs=1e-9)
        assert other.value - told.value == pytest.approx(plain.declared[0][place], rel=0.02)
        expected = math.hypot(plain.scatter[place], plain.declared[0][place])
        assert told.standard_uncertainty == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("number", range(4))
def test_a_declared_flatness_moves_the_filter_by_what_is_stated(number: int) -> None:
    # given a random receiver with dead zone and high-pass, and a generator that errs with frequency
    rng = np.random.default_rng([81, number])
    frequency_hz, played_vpp = SWEEP_HZ, SWEEP_VPP
    cutoff_hz, highpass_hz = float(rng.uniform(12e6, 28e6)), float(rng.uniform(40e3, 90e3))
    shape = magnitude(frequency_hz, cutoff_hz, 3, highpass_hz)
    gain = 5.19 * shape * first_harmonic(played_vpp / 2 * shape, float(rng.uniform(5e-5, 3e-4)), 0.0)
    gain_u, shift = 1e-6 / played_vpp, float(rng.uniform(1e-4, 1e-3)) * frequency_hz / 40e6
    whole = fit_order(frequency_hz, gain, gain_u, 3)
    bare = fit_small_signal(whole, frequency_hz, played_vpp, gain, gain_u)
    plain = fit_small_signal(whole, frequency_hz, played_vpp, gain, gain_u, [shift])
    moved = fit_small_signal(whole, frequency_hz, played_vpp, gain * (1 + shift), gain_u)
    for name, true in (("cutoff", cutoff_hz), ("highpass", highpass_hz)):
        # then the filter is found exactly, and what it moves by is in its uncertainty
        told, other, scatter = (getattr(one, name) for one in (plain, moved, bare))
        assert told.value == pytest.approx(true, rel=1e-6)
        expected = math.hypot(scatter.standard_uncertainty, other.value - told.value)
        assert told.standard_uncertainty == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("highpass_hz", [0.0, 60e3])
@pytest.mark.parametrize(("deadband_sigmas", "cubic_sigmas"), [(0, 0), (2, 0), (0, 2), (0, -3)])
def test_gain_and_filter_are_honest_where_nothing_is_significant(
    deadband_sigmas: float, cubic_sigmas: float, highpass_hz: float
) -> None:
    # given sweeps of a receiver whose dead zone or cubic term is too small, or nearly, to be significant
    gain_u = 1.9e-5 / SWEEP_VPP
    shape = magnitude(SWEEP_HZ, 19e6, 3, highpass_hz)
    bend = first_harmonic(SWEEP_VPP / 2 * shape, deadband_sigmas * 2.3e-7, cubic_sigmas * 2.7e-3)
    pulls, pooled = [], []
    for number in range(40):
        scatter = gain_u * np.random.default_rng([82, number]).standard_normal(gain_u.size)
        points = SWEEP_HZ, SWEEP_VPP, 5.19 * shape * bend + scatter, gain_u
        whole = fit_order(points[0], points[2], gain_u, 3)
        told = fit_small_signal(whole, *points)
        pairs = [
            (told.gain, 5.19),
            (told.cutoff, 19e6),
            *([(told.highpass, highpass_hz)] if highpass_hz else []),
        ]
        assert told.highpass is None or highpass_hz
        pulls.append([pull(one.as_json(), true) for one, true in pairs if one is not None])
        pooled.append((whole.gain - 5.19) / whole.gain_u)
    # then the fit with both states what its numbers scatter by, with the truth in the middle
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(40))
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=4 / math.sqrt(80))
    # and that without them does not, where there is a cubic term
    assert (abs(np.mean(pooled)) > 5) == (cubic_sigmas != 0)


def test_what_neither_explains_is_inconsistent() -> None:
    # given a generator whose middle range is 1 % too large
    rng = np.random.default_rng(80)
    frequency_hz = np.tile(np.geomspace(0.1e6, 38e6, 24), 5)
    played_vpp = np.repeat([3e-3, 13e-3, 30e-3, 50e-3, 200e-3], 24)
    gain_u = 1e-5 / played_vpp
    gain = 5.19 * magnitude(frequency_hz, 19e6, 3) * np.where(played_vpp == 30e-3, 1.01, 1.0)
    gain += gain_u * rng.standard_normal(gain.size)
    told = fit_small_signal(fit_order(frequency_hz, gain, gain_u, 3), frequency_hz, played_vpp, gain, gain_u)
    assert told.status == "inconsistent"
    # then the uncertainties are widened until the numbers say nothing
    assert told.cubic_per_v2 is not None
    assert abs(told.cubic_per_v2.value) < 4 * told.cubic_per_v2.standard_uncertainty


@pytest.mark.slow
def test_recorded_windows_give_the_results_of_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--codes", "4,5", "--amplitudes-mvpp", "3,30,200", "--frequencies-mhz", "1,5,12,17,22,28"]
    assert main(["characterize", *words, "--bench", "simulated", "--quiet", "--out", "run"]) == 0
    # when its windows are read back, all of them or those of a code
    assert main(["characterize", "--windows", "run/data.nc", "--quiet", "--out", "again"]) == 0
    assert main(["characterize", "--windows", "run/data.nc", "--codes", "5", "--quiet", "--out", "five"]) == 0
    first, second, five = (
        json.loads(Path(run, "summary.json").read_text())["results"] for run in ("run", "again", "five")
    )
    assert second == first
    assert five["gain_codes"][0]["noise_rms"] == first["gain_codes"][1]["noise_rms"]
    assert five["gain_codes"][0]["gain"]["value"] == pytest.approx(
        first["gain_codes"][1]["gain"]["value"], rel=1e-6
    )
    # and windows without sines, or of a code that is not there, are refused
    few = ["--codes", "4", "--dark-windows", "1", "--laser", "off", "--bench", "simulated", "--quiet"]
    assert main(["noise", *few, "--out", "dark"]) == 0
    assert main(["characterize", "--windows", "dark/data.nc", "--out", "none"]) == 2
    assert main(["characterize", "--windows", "run/data.nc", "--codes", "7", "--out", "none"]) == 2
