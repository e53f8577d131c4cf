"""Siglent oscilloscopes of the SDS1000X-E series, in their older words (public programming guide).

Answers have no header (``CHDR OFF``). The internal state register tells of a trigger that is ready (bit 13)
and of a signal that was acquired (bit 0). There is no preamble: volts a division, seconds a division, and
the sample rate describe the record, with three digits. The shot goes into the first point of the waveform
setup, one more than its number, since 0 is what stands there without one. The setup is set anew before the
record is read; so the shot cannot be read back afterwards. A positive trigger delay is later, as somebody
measured on an SDS1000CML+ and the older words of LeCroy are not. Assumed: that the setup takes the shot, that
the delay is about the middle of the screen, and how answers are spelt.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import CorruptData
from belahil.oscilloscopes import SCOPES, ScopeRecord
from drivers.oscilloscopes.dialect import Item, agrees, numbers

if TYPE_CHECKING:
    from belahil.oscilloscopes import ScopeSetting
    from drivers.scpi import ScpiSession

TRIGGER_READY, SIGNAL_ACQUIRED = 1 << 13, 1
TRIGGER_LEVEL_V = 1.0
CODES_A_DIVISION = 25
_THREE_DIGITS = 6e-3
_FULL_BANDWIDTH = re.compile(r"C1,OFF(,C[2-4],(ON|OFF))*", re.IGNORECASE)
"""All channels are answered; of the first one, that its bandwidth is not limited."""


class SiglentDialect:
    """The words of the family."""

    model = SCOPES["siglent-sds"]
    known = re.compile(r"SIGLENT TECHNOLOGIES,SDS1\d{3}(X|CML|DL)", re.IGNORECASE)
    stop = "STOP"
    start = "TRMD SINGLE"
    force = "FRTR"
    tells_errors = False

    def items(self, setting: ScopeSetting, identity: str) -> tuple[Item, ...]:
        """Return all that has to be set for a record."""
        return (
            Item("CHDR OFF", "CHDR?", "OFF"),
            _item("C1:TRA", "ON"),
            _item("C1:ATTN", 1.0),
            _item("C1:CPL", "D1M"),
            Item("BWL C1,OFF", "BWL?", _FULL_BANDWIDTH),
            _item("C1:VDIV", self._division_v(setting)),
            _item("C1:OFST", 0.0),
            # The memory is taken only while it runs.
            Item(f"TRMD AUTO;MSIZ {_kilo(setting.points)};STOP", "MSIZ?", _kilo(setting.points)),
            *self._times(setting),
            Item("TRSE EDGE,SR,EX,HT,OFF", "TRSE?", "EDGE,SR,EX,HT,OFF"),
            _item("EX:TRSL", "POS"),
            _item("EX:TRLV", TRIGGER_LEVEL_V),
            _item("ACQW", "SAMPLING"),
        )

    def mark(self, shot: int) -> Item:
        """Return the shot as the first point of a waveform that is not read."""
        return Item(f"WFSU SP,1,NP,0,FP,{shot + 1}", "", "")

    def forget(self, session: ScpiSession) -> None:
        """Read the internal state register, which clears it."""
        self._state(session)

    def is_armed(self, session: ScpiSession) -> bool:
        """Tell whether the trigger has become ready."""
        return bool(self._state(session) & TRIGGER_READY)

    def is_done(self, session: ScpiSession) -> bool:
        """Tell whether a signal has been acquired."""
        return bool(self._state(session) & SIGNAL_ACQUIRED)

    def record(self, session: ScpiSession, setting: ScopeSetting) -> ScopeRecord:
        """Read settings and bytes; what they say of times is checked, and too coarse to be used."""
        session.send("WFSU SP,1,NP,0,FP,0")
        (setup,) = session.ask("WFSU?")
        (division_v,) = numbers(session.ask("C1:VDIV?")[0], 1, "volts a division")
        (offset_v,) = numbers(session.ask("C1:OFST?")[0], 1, "offset")
        (rate_hz,) = numbers(session.ask("SARA?")[0], 1, "sample rate")
        times = self._times(setting)
        answers = session.ask(*(one.query for one in times))
        if not all(agrees(answer, one) for answer, one in zip(answers, times, strict=True)):
            raise CorruptData(f"the time base was changed: {'; '.join(answers)}")
        is_as_set = math.isclose(rate_hz * setting.interval_s, 1.0, rel_tol=_THREE_DIGITS)
        if setup.strip() != "SP,1,NP,0,FP,0" or not is_as_set or not division_v > 0:
            raise CorruptData(
                f"waveform setup {setup}, {rate_hz:g} Sa/s, {division_v:g} V a division: SP,1,NP,0,FP,0 and "
                f"{1 / setting.interval_s:g} Sa/s are due"
            )
        data = session.ask_block("C1:WF? DAT2", before="DAT2,")
        if len(data) != setting.points:
            raise CorruptData(f"{len(data)} points of a waveform: {setting.points} are due")
        half = self.model.code_count // 2
        step_v = division_v / CODES_A_DIVISION
        return ScopeRecord(
            (np.frombuffer(data, np.int8).astype(np.int16) + half).astype(np.uint16),
            volts_per_count=step_v,
            zero_code=half + offset_v / step_v,
            interval_s=setting.interval_s,
            first_s=setting.start_s,
        )

    def _division_v(self, setting: ScopeSetting) -> float:
        return setting.full_scale_v / self.model.code_count * CODES_A_DIVISION

    def _times(self, setting: ScopeSetting) -> tuple[Item, Item]:
        """Return what says when the record begins, and how far it reaches."""
        span_s = setting.points * setting.interval_s
        return _item("TDIV", span_s / self.model.divisions), _item("TRDL", setting.start_s + span_s / 2)

    def _state(self, session: ScpiSession) -> int:
        (state,) = numbers(session.ask("INR?")[0], 1, "internal state")
        return int(state)


def _item(header: str, value: str | float) -> Item:
    text = value if isinstance(value, str) else repr(value)
    return Item(f"{header} {text}", f"{header}?", value, _THREE_DIGITS)


def _kilo(points: int) -> str:
    return f"{points // 1000}K" if points < 1_000_000 else f"{points / 1e6:g}M"
