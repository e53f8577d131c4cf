"""Tektronix oscilloscopes of the 4, 5 and 6 Series MSO (public programmer manuals).

Samples are signed words, the most significant byte first (``RIBinary``), left-justified. The instrument
counts its acquisitions since it was started, so that a record is of this start. The shot goes into the
label of the channel. Assumed: that the auxiliary input is there to trigger.
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

TRIGGER_LEVEL_V = 1.0
DIVISIONS_V = 10
_DESCRIPTION = ("XIN?", "XZE?", "YMU?", "YOF?", "YZE?", "NR_P?")


class TektronixDialect:
    """The words of the family."""

    model = SCOPES["tektronix-mso"]
    known = re.compile(r"TEKTRONIX,MSO[456]\d", re.IGNORECASE)
    stop = ":ACQ:STATE STOP"
    start = ":ACQ:STATE RUN"
    force = ":TRIG FORC"
    tells_errors = False

    def items(self, setting: ScopeSetting, identity: str) -> tuple[Item, ...]:
        """Return all that has to be set for a record."""
        span_s = setting.points * setting.interval_s
        return (
            # Both are on after a reset: words come in their long form, which is as good, and behind headers.
            Item(":VERB 0", "", ""),
            item(":HEAD", "0"),
            item(":SEL:CH1", "1"),
            item(":CH1:COUP", "DC"),
            # It answers in hertz, whatever that is of an instrument and its probe.
            Item(":CH1:BAN FUL", "", ""),
            item(":CH1:POS", 0.0),
            item(":CH1:OFFS", 0.0),
            item(":CH1:SCA", setting.full_scale_v / DIVISIONS_V),
            item(":HOR:MOD", "MANual"),
            item(":HOR:MOD:SAMPLER", 1 / setting.interval_s),
            item(":HOR:MOD:RECO", float(setting.points)),
            item(":HOR:DEL:MOD", "1"),
            item(":HOR:POS", 50.0),
            item(":HOR:DEL:TIM", setting.start_s + span_s / 2),
            item(":TRIG:A:TYP", "EDGE"),
            item(":TRIG:A:EDGE:SOU", "AUXiliary"),
            item(":TRIG:A:EDGE:SLO", "RISe"),
            item(":TRIG:AUXL", TRIGGER_LEVEL_V),
            item(":TRIG:A:MOD", "NORMal"),
            item(":ACQ:MOD", "SAMple"),
            item(":ACQ:STOPA", "SEQuence"),
            item(":DAT:SOU", "CH1"),
            item(":DAT:ENC", "RIBinary"),
            item(":WFMO:BYT_N", 2.0),
            item(":DAT:STAR", 1.0),
            item(":DAT:STOP", float(setting.points)),
        )

    def mark(self, shot: int) -> Item:
        """Return the shot as the label of the channel."""
        return Item(f':CH1:LAB:NAM "SHOT {shot}"', ":CH1:LAB:NAM?", f'"SHOT {shot}"')

    def forget(self, session: ScpiSession) -> None:
        """See that it has stopped; starting clears its count."""
        if session.ask(":ACQ:STATE?")[0].strip() != "0":
            raise StaleData("the oscilloscope was stopped and does not stop")

    def is_armed(self, session: ScpiSession) -> bool:
        """Tell whether all before the trigger is there, and it runs since the start with nothing acquired."""
        running, count, state = session.ask(":ACQ:STATE?", ":ACQ:NUMAC?", ":TRIG:STATE?")
        return (running.strip(), count.strip()) == ("1", "0") and state.strip().upper().startswith("REA")

    def is_done(self, session: ScpiSession) -> bool:
        """Tell whether it has stopped; then it has to count an acquisition since the start."""
        running, count = session.ask(":ACQ:STATE?", ":ACQ:NUMAC?")
        if running.strip() != "0":
            return False
        if count.strip() != "1":
            raise StaleData(f"the oscilloscope stopped without a trigger, after {count} acquisitions")
        return True

    def record(self, session: ScpiSession, setting: ScopeSetting) -> ScopeRecord:
        """Read the description and words; those of a converter of 12 bits end with four zeros."""
        step_s, first_s, step_v, middle, zero_v, points = numbers(
            ",".join(session.ask(*(f":WFMO:{one}" for one in _DESCRIPTION))), len(_DESCRIPTION), "description"
        )
        data = session.ask_block(":CURV?")
        if len(data) != 2 * points or not step_v > 0:
            raise CorruptData(
                f"{len(data)} bytes and {step_v:g} V a step with a description of {points:g} points: "
                "two bytes for each are due"
            )
        words = np.frombuffer(data, ">i2").astype(np.int32)
        finer = 1 << (16 - self.model.bits)
        if np.any(words % finer):
            raise CorruptData(f"words of a waveform that are no multiples of {finer}: was it averaged?")
        half = self.model.code_count // 2
        return ScopeRecord(
            (words // finer + half).astype(np.uint16),
            volts_per_count=step_v * finer,
            zero_code=half + (middle - zero_v / step_v) / finer,
            interval_s=step_s,
            first_s=first_s,
        )
