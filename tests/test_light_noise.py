"""Noise of the light: sunlight to its printed digits, density within the band, and photons one by one."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from msgspec.structs import replace

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import autocovariance, response
from sim.constants import ELEMENTARY_CHARGE_C as Q
from sim.detector import Detector, multiplication
from sim.laser import Laser, PulsePiece, PulseShape, photon_energy_j, pulse_shape
from sim.light_noise import (
    background_density,
    dark_current_density,
    noise_rms_v,
    shot_noise_density,
    solar_power_w,
    white_step_rms_v,
)
from sim.link_budget import link_budget
from sim.scene import Scene
from sim.scene_tables import Sun, SurfaceTable

POLES = butterworth.poles(19e6, 3)
BAND_HZ = butterworth.noise_bandwidth(19e6, 3)
WATTS = photon_energy_j(1064e-9)

# ---- density


@pytest.mark.parametrize("rate_hz", [0.0, 1.0, 3.3e9, 6e10, 1e19])
def test_h14_shot_noise_in_double_and_single_precision(rate_hz: float) -> None:
    # given the square of the density with many digits
    detector = Detector(multiplication=48.4)
    with mpmath.workdps(40):
        square = 2 * mpmath.mpf(Q) ** 2 * mpmath.mpf(0.34) * mpmath.mpf(rate_hz)
        square *= mpmath.mpf(48.4) ** (2 + mpmath.mpf(0.3)) * mpmath.mpf(45e3) ** 2
        true = float(mpmath.sqrt(square))

    assert float(shot_noise_density(detector, rate_hz)) == pytest.approx(true, rel=1e-15)
    single = shot_noise_density(detector, np.array([rate_hz], np.float32))
    assert single.dtype == np.float32
    assert single[0] == pytest.approx(true, rel=1e-6)


def test_h14_the_variance_itself_is_zero_in_single_precision() -> None:
    charge = np.float32(Q)

    with np.errstate(under="ignore"):
        naive = charge * charge * np.float32(1e-8)  # A^2/Hz of a current of 1e-8 charges a second

    assert naive == 0


def test_h15_noise_of_a_rate_behind_the_filter_is_refused() -> None:
    # given a narrow pulse behind the filter, which swings below zero
    times = np.arange(-50e-9, 200e-9, 0.25e-9)
    rate = response(pulse_shape(Laser()).density(times), 4e9, times[0], "linear", POLES, times)
    assert rate.min() < -0.1 * rate.max()
    # then its shot noise is refused, while that of the light before the filter is there
    with pytest.raises(RefusedInput, match="take the rate before any filter"):
        shot_noise_density(Detector(), rate)
    with pytest.raises(RefusedInput, match="must not be negative"):
        shot_noise_density(Detector(), [math.nan])
    assert np.all(np.isfinite(shot_noise_density(Detector(), pulse_shape(Laser()).density(times))))


def test_no_light_and_no_dark_current_make_no_noise() -> None:
    assert shot_noise_density(Detector(), np.zeros(3)).tolist() == [0, 0, 0]
    assert dark_current_density(Detector()) == 0
    assert background_density(Scene()) == 0
    assert background_density(Scene(sun=Sun(irradiance_1au_w_per_m3=0.0))) == 0


def test_only_the_bulk_current_is_multiplied() -> None:
    surface = dark_current_density(Detector(surface_dark_a=50e-9))
    bulk = dark_current_density(Detector(bulk_dark_a=50e-9))

    assert surface == pytest.approx(45e3 * math.sqrt(2 * Q * 50e-9), rel=1e-12)
    assert bulk / surface == pytest.approx(48.4**1.15, rel=1e-9)
    # a bulk current is what light of that primary current is
    assert bulk == pytest.approx(float(shot_noise_density(Detector(), 50e-9 / Q / 0.34)), rel=1e-12)


# ---- sunlight

MEAN, PERIHELION = 0.3871, 0.3075


@pytest.mark.parametrize(
    ("distance_au", "power_nw", "primary_na", "multiplied_na", "noise_mv", "dark_mv"),
    [(MEAN, "2.03", "0.59", "28.6", "1.25", "0.83"), (PERIHELION, "3.21", "0.94", "45.4", "1.57", "1.05")],
)
def test_sunlight_to_the_printed_digits(
    distance_au: float, power_nw: str, primary_na: str, multiplied_na: str, noise_mv: str, dark_mv: str
) -> None:
    # given noon over the mean reflectance, the irradiance rounded as in the table, a band of 20 MHz
    detector, sun = Detector(), Sun(distance_au=distance_au, irradiance_1au_w_per_m3=0.65e9)
    scene = Scene(sun=sun)
    power_w = solar_power_w(detector, 500e3, sun, 0.17)
    primary_a = power_w / WATTS * 0.34 * Q
    noise_v = scene.gain * noise_rms_v(background_density(scene), 20e6)

    assert f"{power_w * 1e9:.2f}" == power_nw
    assert f"{primary_a * 1e9:.2f}" == primary_na
    assert f"{primary_a * multiplication(detector) * 1e9:.1f}" == multiplied_na
    # 1.2452 is printed as 1.25, and 1.5675 as 1.57: half a unit of the last digit
    assert abs(noise_v * 1e3 - float(noise_mv)) < 0.0051
    # the dark noise beside which noon is 1.8 times the night
    assert f"{noise_v / math.sqrt(1.8**2 - 1) * 1e3:.2f}" == dark_mv


def test_the_printed_formula_of_sunlight_lacks_pi() -> None:
    # given the paper's equation: F_0 cos(i) A_FOV Omega_R alpha sigma_rf, without 1/pi
    sun = Sun(irradiance_1au_w_per_m3=0.65e9)
    printed_w = 0.65e9 / MEAN**2 * 2e-9 * 0.17 * 0.84 * 0.85 * 6.0454e-9

    assert f"{printed_w * 1e9:.2f}" == "6.37"
    assert printed_w / solar_power_w(Detector(), 500e3, sun, 0.17) == pytest.approx(math.pi, rel=1e-4)


def test_sunlight_by_altitude_incidence_and_distance() -> None:
    def power(altitude_m: float = 500e3, reflectance: float = 0.17, **sun: float) -> float:
        return solar_power_w(Detector(), altitude_m, Sun(**sun), reflectance)

    usual = power()
    assert power(200e3) == pytest.approx(usual, rel=1e-12)
    assert power(1500e3) == pytest.approx(usual, rel=1e-12)
    assert power(incidence_deg=60.0) == pytest.approx(usual / 2, rel=1e-12)
    assert power(distance_au=2 * 0.3871) == pytest.approx(usual / 4, rel=1e-12)
    assert power(reflectance=0.34) == pytest.approx(2 * usual, rel=1e-12)


def test_day_and_night_follow_the_scene() -> None:
    # given the noise of the night that was derived from noon being 1.8 times as loud at 20 MHz and 0.65
    night_v = 0.83e-3
    day = Scene(sun=Sun(irradiance_1au_w_per_m3=0.65e9))
    noon_v = math.hypot(night_v, day.gain * noise_rms_v(background_density(day), 20e6))
    evening = Scene(sun=Sun(incidence_deg=80.0))

    assert f"{noon_v / night_v:.1f}" == "1.8"
    assert background_density(evening) < background_density(day) / 2
    dark = Scene(detector=Detector(bulk_dark_a=1e-9), sun=day.sun)
    parts = background_density(day), dark_current_density(dark.detector)
    assert background_density(dark) == pytest.approx(math.hypot(*parts), rel=1e-12)


# ---- within the band


@pytest.mark.parametrize("step_s", [0.5e-9, 1e-9, 2e-9])
def test_draws_before_the_filter_have_the_right_density_at_any_step(step_s: float) -> None:
    # given independent draws of a constant light before the filter, h its response to an impulse
    times = np.arange(0, 600e-9, step_s)
    weight = impulse_response(times) * step_s
    density = float(shot_noise_density(Detector(), 1e10))
    drawn_v = float(white_step_rms_v(np.array(density), step_s))
    # when they have passed the filter
    behind_v = drawn_v * math.sqrt(float(weight @ weight))
    # then their rms is density times root of bandwidth, but for the error of the sum over h^2: its first term
    # (Euler and Maclaurin) is step^6 / 30240 times the fifth derivative at 0, which is 40 omega_c^7
    excess = 40 * (2 * math.pi * 19e6) ** 7 * step_s**6 / 30240 / (2 * BAND_HZ)
    assert behind_v / noise_rms_v(density, BAND_HZ) - 1 == pytest.approx(excess / 2, rel=0.05, abs=1e-9)


def test_noise_of_full_bandwidth_at_a_fine_step_counts_the_band_twice() -> None:
    # given the printed recipe: variance S B_0 at each step of 1 ns, then the filter
    weight = impulse_response(np.arange(0, 600e-9, 1e-9)) * 1e-9

    naive = math.sqrt(20e6 * float(weight @ weight)) / math.sqrt(BAND_HZ)

    # then a factor sqrt(2 ENBW dt) is lost
    assert f"{naive:.2f}" == "0.20"


def test_the_printed_formula_has_the_unit_of_a_voltage_times_root_coulomb() -> None:
    # given the printed noise with the multiplied current I in place of the photon rate
    detector, rate_hz = Detector(), 1e10
    current_a = Q * 0.34 * 48.4 * rate_hz
    printed = math.sqrt(2 * Q**2 * 0.34 * current_a * 48.4**2.3) * 45e3

    assert f"{printed / float(shot_noise_density(detector, rate_hz)):.1e}" == "1.6e-09"


def impulse_response(times_s: np.ndarray) -> np.ndarray:
    """Response of the receiver's filter to an impulse of unit area, 1/s."""
    sharp = np.array([1.0, 1.0])
    start = response(sharp, 1e15, 0.0, "hold", POLES, times_s)
    return start / 2e-15


def shot_noise_at(times_s: np.ndarray, scene: Scene) -> np.ndarray:
    """Rms of the shot noise at the converter, V, in closed form per instant by a fine sum."""
    fine_s = 0.25e-9
    at = np.arange(-120e-9, 250e-9, fine_s)
    rate = link_budget(scene).photons * plane_echo(scene).density(at)
    drawn = white_step_rms_v(shot_noise_density(scene.detector, rate), fine_s)
    weights = impulse_response((times_s[:, None] - at).ravel()).reshape(times_s.size, at.size) * fine_s
    return scene.gain * np.sqrt((weights**2) @ (drawn**2))


def plane_echo(scene: Scene) -> PulseShape:
    slope = math.tan(math.radians(scene.surface.slope_deg))
    spread_s = 2 * scene.altitude_m * math.tan(12.5e-6) * slope / 299792458
    (piece,) = pulse_shape(scene.laser).pieces
    return PulseShape((PulsePiece(1.0, math.hypot(piece.sigma_s, spread_s), piece.tau_s),))


@pytest.mark.parametrize(("altitude_m", "noise_mv"), [(500e3, 2.7), (800e3, 1.4)])
def test_shot_noise_of_an_echo_is_above_the_dark_noise(altitude_m: float, noise_mv: float) -> None:
    scene = Scene(altitude_m=altitude_m, surface=SurfaceTable(slope_deg=10.0))
    at = np.arange(0, 60e-9, 1e-9)
    echo = plane_echo(scene)
    times = np.arange(-120e-9, 250e-9, 0.25e-9)
    filtered = response(echo.density(times), 4e9, times[0], "linear", POLES, at)

    at_the_peak = shot_noise_at(at, scene)[int(filtered.argmax())]

    # known as "about" 2.7 and 1.4 mV: to one unit of the last digit
    assert at_the_peak * 1e3 == pytest.approx(noise_mv, abs=0.1)


def test_photons_one_by_one_have_that_mean_and_that_variance() -> None:
    # given a weak echo: a Poisson number of photoelectrons, each with an avalanche of its own (a gamma
    # distribution of mean M and second moment M^2 F), seen through the filter at one instant
    scene = Scene(altitude_m=1400e3, surface=SurfaceTable(slope_deg=10.0))
    budget, detector, instant_s = link_budget(scene), scene.detector, 20e-9
    gain, factor = multiplication(detector), multiplication(detector) ** 0.3
    rng = np.random.default_rng(20250101)
    shots = 20_000
    electrons = rng.poisson(budget.primary_electrons, shots)
    (piece,) = plane_echo(scene).pieces
    count = int(electrons.sum())
    arrivals = rng.normal(0, piece.sigma_s, count) + rng.exponential(piece.tau_s, count)
    avalanches = rng.gamma(1 / (factor - 1), gain * (factor - 1), count)
    table_s = np.arange(-1e-9, 500e-9, 0.1e-9)
    seen = np.interp(instant_s - arrivals, table_s, impulse_response(table_s), left=0.0, right=0.0)
    owner = np.repeat(np.arange(shots), electrons)
    volts = scene.gain * 45e3 * Q * np.bincount(owner, avalanches * seen, shots)
    # then mean and variance are those of the model, within four standard errors
    times = np.arange(-200e-9, 300e-9, 0.25e-9)
    mean = response(plane_echo(scene).density(times), 4e9, times[0], "linear", POLES, np.array([instant_s]))
    expected = budget.area_at_converter_v_s * mean[0]
    rms = shot_noise_at(np.array([instant_s]), scene)[0]
    centred = volts - volts.mean()
    kurtosis = np.mean(centred**4) / np.mean(centred**2) ** 2
    assert volts.mean() == pytest.approx(expected, abs=4 * rms / math.sqrt(shots))
    assert volts.std() / rms == pytest.approx(1, abs=4 * math.sqrt((kurtosis - 1) / shots) / 2)


def test_stationary_noise_behind_the_filter_has_the_bandwidth_of_the_receiver() -> None:
    assert autocovariance(POLES, 0.0) == pytest.approx(BAND_HZ, rel=1e-12)
    assert noise_rms_v(2.0, BAND_HZ) ** 2 == pytest.approx(4 * BAND_HZ, rel=1e-12)
    assert replace(Detector(), tia_pole_hz=0.0) == Detector()
