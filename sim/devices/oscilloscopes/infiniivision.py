"""A Keysight InfiniiVision oscilloscope of the 1000 to 4000 X-Series, as messages make it appear.

Formats, special codes and registers are those of the public programmer's guides of these series. Assumed:
how many digits its numbers have, that a screen of eight divisions spans all 256 codes, and what :SRATe
answers.

What this does not model: a message that waits (``:DIGitize`` arms like ``:SINGle``, and takes a record at
once with the sweep AUTO), and trigger sources other than the external one, where the generator is
connected. Remembered and told alone: averages, peaks and probes. With an inverted channel or segmented
memory no record is taken, and error -221 tells of it. Also not here: measurements, ``:AUToscale``, setups
and pictures. What ``:CHANnel?`` and ``:TIMebase?`` answer has the words of public drivers that read it.
Only an instrument of the 1000 X-Series has ``:EXTernal:LEVel``; assumed: and the external level nowhere
else.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from sim.devices.generator_settings import Number, Switch, Word
from sim.devices.oscilloscopes.acquisition import (
    ScopeDevice,
    ScopeFront,
    ScopePort,
    Sources,
    block,
    quoted,
    shot_in,
)
from sim.devices.scpi.numeric import SECOND, VOLT, answer_number, read_number
from sim.devices.scpi.parameters import Choices, read_name, read_within
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.values import RangeWindow

RUN_BIT = 1 << 3
DIVISIONS = 8
DIVISIONS_S = 10
LONGEST_LABEL = 10
_SHORT = (100, 250, 500)
"""Points of records that are too short for windows."""
_SMALL = re.compile(r"DSOX1\d{3}")
_SHOT = re.compile(r"SHOT (\d+)|S(\d+)|(\d{10})")
_EDGE = Choices("POSitive", "NEGative", "EITHer", "ALTernate")
_SOURCES = Sources("EXTernal", "LINE", "WGEN")
_EXTERNAL_LEVEL = Number("EXTernal:LEVel", "external_v", VOLT, -8.0, 8.0, 0.0)
"""Of the 1000 X-Series alone (public drivers); the larger ones know none (their guides)."""

_SETTINGS = (
    Switch("CHANnel#:DISPlay", "display"),
    Word("CHANnel#:COUPling", "coupling", Choices("AC", "DC")),
    Word("CHANnel#:IMPedance", "impedance", Choices("ONEMeg", "FIFTy")),
    Switch("CHANnel#:BWLimit", "bandwidth_limit"),
    Switch("CHANnel#:INVert", "inverted"),
    Number("CHANnel#:PROBe", "probe", None, 0.1, 1e4, 1.0),
    Number("CHANnel#:RANGe", "range_v", VOLT, 4e-3, 80.0, 8.0),
    Number("CHANnel#:OFFSet", "offset_v", VOLT, -500.0, 500.0, 0.0),
    Word("TIMebase:MODE", "timebase", Choices("MAIN", "WINDow", "XY", "ROLL")),
    Word("TIMebase:REFerence", "reference", Choices("LEFT", "CENTer", "RIGHt")),
    Number("TIMebase:RANGe", "span_s", SECOND, 20e-9, 500.0, 1e-3),
    Number("TIMebase:POSition", "position_s", SECOND, -500.0, 500.0, 0.0),
    Number("TIMebase:DELay", "position_s", SECOND, -500.0, 500.0, 0.0),
    Word("TRIGger:MODE", "trigger_mode", Choices("EDGE", "GLITch", "PATTern", "TV", "TIMeout")),
    Word("TRIGger:SWEep", "sweep", Choices("AUTO", "NORMal")),
    Word("TRIGger[:EDGE]:SOURce", "trigger_source", _SOURCES),
    Word("TRIGger[:EDGE]:SLOPe", "trigger_slope", _EDGE),
    Word("ACQuire:TYPE", "acquisition", Choices("NORMal", "AVERage", "HRESolution", "PEAK")),
    Number("ACQuire:COUNt", "averages", None, 2.0, 65536.0, 8.0, step=1.0),
    Word("ACQuire:MODE", "memory_mode", Choices("RTIMe", "SEGMented")),
    Word("WAVeform:SOURce", "source", _SOURCES),
    Word("WAVeform:FORMat", "format", Choices("BYTE", "WORD", "ASCii")),
    Word("WAVeform:BYTeorder", "byte_order", Choices("LSBFirst", "MSBFirst")),
    Switch("WAVeform:UNSigned", "unsigned"),
    Word("WAVeform:POINts:MODE", "points_mode", Choices("NORMal", "MAXimum", "RAW")),
)
_OTHER_WORDS = (
    Number("CHANnel#:SCALe", "scale_v", VOLT, 5e-4, 10.0, 1.0),
    Number("TIMebase:SCALe", "scale_s", SECOND, 2e-9, 50.0, 1e-4),
)
"""For what is set already: by the division."""


class InfiniiVision(ScopeDevice):
    """One oscilloscope; its first channel and its external trigger are connected.

    Parameters
    ----------
    port, front
        See `ScopeDevice`.
    """

    kept_fields = (
        *dict.fromkeys(setting.field for setting in _SETTINGS),
        *("levels_v", "external_v", "label", "points"),
    )

    def __init__(self, port: ScopePort, front: ScopeFront) -> None:
        super().__init__(port, front)
        self._set_defaults()
        for setting in (*_SETTINGS, *_OTHER_WORDS):
            setting.enter(self.tree, lambda call: self)
        if _SMALL.match(self.model.name):
            _EXTERNAL_LEVEL.enter(self.tree, lambda call: self)
        self._add_commands()

    def _set_defaults(self) -> None:
        self.probe, self.range_v, self.offset_v, self.span_s = 1.0, 8.0, 0.0, 1e-3
        self.position_s = self.external_v = 0.0
        self.levels_v: dict[str, float] = {}
        self.display, self.bandwidth_limit, self.unsigned = True, False, True
        self.coupling, self.impedance, self.label = "DC", "ONEM", "1"
        self.inverted, self.averages, self.memory_mode = False, 8.0, "RTIM"
        self.timebase, self.reference = "MAIN", "CENT"
        self.trigger_mode, self.sweep, self.trigger_source, self.trigger_slope = (
            "EDGE",
            "AUTO",
            "CHAN1",
            "POS",
        )
        self.acquisition, self.source, self.format, self.byte_order = "NORM", "CHAN1", "BYTE", "MSBF"
        self.points_mode, self.points = "NORM", 1000
        self.armed_event = self.trigger_event = False

    @property
    def scale_v(self) -> float:
        """Volts of one division."""
        return self.range_v / DIVISIONS

    @scale_v.setter
    def scale_v(self, scale_v: float) -> None:
        self.range_v = scale_v * DIVISIONS

    @property
    def scale_s(self) -> float:
        """Seconds of one division."""
        return self.span_s / DIVISIONS_S

    @scale_s.setter
    def scale_s(self, scale_s: float) -> None:
        self.span_s = scale_s * DIVISIONS_S

    def reset(self) -> None:
        """Bring all settings to their defaults and stop."""
        self.halt()
        self._set_defaults()

    def shot(self) -> int | None:
        """Return the number in the label of the first channel."""
        found = _SHOT.fullmatch(self.label)
        return shot_in(found[1] or found[2] or found[3]) if found else None

    def view(self) -> tuple[float, float, float, float, int]:
        """Return what the screen shows: its record has as many points as are asked for."""
        if self.inverted or self.memory_mode != "RTIM":
            raise ScpiError(-221, "not emulated: an inverted channel, segmented memory")
        # Of the screen, what is left of the reference; a division from either edge, else the middle.
        before = {"LEFT": 0.1, "CENT": 0.5, "RIGH": 0.9}[self.reference]
        interval_s = self.interval_over(self.span_s, self.points)
        start_s = self.position_s - before * interval_s * self.points
        return self.range_v, self.offset_v, interval_s, start_s, self.points

    def acquired(self) -> None:
        """Set the trigger event register."""
        self.trigger_event = True

    def _single(self, call: Call) -> None:
        self.start(at_once=self.sweep == "AUTO")
        self.armed_event = True

    def _force(self, call: Call) -> None:
        self.force()

    def _stop(self, call: Call) -> None:
        self.halt()

    def _take_armed(self, call: Call) -> str:
        taken, self.armed_event = self.armed_event, False
        return str(int(taken))

    def _take_triggered(self, call: Call) -> str:
        self.record()
        taken, self.trigger_event = self.trigger_event, False
        return str(int(taken))

    def _condition(self, call: Call) -> str:
        self.record()
        return f"{RUN_BIT if self.is_armed else 0:+d}"

    def _set_label(self, call: Call) -> None:
        self.label = read_name(call.parameters[0])[:LONGEST_LABEL]

    def _set_points(self, call: Call) -> None:
        asked, lengths = read_number(call.parameters[0]).value, (*_SHORT, *self.model.record_lengths)
        if not lengths[0] <= asked <= lengths[-1]:
            raise ScpiError(-222, f"{lengths[0]} to {lengths[-1]}")
        self.points = min(lengths, key=lambda one: abs(one - asked))

    def _level_source(self, call: Call, at: int) -> str:
        """Return whose level is meant: the trigger's, unless one is named."""
        source = _SOURCES.read(call.parameters[at]) if len(call.parameters) > at else self.trigger_source
        if source in ("LINE", "WGEN") or (source == "EXT" and _SMALL.match(self.model.name)):
            raise ScpiError(-221, f"no level of {source} is set here")
        return source

    def _set_level(self, call: Call) -> None:
        source = self._level_source(call, 1)
        volts = read_within(call.parameters[0], VOLT, -8.0, 8.0, 0.0, self.report)
        self.levels_v = {**self.levels_v, source: volts}

    def _tell_level(self, call: Call) -> str:
        return answer_number(self.levels_v.get(self._level_source(call, 0), 0.0))

    def _held(self) -> RangeWindow:
        record = self.record()
        if record is None or self.source != "CHAN1":
            raise ScpiError(-230, "no waveform data")
        return record

    def _channel(self, call: Call) -> str:
        volts = f"RANG {answer_number(self.range_v)};OFFS {answer_number(self.offset_v)}"
        switches = f"DISP {self.display:d};BWL {self.bandwidth_limit:d};INV {self.inverted:d}"
        probe = f"UNIT VOLT;PROB {answer_number(self.probe)};PROB:SKEW +0.00E+00;STYP SING"
        inputs = f"COUP {self.coupling};IMP {self.impedance}"
        return f":CHAN{call.suffixes[0]}:{volts};{inputs};{switches};LAB {quoted(self.label)};{probe}"

    def _timebase(self, call: Call) -> str:
        times = f"MAIN:RANG {answer_number(self.span_s)};POS {answer_number(self.position_s)}"
        return f":TIM:MODE {self.timebase};REF {self.reference};{times}"

    def _preamble(self, call: Call) -> str:
        return ",".join(self._described().values())

    def _field(self, name: str) -> Callable[[Call], str]:
        return lambda call: self._described()[name]

    def _described(self) -> dict[str, str]:
        """Return the fields of the preamble, as the format has them."""
        record = self._held()
        steps = 256 if self.format == "WORD" else 1
        middle_v = (self.model.zero_code - record.zero_count) * record.volts_per_count
        first_s = record.start_s + record.housekeeping["trigger_phase_s"]
        return {
            "format": f"{ ({'BYTE': 0, 'WORD': 1, 'ASC': 4}[self.format]):+d}",
            "type": "+0",
            "points": f"{record.counts.size:+d}",
            "count": "+1",
            "XINCrement": _told(record.sample_interval_s, self.model.time_digits),
            "XORigin": _told(first_s, self.model.time_digits),
            "XREFerence": "+0",
            "YINCrement": _told(record.volts_per_count / steps, self.model.volt_digits),
            "YORigin": _told(middle_v, self.model.volt_digits),
            "YREFerence": f"{self.model.zero_code * steps if self.unsigned else 0:+d}",
        }

    def _data(self, call: Call) -> str:
        record = self._held()
        codes = record.counts
        if self.format == "ASC":
            volts = (codes - record.zero_count) * record.volts_per_count
            return block(",".join(f"{volt:.5E}" for volt in volts).encode(), 8)
        if not self.unsigned:
            codes = codes - self.model.zero_code
        if self.format == "BYTE":
            return block(codes.astype(np.uint8).tobytes(), 8)
        words = (codes.astype(np.int32) * 256) & 0xFFFF
        if self.unsigned:
            words[record.counts == self.model.lowest_code] = 1
            words[record.counts == self.model.top_code] = 0xFFFF
        return block(words.astype("<u2" if self.byte_order == "LSBF" else ">u2").tobytes(), 8)

    def _add_commands(self) -> None:
        add = self.tree.add
        add("CHANnel#", query=Action(self._channel))
        add("TIMebase", query=Action(self._timebase))
        add("SYSTem:PRESet", Action(lambda call: self.reset()))
        add("SINGle", Action(self._single))
        add("DIGitize", Action(self._single, 0, 4))
        add("STOP", Action(self._stop))
        add("RUN", Action(self._single))
        add("TRIGger:FORCe", Action(self._force))
        add("TRIGger[:EDGE]:LEVel", Action(self._set_level, 1, 2), Action(self._tell_level, 0, 1))
        add("AER", query=Action(self._take_armed))
        add("TER", query=Action(self._take_triggered))
        add("OPERegister:CONDition", query=Action(self._condition))
        add("CHANnel#:LABel", Action(self._set_label, 1, 1), Action(lambda call: quoted(self.label)))
        add("WAVeform:POINts", Action(self._set_points, 1, 1), Action(lambda call: f"{self.points:+d}"))
        add("WAVeform:PREamble", query=Action(self._preamble))
        add("WAVeform:DATA", query=Action(self._data))
        for name in ("XINCrement", "XORigin", "XREFerence", "YINCrement", "YORigin", "YREFerence"):
            add(f"WAVeform:{name}", query=Action(self._field(name)))
        rate = Action(lambda call: _told(1 / self.interval_over(self.span_s, self.points), 9))
        add("ACQuire:SRATe", query=rate)
        add("ACQuire:POINts", query=Action(lambda call: f"{self.points:+d}"))


def _told(value: float, digits: int) -> str:
    return f"{value:+.{digits - 1}E}"
