"""Keysight InfiniiVision oscilloscopes, 1000 to 4000 X-Series (their public programmer's guides).

The level of the external trigger is ``:EXTernal:LEVel`` on the 1000 X-Series, as public drivers of DSOX1200
have it; the guides of the larger series have no such header, but name the source behind an edge's level.

``:DIGitize`` would hold the instrument's parser until the trigger comes, so that nobody could learn that it
is armed before the generator is triggered; ``:SINGle`` with the arm event register tells.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import CorruptData, StaleData
from belahil.oscilloscopes import SCOPES, ScopeRecord
from drivers.oscilloscopes.dialect import Item, item, numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.oscilloscopes import ScopeSetting
    from drivers.scpi import ScpiSession

RUN_BIT = 1 << 3
LABEL_CHARACTERS = 10
TRIGGER_LEVEL_V = 1.0
"""Of the external input: between the levels of a generator's trigger output."""
_SMALL = re.compile(r"[^,]*,[DM]SO-?X ?1\d{3}", re.IGNORECASE)
_CLIPPED_BELOW, _CLIPPED_ABOVE = 1, 0xFFFF
_WORD_FORMAT, _NORMAL_TYPE = 1, 0


class InfiniiVisionDialect:
    """The words of the family."""

    model = SCOPES["keysight-infiniivision"]
    known = re.compile(r"(KEYSIGHT|AGILENT) TECHNOLOGIES,[DM]SO-?X ?[1-4]\d{3}", re.IGNORECASE)
    stop = ":STOP"
    start = ":SING"
    force = ":TRIG:FORC"
    tells_errors = True

    def items(self, setting: ScopeSetting, identity: str) -> tuple[Item, ...]:
        """Return all that has to be set for a record; input resistance and coupling of the trigger stay."""
        span_s = setting.points * setting.interval_s
        return (
            item(":CHAN1:DISP", "1"),
            item(":CHAN1:PROB", 1.0),
            item(":CHAN1:COUP", "DC"),
            item(":CHAN1:BWL", "0"),
            item(":CHAN1:RANG", setting.full_scale_v),
            item(":CHAN1:OFFS", 0.0),
            item(":TIM:MODE", "MAIN"),
            item(":TIM:REF", "CENT"),
            item(":TIM:RANG", span_s),
            item(":TIM:POS", setting.start_s + span_s / 2),
            item(":TRIG:MODE", "EDGE"),
            item(":TRIG:SWE", "NORM"),
            item(":TRIG:EDGE:SOUR", "EXT"),
            item(":TRIG:EDGE:SLOP", "POS"),
            _level_item(identity),
            item(":ACQ:TYPE", "NORM"),
            item(":WAV:SOUR", "CHAN1"),
            item(":WAV:FORM", "WORD"),
            item(":WAV:BYT", "LSBF"),
            item(":WAV:UNS", "1"),
            item(":WAV:POIN:MODE", "RAW"),
            item(":WAV:POIN", float(setting.points)),
        )

    def mark(self, shot: int) -> Item:
        """Return the shot as the label of the channel: of its ten characters a large shot needs all."""
        label = f'"{f"S{shot}"[-LABEL_CHARACTERS:]}"'
        return Item(f":CHAN1:LAB {label}", ":CHAN1:LAB?", label)

    def forget(self, session: ScpiSession) -> None:
        """Read the arm and the trigger event register, which clears them."""
        session.ask(":AER?", ":TER?")

    def is_armed(self, session: ScpiSession) -> bool:
        """Tell whether the arm event register is set."""
        return session.ask(":AER?")[0].strip("+") == "1"

    def is_done(self, session: ScpiSession) -> bool:
        """Tell whether the run bit is clear; then the trigger event register has to be set."""
        (condition,) = numbers(session.ask(":OPER:COND?")[0], 1, "operation condition")
        if int(condition) & RUN_BIT:
            return False
        if session.ask(":TER?")[0].strip("+") != "1":
            raise StaleData("the oscilloscope stopped without a trigger: what it holds is older")
        return True

    def record(self, session: ScpiSession, setting: ScopeSetting) -> ScopeRecord:
        """Read preamble and words; words of a converter of eight bits end with eight zeros."""
        form, kind, points, _, step_s, first_s, first_at, step_v, middle_v, middle = numbers(
            session.ask(":WAV:PRE?")[0], 10, "preamble"
        )
        if (form, kind) != (_WORD_FORMAT, _NORMAL_TYPE):
            raise CorruptData(f"preamble of format {form:g} and type {kind:g}: 1 and 0 were set")
        data = session.ask_block(":WAV:DATA?")
        if len(data) != 2 * points or not step_v > 0:
            raise CorruptData(
                f"{len(data)} bytes and {step_v:g} V a step with a preamble of {points:g} points: "
                "two bytes for each are due"
            )
        return ScopeRecord(
            _codes(np.frombuffer(data, "<u2")),
            volts_per_count=step_v * 256,
            zero_code=(middle - middle_v / step_v) / 256,
            interval_s=step_s,
            first_s=first_s - first_at * step_s,
        )


def _level_item(identity: str) -> Item:
    if _SMALL.match(identity):
        return item(":EXT:LEV", TRIGGER_LEVEL_V)
    return Item(f":TRIG:EDGE:LEV {TRIGGER_LEVEL_V},EXT", ":TRIG:EDGE:LEV? EXT", TRIGGER_LEVEL_V)


def _codes(words: NDArray[np.uint16]) -> NDArray[np.uint16]:
    codes = words >> np.uint16(8)
    codes[words == _CLIPPED_BELOW] = 1
    finer = (words & 0xFF != 0) & (words != _CLIPPED_BELOW) & (words != _CLIPPED_ABOVE)
    if finer.any():
        raise CorruptData(
            f"word {int(words[finer][0])} of a waveform: the words of an 8-bit converter are multiples of 256"
        )
    return codes.astype(np.uint16)
