"""Gaussian centre, width and amplitude of a pulse in a correlation window: one estimator for all.

The least-squares Gaussian is where the normalized correlation of the samples with a Gaussian is largest, so
only centre t and width W are searched for; the amplitude follows. With q the time from t, g the Gaussian and
v the samples, all that is needed are the moments N_k = sum g v q^k and M_k = sum g^2 q^k, and the score to
climb is ln N_0 - ln(M_0) / 2. Of a Gaussian pulse it is an exact parabola in t and -ln(cosh u) / 2 in
u = ln(W / true W), which is why Newton's step from the nearest template is nearly enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

FitStatus = Literal[
    "ok", "saturated", "width_undetermined", "no_pulse", "inverted", "too_few_samples", "not_converged"
]

CURVATURE = 8 * math.log(2)
"""A Gaussian is exp(-CURVATURE q^2 / (2 W^2)), W its full width at half maximum."""

STEP_SAMPLES, STEP_LOG_WIDTH = 2.0, 0.4
"""A refinement step is never longer: what noise makes of the curvature must not throw the fit away."""

_FEWEST, _MOST = 4, 1024
_NARROWEST = 1.0
_FLAT = 1e-9
_ITERATIONS = 60
_BELOW_SCORE = 1e-6
"""A step so short changes the score by less than its rounding: it is taken without asking."""


@dataclass(frozen=True, slots=True)
class GaussianPulse:
    """A Gaussian.

    Parameters
    ----------
    arrival_s : float
        Centre, s after the first sample.
    fwhm_s : float
        Full width at half maximum, s.
    amplitude_v : float
        Height, V.
    """

    arrival_s: float
    fwhm_s: float
    amplitude_v: float

    def at(self, times_s: ArrayLike) -> NDArray[np.float64]:
        """Return its volts at times from the first sample, with the shape of `times_s`."""
        away = (np.asarray(times_s, dtype=np.float64) - self.arrival_s) / self.fwhm_s
        with np.errstate(under="ignore"):
            return np.asarray(self.amplitude_v * np.exp(-0.5 * CURVATURE * away * away))


@dataclass(frozen=True, slots=True)
class PulseFit:
    """What a fit found.

    Parameters
    ----------
    status : str
        ``ok``; ``saturated``: fitted to the samples that are not clipped; ``width_undetermined``: narrower
        than a sample or wider than the window, the centre holds and the width is the limit it met;
        ``not_converged``: the best so far. The others have no pulse: ``no_pulse`` (flat), ``inverted`` (the
        largest excursion is negative), ``too_few_samples`` (fewer than 4 that are finite). Neither has
        ``saturated`` where clipping leaves none to tell: samples at both clip levels, so that nobody knows
        which excursion is the larger, or fewer than 4 below them.
    pulse : GaussianPulse or None
        None where there is none.
    residual_rms_v : float
        Of the samples used, 3 degrees of freedom taken off, V; 0 without a pulse.
    masked, clipped : int
        Samples left out because they are not finite; because they are clipped.
    """

    status: FitStatus
    pulse: GaussianPulse | None = None
    residual_rms_v: float = 0.0
    masked: int = 0
    clipped: int = 0


def gaussian_fit(volts: ArrayLike, sample_interval_s: float, clip_v: float = math.inf) -> PulseFit:
    """Fit a Gaussian without baseline to a correlation window.

    Parameters
    ----------
    volts : array_like of float, shape (n,)
        Samples about 0 V, n from 4 to 1024. Those that are not finite are left out and counted.
    sample_interval_s : float
        Between samples, s.
    clip_v : float
        Samples from here on, of either sign, are clipped: left out and counted.

    Returns
    -------
    PulseFit

    Raises
    ------
    RefusedInput
        Another shape, or an interval or clip level that is not above zero.

    Notes
    -----
    Valid for widths above one sample interval; from about 1.6 on (20 ns at 80 MHz) the width is well
    determined. A pulse that is not Gaussian gets its least-squares Gaussian.
    """
    samples = np.asarray(volts, dtype=np.float64)
    if samples.ndim != 1 or not _FEWEST <= samples.size <= _MOST:
        raise RefusedInput(
            f"a fit to samples of shape {samples.shape}: one row of {_FEWEST} to {_MOST} samples is allowed"
        )
    if not (0 < sample_interval_s < math.inf and clip_v > 0):
        raise RefusedInput(f"interval {sample_interval_s!r} s, clip {clip_v!r} V: both must be above zero")
    finite = np.isfinite(samples)
    usable = finite & (np.abs(np.where(finite, samples, 0.0)) < clip_v)
    masked, clipped = int((~finite).sum()), int(finite.sum() - usable.sum())
    if usable.sum() < _FEWEST:
        status: FitStatus = "saturated" if finite.sum() >= _FEWEST else "too_few_samples"
        return PulseFit(status, masked=masked, clipped=clipped)
    # Where a clipped sample would be is not known: all count as the clip level, of whichever sign.
    absent = _without_pulse(np.clip(samples[finite], -clip_v, clip_v), clip_v)
    if absent:
        return PulseFit(absent, masked=masked, clipped=clipped)
    places = np.flatnonzero(usable).astype(np.float64)
    centre, log_width = _nearest_template(np.where(usable, samples, 0.0), usable, finite & ~usable, clip_v)
    status, centre, log_width = _climb(samples[usable], places, centre, log_width, samples.size)
    norm, product = (sums[0] for sums in moments(samples[usable], places, centre, math.exp(log_width)))
    if product <= 0:
        return PulseFit("saturated" if clipped else "no_pulse", masked=masked, clipped=clipped)
    pulse = GaussianPulse(
        centre * sample_interval_s, math.exp(log_width) * sample_interval_s, float(product / norm)
    )
    residual = samples[usable] - pulse.at(places * sample_interval_s)
    rms_v = math.sqrt(float(residual @ residual) / (places.size - 3))
    if status == "ok" and clipped:
        status = "saturated"
    return PulseFit(status, pulse, rms_v, masked, clipped)


def _without_pulse(finite: NDArray[np.float64], clip_v: float) -> FitStatus | None:
    high, low = float(finite.max()), float(finite.min())
    if high >= clip_v and low <= -clip_v:
        return "saturated"
    if high - low <= _FLAT * max(abs(high), abs(low)):
        return "no_pulse"
    return "inverted" if -low > high else None


def moments(
    volts: NDArray[np.float64], places: NDArray[np.float64], centre: float, fwhm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the moments M_0 to M_4 and N_0 to N_4, as in the module's text.

    Parameters
    ----------
    volts, places : ndarray of float64, shape (n,)
        Samples and where they are, in samples.
    centre, fwhm : float
        Of the Gaussian, in samples. q is in units of its standard deviation.
    """
    q = (places - centre) * (math.sqrt(CURVATURE) / fwhm)
    with np.errstate(under="ignore"):
        bell = np.exp(-0.5 * q * q)
        powers = np.stack([bell, bell * q, bell * q * q, bell * q**3, bell * q**4])
        return powers @ bell, powers @ volts


def newton_step(norm: NDArray[np.float64], product: NDArray[np.float64], fwhm: float) -> tuple[float, float]:
    """Return the step of centre (samples) and of the width's logarithm that climbs the score.

    Parameters
    ----------
    norm, product : ndarray of float64, shape (5,)
        M_k and N_k from `moments`; ``product[0]`` above zero.
    fwhm : float
        Samples.

    Notes
    -----
    Newton's step; where the score is not concave, the Gauss-Newton step, which always climbs.
    """
    m1, m2, m3, m4 = norm[1] / norm[0], norm[2] / norm[0], norm[3] / norm[0], norm[4] / norm[0]
    n1, n2 = product[1] / product[0], product[2] / product[0]
    n3, n4 = product[3] / product[0], product[4] / product[0]
    up_t, up_w = n1 - m1, n2 - m2
    tt = n2 - n1 * n1 - 2 * (m2 - m1 * m1)
    tw = n3 - 2 * n1 - n1 * n2 - 2 * (m3 - m1 - m1 * m2)
    ww = n4 - 2 * n2 - n2 * n2 - 2 * (m4 - m2 - m2 * m2)
    if not (tt < 0 and tt * ww - tw * tw > 1e-3 * tt * tt):
        tt, tw, ww = m1 * m1 - m2, m1 * m2 - m3, m2 * m2 - m4
    determinant = tt * ww - tw * tw
    if not determinant > 0:
        return 0.0, 0.0
    sigma = fwhm / math.sqrt(CURVATURE)
    step_t = (tw * up_w - ww * up_t) / determinant * sigma
    step_w = (tw * up_t - tt * up_w) / determinant
    shorter = max(abs(step_t) / STEP_SAMPLES, abs(step_w) / STEP_LOG_WIDTH, 1.0)
    return step_t / shorter, step_w / shorter


def _score(norm: NDArray[np.float64], product: NDArray[np.float64]) -> float:
    return float(product[0]) / math.sqrt(float(norm[0])) if norm[0] > 0 else -math.inf


def _climb(
    volts: NDArray[np.float64], places: NDArray[np.float64], centre: float, log_width: float, size: int
) -> tuple[FitStatus, float, float]:
    """Take steps, each halved until the score grows, until they are below rounding."""
    narrowest, widest = math.log(_NARROWEST), math.log(size)
    now = moments(volts, places, centre, math.exp(log_width))
    status: FitStatus = "not_converged"
    for _ in range(_ITERATIONS):
        if now[1][0] <= 0:
            break
        step_t, step_w = newton_step(*now, math.exp(log_width))
        if max(abs(step_t), abs(step_w)) < 1e-11:
            status = "ok"
            break
        for halving in range(40):
            part = 0.5**halving
            moved = centre + part * step_t
            wide = min(max(log_width + part * step_w, narrowest), widest)
            next_ = moments(volts, places, moved, math.exp(wide))
            if max(abs(step_t), abs(step_w)) < _BELOW_SCORE or _score(*next_) > _score(*now):
                break
        else:
            status = "ok"  # no step climbs: the top, to rounding
            break
        centre, log_width, now = moved, wide, next_
    if log_width <= narrowest + 1e-9 or log_width >= widest - 1e-9:
        status = "width_undetermined"
    return status, centre, log_width


def _nearest_template(
    samples: NDArray[np.float64], usable: NDArray[np.bool_], clipped: NDArray[np.bool_], clip_v: float
) -> tuple[float, float]:
    """Centre and log width of the template of least misfit; at clipped samples it may lie above the clip."""
    places, log_widths, bells = _templates(samples.size)
    norm = bells**2 @ usable
    amplitude = np.maximum(bells @ samples, 0.0) / np.maximum(norm, 1e-300)
    explained = amplitude**2 * norm
    if clipped.any():
        below = np.maximum(clip_v - amplitude[:, None] * bells[:, clipped], 0.0)
        explained -= (below**2).sum(axis=1)
    best = int(np.argmax(explained))
    return float(places[best]), float(log_widths[best])


@lru_cache(maxsize=8)
def _templates(size: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Centre, log width and bell of every template: whole samples, widths in steps of a half."""
    widths = np.geomspace(1.2, size, max(2, math.ceil(math.log(size / 1.2) / math.log(1.5)) + 1))
    every = np.arange(float(size))
    centre, width = (grid.ravel() for grid in np.meshgrid(every, widths, indexing="ij"))
    with np.errstate(under="ignore"):
        bells = np.exp(-0.5 * CURVATURE * ((every - centre[:, None]) / width[:, None]) ** 2)
    return centre, np.log(width), bells
