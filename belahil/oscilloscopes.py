"""Oscilloscopes as digitizers: what models can do, and how a record becomes a range window.

A driver and the simulated instrument share this one way from a request to a setting, and from codes to a
window. Numbers marked assumed are in no public manual that we found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import ConfigError, CorruptData, LimitExceeded
from belahil.values import RangeWindow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.config import DigitizerTable
    from belahil.receiver import DigitizerSpec, ReceiverSpec
    from belahil.values import Trigger, WindowRequest

HALF_SPAN = 128
"""Codes below the middle of an eight-bit converter: records are re-centred by it."""
TRIGGERS: tuple[Trigger, ...] = ("immediate", "generator")
GRID_SLACK = 1e-3
"""Parts of a sample interval that a told time may be off by rounding."""


@dataclass(frozen=True, slots=True)
class ScopeModel:
    """What the oscilloscopes of one family have in common.

    Parameters
    ----------
    maker, name : str
        As in the identity of an emulated one.
    zero_code : int
        Code of zero volts without an offset, of 256.
    lowest_code : int
        The lowest code of a sample; this one and 255 mean clipped.
    told_codes : float
        Codes in the unit whose volts the instrument tells.
    volt_digits, time_digits : int
        Significant digits of what it tells.
    divisions : int
        Of the screen, horizontally.
    record_lengths : tuple of int
        Samples of a record, ascending.
    max_rate_hz : float
        Samples per second.
    """

    maker: str
    name: str
    zero_code: int
    lowest_code: int
    told_codes: float
    volt_digits: int
    time_digits: int
    divisions: int
    record_lengths: tuple[int, ...]
    max_rate_hz: float

    def volts_per_count(self, full_scale_v: float) -> float:
        """Volts per code as the instrument tells them, with `full_scale_v` over 256 codes."""
        return told(full_scale_v / 256 * self.told_codes, self.volt_digits) / self.told_codes


SCOPES = {
    "keysight-infiniivision": ScopeModel(
        maker="KEYSIGHT TECHNOLOGIES",
        name="DSOX1204G",
        # Word 0 is a hole, 1 is clipped below, 65535 above (guides of the 2000 and 4000 X-Series).
        zero_code=128,
        lowest_code=1,
        # Words have 256 steps in a code of the converter; the span of a screen over 256 codes is assumed.
        told_codes=1 / 256,
        volt_digits=6,  # assumed, as is the next
        time_digits=9,
        divisions=10,
        record_lengths=(1000, 2000, 5000, 10000, 20000, 50000, 100000, 200000, 500000),
        max_rate_hz=2e9,
    ),
}


@dataclass(frozen=True, slots=True)
class ScopeSetting:
    """What an oscilloscope is set to for one window.

    Parameters
    ----------
    full_scale_v : float
        Span of all 256 codes, V.
    interval_s : float
        Between samples, s.
    points : int
        Samples of the record.
    edges : int
        Whole intervals from the trigger to the start of the record.
    trigger : {"immediate", "generator"}
        What starts it: we force it, or its external input.
    """

    full_scale_v: float
    interval_s: float
    points: int
    edges: int
    trigger: Trigger

    @property
    def start_s(self) -> float:
        """When the record starts after the trigger, s."""
        return self.edges * self.interval_s


@dataclass(frozen=True, slots=True, eq=False)
class ScopeRecord:
    """What an oscilloscope says of one acquisition.

    Parameters
    ----------
    codes : ndarray of uint8, shape (n,)
        Of its converter, from 0 to 255.
    volts_per_count, zero_code : float
        Volts are ``(code - zero_code) volts_per_count``.
    interval_s : float
        Between samples, s.
    first_s : float
        Of the first sample after the trigger, s.
    """

    codes: NDArray[np.uint8]
    volts_per_count: float
    zero_code: float
    interval_s: float
    first_s: float


def told(value: float, digits: int) -> float:
    """Round to significant digits, as an instrument that tells a number does."""
    return float(f"{value:.{digits - 1}e}")


def check_scope(table: DigitizerTable, preset: ReceiverSpec) -> None:
    """Check the keys of ``[digitizer]`` for an oscilloscope.

    Raises
    ------
    ConfigError
        With the key and what is allowed.
    """
    if preset.digitizer.gain_codes is not None:
        raise ConfigError(
            f'[digitizer] receiver = "{preset.name}" with driver = "{table.driver}": an oscilloscope sets no '
            "gain codes; allowed: analog"
        )
    model, rate_hz = SCOPES[table.driver], rate_of(table, preset)
    if rate_hz > model.max_rate_hz:
        raise ConfigError(
            f"[digitizer] sample_rate_hz = {rate_hz:g}: {table.driver} takes at most {model.max_rate_hz:g}"
        )


def rate_of(table: DigitizerTable, preset: ReceiverSpec) -> float:
    """Samples per second of a bench: the bench file's, or else the preset's."""
    return table.sample_rate_hz or preset.digitizer.sample_rate_hz


def scope_spec(table: DigitizerTable, preset: ReceiverSpec) -> DigitizerSpec:
    """Return what an oscilloscope is as a digitizer on this bench."""
    rate_hz = rate_of(table, preset)
    return replace(preset.digitizer, sample_rate_hz=rate_hz, bits=8, converters=1, triggers=TRIGGERS)


def check_request(request: WindowRequest, spec: DigitizerSpec) -> None:
    """Refuse what no oscilloscope can do.

    Raises
    ------
    LimitExceeded
        With what was asked and what is allowed.
    """
    request.check()
    for name, asked, allowed in (
        ("gain_code", request.gain_code, (None,)),
        ("products", request.products, spec.products),
        ("source", request.source, ("return",)),
        ("trigger", request.trigger, spec.triggers),
    ):
        if asked not in allowed:
            words = ", ".join(map(str, allowed))
            raise LimitExceeded(f"a window with {name} = {asked}: an oscilloscope has {words}")
    if request.sample_count > spec.max_sample_count:
        raise LimitExceeded(
            f"a window of {request.sample_count} samples: this bench takes 1 to {spec.max_sample_count}"
        )


def setting_for(
    request: WindowRequest, spec: DigitizerSpec, model: ScopeModel, full_scale_v: float
) -> ScopeSetting:
    """Return the setting whose record begins with the window: the shortest that holds the longest window."""
    interval_s = spec.sample_interval_s
    points = next(count for count in model.record_lengths if count >= spec.max_sample_count)
    return ScopeSetting(
        full_scale_v, interval_s, points, round(request.delay_s / interval_s), request.trigger
    )


def window_of(
    record: ScopeRecord, request: WindowRequest, setting: ScopeSetting, model: ScopeModel
) -> RangeWindow:
    """Cut the window out of a record.

    Returns
    -------
    RangeWindow
        Counts are codes minus 128; `saturated` counts the codes at both ends of the converter; `start_s` is
        on the grid that was asked for, and the first sample comes ``trigger_phase_s`` of `housekeeping`
        later: less than one interval, as far as the instrument knows.

    Raises
    ------
    CorruptData
        A record with another interval than it was set to, with samples that were not taken, or that does not
        hold the window.
    """
    interval_s = setting.interval_s
    if not math.isclose(record.interval_s, interval_s, rel_tol=1e-6):
        raise CorruptData(
            f"window of shot {request.shot}: asked for samples every {interval_s:g} s, "
            f"the record has one every {record.interval_s:g} s"
        )
    first = math.ceil((setting.start_s - record.first_s) / interval_s - GRID_SLACK)
    codes = record.codes[max(first, 0) : max(first, 0) + request.sample_count]
    if first < 0 or codes.size < request.sample_count:
        raise CorruptData(
            f"window of shot {request.shot}: asked for {request.sample_count} samples from "
            f"{setting.start_s:g} s, the record has {record.codes.size} from {record.first_s:g} s"
        )
    lowest = int(codes.min())
    if lowest < model.lowest_code:
        raise CorruptData(f"window of shot {request.shot}: the record has samples that were never taken")
    counts = codes.astype(np.int16) - np.int16(HALF_SPAN)
    counts.setflags(write=False)
    return RangeWindow(
        counts=counts,
        volts_per_count=record.volts_per_count,
        zero_count=record.zero_code - HALF_SPAN,
        sample_interval_s=interval_s,
        start_s=setting.start_s,
        gain_code=None,
        shot=request.shot,
        saturated=int(np.count_nonzero((codes == model.lowest_code) | (codes == 255))),
        housekeeping={"trigger_phase_s": record.first_s + first * interval_s - setting.start_s},
    )
