"""Temperature campaigns: photons, alignment, range bias beside geometry, the library, and the command."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from belahil.chunks import work
from belahil.cli.main import main
from belahil.errors import RefusedInput
from procedures.campaign_temperature import (
    AZIMUTHS_DEG,
    PARTS,
    STRENGTHS,
    TemperatureOptions,
    changed,
    one_set,
    plan,
    scaled,
    wrong_library,
)
from procedures.campaign_temperature_outcome import aligned, change, gathered, peak_of
from procedures.pulse_library import mean_fit
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.laser import Laser
from sim.presets import THERMAL, ThermalSet, laser_preset
from sim.scene import Scene, as_toml


def found_set(
    laser: Laser, altitude_m: float = 500e3, slope_deg: float = 10.0, azimuth_deg: float = 0.0
) -> dict[str, np.ndarray]:
    scene = structs.replace(Scene(), laser=laser, altitude_m=altitude_m)
    return one_set(as_toml(scene), 0.17, slope_deg, azimuth_deg)


@pytest.mark.parametrize("thermal", ["cold", "ambient", "hot"])
def test_the_assumed_sets_are_those_of_the_presets(thermal: str) -> None:
    made = changed(Laser(), THERMAL[thermal])  # type: ignore[index]

    assert structs.replace(made, thermal=thermal) == laser_preset("bela", thermal)  # type: ignore[arg-type]


@pytest.mark.parametrize("strength", [0.0, 1.0, 2.5])
def test_a_set_is_made_stronger(strength: float) -> None:
    one = scaled(ThermalSet(1.1, 0.8, 1.0, (2e-6, -1e-6)), strength)

    assert one == ThermalSet(1.1**strength, 0.8**strength, 1.0, (2e-6 * strength, -1e-6 * strength))


def test_a_plan_tries_each_set_each_change_and_each_strength() -> None:
    names = [one.name for one in plan(TemperatureOptions()).chunks]

    assert names[:3] == ["cold", "ambient", "hot"]
    assert names[-1] == "library"
    assert len(names) == 3 + 2 * (len(PARTS) + len(STRENGTHS)) + 1


def test_lasers_of_scenes_have_the_photons_of_the_campaigns_scene(tmp_path: Path) -> None:
    # given a hot laser of another energy and wavelength
    hot = tmp_path / "hot.toml"
    hot.write_text("[laser]\nenergy_j = 0.01\nwavelength_m = 532e-9\nfwhm_s = 8e-9\n")
    made = plan(TemperatureOptions(hot=str(hot), ambient="ambient", cold="cold"))

    # when its sets are computed, then all have the same photons, and nothing is varied
    chunks = {one.name: one for one in made.chunks}
    assert list(chunks) == ["cold", "ambient", "hot", "library"]
    photons = [work(chunks[name].work, chunks[name].given)["photons"] for name in ("cold", "ambient", "hot")]
    assert photons[0] == pytest.approx(photons[1], rel=1e-12)
    assert photons[2] == pytest.approx(photons[1], rel=1e-12)


@pytest.mark.parametrize("thermal", ["cold", "hot"])
def test_the_light_is_all_there(thermal: str) -> None:
    one = found_set(laser_preset("bela", thermal))  # type: ignore[arg-type]

    step_s = one["time_s"][1] - one["time_s"][0]
    assert one["emitted_rate"].sum() * step_s == pytest.approx(one["photons"][0], rel=1e-6)
    assert one["received_rate"].sum() * step_s == pytest.approx(one["photons"][1], rel=1e-4)


@pytest.mark.parametrize(
    ("altitude_m", "slope_deg", "azimuth_deg"), [(500e3, 10, 0), (800e3, 20, 60), (400e3, 5, 180)]
)
def test_the_bias_of_pointing_is_that_of_geometry(
    altitude_m: float, slope_deg: float, azimuth_deg: float
) -> None:
    # given a beam that points 5 urad along x, over a plane
    off = laser_preset(pointing_rad=(5e-6, 0.0))

    bias = change(
        found_set(off, altitude_m, slope_deg, azimuth_deg),
        found_set(laser_preset(), altitude_m, slope_deg, azimuth_deg),
    )

    # then the ground is nearer by its rise, 2 mm or so beside the width that the slant adds
    rise_m = altitude_m * 5e-6 * math.tan(math.radians(slope_deg)) * math.cos(math.radians(azimuth_deg))
    assert bias.range_bias_m == pytest.approx(-rise_m, abs=1e-3)
    assert bias.pointing_m == pytest.approx(-rise_m, abs=1e-3)


@pytest.mark.parametrize("late_s", [0.0, 3.3e-9, -7.77e-9])
def test_aligned_pulses_of_one_shape_do_not_differ(late_s: float) -> None:
    # given one pulse at two places, and half as high
    ambient = found_set(laser_preset())
    times_s = ambient["time_s"]
    other = ambient | {"volts": 0.5 * np.interp(times_s - late_s, times_s, ambient["volts"])}

    moved = aligned(other, ambient)

    # then it comes back, to what straight lines between 0.3 ns lose
    inner = slice(200, -200)
    assert np.abs(2 * moved - ambient["volts"])[inner].max() < 1e-4 * ambient["volts"].max()
    assert peak_of(other)[0] - peak_of(ambient)[0] == pytest.approx(late_s, abs=2e-11)


@pytest.mark.slow
def test_a_library_of_the_own_set_leaves_nothing_and_a_wrong_one_something() -> None:
    own, hot = as_toml(Scene()), as_toml(structs.replace(Scene(), laser=laser_preset("bela", "hot")))

    found = wrong_library([own, hot], own, 10.0, 0.0)

    # then the own set is found at its slope, and what is left is rounding
    assert set(found["slope_deg"][0]) == {10.0}
    assert found["msr_v2"][0].max() < 1e-14
    # and the other, as that between two slopes of the library, leaves more, yet far less than 1 mV2
    assert 1e-10 < found["msr_v2"][1].mean() < 1e-7
    assert 1e-11 < found["msr_v2"][2].mean() < 1e-7
    assert set(found["slope_deg"][2]) <= {10.0, 11.0}


@pytest.mark.slow
def test_the_outcome_adds_up() -> None:
    made = plan(TemperatureOptions())
    results = [work(one.work, one.given) for one in made.chunks]

    sets = gathered(made, results)

    ambient, hot, cold = (sets.found[name] for name in ("ambient", "hot", "cold"))
    # pointing makes the larger part of the bias, and the bias is antisymmetric within a few percent
    for one, sign in ((cold, 1), (hot, -1)):
        whole = change(one, ambient)
        assert sign * whole.range_bias_m > 0
        assert abs(whole.range_bias_m - whole.pointing_m) < 0.02
        assert whole.pointing_m == pytest.approx(
            SPEED_OF_LIGHT_M_PER_S / 2 * (one["ground_s"][0] - ambient["ground_s"][0]), rel=1e-12
        )
    # and turned by half a circle the slope turns the sign of what pointing does
    half = len(AZIMUTHS_DEG) // 2
    towards, away = (hot["ground_s"][at] - ambient["ground_s"][at] for at in (0, half))
    assert towards == pytest.approx(-away, rel=1e-3)
    # a colder pulse is shorter, so of equal photons its peak is higher
    assert peak_of(cold)[1] > peak_of(ambient)[1] > peak_of(hot)[1]


@pytest.mark.parametrize(
    "given", [{"slope_deg": 90.0}, {"slope_deg": -1.0}, {"azimuth_deg": float("nan")}, {"threshold": 1.0}]
)
def test_an_option_outside_its_range_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(RefusedInput):
        TemperatureOptions(**given)  # type: ignore[arg-type]


def test_a_pulse_that_leaves_what_is_computed_is_refused_in_words(tmp_path: Path) -> None:
    # given a slope so steep that the pointing of the hot set takes its pulse 128 ns away
    scene = tmp_path / "high.toml"
    scene.write_text("altitude_m = 1400e3\n")
    options = TemperatureOptions(scene=str(scene), slope_deg=70.0)

    with pytest.raises(
        RefusedInput, match=r"--slope-deg 70: .* no 42 samples round it there; a gentler slope"
    ):
        plan(options)


@pytest.mark.parametrize(("early", "late"), [(2, 0), (0, 2)])
def test_a_fit_uses_the_last_sample_that_there_is(early: int, late: int) -> None:
    # given a Gaussian with as many samples on either side as its window has, or some too few
    steps, window, interval_s = 4, 12, 12.5e-9
    place = np.arange(window * steps) - window // 2 * steps
    curve = np.exp(-0.5 * (place / (2 * steps)) ** 2)

    arrival_s, fwhm_s, _ = mean_fit(curve[: window * steps], 1, window * steps, interval_s)

    assert arrival_s == pytest.approx(window // 2 * steps * interval_s, abs=1e-12)
    assert fwhm_s == pytest.approx(2 * steps * math.sqrt(8 * math.log(2)) * interval_s, rel=1e-6)
    with pytest.raises(RefusedInput):
        mean_fit(curve[early : curve.size - late], 1, window * steps, interval_s)


def test_the_command_keeps_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["campaign", "temperature", "--workers", "1", "--json", "--quiet", "--out", str(tmp_path / "run")]

    assert main([*words, "--slope-deg", "5"]) == 0

    results = json.loads(capsys.readouterr().out)["results"]
    assert results["photons"]["received"] == pytest.approx(1300, abs=1)
    for name in ("cold", "hot"):
        assert results["against_ambient"][name]["difference"]["standard_uncertainty"] > 0
        assert results["sets"][name]["photons_received"] == results["photons"]["received"]
    # half of the strength that makes 2 mV makes less
    assert results["strength_of_published_difference"]["hot_cold"] > 1
    assert (tmp_path / "run" / "figure-temperature.png").stat().st_size > 10_000


def test_a_scene_that_is_not_there_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "temperature", "--hot", "no-such-scene", "--out", str(tmp_path / "run")]) == 2
    assert "no-such-scene" in capsys.readouterr().err
