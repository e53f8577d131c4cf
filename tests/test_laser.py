"""The laser: photons, shape in time against many digits, shape across, and what changes from shot to shot."""

from __future__ import annotations

import math
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from belahil.errors import ConfigError, RefusedInput
from belahil.pole_response import response
from sim.draws import Draws
from sim.laser import (
    BeamImage,
    Laser,
    PulsePiece,
    PulseShape,
    beam_sigma_m,
    beam_weights,
    energy_factor,
    photon_energy_j,
    photon_number,
    pointing_jitter,
    pulse_shape,
)
from sim.presets import laser_preset

# ---- photons


def test_photons_of_a_pulse_to_the_printed_digits() -> None:
    # then N_0, the energy of a photon and the photons of a femtojoule are those of the table of facts
    assert f"{photon_number(Laser()):.4g}" == "2.678e+17"
    assert f"{photon_energy_j(1064e-9):.6g}" == "1.86696e-19"
    assert round(1e-15 / photon_energy_j(1064e-9)) == 5356


# ---- shape in time


def test_the_default_pulse_is_seven_nanoseconds_wide() -> None:
    shape = pulse_shape(Laser())

    assert f"{shape.fwhm_s * 1e9:.1f}" == "7.1"
    assert shape.mean_s == 3.0e-9
    assert shape.std_s == pytest.approx(math.hypot(5.4e-9 / 2.354820045, 3e-9), rel=1e-9)


def test_a_tail_of_zero_is_a_gaussian_bit_for_bit() -> None:
    times = np.linspace(-20e-9, 30e-9, 101)
    neutral = pulse_shape(Laser(tail_s=0.0))
    absent = pulse_shape(Laser(pulse="gaussian"))

    assert neutral == absent
    assert np.array_equal(neutral.density(times), absent.density(times))


@given(
    st.floats(-9, 0).map(lambda power: 10.0**power),
    st.floats(-4, 4).map(lambda power: 10.0**power),
)
def test_half_maximum_is_where_the_width_says(sigma: float, ratio: float) -> None:
    # given a tailed pulse of any size
    shape = PulseShape((PulsePiece(1.0, sigma, ratio * sigma),))
    # then its maximum is at least twice the density just outside of a span of that width, wherever it lies
    reach = 8 * sigma * (1 + ratio)
    starts = np.linspace(-8 * sigma, reach, 4001)
    peak = shape.density(starts).max()
    # The grid is up to 0.02 sigma, or 0.2 % of the tail, coarse; half way up the slope is below 1 / sigma.
    both = np.minimum(shape.density(starts), shape.density(starts + shape.fwhm_s))
    assert both.max() == pytest.approx(peak / 2, rel=0.02)


def test_the_width_of_a_gaussian_is_the_one_it_was_given() -> None:
    assert pulse_shape(Laser(pulse="gaussian")).fwhm_s == pytest.approx(5.4e-9, rel=1e-12)


def test_the_width_of_two_pulses_spans_both() -> None:
    apart = PulseShape((PulsePiece(0.5, 1e-9), PulsePiece(0.5, 1e-9, offset_s=20e-9)))

    assert apart.fwhm_s == pytest.approx(20e-9 + 2.354820045e-9, rel=1e-9)
    assert apart.mean_s == pytest.approx(10e-9, rel=1e-12)
    assert apart.std_s == pytest.approx(math.hypot(10e-9, 1e-9), rel=1e-12)


TABLE = PulseShape(times_s=np.array([-2e-9, 0, 1e-9, 6e-9]), relative=np.array([0.0, 5.0, 4.0, 1.0]))


def test_a_table_has_unit_area_and_jumps_where_it_ends() -> None:
    # given a table that begins at zero and ends above it; its area is 5 + 4.5 + 12.5
    assert TABLE.density(-2e-9 / 2) == pytest.approx(2.5 / 22e-9, rel=1e-14)
    assert TABLE.density(6e-9) == pytest.approx(1 / 22e-9, rel=1e-14)
    assert TABLE.density(6.001e-9) == 0
    # half of the maximum is crossed on the way up at -1 ns and on the way down at 3.5 ns
    assert TABLE.fwhm_s == pytest.approx(4.5e-9, rel=1e-12)


def test_moments_of_a_table() -> None:
    # given Simpson's rule, which is exact here: density times t^2 is a cubic between break points
    def moment(power: int) -> float:
        total = 0.0
        for left, right in zip(TABLE.times_s, TABLE.times_s[1:], strict=False):
            at = np.array([left, (left + right) / 2, right])
            total += (right - left) / 6 * float(TABLE.density(at) * at**power @ [1, 4, 1])
        return total

    assert moment(0) == pytest.approx(1, rel=1e-14)
    assert TABLE.mean_s == pytest.approx(moment(1), rel=1e-13)
    assert TABLE.std_s == pytest.approx(math.sqrt(moment(2) - moment(1) ** 2), rel=1e-12)


S_PLANE = (0.0, 1e-3, 1e5, 2e7 + 3e7j, -1.2e8 + 1e8j, -9e7j, 3e8, 1e9 - 2e9j)


@pytest.mark.parametrize("s", S_PLANE)
def test_the_transform_of_a_table(s: complex) -> None:
    with mpmath.workdps(50):
        true = mpmath.mpc(0)
        for k in range(3):
            left, right = map(mpmath.mpf, TABLE.times_s[k : k + 2].tolist())
            low, high = map(mpmath.mpf, TABLE.relative[k : k + 2].tolist())
            rise = (high - low) / (right - left)
            true += mpmath.quad(
                lambda t, low=low, rise=rise, left=left: (
                    (low + rise * (t - left)) * mpmath.exp(-mpmath.mpc(s) * t)
                ),
                mpmath.linspace(left, right, 9),
            )

    assert abs(complex(TABLE.transform(s)) - complex(true)) < 1e-13 * max(1.0, abs(complex(true)))


@pytest.mark.parametrize("s", [s for s in S_PLANE if abs(s) < 2e8])
def test_the_transform_of_a_tailed_pulse(s: complex) -> None:
    shape = pulse_shape(Laser())
    step = 0.02e-9
    times = np.arange(-40e-9, 140e-9, step)
    # The trapezoid rule is exact to rounding for a smooth pulse; the tail has ended at 140 ns.
    true = complex(np.sum(shape.density(times) * np.exp(-s * times)) * step)

    assert complex(shape.transform(s)) == pytest.approx(true, rel=1e-11)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: PulseShape(), "needs pieces, or else a table"),
        (lambda: PulseShape((PulsePiece(1.0, 0.0),)), "sigma_s must be positive"),
        (lambda: PulseShape((PulsePiece(0.5, 1e-9),)), "must be 1"),
        (lambda: PulseShape(times_s=np.array([0, 0.0]), relative=np.ones(2)), "must be finite and rise"),
        (lambda: PulseShape(times_s=np.arange(2.0), relative=np.zeros(2)), "somewhere positive"),
        (lambda: PulseShape(times_s=np.arange(2.0), relative=np.array([1, -1.0])), "not negative"),
        (lambda: PulseShape(times_s=np.arange(2.0), relative=np.ones(3)), "two equal rows"),
    ],
)
def test_a_shape_that_cannot_be(made, said: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(RefusedInput, match=said):
        made()


def test_a_table_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "pulse.csv"
    path.write_text("time_s, power\n# measured\n-2e-9, 0\n0, 5\n1e-9, 4\n6e-9, 1\n")

    assert pulse_shape(Laser(pulse="table", table=str(path))) == TABLE


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3\n", "has 3 columns"),
        ("0 1\n1 x\n", "not a table of numbers"),
        ("0 1\n", "at least two"),
        ("0 1\nnan 1\n", "must be finite"),
    ],
)
def test_a_bad_table_is_told_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "pulse.txt"
    path.write_text(text)

    with pytest.raises(ConfigError, match=said) as caught:
        pulse_shape(Laser(pulse="table", table=str(path)))
    assert f"[laser] table = {path}" in str(caught.value)


# ---- shape across


def test_a_quarter_of_the_divergence_is_one_sigma() -> None:
    laser = Laser()

    # 50 urad at 1/e^2 make 6.25 m at 500 km, and 20 m of diameter at 400 km
    assert beam_sigma_m(laser, 500e3)[0] == pytest.approx(6.25, rel=1e-9)
    assert 4 * beam_sigma_m(laser, 400e3)[0] == pytest.approx(20.0, rel=1e-9)
    edge = beam_weights(laser, 500e3, np.array([0.0, 12.5]), np.zeros(2))
    assert edge == pytest.approx([1.0, math.exp(-2)], rel=1e-9)


def test_pointing_displaces_the_beam() -> None:
    laser = Laser(pointing_rad=(20e-6, -10e-6))
    x, y = np.meshgrid(np.arange(-40.0, 60.0), np.arange(-60.0, 40.0))

    weights = beam_weights(laser, 500e3, x, y)

    assert (weights * x).sum() / weights.sum() == pytest.approx(10.0, abs=1e-6)
    assert (weights * y).sum() / weights.sum() == pytest.approx(-5.0, abs=1e-6)


def test_an_ellipse_keeps_its_area_and_its_direction() -> None:
    laser = Laser(beam="elliptical", ellipticity=0.4, beam_azimuth_deg=30.0)
    x, y = np.meshgrid(np.arange(-50.0, 50.0, 0.5), np.arange(-50.0, 50.0, 0.5))

    weights = beam_weights(laser, 500e3, x, y)
    weights /= weights.sum()
    spread = np.array([[(weights * x * x).sum(), (weights * x * y).sum()], [0, (weights * y * y).sum()]])
    spread[1, 0] = spread[0, 1]
    sizes, axes = np.linalg.eigh(spread)

    minor, major = np.sqrt(sizes)
    assert beam_sigma_m(laser, 500e3) == pytest.approx((major, minor), rel=1e-6)
    assert minor / major == pytest.approx(0.6, rel=1e-6)
    assert minor * major == pytest.approx(6.25**2, rel=1e-6)
    assert math.degrees(math.atan(axes[1, 1] / axes[0, 1])) == pytest.approx(30.0, abs=1e-3)


def test_an_ellipse_without_ellipticity_is_round() -> None:
    x, y = np.meshgrid(np.arange(-20.0, 20.0), np.arange(-20.0, 20.0))
    neutral = beam_weights(Laser(beam="elliptical", ellipticity=0.0), 500e3, x, y)

    assert np.array_equal(neutral, beam_weights(Laser(), 500e3, x, y))


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A Gaussian of 12.5 urad with a weak side lobe above it and to the right, 1 urad a pixel."""
    along, across = np.meshgrid(np.arange(-60.0, 61.0), np.arange(60.0, -61.0, -1.0))
    main = np.exp(-0.5 * (along**2 + across**2) / 12.5**2)
    lobe = 0.2 * np.exp(-0.5 * ((along - 30) ** 2 + (across - 20) ** 2) / 5**2)
    path = tmp_path / "beam.npy"
    np.save(path, main + lobe)
    return path


def test_an_image_lies_with_its_top_towards_plus_y_and_its_centroid_on_the_axis(picture: Path) -> None:
    laser = Laser(beam="image", image=str(picture), image_pixel_rad=1e-6)
    x, y = np.meshgrid(np.arange(-40.0, 40.0, 0.5), np.arange(-40.0, 40.0, 0.5))

    weights = beam_weights(laser, 500e3, x, y)
    total = weights.sum()

    assert (weights * x).sum() / total == pytest.approx(0, abs=1e-2)
    assert (weights * y).sum() / total == pytest.approx(0, abs=1e-2)
    # the lobe is 15 m and 10 m from the main beam, up and right; the centroid is between them
    main, lobe = np.array([[0, 0], [30, 20]]) * 0.5
    share = 0.2 * 25 / (12.5**2 + 0.2 * 25)
    at = lobe - share * (lobe - main)
    seen = beam_weights(laser, 500e3, np.array([at[0], -at[0]]), np.array([at[1], -at[1]]))
    assert seen[0] > 3 * seen[1]


def test_an_image_of_a_gaussian_is_that_gaussian(tmp_path: Path) -> None:
    along, across = np.meshgrid(np.arange(-70.0, 71.0), np.arange(-70.0, 71.0))
    np.save(tmp_path / "beam.npy", np.exp(-0.5 * (along**2 + across**2) / 12.5**2))
    laser = Laser(beam="image", image=str(tmp_path / "beam.npy"), image_pixel_rad=1e-6)
    x, y = np.meshgrid(np.arange(-15.0, 15.0), np.arange(-15.0, 15.0))

    weights = beam_weights(laser, 500e3, x, y)

    # between pixels the straight line errs by up to h^2 / 8 of the second derivative: 1 / (8 12.5^2) an axis
    assert np.abs(weights - beam_weights(Laser(), 500e3, x, y)).max() < 2 / (8 * 12.5**2)
    assert beam_sigma_m(laser, 500e3) == pytest.approx((6.25, 6.25), rel=1e-5)
    assert beam_weights(laser, 500e3, np.array([36.0]), np.array([0.0])) == 0


@pytest.mark.parametrize(
    ("name", "pixels", "said"),
    [
        ("a.npy", np.zeros((4, 4)), "somewhere positive"),
        ("a.npy", np.ones((4, 4, 3)), "one grey picture"),
        ("a.npy", np.full((4, 4), np.nan), "finite"),
        ("a.tif", np.ones((4, 4)), "allowed: .npy, .png, .csv, .txt"),
    ],
)
def test_a_bad_image_is_told_in_one_line(tmp_path: Path, name: str, pixels: np.ndarray, said: str) -> None:
    path = tmp_path / name
    with path.open("wb") as file:
        np.save(file, pixels)

    with pytest.raises(ConfigError, match=said) as caught:
        beam_sigma_m(Laser(beam="image", image=str(path)), 500e3)
    assert f"[laser] image = {path}" in str(caught.value)


def test_an_image_in_text_or_png_is_the_same_image(tmp_path: Path) -> None:
    from matplotlib.image import imsave

    pixels = np.arange(12.0).reshape(3, 4)
    np.savetxt(tmp_path / "a.csv", pixels, delimiter=",")
    np.savetxt(tmp_path / "a.txt", pixels)
    grey = np.repeat((pixels / 11)[..., None], 3, axis=2)
    imsave(tmp_path / "colour.png", grey)
    sizes = BeamImage(pixels, 1e-6).sigma_rad

    for name in ("a.csv", "a.txt"):
        laser = Laser(beam="image", image=str(tmp_path / name))
        assert beam_sigma_m(laser, 1.0) == pytest.approx(sizes, rel=1e-12)
    with pytest.raises(ConfigError, match="one grey picture"):
        beam_sigma_m(Laser(beam="image", image=str(tmp_path / "colour.png")), 1.0)


# ---- from shot to shot


def test_jitter_belongs_to_the_shot_and_has_the_size_it_says() -> None:
    laser = Laser(jitter_rad=(1e-6, 3e-6), energy_jitter=0.014)
    shots = [Draws(7, shot) for shot in range(1000)]

    pointing = np.array([pointing_jitter(laser, draws) for draws in shots])
    energy = np.array([energy_factor(laser, draws) for draws in shots])

    assert pointing_jitter(laser, Draws(7, 500)) == tuple(pointing[500])
    # standard error of a standard deviation: 1 / sqrt(2 N) = 2.2 %; four of them
    assert pointing.std(axis=0) == pytest.approx([1e-6, 3e-6], rel=0.09)
    assert energy.std() == pytest.approx(0.014, rel=0.09)
    assert energy.mean() == pytest.approx(1, abs=4 * 0.014 / math.sqrt(1000))


def test_no_jitter_is_exactly_none() -> None:
    still = Laser(jitter_rad=(0.0, 0.0), energy_jitter=0.0)

    assert pointing_jitter(still, Draws(1, 0)) == (0.0, 0.0)
    assert energy_factor(still, Draws(1, 0)) == 1.0


# ---- thermal sets

PER_PHOTON_RATE_V_S = 1.602176634e-19 * 0.34 * 48.4 * 45e3 * 5.19


def digitized(laser: Laser) -> np.ndarray:
    """Echo of a plane of 10 degrees at 500 km at the converter, V, on a fine grid."""
    from belahil import butterworth

    slope_s = 2 * beam_sigma_m(laser, 500e3)[0] * math.tan(math.radians(10)) / 299792458
    (piece,) = pulse_shape(laser).pieces
    echo = PulseShape((PulsePiece(1.0, math.hypot(piece.sigma_s, slope_s), piece.tau_s),))
    times = np.arange(-100e-9, 300e-9, 0.1e-9)
    volts = 1300.3 * PER_PHOTON_RATE_V_S * echo.density(times)
    return response(volts, 1e10, times[0], "linear", butterworth.poles(19e6, 3), times)


@pytest.mark.parametrize("thermal", ["cold", "hot"])
def test_a_thermal_set_moves_the_beam_but_hardly_the_digitized_shape(thermal: str) -> None:
    # given the ambient set, whose factors are all 1
    ambient, changed = laser_preset("bela", "ambient"), laser_preset("bela", thermal)  # type: ignore[arg-type]
    assert ambient == Laser()
    # when pulses are aligned by their peaks, as in the paper's appendix A
    usual, other = digitized(ambient), digitized(changed)
    other = np.roll(other, int(usual.argmax()) - int(other.argmax()))
    # then they differ, by 2 mV at most
    assert 0.1e-3 < np.abs(usual - other).max() < 2e-3
    assert changed.pointing_rad[0] != 0
    assert photon_number(changed) == photon_number(ambient)


def test_what_a_file_says_stands_at_any_temperature() -> None:
    assert laser_preset("bela", "hot", fwhm_s=4e-9).fwhm_s == 4e-9
    assert laser_preset("bela", "hot", fwhm_s=4e-9).tail_s == replace(Laser(), tail_s=3e-9 * 1.15).tail_s
