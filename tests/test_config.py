"""Bench files: what is written is what is read, and what is wrong is said in one line."""

from __future__ import annotations

import math

import pytest

from belahil.config import as_toml, emulated, parse_bench, simulated
from belahil.errors import ConfigError
from belahil.receiver import BELA_GRM
from belahil.receiver_truth import receiver_truth


def test_an_empty_file_is_the_emulated_bench() -> None:
    assert parse_bench("") == emulated()
    assert emulated().source == "emulated"
    assert simulated().source == "simulated"


def test_every_key_survives_being_written_and_read() -> None:
    # given a file that sets something in every table
    text = """
[bench]
trigger = "digitizer"
settle_s = 0.25
[generator]
load_ohm = inf
uncertainty = { amplitude_v = 1e-3 }
[emulation]
seed = 7
[emulation.receiver]
cutoff_hz = 17.3e6
interleave = { gain = 0.01, skew_s = 50e-12 }
[limits]
cutoff_hz = [18e6, 20e6]
"""
    # when it is read, written with every key, and read again
    config = parse_bench(text)
    again = parse_bench(as_toml(config))
    # then nothing is lost
    assert again == config
    assert math.isinf(again.generator.load_ohm)
    assert again.limits is not None
    assert again.limits.cutoff_hz == (18e6, 20e6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[generator]\nfoo = 1", "[generator] has an unknown key `foo`; allowed: driver, address"),
        ("[emulation.receiver.interleave]\nz = 1", "unknown key `z`; allowed: gain, offset_v, skew_s"),
        ("nope = 1", "unknown key `nope`; allowed: bench, generator"),
        ("[generator]\nload_ohm = 'a'", "[generator] load_ohm: expected a number, got text"),
        ("[generator]\nload_ohm = 0.5", "[generator] load_ohm = 0.5: allowed: 1 to 10000 ohm, or inf"),
        ("[generator]\nload_ohm = 10001", "[generator] load_ohm = 10001: allowed: 1 to 10000 ohm, or inf"),
        ("[emulation.receiver]\norder = 9", "order: expected a whole number <= 6"),
        ("[emulation.receiver]\ngain_by_code = [1, 2]", "gain_by_code has 2 numbers; bela-grm has 16"),
        ("[bench]\ntrigger = 'x'", "[bench] trigger = 'x' is unknown; allowed: generator, digitizer"),
        ("[emulation.generator]\nflatness = nan", "[emulation.generator] flatness is not a number"),
        ("[bench]\nsettle_s = inf", "[bench] settle_s is infinite: must be finite"),
        ("[generator]\nmax_vpp = inf", "[generator] max_vpp is infinite: must be finite"),
        ("[generator]\nattenuation_db = 7000.0", "[generator] attenuation_db: expected a number <= 200"),
        ("[emulation.receiver.interleave]\ngain = -inf", "[emulation.receiver.interleave] gain is infinite"),
        ("[generator]\ndriver = 'x'", 'driver = "x" is unknown; allowed: keysight-33500'),
        ("[digitizer]\nreceiver = 'x'", 'receiver = "x" is unknown; allowed: analog, bela-grm'),
        ("[digitizer]\nlink = 'simulated'", "both must be emulated, both simulated, or both real"),
        ("[limits]\ngain = [2, 1]", "[limits] gain = [2, 1]: low must not exceed high"),
        ("a =", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_bench(text, "lab.toml")
    assert said in str(caught.value)
    assert str(caught.value).startswith("lab.toml: ")
    assert "\n" not in str(caught.value)


def test_gaps_in_the_truth_are_the_preset() -> None:
    truth = receiver_truth(parse_bench("[emulation.receiver]\ncutoff_hz = 15e6"))
    assert truth.cutoff_hz == 15e6
    assert truth.order == BELA_GRM.order == 3
    assert truth.gain_by_code[4] == 5.19
    assert truth.noise_rms_v_by_code[4] == pytest.approx(0.83e-3, rel=1e-3)
