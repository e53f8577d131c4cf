"""A characterization finds the receiver that was hidden in the bench, within its stated uncertainties."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hidden_receivers import CODES, found, hidden, pulls

from belahil.config import (
    DigitizerTable,
    EmulatedGenerator,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    GeneratorUncertainty,
    SmallSignal,
    simulated,
)
from procedures.characterize import AMPLITUDES_VPP, GainOptions


def _check(numbers: range, codes: tuple[int, ...] | None, least_pulls: int) -> None:
    collected: dict[str, list[float]] = {}
    for number in numbers:
        # given a hidden receiver
        config = hidden(number)
        truth = config.emulation.receiver
        # when it is characterized
        outcome = found(config, GainOptions(codes=codes, amplitudes_vpp=(13e-3, 50e-3)))
        for name, values in pulls(config, outcome).items():
            collected.setdefault(name, []).extend(values)
        # then every code is ok and of the right order
        for one in outcome.results["gain_codes"]:
            assert one["status"] == "ok", (number, one)
            assert one["order"]["integer"] == truth.order, (number, one)
        # and the best code is as good as the true best, within 3 %
        assert truth.noise_rms_v_by_code is not None
        assert truth.gain_by_code is not None
        if codes is None:
            input_noise = np.array(truth.noise_rms_v_by_code) / np.array(truth.gain_by_code)
            assert input_noise[outcome.results["best_code"]] <= 1.03 * input_noise.min()
    # and each quantity is within 3 standard uncertainties in at least 98 %, all pooled 0.9 to 1.1 wide
    pooled = np.concatenate(list(collected.values()))
    assert pooled.size >= least_pulls
    for name, values in collected.items():
        assert np.mean(np.abs(values) <= 3) >= 0.98, name
    assert 0.9 <= np.std(pooled) <= 1.1


def test_hidden_receivers_come_back() -> None:
    # 10 receivers with 2 codes give some 110 pulls, whose width scatters by 7 %: the receivers and their
    # draws are fixed, and the bounds are those of the slow test.
    _check(range(10), (3, 11), 90)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_two_hundred_hidden_receivers_come_back() -> None:
    _check(range(200), None, 1000)


def test_an_ac_coupling_is_found_or_said_to_be_missing() -> None:
    for corner_hz, found_it in ((0.0, False), (5e3, True), (20e3, True)):
        config = msgspec.structs.replace(
            simulated(), emulation=EmulationTable(receiver=EmulatedReceiver(highpass_hz=corner_hz))
        )
        (result,) = found(config, GainOptions(codes=(4,))).results["gain_codes"]
        assert (result["highpass"] is not None) is found_it
        if found_it:
            pull = (result["highpass"]["value"] - corner_hz) / result["highpass"]["standard_uncertainty"]
            assert abs(pull) < 3


@pytest.mark.slow
def test_declared_generator_errors_are_inside_the_declared_uncertainty() -> None:
    """Each declared error moves the result by its sensitivity, and the budget says by how much."""
    declared = GeneratorUncertainty(
        amplitude_relative=0.01, amplitude_v=0.2e-3, flatness_relative=0.02, attenuation_db=0.05
    )
    pulled = []
    for number in range(12):
        # given a generator with errors drawn from what the bench file declares, and odd resistances
        rng = np.random.default_rng([11, number])
        base = hidden(number)
        truth = base.emulation.receiver
        config = msgspec.structs.replace(
            base,
            generator=msgspec.structs.replace(
                base.generator, load_ohm=float(rng.choice([50.0, 75.0, math.inf])), uncertainty=declared
            ),
            digitizer=DigitizerTable(link="simulated", input_ohm=75.0),
            emulation=msgspec.structs.replace(
                base.emulation,
                generator=EmulatedGenerator(
                    amplitude_error=float(rng.normal(0, 0.01)), flatness=float(rng.normal(0, 0.02))
                ),
                receiver=msgspec.structs.replace(truth, input_ohm=75.0),
            ),
        )
        # when it is characterized
        outcome = found(config, GainOptions(codes=(5,), amplitudes_vpp=(13e-3, 50e-3)))
        # then gain and cut-off are inside what is declared
        (one,) = outcome.results["gain_codes"]
        assert truth.gain_by_code is not None
        assert truth.cutoff_hz is not None
        for name, true in (("gain", truth.gain_by_code[5]), ("cutoff", truth.cutoff_hz)):
            pulled.append((one[name]["value"] - true) / one[name]["standard_uncertainty"])
        # and the budget names every source that is declared
        sources = {line.source for line in outcome.budget if line.quantity == "gain, code 5"}
        names = [name for name in declared.__struct_fields__ if getattr(declared, name)]
        assert {f"[generator] uncertainty.{name}" for name in names} < sources
    assert np.max(np.abs(pulled)) < 3
    # the attenuator and the absolute term are right here, so the pulls are narrower than one, but not nothing
    assert 0.3 < np.std(pulled) < 1.2


def test_a_wrong_input_resistance_would_be_seen() -> None:
    """Without the right ``input_ohm`` the gain is off by the divider: the conversion is really used."""
    config = msgspec.structs.replace(
        simulated(), emulation=EmulationTable(receiver=EmulatedReceiver(input_ohm=75.0))
    )
    (one,) = found(config, GainOptions(codes=(4,), amplitudes_vpp=(50e-3,))).results["gain_codes"]
    divider = 75 / 125 / (50 / 100)
    assert one["gain"]["value"] == pytest.approx(5.19 * divider, rel=1e-4)


def test_the_receiver_or_the_estimator_deviates_at_small_amplitudes() -> None:
    """The table of gains by amplitude tells a true small-signal deviation from that of an estimator."""

    def rows(small_signal: SmallSignal) -> list[dict[str, float]]:
        receiver = EmulatedReceiver(small_signal=small_signal, noise_rms_v_by_code=(2e-3,) * 16)
        config = msgspec.structs.replace(simulated(), emulation=EmulationTable(receiver=receiver))
        options = GainOptions(codes=(4,), amplitudes_vpp=(3e-3, 50e-3))
        result: list[dict[str, float]] = found(config, options).results["gain_by_amplitude"]
        return result

    def relative(row: dict[str, float]) -> float:
        return row["sine_fit"]["value"] / 5.19  # type: ignore[index,no-any-return]

    # given a linear receiver with 2 mV noise, when the gain is taken at 3 mVpp
    small, large = rows(SmallSignal())
    # then the sine fit agrees with 50 mVpp, while rms and peak to peak are too large
    assert abs(relative(small) - 1) < 4 * 0.0015
    assert small["rms"] / 5.19 > 1.03
    assert small["peak_to_peak"] / 5.19 > 1.5
    # given a receiver with a dead zone of 0.1 mV, then the sine fit itself is low at 3 mVpp
    small, large = rows(SmallSignal(deadband_v=0.1e-3))
    assert relative(small) < 0.93
    assert relative(large) > 0.99


@pytest.mark.parametrize("amplitudes_vpp", [AMPLITUDES_VPP, (50e-3, 200e-3), (13e-3, 50e-3)])
def test_a_receiver_that_compresses_keeps_its_small_signal_truth_inside_the_uncertainty(
    amplitudes_vpp: tuple[float, ...],
) -> None:
    # given a receiver whose gain is 3.75 % low at 200 mVpp (3/4 of 5 times 0.1 V squared)
    receiver = EmulatedReceiver(small_signal=SmallSignal(cubic_per_v2=-5.0))
    config = msgspec.structs.replace(simulated(), emulation=EmulationTable(receiver=receiver))
    # when it is characterized
    outcome = found(config, GainOptions(codes=(4,), amplitudes_vpp=amplitudes_vpp))
    # then gain and cut-off for small signals lie within three standard uncertainties, and the reason is told
    (one,) = outcome.results["gain_codes"]
    assert (one["status"], one["order"]["integer"]) == ("ok", 3)
    for name, true in (("gain", 5.19), ("cutoff", 19e6)):
        assert abs(one[name]["value"] - true) < 3 * one[name]["standard_uncertainty"]
        assert one[name]["standard_uncertainty"] < 0.03 * true
    assert one["linearity"]["chi_square"] > 200
    assert one["linearity"]["degrees_of_freedom"] == len(amplitudes_vpp) - 1
    sources = [(line.quantity, line.source) for line in outcome.budget if "between" in line.source]
    assert sources == [(f"{name}, code 4", "difference between amplitudes") for name in ("gain", "cut-off")]
    assert any("is not linear at gain code 4: gains at" in note for note in outcome.notes)


def test_a_linear_receiver_has_no_difference_between_amplitudes() -> None:
    for seed in (1, 2, 3):
        config = msgspec.structs.replace(simulated(), emulation=EmulationTable(seed=seed))
        outcome = found(config, GainOptions(codes=(4,)))
        (one,) = outcome.results["gain_codes"]
        # 18.5 of 4 degrees of freedom is probability 1e-3
        assert 0 < one["linearity"]["chi_square"] < 18.5
        assert one["linearity"]["degrees_of_freedom"] == 4
        assert one["fit"]["degrees_of_freedom"] == 5 * 24 - 3
        assert {line.source for line in outcome.budget} == {"scatter of the points"}
        assert not any("not linear" in note for note in outcome.notes)


def test_a_difference_that_the_generator_may_make_is_not_laid_on_the_receiver() -> None:
    # given the same compression, and a generator whose amplitudes are declared no better than that
    receiver = EmulatedReceiver(small_signal=SmallSignal(cubic_per_v2=-5.0))
    declared = GeneratorUncertainty(amplitude_relative=0.02)
    config = msgspec.structs.replace(
        simulated(),
        generator=GeneratorTable(address="simulated", uncertainty=declared),
        emulation=EmulationTable(receiver=receiver),
    )
    outcome = found(config, GainOptions(codes=(4,)))
    # then nothing is added, and the truth is inside all the same
    (one,) = outcome.results["gain_codes"]
    assert not any("between" in line.source for line in outcome.budget)
    assert abs(one["gain"]["value"] - 5.19) < 3 * one["gain"]["standard_uncertainty"]


def test_notes_say_what_the_uncertainties_leave_out() -> None:
    sweep = GainOptions(codes=(4,), amplitudes_vpp=(50e-3,), frequencies_hz=(1e6, 5e6, 15e6, 20e6, 29e6))
    declared = msgspec.structs.replace(
        simulated(),
        generator=GeneratorTable(address="simulated", uncertainty=GeneratorUncertainty(attenuation_db=0.1)),
    )
    for config, silent in ((simulated(), True), (declared, False)):
        notes = found(config, sweep).notes
        assert any("the uncertainties hold for the scatter only" in note for note in notes) == silent
        assert any("relative to the generator's own reference" in note for note in notes)


def test_codes_are_all_measured_by_default() -> None:
    outcome = found(simulated(), GainOptions(amplitudes_vpp=(13e-3,), frequencies_hz=(1e6, 5e6, 20e6, 29e6)))
    assert tuple(one["code"] for one in outcome.results["gain_codes"]) == CODES


def test_above_nyquist_the_alias_carries_the_gain() -> None:
    # given a generator that reaches beyond half the sample rate
    config = msgspec.structs.replace(
        simulated(), generator=GeneratorTable(driver="keysight-33600", address="simulated")
    )
    # when the default sweep is measured
    outcome = found(config, GainOptions(codes=(4,), amplitudes_vpp=(50e-3, 200e-3)))
    frequency = outcome.tables["points"].columns["point_frequency_hz"][0]
    gain = outcome.tables["points"].columns["point_gain"][0]
    spread = outcome.tables["points"].columns["point_gain_u"][0]
    # then it has points above 40 MHz, and they lie on the filter
    above = frequency > 40e6
    assert np.count_nonzero(above) >= 8
    expected = 5.19 / np.sqrt(1 + (frequency[above] / 19e6) ** 6)
    assert np.max(np.abs(gain[above] - expected) / spread[above]) < 4
