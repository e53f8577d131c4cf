"""A bench file that someone else wrote: any converter, filter and pad comes back, the same on every link."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hidden_receivers import found, pulls

from belahil.config import (
    BenchConfig,
    EmulatedReceiver,
    EmulationTable,
    GeneratorUncertainty,
    parse_bench,
    simulated,
)
from procedures.characterize import GainOptions

# Gain and noise by code follow no rule, code 7 has the least noise at the input.
TRUTH = """
[generator]
address = "{address}"
attenuation_db = {attenuation_db}
[digitizer]
link = "{link}"
[emulation]
seed = {seed}
[emulation.receiver]
cutoff_hz = {cutoff_hz}
order = {order}
highpass_hz = {highpass_hz}
gain_by_code = [7.3, 1.1, 9.9, 1.7, 3.14159, 5.5, 2.2, 13.7, 6.0, 1.9, 8.8, 4.4, 21.1, 3.3, 11.1, 2.5]
noise_rms_v_by_code = [
  2.1e-3, 0.9e-3, 4e-3, 1.3e-3, 1.7e-3, 2e-3, 2.9e-3, 1.1e-3, 2e-3, 1e-3, 3e-3, 2e-3, 6.6e-3, 2e-3, 3e-3, 1e-3
]
adc_full_scale_v = {full_scale_v}
adc_bits = {bits}
clock_ppm = {clock_ppm}
interleave = {{ gain = {gain}, offset_v = {offset_v}, skew_s = {skew_s} }}
"""
CODES = (1, 7, 12)
OPTIONS = GainOptions(codes=CODES, amplitudes_vpp=(13e-3, 50e-3))


def bench(link: str = "simulated", **truth: float) -> BenchConfig:
    words: dict[str, object] = {
        "attenuation_db": 7.77,
        "seed": 20,
        "cutoff_hz": 17.17e6,
        "order": 3,
        "highpass_hz": 0.0,
        "full_scale_v": 1.9,
        "bits": 12,
        "clock_ppm": -33.3,
        "gain": 0.011,
        "offset_v": -1.7e-3,
        "skew_s": 47e-12,
    }
    address = "simulated" if link == "simulated" else "emulated"
    return parse_bench(TRUTH.format(**words | truth, address=address, link=link))


@pytest.mark.parametrize(
    "truth",
    [
        {"bits": 8, "full_scale_v": 1.1},
        {"bits": 10, "full_scale_v": 1.234},
        {"bits": 11, "full_scale_v": 3.9, "order": 5, "cutoff_hz": 9.1e6, "clock_ppm": 222.0},
        {"bits": 14, "full_scale_v": 1.04, "order": 1, "cutoff_hz": 26e6, "highpass_hz": 17e3},
        {"bits": 16, "full_scale_v": 4.0, "order": 6, "cutoff_hz": 25.7e6, "clock_ppm": -249.0},
        {"attenuation_db": 19.7, "gain": 0.2, "offset_v": 0.2, "skew_s": 2e-9},
        {"attenuation_db": 0.0, "order": 2, "cutoff_hz": 41e6, "clock_ppm": 0.0},
    ],
    ids=["8 bit", "10 bit", "11 bit", "14 bit", "16 bit", "mismatch", "beyond the generator"],
)
def test_odd_receivers_come_back(truth: dict[str, float]) -> None:
    # given a hidden receiver, when three of its codes are characterized
    config = bench(**truth)
    outcome = found(config, OPTIONS)
    # then order and best code are right
    rows = outcome.results["gain_codes"]
    order = config.emulation.receiver.order
    assert [(row["status"], row["order"]["integer"]) for row in rows] == [("ok", order)] * len(CODES)
    assert outcome.results["best_code"] == 7
    # and each number is there, within 4 standard uncertainties (one in 16 000; there are some 80)
    for name, values in pulls(config, outcome).items():
        assert np.max(np.abs(values)) < 4, name
        assert len(values) == (1 if name.startswith(("clock", "interleave")) else len(CODES)), name


def test_gain_and_best_code_do_not_need_a_cutoff() -> None:
    # given a receiver whose cut-off is far beyond the generator's frequencies, when it is characterized
    config = bench(cutoff_hz=150e6)
    outcome = found(config, OPTIONS)
    # then no cut-off is told, and gains are right all the same
    rows = outcome.results["gain_codes"]
    for row in rows:
        assert row["status"] == "cutoff_not_identified"
        assert (row["cutoff"], row["order"]) == (None, {"free": None, "integer": None})
    assert np.max(np.abs(pulls(config, outcome)["gain"])) < 4
    assert outcome.results["best_code"] == 7


def test_two_frequencies_give_gain_and_cutoff_without_an_order() -> None:
    # given a sweep of two frequencies, one at the cut-off, when it is characterized
    config = bench(cutoff_hz=19e6)
    outcome = found(config, GainOptions(CODES, (13e-3, 50e-3), (0.5e6, 19e6)))
    # then the order is null and the status says so, and the other numbers are right
    for row in outcome.results["gain_codes"]:
        assert (row["status"], row["order"]) == ("order_not_identified", {"free": None, "integer": None})
    pulled = pulls(config, outcome)
    for name in ("gain", "cut-off"):
        assert len(pulled[name]) == len(CODES)
        assert np.max(np.abs(pulled[name])) < 4
    assert outcome.results["best_code"] == 7
    legend = outcome.figures["gain"]().axes[0].get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "gain code 7, order unknown"


@pytest.mark.parametrize(("cutoff_hz", "title"), [(150e6, "cut-off unknown"), (17e6, "order 3")])
def test_points_are_drawn_with_a_curve_only_where_a_cutoff_is_known(cutoff_hz: float, title: str) -> None:
    # given receivers whose cut-off can and cannot be told
    outcome = found(bench(cutoff_hz=cutoff_hz), OPTIONS)
    # when the figures are drawn
    axes = outcome.figures["gain"]().axes[0]
    by_amplitude = outcome.figures["estimators"]().axes[0]
    # then all usable points of the best code are there, at both amplitudes, and a curve for each known filter
    lines = [line for line in axes.lines if line.get_linestyle() != "None"]
    points = [line for line in axes.lines if line.get_linestyle() == "None"]
    assert len(lines) == (0 if title == "cut-off unknown" else len(CODES))
    assert [len(line.get_xdata()) for line in points] == [24, 24]
    legend = axes.get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == f"gain code 7, {title}"
    # and the estimators stand beside each other in both cases
    assert [len(line.get_xdata()) for line in by_amplitude.lines[:3]] == [2, 2, 2]
    assert not any("no usable point" in text.get_text() for text in axes.texts + by_amplitude.texts)


def test_no_code_is_the_best_while_the_steps_of_the_converter_hide_the_noise_of_another() -> None:
    # given steps of 62 mV beside 1 to 7 mV of noise, when the codes are characterized
    results = found(bench(bits=6, full_scale_v=4.0), OPTIONS).results
    # then gains are told, and the quietest code has no noise but a status
    row = next(row for row in results["gain_codes"] if row["code"] == 7)
    assert row["gain"] is not None
    assert (row["noise_rms"], row["input_noise_rms"]) == (None, None)
    assert row["status"] == "noise_no_signal"
    assert results["best_code"] is None


def test_the_runner_up_is_told_and_called_equal_only_within_the_scatter() -> None:
    # given a receiver with a clearly best code, and a generator whose amplitude is known to 20 % only
    config = bench()
    declared = GeneratorUncertainty(amplitude_relative=0.2)
    generator = msgspec.structs.replace(config.generator, uncertainty=declared)
    outcome = found(msgspec.structs.replace(config, generator=generator), OPTIONS)
    # then the next code is told with its distance, which an error common to all codes does not blur
    second = outcome.results["best_code_runner_up"]
    assert second["code"] == 12
    distance = 6.6e-3 / 21.1 - 1.1e-3 / 13.7
    assert abs(second["difference"]["value"] - distance) < 4 * second["difference"]["standard_uncertainty"]
    assert second["difference"]["standard_uncertainty"] < 0.05 * distance
    assert not any("is within the uncertainty of the best" in note for note in outcome.notes)


def test_codes_that_are_alike_are_said_to_be_within_the_uncertainty() -> None:
    receiver = EmulatedReceiver(gain_by_code=(5.0,) * 16, noise_rms_v_by_code=(2e-3,) * 16)
    config = msgspec.structs.replace(simulated(), emulation=EmulationTable(receiver=receiver))
    outcome = found(config, GainOptions((1, 7), (50e-3,)))
    best, second = outcome.results["best_code"], outcome.results["best_code_runner_up"]
    assert {best, second["code"]} == {1, 7}
    assert 0 <= second["difference"]["value"] < 4 * second["difference"]["standard_uncertainty"]
    told = f"Gain code {second['code']} is within the uncertainty of the best, {best}"
    assert any(told in note for note in outcome.notes)


def test_the_frequencies_that_were_played_are_told() -> None:
    outcome = found(bench(), GainOptions((1,), (50e-3,), (1e6, 5e6, 3.0000001234567e6)))
    # as the generator rounds them, to 1 µHz
    assert outcome.conditions == {"frequencies played": "1, 3.000000123457, 5 MHz"}


def test_results_are_equal_on_every_link() -> None:
    direct, serial, usb = (
        found(bench(link), OPTIONS).results for link in ("simulated", "emulated:serial", "emulated:usb")
    )
    assert serial == direct
    assert usb == direct
