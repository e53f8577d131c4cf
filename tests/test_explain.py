"""What `explain` says: the paper's table digit for digit, sources, and what is assumed."""

from __future__ import annotations

import re

import pytest

from sim.explain import Explained, explain, explained
from sim.scene import Scene, load_scene, parse_scene, ready_scenes


def by_key(scene: Scene) -> dict[str, Explained]:
    return {line.key: line for line in explained(scene)}


@pytest.mark.parametrize(
    ("key", "printed", "unit"),
    [
        ("laser.energy_j", 50e-3, "J"),
        ("laser.wavelength_m", 1064e-9, "m"),
        ("detector.telescope_radius_m", 10e-2, "m"),
        ("detector.field_of_view_rad", 247.5e-6, "rad"),
        ("detector.optical_efficiency", 0.84, "1"),
        ("detector.filter_transmission", 0.85, "1"),
        ("detector.quantum_efficiency", 0.34, "1"),
        ("detector.filter_width_m", 2e-9, "m"),
        ("detector.tia_bandwidth_hz", 20e6, "Hz"),
        ("receiver.gain", 5.19, "1"),
        ("receiver.sample_interval_s", 12.5e-9, "s"),
    ],
)
def test_the_preset_bela_is_the_table_of_the_paper(key: str, printed: float, unit: str) -> None:
    line = by_key(Scene())[key]

    assert line.value == printed
    assert line.unit == unit
    assert "table 1" in line.source
    assert not line.assumed


def test_the_gain_of_the_photodiode_is_the_table_of_the_paper() -> None:
    line = by_key(Scene())["computed.multiplication"]

    assert line.value == pytest.approx(48.4, rel=1e-12)
    assert "paper, table 1: 48.4" in line.source
    assert "table 1" not in by_key(parse_scene("[detector]\nbias_v = 310"))["computed.multiplication"].source


def test_what_is_assumed_is_told() -> None:
    lines = by_key(Scene())

    assumed = {key for key, line in lines.items() if line.assumed}
    assert {"laser.fwhm_s", "laser.tail_s", "laser.jitter_rad", "detector.excess_noise_exponent"} <= assumed
    assert {"receiver.adc_full_scale_v", "detector.breakdown_v", "laser.pulse"} <= assumed
    assert not assumed & {"laser.energy_j", "detector.feedback_ohm", "receiver.cutoff_hz", "altitude_m"}


def test_what_the_scene_says_is_neither_the_papers_nor_assumed() -> None:
    lines = by_key(
        parse_scene(
            "gain_code = 5\n[laser]\nfwhm_s = 4e-9\n[surface]\nslope_deg = 3\n"
            "[electronics]\ncutoff_hz = 18e6\nclock_ppm = 20\ninterleave = { gain = 0.01 }"
        )
    )

    for key in ("gain_code", "laser.fwhm_s", "surface.slope_deg", "receiver.cutoff_hz"):
        assert (lines[key].source, lines[key].assumed) == ("scene", False)
    assert lines["electronics.clock_ppm"].value == 20
    assert lines["electronics.interleave.gain"].value == 0.01
    assert "electronics.interleave.skew_s" not in lines
    # the gain at another code is assumed, that at code 4 is not
    assert lines["receiver.gain"].assumed


def test_a_thermal_set_is_told() -> None:
    lines = by_key(load_scene("hot"))

    assert lines["laser.thermal"].value == "hot"
    assert "three named scalings" in lines["laser.fwhm_s"].source
    assert lines["laser.fwhm_s"].assumed
    assert lines["laser.energy_j"].source == "paper, table 1"


def test_what_does_nothing_is_left_out() -> None:
    lines = by_key(load_scene("previous-model"))

    assert not lines.keys() & {"laser.tail_s", "laser.ellipticity", "surface.hurst", "detector.bias_v"}
    assert not lines.keys() & {"receiver.cutoff_hz", "sun.distance_au", "noise.dark_rms_v"}
    assert lines["detector.multiplication"].value == pytest.approx(60.5)
    assert "sun.distance_au" in by_key(load_scene("day"))


@pytest.mark.parametrize("name", ready_scenes())
def test_every_line_has_value_unit_and_source(name: str) -> None:
    scene = load_scene(name)

    for line in explained(scene):
        assert line.source
        assert bool(line.unit) == (not isinstance(line.value, str))
    text = explain(scene)
    assert text.startswith("paper: Nishiyama et al.")
    assert len(text.splitlines()) == len(explained(scene)) + 3
    assert "nan" not in text


def test_the_printed_table_shows_digits_unit_and_mark() -> None:
    text = explain(load_scene("day"))

    assert re.search(r"^detector\.field_of_view_rad +0\.0002475 +rad +paper, table 1$", text, re.MULTILINE)
    assert re.search(r"^laser\.tail_s +3e-09 +s +assumed  0 to 10 ns", text, re.MULTILINE)
    assert re.search(r"^computed\.photons +1300\.3 ", text, re.MULTILINE)
    assert re.search(r"^noise\.shot +true +1 ", text, re.MULTILINE)
