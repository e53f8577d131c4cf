"""Rigol oscilloscopes of the DS1000Z series with an external trigger input (their public programming guides).

The memory is read as bytes in pieces, at most 250 000 points each. The shot goes into the data of the SPI
trigger, an exact whole number of 32 bits that an edge trigger does not use. There is no register of trigger
events: a record is taken for new because the instrument was seen stopped before, waiting after the start,
and stopped again. Assumed: that nobody stops it by hand between these, or that it then holds no record.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import CorruptData, StaleData
from belahil.oscilloscopes import SCOPES, ScopeRecord
from drivers.oscilloscopes.dialect import Item, item, numbers

if TYPE_CHECKING:
    from belahil.oscilloscopes import ScopeSetting
    from drivers.scpi import ScpiSession

LARGEST_PIECE = 250_000
TRIGGER_LEVEL_V = 1.0
CODES_A_DIVISION = 25
_BYTE_FORMAT, _RAW_MODE = 0, 2


class RigolDialect:
    """The words of the family."""

    model = SCOPES["rigol-ds1000z"]
    known = re.compile(r"RIGOL TECHNOLOGIES,(DS|MSO)1\d{3}Z", re.IGNORECASE)
    stop = ":STOP"
    start = ":SING"
    force = ":TFOR"
    tells_errors = True

    def items(self, setting: ScopeSetting, identity: str) -> tuple[Item, ...]:
        """Return all that has to be set for a record; the memory depth is taken only while it runs."""
        span_s = setting.points * setting.interval_s
        depth = f":RUN;:ACQ:MDEP {setting.points};:STOP"
        return (
            item(":CHAN1:DISP", "1"),
            item(":CHAN1:PROB", 1.0),
            item(":CHAN1:COUP", "DC"),
            item(":CHAN1:BWL", "OFF"),
            item(":CHAN1:VERN", "1"),
            item(":CHAN1:SCAL", setting.full_scale_v / self.model.code_count * CODES_A_DIVISION),
            item(":CHAN1:OFFS", 0.0),
            item(":TIM:MODE", "MAIN"),
            item(":TRIG:MODE", "EDGE"),
            item(":TRIG:EDG:SOUR", "EXT"),
            item(":TRIG:EDG:SLOP", "POS"),
            item(":TRIG:EDG:LEV", TRIGGER_LEVEL_V),
            item(":TRIG:SWE", "SING"),
            item(":TRIG:SPI:WIDT", 32.0),
            item(":ACQ:TYPE", "NORM"),
            Item(depth, ":ACQ:MDEP?", float(setting.points)),
            item(":TIM:MAIN:SCAL", span_s / self.model.divisions),
            item(":TIM:MAIN:OFFS", setting.start_s + span_s / 2),
            item(":WAV:SOUR", "CHAN1"),
            item(":WAV:MODE", "RAW"),
            item(":WAV:FORM", "BYTE"),
        )

    def mark(self, shot: int) -> Item:
        """Return the shot as the data of a trigger that is not used."""
        return Item(f":TRIG:SPI:DATA {shot}", ":TRIG:SPI:DATA?", str(shot))

    def forget(self, session: ScpiSession) -> None:
        """See that it has stopped."""
        if self._status(session) != "STOP":
            raise StaleData("the oscilloscope was stopped and does not stop")

    def is_armed(self, session: ScpiSession) -> bool:
        """Tell whether it waits."""
        return self._status(session) == "WAIT"

    def is_done(self, session: ScpiSession) -> bool:
        """Tell whether it has stopped."""
        return self._status(session) == "STOP"

    def record(self, session: ScpiSession, setting: ScopeSetting) -> ScopeRecord:
        """Read preamble and bytes; its yorigin is in counts."""
        form, mode, _, _, step_s, first_s, first_at, step_v, origin, middle = numbers(
            session.ask(":WAV:PRE?")[0], 10, "preamble"
        )
        if (form, mode) != (_BYTE_FORMAT, _RAW_MODE) or not step_v > 0:
            raise CorruptData(
                f"preamble of format {form:g}, mode {mode:g} and {step_v:g} V a count: 0, 2 and more than 0 "
                "are due"
            )
        pieces = [
            self._piece(session, first, min(first + LARGEST_PIECE - 1, setting.points))
            for first in range(1, setting.points + 1, LARGEST_PIECE)
        ]
        return ScopeRecord(
            np.frombuffer(b"".join(pieces), np.uint8).astype(np.uint16),
            volts_per_count=step_v,
            zero_code=middle + origin,
            interval_s=step_s,
            first_s=first_s - first_at * step_s,
        )

    def _piece(self, session: ScpiSession, first: int, last: int) -> bytes:
        session.send(f":WAV:STAR {first}", f":WAV:STOP {last}")
        set_to = [int(float(answer)) for answer in session.ask(":WAV:STAR?", ":WAV:STOP?")]
        data = session.ask_block(":WAV:DATA?")
        if set_to != [first, last] or len(data) != last - first + 1:
            raise CorruptData(
                f"asked for points {first} to {last} of a waveform, {len(data)} came from {set_to[0]} on"
            )
        return data

    def _status(self, session: ScpiSession) -> str:
        return session.ask(":TRIG:STAT?")[0].strip().upper()
