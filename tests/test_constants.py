"""Constants of instrument and planet to their printed digits, from public functions alone.

What stands in `test_detector.py` (link budget by altitude, mV ns per fJ) and the exponent of
fractals in `test_terrain_fractal.py` is not repeated here.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import brentq, minimize_scalar

from belahil import butterworth
from belahil.pole_response import frequency_response
from belahil.pulse_fit import CURVATURE
from belahil.receiver import BELA_GRM
from sim.chain import Chain
from sim.detector import gaussian_filter_sigma_s
from sim.kernel import Kernel
from sim.laser import beam_sigma_m, photon_energy_j, photon_number
from sim.light_noise import background_density, noise_rms_v, solar_power_w
from sim.link_budget import link_budget
from sim.presets import laser_preset
from sim.pulse_shape import PulsePiece, PulseShape
from sim.scene import Scene
from sim.scene_tables import Sun, SurfaceTable

LIGHT_M_PER_S = 299792458.0
SCENE = Scene(altitude_m=500e3, surface=SurfaceTable(slope_deg=10.0))
CUTOFF_HZ = SCENE.truth.cutoff_hz
POLES = butterworth.poles(CUTOFF_HZ, SCENE.truth.order)


def impulse(narrow_s: float = 1e-13) -> Kernel:
    """As good as the impulse response: its Gaussian changes what is printed by 1e-10."""
    return Kernel(PulseShape((PulsePiece(1.0, narrow_s),)), POLES)


# ---- photons


def test_photons_to_the_printed_digits() -> None:
    assert f"{photon_energy_j(1064e-9):.5e}" == "1.86696e-19"
    assert f"{photon_number(laser_preset('bela')):.3e}" == "2.678e+17"
    assert f"{1e-15 / photon_energy_j(1064e-9):.0f}" == "5356"
    assert f"{link_budget(SCENE).photons:.0f}" == "1300"


def test_the_chain_has_the_photons_of_the_budget() -> None:
    laser = replace(SCENE.laser, jitter_rad=(0.0, 0.0), energy_jitter=0.0)

    assert f"{Chain(replace(SCENE, laser=laser)).echo().photons:.0f}" == "1300"


# ---- the receiver's filter


def test_the_delay_of_the_filter_is_16_753_ns() -> None:
    delay_s = float(butterworth.group_delay(0.0, CUTOFF_HZ, 3))

    assert f"{1e9 * delay_s:.3f}" == "16.753"
    assert delay_s == pytest.approx(2 / (2 * math.pi * CUTOFF_HZ), rel=1e-14)
    printed = {0: "16.75", 1: "16.78", 10: "19.94", 19: "20.94"}
    for mhz, text in printed.items():
        assert f"{1e9 * float(butterworth.group_delay(mhz * 1e6, CUTOFF_HZ, 3)):.2f}" == text


def test_the_noise_bandwidth_is_19_897_mhz() -> None:
    assert f"{1e-6 * butterworth.noise_bandwidth(CUTOFF_HZ, 3):.3f}" == "19.897"


@pytest.mark.parametrize(("mhz", "printed"), [(10, "0.09"), (19, "3.01"), (40, "19.4"), (61, "30.4")])
def test_attenuation(mhz: float, printed: str) -> None:
    (value,) = frequency_response(POLES, [mhz * 1e6])

    digits = len(printed.partition(".")[2])
    assert f"{-20 * math.log10(abs(value)):.{digits}f}" == printed


def test_the_impulse_response_to_the_printed_digits() -> None:
    kernel = impulse()

    def at(ns: float) -> float:
        return float(kernel.exact(1e-9 * ns))

    top = minimize_scalar(lambda ns: -at(ns), bounds=(10, 25), method="bounded", options={"xatol": 1e-8})
    bottom = minimize_scalar(at, bounds=(40, 60), method="bounded", options={"xatol": 1e-8})
    peak = at(top.x)
    before, after = (brentq(lambda ns: at(ns) - peak / 2, *pair) for pair in ((1, top.x), (top.x, 40)))

    assert f"{top.x:.1f}" == "17.2"
    assert f"{after - before:.2f}" == "22.55"
    assert f"{100 * at(bottom.x) / peak:.2f}" == "-11.46"
    assert f"{bottom.x:.0f}" == "51"


@pytest.mark.parametrize(
    ("fwhm_ns", "peak_delay_ns", "ratio", "undershoot"),
    [
        (3, "17.25", "0.153", "-11.4"),
        (5, "17.35", "0.251", "-11.3"),
        (10, "17.75", "0.472", "-10.9"),
        (20, "18.50", "0.766", "-8.9"),
        (40, "18.45", "0.959", "-2.2"),
        (60, "17.80", "0.992", "0"),
        (100, "17.15", "1.000", "0"),
    ],
)
def test_gaussians_behind_the_filter(fwhm_ns: float, peak_delay_ns: str, ratio: str, undershoot: str) -> None:
    sigma_s = 1e-9 * fwhm_ns / math.sqrt(CURVATURE)
    kernel = Kernel(PulseShape((PulsePiece(1.0, sigma_s),)), POLES)
    times_ns = np.arange(-200, 400, 0.01)

    volts = math.sqrt(2 * math.pi) * sigma_s * kernel.exact(1e-9 * times_ns)

    # The delays were printed from a grid of 0.05 ns
    assert times_ns[volts.argmax()] == pytest.approx(float(peak_delay_ns), abs=0.05)
    assert f"{volts.max():.3f}" == ratio
    digits = len(undershoot.partition(".")[2])
    lowest = 100 * volts.min() / volts.max()
    assert abs(lowest - float(undershoot)) <= 0.5 * 10.0**-digits * 1.02


def test_the_former_models_filter_is_the_gaussian_of_20_mhz() -> None:
    assert f"{1e9 * gaussian_filter_sigma_s(20e6):.2f}" == "9.97"
    assert gaussian_filter_sigma_s(20e6) == pytest.approx(1 / (2 * math.sqrt(2 * math.pi) * 20e6), rel=1e-15)


# ---- the ground


def test_the_slope_widens_the_echo_by_7_35_ns() -> None:
    sigma_m, _ = beam_sigma_m(SCENE.laser, SCENE.altitude_m)
    assert f"{sigma_m:.2f}" == "6.25"
    slope_s = 2 * sigma_m * math.tan(math.radians(10)) / LIGHT_M_PER_S
    assert f"{1e9 * slope_s:.2f}" == "7.35"
    # and so does the chain, whose delays have that spread but for the curve of the wavefront
    lit = Chain(SCENE).lit()
    assert lit.delays.std_s == pytest.approx(slope_s, rel=1e-4)  # type: ignore[union-attr]


def test_the_area_of_a_gaussian() -> None:
    factor = math.sqrt(math.pi) / (2 * math.sqrt(math.log(2)))

    assert f"{factor:.5f}" == "1.06447"
    pulse = PulseShape((PulsePiece(1.0, 1 / math.sqrt(CURVATURE)),))
    assert 1 / float(pulse.density(0.0)) == pytest.approx(factor, rel=1e-12)


# ---- window and chance


def test_the_range_window_is_30_099_km() -> None:
    window_s = BELA_GRM.digitizer.max_sample_count * BELA_GRM.digitizer.sample_interval_s

    assert f"{1e6 * window_s:.1f}" == "200.8"
    assert f"{window_s * LIGHT_M_PER_S / 2e3:.3f}" == "30.099"
    # 4 candidates within 10 m on either side, by chance
    chance = BELA_GRM.candidate_count * 20 / (window_s * LIGHT_M_PER_S / 2)
    assert f"{100 * chance:.2f}" == "0.27"


# ---- sunlight


@pytest.mark.parametrize(
    ("distance_au", "power_nw", "noise_mv"), [(0.3871, "2.03", "1.25"), (0.3075, "3.21", "1.57")]
)
def test_sunlight_to_the_printed_digits(distance_au: float, power_nw: str, noise_mv: str) -> None:
    # Given the irradiance that the table rounds to
    sun = Sun(distance_au=distance_au, irradiance_1au_w_per_m3=0.65e9)
    scene = replace(SCENE, sun=sun)

    powers = [solar_power_w(scene.detector, h, sun, 0.17) for h in (200e3, 500e3, 1400e3)]
    density = background_density(scene)
    # (the table has the printed bandwidth of 20 MHz)
    rms_v = scene.gain * noise_rms_v(density, scene.detector.tia_bandwidth_hz)

    assert f"{1e9 * powers[1]:.2f}" == power_nw
    assert powers[0] == pytest.approx(powers[2], rel=1e-9)
    assert f"{1e3 * rms_v:.2f}" == noise_mv
    if distance_au == 0.3871:
        # The dark noise that makes the day 1.8 times as noisy as the night
        assert f"{1e3 * rms_v / math.sqrt(1.8**2 - 1):.2f}" == "0.83"
