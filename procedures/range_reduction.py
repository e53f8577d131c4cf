"""From the two arrivals that a range finder reports to a one-way range, term by term with its uncertainty.

Both pulses of a shot go through the same receiver, which delays each by an amount that depends on its width.
With t_R and t_T the fitted arrivals on the receiver's clock,

    range = c / 2 [(t_R - t_T) / (1 + clock error) - (d_R(W) - d_T) + sum of the fixed offsets]

d_R(W) is the delay of a received pulse of detected width W (`belahil.delay_curve`), d_T that of the detected
transmitted pulse; their difference is the shift of the arrival, which is taken off. The paper's t_shift has
the other sign, d_T - d_R(W), where its linear coefficient is read as 0.0937 (see `delays_from_published`).

Not modelled: pointing, the refraction of an atmosphere, the motion of the spacecraft during the flight, and
any change of the fixed offsets with temperature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from belahil.delay_curve import DelayCurve, published_curve
from belahil.errors import RefusedInput
from belahil.outcome import BudgetLine
from belahil.uncertainty import budget, combined
from belahil.values import Estimate
from sim.constants import SPEED_OF_LIGHT_M_PER_S

ReductionStatus = Literal["ok", "width_outside_curve", "not_after_transmitted"]

HALF_LIGHT_M_PER_S = SPEED_OF_LIGHT_M_PER_S / 2
"""Metres of one-way range in a second of time of flight."""

_ROUNDING_S = 0.5e-12 / math.sqrt(3)
"""Printed offsets have picoseconds; a rounding error is uniform over one of them."""

_SLOPE_STEP = 1e-3
"""Of the range of a delay curve, over which its slope is taken."""


@dataclass(frozen=True, slots=True)
class FixedOffset:
    """What is added to a measured time of flight, whatever the pulse.

    Parameters
    ----------
    source : str
        Where it comes from.
    time : Estimate
        s.
    """

    source: str
    time: Estimate

    @property
    def one_way_m(self) -> float:
        """What it adds to a range, m: c t / 2, half of the path c t that the paper's table lists."""
        return HALF_LIGHT_M_PER_S * self.time.value

    @property
    def path_m(self) -> float:
        """The path c t, m, which the paper's table calls the corresponding range."""
        return 2 * self.one_way_m


FIXED_OFFSETS = tuple(
    FixedOffset(source, Estimate(time_s, _ROUNDING_S, "s"))
    for source, time_s in (
        ("travel time between transmitter and photodiode", 3.407e-9),
        ("additional light path within the telescope", -0.936e-9),
        ("distance between photodiode and transmitter", 0.146e-9),
    )
)
"""Nishiyama et al., table "Fixed offsets in time-of-flight measurements by BELA". From a computer-aided
design, without an uncertainty: only that of rounding is taken. They sum to 2.617 ns; printed is 2.616."""


@dataclass(frozen=True, slots=True)
class ReceiverDelays:
    """What a receiver delays fitted arrivals by.

    Parameters
    ----------
    received : DelayCurve
        d_R: delay of received pulses against the detected width.
    transmitted : Estimate
        d_T: delay of the detected transmitted pulse, s, from the centroid of all the light that was emitted,
        as `received` counts from the centroid of what enters: ``centre_minus_full_centroid`` of
        `procedures.tx_definitions`.
    spread_s : float
        Standard deviation of the delays of single pulses about the curve, s, not negative.

    Raises
    ------
    RefusedInput
        A spread that is negative or not finite.
    """

    received: DelayCurve
    transmitted: Estimate
    spread_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.spread_s < math.inf:
            raise RefusedInput(f"a spread of {self.spread_s!r} s about a delay curve: must not be negative")


@dataclass(frozen=True, slots=True)
class TimeTerm:
    """One term of a reduction.

    Parameters
    ----------
    source : str
        What it is.
    time : Estimate
        What it adds to the time of flight, s.
    """

    source: str
    time: Estimate

    @property
    def range_m(self) -> Estimate:
        """The same as one-way range, m."""
        return Estimate(
            HALF_LIGHT_M_PER_S * self.time.value, HALF_LIGHT_M_PER_S * self.time.standard_uncertainty, "m"
        )


@dataclass(frozen=True, slots=True)
class ReducedRange:
    """A range and where it comes from.

    Parameters
    ----------
    status : str
        ``ok``; ``width_outside_curve``: the delay of such a pulse is not known; ``not_after_transmitted``:
        the received pulse does not come after the transmitted one. Only ``ok`` has a range.
    range : Estimate or None
        One way, m.
    terms : tuple of TimeTerm
        Their times sum to twice the range divided by c. Empty without a range.
    """

    status: ReductionStatus
    range: Estimate | None = None
    terms: tuple[TimeTerm, ...] = ()

    @property
    def budget(self) -> list[BudgetLine]:
        """What each term adds to the uncertainty of the range, the largest first; m."""
        parts = {term.source: term.range_m.standard_uncertainty for term in self.terms}
        return budget("range", "m", {source: value for source, value in parts.items() if value})


def reduce_range(
    received: Estimate,
    width: Estimate,
    transmitted: Estimate,
    delays: ReceiverDelays,
    offsets: Sequence[FixedOffset] = FIXED_OFFSETS,
    clock_ppm: Estimate | None = None,
) -> ReducedRange:
    """Reduce one shot.

    Parameters
    ----------
    received, width : Estimate
        Fitted arrival and detected full width of the received pulse, s.
    transmitted : Estimate
        Fitted arrival of the transmitted pulse, s, on the same clock and from the same origin.
    delays : ReceiverDelays
        Of this receiver.
    offsets : sequence of FixedOffset
        Each is added.
    clock_ppm : Estimate or None
        Error of the receiver's clock, unit ``1e-6``; above zero: it is fast, and times come out too long.
        None: true, with no uncertainty.

    Returns
    -------
    ReducedRange

    Raises
    ------
    RefusedInput
        A time or uncertainty that is not finite, an uncertainty below zero, or a clock error of -1e6 or less.

    Notes
    -----
    The terms are taken for independent: arrival and width of a fitted Gaussian are uncorrelated in stationary
    noise (they are orthogonal by symmetry), and the delay's slope is at most 0.05 s/s. The clock error is of
    first order: its uncertainty is that of the time of flight times that of the error.
    """
    told = [received, width, transmitted, delays.transmitted, *(one.time for one in offsets)]
    for one in [*told, *([clock_ppm] if clock_ppm else [])]:
        _refuse_odd(one)
    flight_s = received.value - transmitted.value
    if not flight_s > 0:
        return ReducedRange("not_after_transmitted")
    curve = delays.received
    if not curve.narrowest_s <= width.value <= curve.widest_s:
        return ReducedRange("width_outside_curve")
    terms = [
        TimeTerm("arrival of the received pulse", received),
        TimeTerm("arrival of the transmitted pulse", _turned(transmitted)),
    ]
    if clock_ppm is not None:
        terms.append(TimeTerm("clock of the receiver", _clock_term(flight_s, clock_ppm)))
    delay_s = float(curve.at(width.value))
    by_width_s = abs(_slope(curve, width.value)) * width.standard_uncertainty
    terms += [
        TimeTerm(
            "delay of the received pulse", Estimate(-delay_s, math.hypot(by_width_s, delays.spread_s), "s")
        ),
        TimeTerm("delay of the transmitted pulse", delays.transmitted),
        *(TimeTerm(one.source, one.time) for one in offsets),
    ]
    total_s = math.fsum(term.time.value for term in terms)
    uncertainty_s = combined(term.time.standard_uncertainty for term in terms)
    found = TimeTerm("", Estimate(total_s, uncertainty_s, "s")).range_m
    return ReducedRange("ok", found, tuple(terms))


def delays_from_published(
    transmitted: Estimate, spread_s: float = 0.0, *, as_printed: bool = False
) -> ReceiverDelays:
    """Return the delays that the published t_shift means, d_R(W) = d_T - t_shift(W).

    Parameters
    ----------
    transmitted : Estimate
        d_T, s. With 11.84 ns the curve is that of a third-order Butterworth filter of 19 MHz to 0.1 ns.
    spread_s : float
        As in `ReceiverDelays`; the paper finds up to 1 m of range, 6.7 ns, for rough ground.
    as_printed : bool
        With the printed linear coefficient of 0.937, by which the shift would change by 70 ns from 20 to
        100 ns of width; see `belahil.delay_curve.published_curve`.
    """
    shift = published_curve(as_printed=as_printed)
    turned = [-one for one in shift.coefficients_s]
    turned[0] += transmitted.value
    curve = replace(shift, coefficients_s=tuple(turned))
    return ReceiverDelays(curve, transmitted, spread_s)


def _clock_term(flight_s: float, clock_ppm: Estimate) -> Estimate:
    rate = 1 + clock_ppm.value * 1e-6
    if not rate > 0:
        raise RefusedInput(f"a clock error of {clock_ppm.value!r} ppm: must be above -1e6")
    # flight / rate - flight, without the cancellation
    return Estimate(
        -flight_s * (clock_ppm.value * 1e-6) / rate,
        flight_s * clock_ppm.standard_uncertainty * 1e-6 / rate**2,
        "s",
    )


def _turned(one: Estimate) -> Estimate:
    return Estimate(-one.value, one.standard_uncertainty, one.unit)


def _slope(curve: DelayCurve, width_s: float) -> float:
    """Slope of a delay curve, by a difference that stays within its range."""
    step_s = _SLOPE_STEP * (curve.widest_s - curve.narrowest_s)
    low = max(width_s - step_s, curve.narrowest_s)
    high = min(width_s + step_s, curve.widest_s)
    before_s, after_s = curve.at([low, high])
    return float((after_s - before_s) / (high - low))


def _refuse_odd(one: Estimate) -> None:
    if not (math.isfinite(one.value) and 0 <= one.standard_uncertainty < math.inf):
        raise RefusedInput(
            f"{one.value!r} with a standard uncertainty of {one.standard_uncertainty!r} {one.unit}: "
            "a finite number with an uncertainty that is not negative is allowed"
        )
