"""The pulse before the fibre, and a receiver's response to it above any threshold, beside slow forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil import butterworth
from belahil.config import EmulatedTransmitter
from belahil.errors import ConfigError, RefusedInput
from belahil.pole_response import response
from procedures.tx_delay import TxDelayOptions
from procedures.tx_pulse import KnownPulse, OpticalPulse, tailed_pulse
from procedures.tx_response import HIGHEST, CutResponses
from sim.kernel import Kernel
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape
from sim.pulse_threshold import cut_pulse
from sim.transmitter import Transmitter

TIMES_S = np.arange(-100e-9, 500e-9, 0.4e-9)


def direct(
    pulse: OpticalPulse, threshold: float, poles: tuple[complex, ...], times_s: np.ndarray
) -> np.ndarray:
    """The cut pulse point by point, and the response by the trapezoid rule over its impulse response."""
    fine_s = np.arange(pulse.first_s, pulse.last_s, 5e-12)
    light = np.interp(fine_s, pulse.times_s, pulse.relative)
    light = np.where(light >= threshold, light, 0.0)
    out = np.zeros(times_s.size)
    for k, pole in enumerate(poles):
        weight = -pole
        for other in (*poles[:k], *poles[k + 1 :]):
            weight *= -other / (pole - other)
        since_s = times_s[:, None] - fine_s[None, :]
        kernel = np.where(since_s > 0, (weight * np.exp(pole * np.maximum(since_s, 0))).real, 0.0)
        out += kernel @ light * 5e-12
    return out


@pytest.mark.parametrize(("fwhm_s", "tail_s"), [(5.4e-9, 3e-9), (4e-9, 0.0), (2e-9, 20e-9)])
@pytest.mark.parametrize(("cutoff_hz", "order", "highpass_hz"), [(15e6, 3, 0.0), (25e6, 2, 1e5)])
@pytest.mark.parametrize("threshold", [0.0, 0.17, 0.95])
def test_a_cut_pulse_behind_a_filter_is_that_of_the_closed_form(
    fwhm_s: float, tail_s: float, cutoff_hz: float, order: int, highpass_hz: float, threshold: float
) -> None:
    # Given the same pulse by pieces, cut by another module, whose centre of the Gaussian is at time 0
    shape = PulseShape((PulsePiece(1.0, fwhm_s / FWHM_OF_SIGMA, tail_s),))
    near_s = np.linspace(-2 * fwhm_s, 2 * fwhm_s + tail_s, 400_001)
    density = shape.density(near_s)
    poles, zeros = butterworth.poles(cutoff_hz, order, highpass_hz), int(highpass_hz > 0)
    kernel = Kernel(cut_pulse(shape, threshold), poles, zeros)
    expected = kernel.exact(TIMES_S + near_s[density.argmax()])
    # When it is cut here
    found = CutResponses(tailed_pulse(fwhm_s, tail_s), poles, zeros, TIMES_S).exact(threshold)
    # Then they differ by a factor, the area, and by straight lines between 64 points in a standard deviation
    found = found * (expected @ expected) / (expected @ found)
    assert np.abs(found - expected).max() < 2e-5 * expected.max()


@pytest.mark.parametrize("threshold", [0.08, 0.3])
def test_a_pulse_with_two_humps_passes_in_two_pieces(threshold: float) -> None:
    # Given a second hump of 40 %, which stands above both thresholds, or above none but the rest of the pulse
    step_s = 0.05e-9
    times_s = np.arange(-15e-9, 45e-9, step_s)
    power = np.exp(-0.5 * (times_s / 2e-9) ** 2) + 0.4 * np.exp(-0.5 * ((times_s - 20e-9) / 3e-9) ** 2)
    pulse = OpticalPulse(float(times_s[0]), step_s, power / power.max())
    poles = butterworth.poles(19e6, 3)
    at_s = np.linspace(-20e-9, 120e-9, 141)
    assert len(pulse.above(threshold)) == 2
    found = CutResponses(pulse, poles, 0, at_s).exact(threshold)
    expected = direct(pulse, threshold, poles, at_s)
    # a step of 5 ps moves each of four jumps by up to as much
    allowed = 4 * 5e-12 * threshold * 2 * np.pi * 19e6
    assert np.abs(found - expected).max() < allowed


@pytest.mark.parametrize(("fwhm_s", "tail_s"), [(5.4e-9, 3e-9), (6e-9, 20e-9), (4e-9, 0.0)])
def test_the_table_over_thresholds_is_as_exact_as_it_says(fwhm_s: float, tail_s: float) -> None:
    made = CutResponses(tailed_pulse(fwhm_s, tail_s), butterworth.poles(19e6, 3), 0, TIMES_S)
    for threshold in np.random.default_rng(3).uniform(0, HIGHEST, 40):
        exact = made.exact(float(threshold))
        allowed = 2e-5 if threshold < 0.7 else 2e-4
        assert np.abs(made.hard(float(threshold)) - exact).max() < allowed * exact.max(), threshold


@settings(max_examples=12, deadline=None)
@given(threshold=st.floats(0.02, 0.7), part=st.floats(0.1, 1.0))
def test_a_soft_edge_is_that_of_the_emulated_fibre(threshold: float, part: float) -> None:
    # Given the emulated fibre with an edge, in volts at the cut, whose time 0 is the centre of the Gaussian
    width = part * 2 * min(1 - threshold - 0.03, threshold + 0.3)
    truth = EmulatedTransmitter(threshold=threshold, cut="soft", cut_width=width, peak_v=1.0)
    light = Transmitter(truth).mean
    poles = butterworth.poles(19e6, 3)
    pulse = tailed_pulse(5.4e-9, 3e-9)
    peak_s = -7 * 5.4e-9 / FWHM_OF_SIGMA - pulse.first_s
    expected = response(light.volts, light.sample_rate_hz, light.start_s, "linear", poles, TIMES_S + peak_s)
    found = CutResponses(pulse, poles, 0, TIMES_S).soft(threshold, width)
    # Then both agree to the lines between the emulated break points, where the edge has corners
    assert np.abs(found - expected).max() < 2e-4 * expected.max()


def test_an_edge_of_no_width_is_a_hard_cut() -> None:
    made = CutResponses(tailed_pulse(5.4e-9, 3e-9), butterworth.poles(19e6, 3), 0, TIMES_S)
    np.testing.assert_array_equal(made.soft(0.2, 0.0), made.hard(0.2))
    narrow = made.soft(0.2, 1e-4)
    assert np.abs(narrow - made.hard(0.2)).max() < 1e-5 * narrow.max()


@pytest.mark.parametrize("threshold", [0.0, 0.1, 0.5])
def test_the_centroid_is_that_of_the_points(threshold: float) -> None:
    pulse = tailed_pulse(5.4e-9, 3e-9)
    fine_s = np.arange(pulse.first_s, pulse.last_s, 1e-12)
    light = np.interp(fine_s, pulse.times_s, pulse.relative)
    light = np.where(light >= threshold, light, 0.0)
    assert pulse.centroid_s(threshold) == pytest.approx(float(fine_s @ light / light.sum()), abs=2e-12)


def test_the_peak_is_at_zero_and_one_whatever_is_done_to_the_pulse() -> None:
    known = KnownPulse(5.4e-9, 3e-9, 0.05, 0.05)
    for pulse in (known.pulse(), known.pulse(1.3, 0.8), known.pulse().bent(1e-9, 0.1)):
        near = np.abs(pulse.times_s) < 2 * pulse.step_s
        assert pulse.relative.max() == pytest.approx(1.0, abs=1e-4)
        assert pulse.relative[near].max() == pulse.relative.max()


def test_a_table_keeps_its_shape_and_stretches_each_side(tmp_path: Path) -> None:
    # Given the same pulse as a table, on times that do not begin at its peak
    pieces = tailed_pulse(5.4e-9, 6e-9)
    rows = np.stack([pieces.times_s + 1e-6, 7 * pieces.relative], axis=1)
    np.savetxt(tmp_path / "pulse.txt", rows)
    told = KnownPulse.of(TxDelayOptions(pulse_table=str(tmp_path / "pulse.txt")))
    # Then it is the same pulse, to half a row of 36 ps, by which its highest row may miss the peak
    at_s = np.linspace(-8e-9, 40e-9, 200)
    pulse = told.pulse()
    found = np.interp(at_s, pulse.times_s, pulse.relative)
    expected = np.interp(at_s, pieces.times_s, pieces.relative)
    steepest = np.abs(np.diff(pieces.relative)).max()
    assert np.abs(found - expected).max() < 0.6 * steepest
    # and a stretched fall leaves the rise as it was
    late = told.pulse(fall=1.5)
    rise_s = np.linspace(-8e-9, 0, 50)
    for stretch, times_s in ((1.0, rise_s), (1.5, at_s[at_s > 0])):
        stretched = np.interp(stretch * times_s, late.times_s, late.relative)
        plain = np.interp(times_s, pieces.times_s, pieces.relative)
        np.testing.assert_allclose(stretched, plain, atol=0.6 * steepest)


@pytest.mark.parametrize(
    ("given_", "message"),
    [
        ({"fwhm_s": 0.0}, "must be above zero"),
        ({"tail_s": -1e-9}, "not negative"),
        ({"fall_relative": 0.5}, "of the fall 0.5"),
        ({"rise_relative": -0.1}, "of the rise -0.1"),
        ({"shape_relative": 0.9}, "of the shape 0.9"),
        ({"times_s": (0.0, 0.0), "power": (1.0, 1.0)}, "must be finite and rise"),
        ({"times_s": (0.0, 1.0), "power": (0.0, 0.0)}, "somewhere positive"),
    ],
)
def test_a_pulse_that_cannot_be_is_refused(given_: dict[str, float], message: str) -> None:
    told = {"fwhm_s": 5e-9, "tail_s": 3e-9, "fall_relative": 0.0, "rise_relative": 0.0} | given_
    with pytest.raises(RefusedInput, match=message):
        KnownPulse(**told)  # type: ignore[arg-type]


def test_an_endless_tail_is_refused() -> None:
    with pytest.raises(RefusedInput, match="too long a tail"):
        tailed_pulse(1e-10, 1e-5)


def test_a_table_that_is_none_is_told_with_its_option(tmp_path: Path) -> None:
    (tmp_path / "pulse.txt").write_text("1 2 3\n4 5 6\n")
    with pytest.raises(ConfigError, match="--pulse-table"):
        KnownPulse.of(TxDelayOptions(pulse_table=str(tmp_path / "pulse.txt")))
