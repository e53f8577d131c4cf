"""Ready scenes and presets, from end to end against what they claim to be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs
from scenes import with_

from belahil.pulse_fit import CURVATURE
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.chain_noise import GaussianFilter
from sim.link_budget import link_budget
from sim.presets import THERMAL, detector_preset, laser_preset
from sim.scene import Scene, load_scene
from sim.scene_tables import Sun, SurfaceTable

LIGHT_M_PER_S = 299792458.0


def steady(name: str) -> Scene:
    return with_(load_scene(name), laser={"jitter_rad": (0.0, 0.0), "energy_jitter": 0.0})


def searched(scene: Scene) -> np.ndarray:
    """Arrival (s), full width (s) and amplitude (V) of the best candidate in a window without noise."""
    chain = Chain(scene, Accuracy(1e-4))
    whole = np.zeros(2000)
    volts = chain.samples(request=chain.correlation_window(sample_count=400)).volts
    whole[800:1200] = volts
    return np.asarray(chain.range_finder.search(whole)[0])


# ---- another instrument


def test_a_gala_like_instrument_runs_from_the_laser_to_its_candidates() -> None:
    # Given the ready scene by night
    scene = steady("gala-like")
    chain = Chain(scene)

    # When a whole window is digitized and searched
    window = chain.window(3)
    best, *others = chain.candidates(3, with_samples=True)

    # Then rate, window and correlation windows are its own
    assert window.sample_interval_s == 5e-9
    assert window.counts.size == 32000
    assert len(best.correlation_window) == 64
    assert chain.range_finder.bank.sample_interval_s == 5e-9
    assert len(others) == 3
    # and the echo is where light and filter put it, within what its noise permits
    (piece,) = chain.light_kernel.pulse.pieces
    delay_s = float(-sum(1 / pole for pole in chain.receiver.poles).real)
    true_s = chain.gate_s + delay_s + chain.lit(3).delays.mean_s + piece.tau_s
    phase_s = chain.first_sample_s(3, chain.whole_window(3)) + chain.gate_s
    assert best.arrival_s + phase_s == pytest.approx(true_s, abs=3e-9)
    assert best.amplitude_v > 3 * max(other.amplitude_v for other in others)


def test_the_gala_like_echo_is_as_wide_as_its_own_footprint_makes_it() -> None:
    scene = steady("gala-like")
    sigma_m = scene.altitude_m * scene.laser.divergence_rad / 4
    spread_s = 2 * sigma_m * math.tan(math.radians(10)) / LIGHT_M_PER_S
    optical_s = math.hypot(scene.laser.fwhm_s, math.sqrt(CURVATURE) * spread_s)

    _, fwhm_s, _ = searched(scene)[:3]

    # A maximally flat filter of 60 MHz leaves the variance of 35 ns as it is, and little skew
    assert fwhm_s == pytest.approx(optical_s, rel=0.01)
    assert Chain(scene).echo().photons == pytest.approx(link_budget(scene).photons, rel=1e-3)


# ---- the model before


def test_the_previous_model_is_its_definition() -> None:
    # Given pulse, beam and filter that are Gaussian, which leaves a Gaussian in closed form
    scene, chain = steady("previous-model"), Chain(steady("previous-model"), Accuracy(1e-6))
    sigma_b_s = 1 / (2 * math.sqrt(2 * math.pi) * 20e6)
    sigma_r_m = scene.altitude_m * scene.laser.divergence_rad / 4
    slope_s = 2 * sigma_r_m * math.tan(math.radians(10)) / LIGHT_M_PER_S
    total_s = math.hypot(5.4e-9 / math.sqrt(CURVATURE), slope_s, sigma_b_s)
    area_v_s = 1.25 * link_budget(with_(scene, detector={"multiplication": 48.4})).area_at_converter_v_s

    # When its samples are taken
    request = chain.correlation_window()
    times_s = chain.first_sample_s(None, request) + 12.5e-9 * np.arange(42)
    volts = chain.samples(request=request).volts

    # Then they are that Gaussian; the curve of the wavefront changes it by less than 1e-3
    assert isinstance(chain.passed, GaussianFilter)
    assert chain.passed.sigma_s == pytest.approx(sigma_b_s, rel=1e-12)
    expected = area_v_s / (math.sqrt(2 * math.pi) * total_s) * np.exp(-0.5 * (times_s / total_s) ** 2)
    np.testing.assert_allclose(volts, expected, rtol=0, atol=1e-3 * expected.max())


def test_the_previous_model_differs_from_belas_in_nothing_else() -> None:
    laser, detector = laser_preset("previous-model"), detector_preset("previous-model")

    changed = structs.replace(laser, preset="bela", pulse="tailed")
    assert changed == laser_preset("bela")
    assert structs.replace(detector, preset="bela", multiplication=None) == detector_preset("bela")
    assert structs.replace(
        load_scene("previous-model"), laser=laser_preset(), detector=detector_preset()
    ) == (Scene(filter="gaussian", surface=SurfaceTable(slope_deg=10.0)))


# ---- temperatures


def test_the_thermal_sets_change_the_digitized_pulse_by_2_mv_at_most() -> None:
    # Given the three over one plane; the published figure is for pulses with their peaks aligned
    def aligned(name: str) -> np.ndarray:
        chain, step_s = Chain(steady(name)), 0.25e-9
        curve = chain.curve(None, -150e-9, step_s, 2400)
        return curve[curve.argmax() - 400 : curve.argmax() + 800]

    ambient = aligned("ambient")
    changes_v = {name: np.abs(aligned(name) - ambient).max() for name in ("hot", "cold")}

    # Then hot and cold differ from ambient, by no more
    assert all(1e-4 < change_v <= 2e-3 for change_v in changes_v.values())


def test_the_thermal_sets_are_data_on_the_preset() -> None:
    usual = laser_preset("bela")
    for name, change in THERMAL.items():
        laser = load_scene(name).laser
        assert laser.fwhm_s == pytest.approx(usual.fwhm_s * change.fwhm)
        assert laser.tail_s == pytest.approx(usual.tail_s * change.tail)
        assert laser.divergence_rad == pytest.approx(usual.divergence_rad * change.divergence)
        # The number of photons is the same in all cases (paper, appendix A)
        assert link_budget(load_scene(name)).photons == link_budget(load_scene("ambient")).photons
    # Footprints of 42 to 60 urad and pulses of 3 to 8 ns are possible
    assert all(42e-6 <= usual.divergence_rad * one.divergence <= 60e-6 for one in THERMAL.values())
    assert all(3e-9 <= usual.fwhm_s * one.fwhm <= 8e-9 for one in THERMAL.values())


# ---- day and night


def test_noon_is_1_8_times_as_noisy_as_night() -> None:
    day, night = (Chain(load_scene(name)).noise_rms_v for name in ("day", "night"))

    assert night == pytest.approx(0.83e-3)
    assert f"{day / night:.1f}" == "1.8"


@pytest.mark.parametrize(
    "changed",
    [
        {"sun": {"incidence_deg": 60.0}},
        {"sun": {"distance_au": 0.3075}},
        {"surface": {"reflectance": 0.30}},
        {"sun": {"incidence_deg": 90.0}},
    ],
)
def test_the_ratio_of_day_to_night_follows_the_scene(changed: dict[str, dict[str, float]]) -> None:
    # Given sunlight whose power is proportional to cosine, reflectance and the square of nearness
    day = load_scene("day")
    other = with_(day, **changed)
    assert isinstance(day.sun, Sun)
    assert isinstance(other.sun, Sun)

    def power(scene: Scene, sun: Sun) -> float:
        return scene.surface.reflectance * math.cos(math.radians(sun.incidence_deg)) / sun.distance_au**2

    night_v = Chain(structs.replace(day, sun=None)).noise_rms_v
    usual_v = math.sqrt(Chain(day).noise_rms_v ** 2 - night_v**2)
    expected_v = math.hypot(night_v, usual_v * math.sqrt(power(other, other.sun) / power(day, day.sun)))

    assert Chain(other).noise_rms_v == pytest.approx(expected_v, rel=1e-9)


def test_the_measured_noise_of_day_and_night_has_that_ratio() -> None:
    def rms(name: str) -> float:
        # (The echo comes in the middle of the window.)
        chain = Chain(steady(name))
        return float(np.std([chain.samples(k, chain.whole_window(k)).volts[:7000] for k in range(10)]))

    day, night = (Chain(load_scene(name)).noise_rms_v for name in ("day", "night"))

    # 70 000 samples, of which filtered noise leaves about half independent: 0.4 % each
    assert rms("day") / rms("night") == pytest.approx(day / night, rel=0.02)


# ---- the three idealized surfaces (paper, appendix "Details of pulse shape")


@pytest.mark.parametrize("altitude_m", [700e3, 1000e3, 1400e3])
def test_the_boulder_is_narrower_than_the_plane_at_the_papers_slope(altitude_m: float) -> None:
    # Given a boulder as wide as the footprint, on the slope of 10 degrees that the paper has
    scale = altitude_m / 1000e3
    plane = structs.replace(steady("plane"), altitude_m=altitude_m)
    boulder = structs.replace(steady("boulder"), altitude_m=altitude_m)
    boulder = with_(boulder, surface={"diameter_m": 50.0 * scale, "height_m": 4.0 * scale})
    assert plane.surface.slope_deg == boulder.surface.slope_deg == 10.0

    narrow_s, wide_s = searched(boulder)[1], searched(plane)[1]

    # Then what the range finder reports is narrower: 2 % at 700 km, 9 % at 1000, 15 % at 1400 km
    assert narrow_s < {700e3: 0.99, 1000e3: 0.93, 1400e3: 0.88}[altitude_m] * wide_s
    # although the light is spread more, since the relief is not correlated with the slope
    spread_s = [Chain(one).lit().delays.std_s for one in (plane,)]  # type: ignore[union-attr]
    times_s = np.arange(-300e-9, 300e-9, 0.25e-9)
    rate = Chain(boulder).echo().photon_rate_hz(-300e-9, 0.25e-9, times_s.size)
    mean_s = np.average(times_s, weights=rate)
    pulse = Chain(boulder).light_kernel.pulse.std_s
    assert math.sqrt(np.average((times_s - mean_s) ** 2, weights=rate)) > math.hypot(*spread_s, pulse)


def test_near_the_ground_a_boulder_of_that_shape_is_no_narrower() -> None:
    # At 500 km the laser's pulse and the filter make most of the width, and the relief adds to it
    plane = structs.replace(steady("plane"), altitude_m=500e3)
    boulder = with_(
        structs.replace(steady("boulder"), altitude_m=500e3), surface={"diameter_m": 25.0, "height_m": 2.0}
    )

    assert 1.0 < searched(boulder)[1] / searched(plane)[1] < 1.05
    # but a wider one, 50 m and 4 m high, still is, by half a percent
    wider = with_(boulder, surface={"diameter_m": 50.0, "height_m": 4.0})
    assert 0.98 < searched(wider)[1] / searched(plane)[1] < 1.0


def test_a_crater_or_boulder_that_is_deep_shows_two_peaks() -> None:
    # Given light alone, over level ground as in the paper's crater
    for kind, key in (("crater", "depth_m"), ("boulder", "height_m")):
        surface = SurfaceTable(kind=kind, diameter_m=15.0, exponent=4.0, **{key: 4.0})
        if kind == "crater":
            surface = structs.replace(surface, rim_height_m=0.0)
        scene = structs.replace(steady("plane"), altitude_m=500e3, surface=surface)
        rate = Chain(scene).echo().photon_rate_hz(-100e-9, 0.25e-9, 800)
        peaks = np.flatnonzero(
            (rate[1:-1] > rate[:-2]) & (rate[1:-1] > rate[2:]) & (rate[1:-1] > rate.max() / 10)
        )
        assert peaks.size == 2
        # The boulder's light is 27 ns early, that of the floor 27 ns late
        arrivals_s = -100e-9 + 0.25e-9 * (peaks + 1)
        sign = 1 if kind == "crater" else -1
        far_s = sign * 2 * 4.0 / LIGHT_M_PER_S
        assert np.abs(arrivals_s - far_s).min() < 4e-9
        assert np.abs(arrivals_s).min() < 4e-9
