"""Hard cases of delay curves and thresholds: high degrees, printed digits, places without data."""

from __future__ import annotations

from contextlib import suppress

import mpmath
import numpy as np
import pytest
from hard_cases_echo import impulse_response
from numpy.polynomial import Legendre, Polynomial, legendre
from scipy import optimize

from belahil import butterworth
from belahil.delay_curve import NARROWEST_S, WIDEST_S, DelayCurve, fit_delay_curve, published_curve
from belahil.errors import RefusedInput
from sim.filter_delay import filter_delay_curve
from sim.kernel import Kernel
from sim.pulse_shape import PulsePiece, PulseShape
from sim.pulse_threshold import cut_pulse, threshold_bound

WIDTHS_NS = np.arange(20.0, 110.5)
POWERS = (14.05, 0.5459, -2.257e-2, 3.976e-4, -3.237e-6, 1.0004e-8)
"""Of some curve, ns for widths in ns; what is fitted is this, exactly."""

# ---- H35: a polynomial of degree 5


def true_delays_ns() -> np.ndarray:
    with mpmath.workdps(40):
        return np.array(
            [
                float(sum(mpmath.mpf(c) * mpmath.mpf(w) ** k for k, c in enumerate(POWERS)))
                for w in WIDTHS_NS.tolist()
            ]
        )


def delays_of_degree_five() -> float:
    """In ns, against the polynomial in 40 digits; the columns' condition is below 10."""
    true_ns = true_delays_ns()
    curve = fit_delay_curve(1e-9 * WIDTHS_NS, 1e-9 * true_ns)
    assert np.linalg.cond(legendre.legvander((WIDTHS_NS - 65) / 45, 5)) < 10
    # A cluster at one end says nothing of the other
    with pytest.raises(RefusedInput, match="condition"):
        fit_delay_curve(np.linspace(20e-9, 22e-9, 50), np.linspace(0, 1e-9, 50))
    return float(np.abs(1e9 * curve.at(1e-9 * WIDTHS_NS) - true_ns).max())


def powers_of_seconds() -> float:
    """Columns from 1 to 1e-35: least squares takes two of six for something."""
    columns = np.vander(1e-9 * WIDTHS_NS, 6)
    assert np.linalg.cond(columns) > 1e30
    found, _, rank, _ = np.linalg.lstsq(columns, 1e-9 * true_delays_ns(), rcond=None)
    assert rank < 6
    return float(np.abs(1e9 * columns @ found - true_delays_ns()).max())


# ---- H36: printed coefficients


def simulated() -> DelayCurve:
    return filter_delay_curve(butterworth.poles(19e6, 3), 12.5e-9)


def from_published_ns(*, as_printed: bool) -> float:
    """Of the simulated delay and of t_shift, which has the other sign and an unknown reference."""
    widths_s = 1e-9 * WIDTHS_NS
    off_ns = 1e9 * (simulated().at(widths_s) + published_curve(as_printed=as_printed).at(widths_s))
    return float(np.abs(off_ns - off_ns.mean()).max())


def published_digits() -> float:
    """Of the paper's curve with its probable coefficient from the simulated one, ns; its mean is free."""
    # Half a unit of the third digit of all coefficients is as much at 110 ns
    digits = (5e-3, 5e-4, 5e-6, 5e-8, 5e-10, 5e-12)
    assert sum(half * 110.0**k for k, half in enumerate(digits)) == pytest.approx(0.34, abs=0.01)
    # One's own coefficients in powers would lose it too; as they are kept they do not
    curve = simulated()
    powers = Legendre(1e9 * np.array(curve.coefficients_s), domain=(20, 110)).convert(kind=Polynomial)
    rounded = Polynomial([float(f"{one:.2e}") for one in powers.coef])
    assert np.abs(rounded(WIDTHS_NS) - powers(WIDTHS_NS)).max() > 0.1
    assert 1e9 * curve.at(1e-9 * WIDTHS_NS) == pytest.approx(powers(WIDTHS_NS), abs=1e-9)
    return from_published_ns(as_printed=False)


def published_misprint() -> float:
    """With the linear coefficient as it is printed the correction grows by a nanosecond a nanosecond."""
    return from_published_ns(as_printed=True)


# ---- H37: extrapolation


def widths_without_data() -> float:
    """Delays given for widths outside the range, or that are no numbers; at its ends there is one."""
    curve, given = published_curve(), 0
    for width_s in (0.0, -50e-9, 10e-9, 19.9e-9, 110.1e-9, 130e-9, 300e-9, np.nan, np.inf):
        with suppress(RefusedInput):
            curve.at([60e-9, width_s])
            given += 1
        with pytest.raises(RefusedInput, match=r"delays are known from 2e-08 to 1\.1e-07 s"):
            fit_delay_curve([*np.linspace(20e-9, 110e-9, 20), width_s], np.zeros(21))
    assert np.all(np.isfinite(curve.at([NARROWEST_S, WIDEST_S])))
    return float(given)


def polynomial_anywhere() -> float:
    """The printed polynomial gives hundreds of nanoseconds at 300 ns."""
    t_shift_ns = Polynomial((-8.13, 9.37e-1, -2.18e-3, 3.81e-5, -3.27e-7, 1.01e-9))(300.0)
    assert t_shift_ns > 900
    return 1.0


# ---- H40: thresholds of a pulse

POLES = butterworth.poles(19e6, 3)
SHARP = PulseShape((PulsePiece(1.0, 2e-9, 8e-9),))
PER_PEAK = 1 / 50
CLOCK_S = 12.5e-9


def thresholds_to_the_top() -> float:
    """Thresholds that are flagged as flat, or not, against the misfit to the sharpest pulse there is.

    Where a filtered impulse fits the samples within their noise, no higher threshold can be told apart.
    """
    wrong = 0
    for threshold in (0.05, 0.22, 0.4, 0.8, 0.9, 0.95, 0.99, 0.9999):
        cut = cut_pulse(SHARP, threshold)
        assert np.all(np.isfinite(Kernel(cut, POLES).exact(np.linspace(0, 100e-9, 101))))
        found = threshold_bound(SHARP, threshold, POLES, CLOCK_S, PER_PEAK)
        wrong += (found.status == "flat") != (sigmas_from_an_impulse(cut) < 1)
    # The scale is that of one photon, and the end is refused
    assert cut.std_s < 1e-10
    for threshold in (-0.1, 1.0, 1.5, np.nan):
        with pytest.raises(RefusedInput, match="from 0 to below 1"):
            cut_pulse(SHARP, threshold)
    return float(wrong)


def sigmas_from_an_impulse(cut: PulseShape) -> float:
    """Distance of the samples from the best impulse response, in noise of `PER_PEAK`; mean of four phases."""
    kernel, squares = Kernel(cut, POLES), []
    peak = kernel.exact(np.linspace(0, 60e-9, 2001)).max()
    for phase in range(4):
        times_s = cut.times_s[0] + CLOCK_S * (np.arange(42) + phase / 4)
        volts = kernel.exact(times_s) / (peak * PER_PEAK)

        def off(place_ns: float, times_s: np.ndarray = times_s, volts: np.ndarray = volts) -> float:
            since_s = times_s - 1e-9 * place_ns
            shape = np.array([impulse_response(t) if t > 0 else 0.0 for t in since_s])
            return float(np.sum((volts - (volts @ shape) / (shape @ shape) * shape) ** 2))

        middle_ns = 1e9 * cut.mean_s
        squares.append(
            optimize.minimize_scalar(off, bounds=(middle_ns - 3, middle_ns + 3), method="bounded").fun
        )
    return float(np.sqrt(np.mean(squares)))


def samples_above_a_threshold() -> float:
    """Samples each 0.5 ns above 1 of the peak are one, above more none: their area is zero over zero."""
    times_s = 0.5e-9 * np.arange(-20, 120)
    density = SHARP.density(times_s)
    assert np.count_nonzero(density >= density.max()) == 1
    kept = np.where(density >= 1.01 * density.max(), density, 0.0)
    with np.errstate(invalid="ignore"):
        return float(np.max(kept / (kept.sum() * 0.5e-9)))
