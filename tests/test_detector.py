"""From light to volts: gain, solid angle, field of view, and the link budget to its printed digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import response
from sim.detector import (
    Detector,
    amperes_per_photon_rate,
    excess_noise_factor,
    field_of_view_m2,
    gaussian_filter_sigma_s,
    in_field_of_view,
    miller_gain,
    multiplication,
    optical_transmission,
    solid_angle_sr,
    tia_poles,
    volts_per_photon_rate,
)
from sim.laser import PulsePiece, PulseShape, pulse_shape
from sim.link_budget import link_budget
from sim.presets import detector_preset
from sim.scene import Scene
from sim.scene_tables import SurfaceTable

EXPONENT = 0.103624

# ---- Miller's gain


def test_the_printed_gains_need_two_breakdown_voltages() -> None:
    # given the two pairs of bias and gain that the paper prints with one exponent
    # then one breakdown voltage gives the first and not the second, as the table of facts has it
    assert f"{multiplication(Detector()):.1f}" == "48.4"
    assert f"{multiplication(Detector(bias_v=370.0)):.1f}" == "171.9"
    assert f"{miller_gain(320.0, 403.14, EXPONENT):.1f}" == "42.3"
    assert f"{miller_gain(370.0, 403.14, EXPONENT):.0f}" == "113"
    # and the gain follows the temperature: 2.4 V more breakdown is 2.9 % less gain, as much less 3.1 % more
    assert multiplication(Detector(apd_temperature_c=21.0)) / 48.4 == pytest.approx(1 - 0.029, abs=5e-4)
    assert multiplication(Detector(apd_temperature_c=19.0)) / 48.4 == pytest.approx(1 + 0.031, abs=5e-4)


def test_a_given_gain_stands() -> None:
    assert multiplication(Detector(multiplication=60.5, bias_v=0.0)) == 60.5
    assert multiplication(detector_preset("previous-model")) == pytest.approx(1.25 * 48.4, rel=1e-15)


def test_responsivity_to_the_printed_digits() -> None:
    watts = 1.8669603920572636e-19  # of one photon a second

    assert f"{amperes_per_photon_rate(Detector(multiplication=1.0)) / watts:.4f}" == "0.2918"
    assert f"{amperes_per_photon_rate(Detector()) / watts:.2f}" == "14.12"
    assert volts_per_photon_rate(Detector()) == pytest.approx(45e3 * amperes_per_photon_rate(Detector()))
    assert f"{excess_noise_factor(Detector()):.2f}" == "3.20"


# ---- telescope


@pytest.mark.parametrize("altitude_m", [0.0, -1.0, math.inf, math.nan])
def test_no_solid_angle_without_an_altitude(altitude_m: float) -> None:
    with pytest.raises(RefusedInput, match="must be positive and finite"):
        solid_angle_sr(0.1, altitude_m)


def test_field_of_view() -> None:
    # given a detector that looks 100 urad towards +x
    detector = Detector(boresight_rad=(100e-6, 0.0))
    # then it sees a disc of 123.75 m radius round (50, 0) m from 500 km
    seen = in_field_of_view(detector, 500e3, np.array([-73.0, -74.0, 173.0, 174.0]), np.zeros(4))
    assert seen.tolist() == [True, False, True, False]
    assert field_of_view_m2(detector, 500e3) == pytest.approx(math.pi * 123.75**2, rel=1e-6)


def test_etendue_to_the_printed_digits() -> None:
    seen = [field_of_view_m2(Detector(), h) * solid_angle_sr(0.1, h) for h in (200e3, 1500e3)]

    assert f"{seen[0]:.3g}" == "6.05e-09"
    # H cancels but for (r / H)^2
    assert seen[0] == pytest.approx(seen[1], rel=1e-12)


def test_an_extra_pole_only_where_there_is_one() -> None:
    assert tia_poles(Detector()) == ()
    assert tia_poles(Detector(tia_pole_hz=20e6)) == (complex(-2 * math.pi * 20e6),)
    assert f"{gaussian_filter_sigma_s(20e6) * 1e9:.2f}" == "9.97"
    assert f"{gaussian_filter_sigma_s(20e6) * 1e9 * 2.354820045:.1f}" == "23.5"


# ---- link budget

SCENE = Scene(surface=SurfaceTable(slope_deg=10.0))


def test_the_integral_of_the_voltage_to_the_printed_digits() -> None:
    budget = link_budget(SCENE)

    millivolt_nanoseconds_per_femtojoule = budget.area_at_converter_v_s / budget.energy_j * 1e-3
    assert f"{millivolt_nanoseconds_per_femtojoule:.0f}" == "3298"
    assert f"{budget.transmitted_photons:.4g}" == "2.678e+17"
    assert f"{optical_transmission(Detector()):.3f}" == "0.714"


@pytest.mark.parametrize(
    ("altitude_km", "photons", "energy_fj", "electrons", "optical_ns", "filtered_ns", "peak_mv", "cut_mv"),
    [
        (400, "2032", "0.379", "691", "16.1", "26.4", "48.9", "14.0"),
        (500, "1300", "0.243", "442", "19.2", "28.0", "29.2", "7.5"),
        (800, "508", "0.0948", "173", "29.0", "34.2", "9.0", "1.95"),
        (1000, "325", "0.0607", "111", "35.7", "39.3", "5.0", "1.01"),
        (1100, "269", "0.0502", "91", "39.1", "42.0", "3.8", "0.77"),
        (1400, "166", "0.0310", "56", "49.3", "50.9", "1.9", "0.38"),
    ],
)
def test_link_budget_to_the_printed_digits(
    altitude_km: int,
    photons: str,
    energy_fj: str,
    electrons: str,
    optical_ns: str,
    filtered_ns: str,
    peak_mv: str,
    cut_mv: str,
) -> None:
    # given a plane of 10 degrees, reflectance 0.17, and the receiver's filter on a grid so fine that the
    # straight lines between its points err by less than 1e-5
    scene = replace(SCENE, altitude_m=altitude_km * 1e3)
    budget = link_budget(scene)
    spread_s = 2 * scene.altitude_m * math.tan(12.5e-6) * math.tan(math.radians(10)) / 299792458
    (piece,) = pulse_shape(scene.laser).pieces
    echo = PulseShape((PulsePiece(1.0, math.hypot(piece.sigma_s, spread_s), piece.tau_s),))
    times = np.arange(-150e-9, 350e-9, 0.05e-9)
    volts = budget.area_at_cut_v_s * echo.density(times)
    behind = scene.gain * response(volts, 20e9, times[0], "linear", butterworth.poles(19e6, 3), times)
    # then each column of the table comes out
    found = (
        budget.photons,
        budget.energy_j * 1e15,
        budget.primary_electrons,
        echo.fwhm_s * 1e9,
        PulseShape(times_s=times, relative=np.maximum(behind, 0.0)).fwhm_s * 1e9,
        behind.max() * 1e3,
        volts.max() * 1e3,
    )
    printed = (photons, energy_fj, electrons, optical_ns, filtered_ns, peak_mv, cut_mv)
    for number, digits in zip(found, printed, strict=True):
        last = 10.0 ** -len(digits.partition(".")[2])
        assert abs(number - float(digits)) <= last / 2 * 1.02, (found, printed)


def test_the_radiation_factor() -> None:
    def photons(**surface: object) -> float:
        return link_budget(replace(SCENE, surface=SurfaceTable(slope_deg=60.0, **surface))).photons  # type: ignore[arg-type]

    usual = photons()
    assert photons(photometry="lambert") == pytest.approx(usual / 2, rel=1e-12)
    assert photons(photometry="factor", radiation_factor=1.5) == pytest.approx(1.5 * usual, rel=1e-12)
    assert photons(photometry="factor", radiation_factor=1.0) == usual
    assert photons(reflectance=0.0) == 0
