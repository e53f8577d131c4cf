"""Scenes: every key has a default, what is written is what is read, what is wrong is said in one line."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import ConfigError
from sim.chain import Chain
from sim.explain import explain
from sim.light_noise import background_density
from sim.link_budget import link_budget
from sim.presets import DETECTOR_SOURCES, DETECTORS, LASER_SOURCES, LASERS, RECEIVER_SOURCES
from sim.rfm import RangeFinder
from sim.scene import Scene, as_toml, load_scene, parse_scene, ready_scenes
from sim.scene_tables import Detector, Laser, Noise, Sun, SurfaceTable

SCENE_OF_THE_CONTRACT = """
altitude_m = 500e3
receiver = "bela-grm"
gain_code = 4
[laser]
[surface]
kind = "plane"
slope_deg = 10.0
reflectance = 0.17
[noise]
dark_rms_v = 0.83e-3
shot = true
[sun]
incidence_deg = 0.0
distance_au = 0.3871
"""


def test_an_empty_file_is_the_default_scene() -> None:
    scene = parse_scene("")

    assert scene == Scene()
    assert scene.laser == Laser() == LASERS["bela"]
    assert scene.detector == Detector() == DETECTORS["bela"]
    # nothing makes noise, and it is night
    assert (scene.noise, scene.sun) == (Noise(), None)
    assert scene.truth.noise_rms_v_by_code == (0.0,) * 16


def test_the_scene_of_the_contract() -> None:
    scene = parse_scene(SCENE_OF_THE_CONTRACT)

    assert scene == Scene(
        surface=SurfaceTable(slope_deg=10.0), noise=Noise(dark_rms_v=0.83e-3, shot=True), sun=Sun()
    )
    assert scene.gain == 5.19
    assert [volts for volts in scene.truth.noise_rms_v_by_code if volts] == [0.83e-3]
    assert scene.truth.noise_rms_v_by_code[4] == 0.83e-3


def test_a_preset_fills_what_the_file_leaves_out() -> None:
    scene = parse_scene('[laser]\npreset = "gala-like"\nfwhm_s = 4e-9\n[detector]\npreset = "previous-model"')

    assert scene.laser == msgspec.structs.replace(LASERS["gala-like"], fwhm_s=4e-9)
    assert scene.detector.multiplication == pytest.approx(60.5)


def test_a_thermal_set_acts_on_the_preset_and_not_on_what_the_file_says() -> None:
    hot = parse_scene('[laser]\nthermal = "hot"\ntail_s = 2e-9')

    assert hot.laser.fwhm_s == pytest.approx(5.4e-9 * 1.05)
    assert hot.laser.tail_s == 2e-9
    assert hot.laser.pointing_rad == (5e-6, 0.0)


def test_one_number_is_the_jitter_of_both_axes() -> None:
    assert parse_scene("[laser]\njitter_rad = 2e-6").laser.jitter_rad == (2e-6, 2e-6)
    assert parse_scene("[laser]\njitter_rad = [0, 2e-6]").laser.jitter_rad == (0.0, 2e-6)


def test_what_differs_in_the_receiver_reaches_its_truth() -> None:
    text = (
        "gain_code = 0\n[noise]\ndark_rms_v = 1e-3\n"
        "[electronics]\nhighpass_hz = 10e3\ninterleave = { gain = 0.01 }"
    )
    truth = parse_scene(text).truth

    assert (truth.highpass_hz, truth.interleave.gain, truth.cutoff_hz) == (10e3, 0.01, 19e6)
    assert truth.noise_rms_v_by_code == (1e-3,) + (0.0,) * 15
    assert parse_scene(text).gain == truth.gain_by_code[0]


# ---- ready scenes


@pytest.mark.parametrize("name", ready_scenes())
def test_a_ready_scene_is_read_and_survives_being_written(name: str) -> None:
    scene = load_scene(name)

    assert parse_scene(as_toml(scene)) == scene
    assert link_budget(scene).photons > 0


def test_the_ready_scenes_are_those_that_were_promised() -> None:
    assert {"plane", "crater", "boulder", "boulder-example"} <= set(ready_scenes())
    assert {"hot", "ambient", "cold", "day", "night", "gala-like", "previous-model"} <= set(ready_scenes())


def test_ready_scenes_are_what_their_names_say() -> None:
    day, night = load_scene("day"), load_scene("night")
    plane, crater, boulder = (load_scene(name).surface for name in ("plane", "crater", "boulder"))

    assert (day.sun, night.sun) == (Sun(), None)
    assert msgspec.structs.replace(day, sun=None) == night
    assert plane.slope_deg == crater.slope_deg == boulder.slope_deg
    assert (crater.diameter_m, crater.depth_m) == (boulder.diameter_m, boulder.height_m)
    assert [load_scene(name).laser.thermal for name in ("cold", "ambient", "hot")] == [
        "cold",
        "ambient",
        "hot",
    ]


def test_nothing_is_belas_alone() -> None:
    scene = load_scene("gala-like")

    assert scene.receiver_spec.digitizer.sample_rate_hz == 200e6
    assert scene.receiver_spec.correlation_window_samples == 64
    assert scene.laser.divergence_rad * scene.altitude_m == pytest.approx(50.0)
    assert link_budget(scene).photons > 0


def test_a_range_finder_is_that_of_the_receiver_but_for_what_the_scene_says() -> None:
    # given scenes that say nothing of it, and something
    usual, gala = Chain(parse_scene("")), Chain(load_scene("gala-like"))
    other = Chain(
        parse_scene(
            "[range_finder]\ntemplate_count = 5\nwidest_s = 150e-9\nexclusion_samples = 7\n"
            "correlation_window_samples = 64\nrefinement_steps = 3\n"
        )
    )
    for chain in (usual, gala):
        assert chain.range_finder == RangeFinder.of(chain.scene.receiver_spec)
    finder = other.range_finder
    widths_s = finder.bank.widths * finder.bank.sample_interval_s
    assert widths_s == pytest.approx(np.geomspace(18e-9, 150e-9, 5))
    assert (finder.exclusion_samples, finder.refinement_steps) == (7, 3)
    # then a correlation window has as many samples as the range finder keeps
    assert other.correlation_window().sample_count == finder.correlation_window_samples == 64
    assert usual.correlation_window().sample_count == 42
    assert other.scene.gain == usual.scene.gain


def test_templates_that_a_bank_cannot_have_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"\[range_finder\] templates from 1e-09"):
        parse_scene("[range_finder]\nnarrowest_s = 1e-9\n")


def test_the_previous_model_has_gaussian_shapes_and_more_gain() -> None:
    scene = load_scene("previous-model")

    assert (scene.filter, scene.laser.pulse, scene.laser.beam) == ("gaussian", "gaussian", "gaussian")
    assert link_budget(scene).multiplication == pytest.approx(1.25 * 48.4)


def test_every_key_of_a_preset_has_a_source() -> None:
    words = {"preset", "thermal", "table", "image"}
    for name in LASERS:
        assert set(Laser.__struct_fields__) - words == set(LASER_SOURCES[name])
    for name, detector in DETECTORS.items():
        keys = set(Detector.__struct_fields__) - words
        known = set(DETECTOR_SOURCES[name])
        assert keys - known <= ({"multiplication"} if detector.multiplication is None else set())
    assert {frozenset(sources) for sources in RECEIVER_SOURCES.values()} == {
        frozenset(RECEIVER_SOURCES["bela-grm"])
    }


# ---- files


def test_files_are_found_from_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a scene in a folder, with a pulse beside it
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "pulse.txt").write_text("0 0\n5e-9 1\n10e-9 0\n")
    (folder / "lab.toml").write_text('[laser]\npulse = "table"\ntable = "pulse.txt"\n')
    monkeypatch.chdir(tmp_path)

    scene = load_scene("scenes/lab.toml")

    assert scene.laser.table == str(folder / "pulse.txt")
    assert load_scene(folder / "lab.toml") == scene
    assert parse_scene(as_toml(scene)) == scene


def test_a_scene_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where nobody keeps a lab.toml
    with pytest.raises(ConfigError, match="scene noon: no such file; ready scenes: ambient, boulder"):
        load_scene("noon")
    with pytest.raises(ConfigError, match=r"scene file lab\.toml: cannot be read \(No such file"):
        load_scene("lab.toml")


# ---- what is wrong


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("foo = 1", "there is an unknown key `foo`; allowed: altitude_m, receiver"),
        ("[laser]\nfoo = 1", "[laser] has an unknown key `foo`; allowed: preset, thermal, energy_j"),
        ("[sun]\nfoo = 1", "[sun] has an unknown key `foo`; allowed: incidence_deg"),
        ("[electronics.interleave]\nfoo = 1", "unknown key `foo`; allowed: gain, offset_v, skew_s"),
        ("altitude_m = 0", "altitude_m: expected a number >= 1.0"),
        ("altitude_m = inf", "altitude_m: expected a number <= 1000000000.0"),
        ("[laser]\nbeam_azimuth_deg = nan", "laser.beam_azimuth_deg is not a finite number"),
        ("[laser]\npointing_rad = [0, nan]", "[laser] pointing_rad[1]: expected a number"),
        ("[laser]\npointing_rad = 1e-6", "[laser] pointing_rad: expected a list, got a number"),
        ("laser = 3", "laser: expected a table, got a whole number"),
        ("sun = true", "sun: expected a table, got true or false"),
        ("[noise]\nshot = 'yes'", "[noise] shot: expected true or false, got text"),
        ("[laser]\nthermal = 'warm'", "[laser] thermal = 'warm' is unknown; allowed: cold, ambient, hot"),
        ("[laser]\npreset = 'x'", '[laser] preset = "x" is unknown; allowed: bela, gala-like'),
        ("[detector]\npreset = 'x'", '[detector] preset = "x" is unknown; allowed: bela, gala-like'),
        ("receiver = 'x'", 'receiver = "x" is unknown; allowed: analog, bela-grm, gala-like'),
        ("filter = 'x'", "filter = 'x' is unknown; allowed: butterworth, gaussian"),
        ("gain_code = 16", "gain_code = 16; bela-grm has 0 to 15"),
        ("[surface]\nkind = 'hill'", "[surface] kind = 'hill' is unknown; allowed: plane, crater"),
        ("[surface]\nslope_deg = 90", "[surface] slope_deg: expected a number < 90"),
        ("[surface]\nreflectance = -0.1", "[surface] reflectance: expected a number >= 0"),
        (
            "[surface]\nhurst = 0.7",
            '[surface] hurst = 0.7 does nothing with kind = "plane"; it acts with kind',
        ),
        ("[surface]\nkind = 'dtm'", '[surface] file: kind = "dtm" needs a file'),
        ("[surface]\nkind = 'dtm'\nfile = 'no.tif'", "no.tif: no such file"),
        (
            "[laser]\npulse = 'gaussian'\ntail_s = 1e-9",
            '[laser] tail_s = 1e-09 does nothing with pulse = "gaussian"',
        ),
        ("[laser]\npulse = 'table'", '[laser] table: pulse = "table" needs a file'),
        ("[laser]\nbeam = 'image'", '[laser] image: beam = "image" needs a file'),
        ("[detector]\nbias_v = 400", "bias_v = 400: must be below the breakdown voltage, 391.43 V at apd"),
        ("[detector]\napd_temperature_c = -20", "breakdown voltage, 295.43 V at apd_temperature_c = -20"),
        ("[noise]\ndark_rms_v = 1e-3\ndark_windows = 'a.npy'", "dark_rms_v and dark_windows: allowed is one"),
        ("[noise]\ndark_windows = 'no.npy'", "no.npy: no such file"),
        ("[electronics]\ngain_by_code = [1, 2]", "[electronics] gain_by_code has 2 numbers; bela-grm has 16"),
        (
            "[electronics]\nnoise_rms_v_by_code = [1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]",
            "the noise of a scene is [noise] dark_rms_v",
        ),
        ("[sun]\nincidence_deg = 91", "[sun] incidence_deg: expected a number <= 90"),
        ("a =", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_scene(text, "my.toml")
    assert said in str(caught.value)
    assert str(caught.value).startswith("my.toml: ")
    assert str(caught.value).count("my.toml: ") == 1
    assert "\n" not in str(caught.value)


def test_a_key_without_effect_may_keep_its_usual_value() -> None:
    text = "[surface]\nkind = 'plane'\nhurst = 0.8\n[laser]\npulse = 'gaussian'\ntail_s = 3e-9"

    assert parse_scene(text).surface == SurfaceTable()


TABLES = {
    "": [key for key in Scene.__struct_fields__ if key not in ("electronics", "laser", "surface")],
    "laser": list(Laser.__struct_fields__),
    "detector": list(Detector.__struct_fields__),
    "surface": list(SurfaceTable.__struct_fields__),
    "noise": list(Noise.__struct_fields__),
    "sun": list(Sun.__struct_fields__),
}
ANYTHING = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.floats(0, 1),
    st.floats(1, 1000),
    st.booleans(),
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8),
    st.sampled_from(["hot", "table", "dtm", "gala-like", "elliptical", "lambert", "gaussian"]),
    st.lists(st.floats(), max_size=3),
    st.dictionaries(st.sampled_from(["a", "preset", "kind"]), st.integers(), max_size=2),
)


def allowed(annotation: Any) -> st.SearchStrategy[Any]:
    """Values that the type of a key allows."""
    arguments = get_args(annotation)
    if get_origin(annotation) is Literal:
        return st.sampled_from([word for word in arguments if word not in ("table", "image", "dtm")])
    if get_origin(annotation) is Annotated:
        kind, meta = arguments
        lowest = meta.ge if meta.ge is not None else meta.gt
        highest = meta.le if meta.le is not None else meta.lt
        open_ends = {"exclude_min": meta.ge is None, "exclude_max": meta.le is None and meta.lt is not None}
        if kind is int:
            return st.integers(lowest, 20)
        return st.floats(lowest, 1e6 if highest is None else highest, **open_ends)
    if get_origin(annotation) is tuple:
        return st.tuples(*map(allowed, arguments)).map(list)
    if arguments:
        return allowed(arguments[0])
    return st.floats(-1e6, 1e6) if annotation is float else st.booleans()


KEYS = {
    name: {key.name: key.type for key in msgspec.structs.fields(kind) if key.type is not str}
    for name, kind in {"laser": Laser, "detector": Detector, "surface": SurfaceTable, "sun": Sun}.items()
}


@given(st.data())
def test_allowed_values_at_any_key_make_a_scene_of_finite_numbers(data: st.DataObject) -> None:
    # given values at the ends of their ranges and between, at a few keys of one table
    table = data.draw(st.sampled_from(sorted(KEYS)))
    keys = data.draw(st.lists(st.sampled_from(sorted(KEYS[table])), max_size=4, unique=True))
    text = tomli_w.dumps({table: {key: data.draw(allowed(KEYS[table][key])) for key in keys}})
    # when they are read
    scene, refusal = read_or_refused(text)
    # then there is a scene, or else a key was idle or the bias above breakdown
    if scene is None:
        assert re.search("does nothing with|must be below the breakdown voltage", refusal)
    else:
        expect_finite(scene)


@given(st.data())
def test_anything_at_any_key_is_read_or_refused_in_one_line(data: st.DataObject) -> None:
    # given a file with any values at a few keys
    written: dict[str, object] = {}
    for table, keys in TABLES.items():
        given_keys = data.draw(st.lists(st.sampled_from(keys), max_size=2, unique=True))
        values = {key: data.draw(ANYTHING) for key in given_keys}
        if not table:
            written |= values
        elif values:
            written[table] = values
    text = tomli_w.dumps(written)
    # when it is read
    scene, refusal = read_or_refused(text)
    # then it is a scene, or it is refused in one line
    if scene is not None:
        expect_finite(scene)
        return
    assert refusal.startswith("any.toml: ")
    assert len(refusal.splitlines()) == 1


def expect_finite(scene: Scene) -> None:
    """All that follows from a scene is a finite number, and the scene survives being written."""
    assert parse_scene(as_toml(scene)) == scene
    assert all(map(math.isfinite, dataclasses.astuple(link_budget(scene))))
    assert math.isfinite(background_density(scene))
    assert not re.search(r"\b(nan|inf)\b", explain(scene).lower())


def read_or_refused(text: str) -> tuple[Scene | None, str]:
    try:
        return parse_scene(text, "any.toml"), ""
    except ConfigError as refusal:
        return None, str(refusal)
