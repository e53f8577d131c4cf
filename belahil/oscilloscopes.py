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

TRIGGERS: tuple[Trigger, ...] = ("immediate", "generator")
GRID_SLACK = 0.02
"""Parts of a sample interval that a told time may be off by rounding."""


@dataclass(frozen=True, slots=True)
class ScopeModel:
    """What the oscilloscopes of one family have in common.

    Parameters
    ----------
    maker, name : str
        As in the identity of an emulated one.
    bits : int
        Of the converter.
    zero_code : int
        Code of zero volts without an offset.
    lowest_code : int
        The lowest code of a sample; this one and `top_code` mean clipped.
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
    tells_phase : bool
        Whether its times tell where between two samples the trigger came.
    """

    maker: str
    name: str
    bits: int
    zero_code: int
    lowest_code: int
    told_codes: float
    volt_digits: int
    time_digits: int
    divisions: int
    record_lengths: tuple[int, ...]
    max_rate_hz: float
    tells_phase: bool

    @property
    def code_count(self) -> int:
        """How many codes the converter has."""
        return 1 << self.bits

    @property
    def top_code(self) -> int:
        """The highest code."""
        return (1 << self.bits) - 1

    def volts_per_count(self, full_scale_v: float) -> float:
        """Volts per code as the instrument tells them, with `full_scale_v` over all codes."""
        return told(full_scale_v / self.code_count * self.told_codes, self.volt_digits) / self.told_codes


SCOPES = {
    "keysight-infiniivision": ScopeModel(
        maker="KEYSIGHT TECHNOLOGIES",
        name="DSOX1204G",
        bits=8,
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
        tells_phase=True,  # assumed
    ),
    "rigol-ds1000z": ScopeModel(
        maker="RIGOL TECHNOLOGIES",
        name="DS1202Z-E",
        bits=8,
        # 25 codes a division; yreference is 127 in the programming guide's example.
        zero_code=127,
        lowest_code=0,
        told_codes=1.0,
        volt_digits=7,
        time_digits=7,
        divisions=12,
        record_lengths=(12000, 120000, 1200000, 12000000),  # with one channel on; of 2-channel models assumed
        max_rate_hz=1e9,
        tells_phase=False,  # assumed
    ),
    "siglent-sds": ScopeModel(
        maker="Siglent Technologies",
        name="SDS1104X-E",
        bits=8,
        zero_code=128,  # sent as 0
        lowest_code=0,
        told_codes=25.0,  # volts a division are told
        volt_digits=3,
        time_digits=3,
        divisions=14,
        record_lengths=(14000, 140000, 1400000, 14000000),
        max_rate_hz=1e9,
        tells_phase=False,
    ),
    "tektronix-mso": ScopeModel(
        maker="TEKTRONIX",
        name="MSO54",
        bits=12,
        zero_code=2048,  # sent as 0
        lowest_code=0,
        told_codes=1 / 16,
        volt_digits=5,  # assumed, as are the next, and that 10 divisions span all codes
        time_digits=10,
        divisions=10,
        record_lengths=(1000, 10000, 100000, 1000000, 10000000),
        max_rate_hz=3.125e9,
        tells_phase=True,  # assumed
    ),
}


@dataclass(frozen=True, slots=True)
class ScopeSetting:
    """What an oscilloscope is set to for one window.

    Parameters
    ----------
    full_scale_v : float
        Span of all codes, V.
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
    codes : ndarray of uint16, shape (n,)
        Of its converter, from 0.
    volts_per_count, zero_code : float
        Volts are ``(code - zero_code) volts_per_count``.
    interval_s : float
        Between samples, s.
    first_s : float
        Of the first sample after the trigger, s.
    """

    codes: NDArray[np.uint16]
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
    bits = SCOPES[table.driver].bits
    return replace(preset.digitizer, sample_rate_hz=rate_hz, bits=bits, converters=1, triggers=TRIGGERS)


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
        Counts are codes minus half of their number; `saturated` counts the codes at both ends of the
        converter; `start_s` is on the grid that was asked for, and the first sample comes up to an interval
        later: ``trigger_phase_s`` of `housekeeping`, where the instrument knows it.

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
    late = (record.first_s - setting.start_s) / interval_s
    # A told time is rounded: a hair before the start is at it, a hair less than an interval late is whole.
    at_start = -GRID_SLACK < late < 1 + GRID_SLACK
    first = 0 if at_start else math.ceil(-late) if model.tells_phase else round(-late)
    codes = record.codes[max(first, 0) : max(first, 0) + request.sample_count]
    if first < 0 or codes.size < request.sample_count:
        raise CorruptData(
            f"window of shot {request.shot}: asked for {request.sample_count} samples from "
            f"{setting.start_s:g} s, the record has {record.codes.size} from {record.first_s:g} s"
        )
    lowest = int(codes.min())
    if lowest < model.lowest_code:
        raise CorruptData(f"window of shot {request.shot}: the record has samples that were never taken")
    half = model.code_count // 2
    counts = codes.astype(np.int16) - np.int16(half)
    counts.setflags(write=False)
    return RangeWindow(
        counts=counts,
        volts_per_count=record.volts_per_count,
        zero_count=record.zero_code - half,
        sample_interval_s=interval_s,
        start_s=setting.start_s,
        gain_code=None,
        shot=request.shot,
        saturated=int(np.count_nonzero((codes == model.lowest_code) | (codes == model.top_code))),
        housekeeping={"trigger_phase_s": (late + first) * interval_s} if model.tells_phase else {},
    )
