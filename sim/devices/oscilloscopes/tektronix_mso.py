"""A Tektronix oscilloscope of the 5 Series MSO, as messages make it appear.

Words, states and the meaning of the waveform's description are those of public programmer manuals. After a
reset an answer repeats its header (``HEADer``), and both are in their long form (``VERBose``). Assumed: how
many digits its numbers have, that ten divisions span all codes, its bandwidth, that ``*RST`` switches both
on, that it has an auxiliary input, that the scale of time changes the sample rate and leaves the record as
long as it is, and that ``ALLEv?`` tells errors without ``*ESR?`` before it.

Remembered and told alone: averages, the attenuation before a probe, levels of channels as the trigger. What
this does not model: measurements, files, pictures of the screen, other encodings than ``RIBinary`` and
``RPBinary``, bandwidth limits, and other triggers than the auxiliary input.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from sim.devices.generator_settings import Number, Switch, Word
from sim.devices.oscilloscopes.acquisition import ScopeDevice, ScopeFront, ScopePort, block, quoted, shot_in
from sim.devices.scpi.numeric import HERTZ, PERCENT, SECOND, VOLT, answer_number, read_number
from sim.devices.scpi.parameters import Choices, read_name, read_within
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call, Handler, header_of

if TYPE_CHECKING:
    from belahil.values import RangeWindow

DIVISIONS_V = 10
LONGEST_LABEL = 32
"""Characters; assumed."""
DIVISIONS_S = 10
BANDWIDTH_HZ = 5e8
LEAST_RATE_HZ, MOST_RATE_HZ = 1.0, 3.125e9
_SOURCES = Choices("CH1", "CH2", "CH3", "CH4", "AUXiliary", "LINE")
_NO_EVENT = '0,"No events to report; queue empty"'
_STATES = Choices("ARMed", "AUTO", "READy", "SAVe", "TRIGger")
_SETTINGS = (
    Switch("HEADer", "headers"),
    Switch("VERBose", "verbose"),
    Switch("SELect:CH#", "display"),
    Word("CH#:COUPling", "coupling", Choices("AC", "DC")),
    Number("CH#:POSition", "position_divisions", None, -5.0, 5.0, 0.0),
    Number("CH#:OFFSet", "offset_v", VOLT, -100.0, 100.0, 0.0),
    Number("CH#:SCAle", "scale_v", VOLT, 5e-4, 10.0, 0.1),
    Word("HORizontal:MODe", "horizontal", Choices("AUTO", "MANual")),
    Number("HORizontal:MODe:SAMPLERate", "rate_hz", HERTZ, LEAST_RATE_HZ, MOST_RATE_HZ, MOST_RATE_HZ),
    Number("HORizontal:SAMPLERate", "rate_hz", HERTZ, LEAST_RATE_HZ, MOST_RATE_HZ, MOST_RATE_HZ),
    Number("HORizontal:MODe:RECOrdlength", "points", None, 1000.0, 10e6, 10000.0, step=1.0),
    Number("HORizontal:RECOrdlength", "points", None, 1000.0, 10e6, 10000.0, step=1.0),
    Switch("HORizontal:DELay:MODe", "is_delayed"),
    Number("HORizontal:POSition", "position_percent", PERCENT, 0.0, 100.0, 50.0),
    Number("HORizontal:DELay:TIMe", "delay_s", SECOND, -5000.0, 5000.0, 0.0),
    Word("TRIGger:A:TYPe", "trigger_type", Choices("EDGE", "WIDth", "TIMEOut", "RUNt", "LOGIc")),
    Word("TRIGger:A:EDGE:SOUrce", "trigger_source", _SOURCES),
    Word("TRIGger:A:EDGE:SLOpe", "trigger_slope", Choices("RISe", "FALL", "EITher")),
    Number("TRIGger:AUXLevel", "trigger_v", VOLT, -8.0, 8.0, 0.0),
    Word("TRIGger:A:MODe", "trigger_mode", Choices("AUTO", "NORMal")),
    Word("ACQuire:MODe", "acquisition", Choices("SAMple", "PEAKdetect", "HIRes", "AVErage", "ENVelope")),
    Number("ACQuire:NUMAVg", "averages", None, 2.0, 10240.0, 16.0, step=1.0),
    Number("CH#:PROBEFunc:EXTAtten", "outer_attenuation", None, 1e-10, 1e10, 1.0),
    Word("ACQuire:STOPAfter", "stop_after", Choices("RUNSTop", "SEQuence")),
    Word("DATa:SOUrce", "source", _SOURCES),
    Word("DATa:ENCdg", "encoding", Choices("RIBinary", "RPBinary")),
    Number("WFMOutpre:BYT_Nr", "word_bytes", None, 1.0, 2.0, 1.0, step=1.0),
    Number("DATa:STARt", "first", None, 1.0, 10e6, 1.0, step=1.0),
    Number("DATa:STOP", "last", None, 1.0, 10e6, 10000.0, step=1.0),
)
_SCALE = Number("HORizontal:SCAle", "scale_s", SECOND, 1e-10, 1000.0, 320e-9)


class TektronixScope(ScopeDevice):
    """One oscilloscope; its first channel and its auxiliary trigger are connected.

    Parameters
    ----------
    port, front
        See `ScopeDevice`.
    """

    kept_fields = (*(setting.field for setting in _SETTINGS), "label", "levels_v")

    def __init__(self, port: ScopePort, front: ScopeFront) -> None:
        super().__init__(port, front)
        self._set_defaults()
        common = set(self.tree.actions)
        for setting in (*_SETTINGS, _SCALE):
            counts = isinstance(setting, Number) and setting.step == 1
            setting.enter(self.tree, lambda call: self, _whole if counts else answer_number)
        self._add_commands()
        self._dress_answers(common)

    def _set_defaults(self) -> None:
        self.headers = self.verbose = self.display = self.is_delayed = True
        self.coupling, self.label = "DC", ""
        self.position_divisions, self.offset_v, self.scale_v = 0.0, 0.0, 0.1
        self.horizontal, self.rate_hz, self.points = "AUTO", MOST_RATE_HZ, 10000.0
        self.averages, self.outer_attenuation = 16.0, 1.0
        self.levels_v: dict[int, float] = {}
        self.position_percent, self.delay_s = 50.0, 0.0
        self.trigger_type, self.trigger_source, self.trigger_slope = "EDGE", "CH1", "RIS"
        self.trigger_v, self.trigger_mode = 0.0, "AUTO"
        self.acquisition, self.stop_after = "SAM", "RUNST"
        self.source, self.encoding, self.word_bytes = "CH1", "RIB", 1.0
        self.first, self.last = 1.0, 10000.0
        self.acquisitions = 0

    @property
    def scale_s(self) -> float:
        """Seconds of one of ten divisions; a record at the highest rate reaches beyond a shorter screen."""
        return self.points / self.rate_hz / DIVISIONS_S

    @scale_s.setter
    def scale_s(self, scale_s: float) -> None:
        rate_hz = self.points / (DIVISIONS_S * scale_s)
        self.rate_hz = min(max(rate_hz, LEAST_RATE_HZ), MOST_RATE_HZ)

    def reset(self) -> None:
        """Bring all settings to their defaults and stop."""
        self.halt()
        self._set_defaults()

    def shot(self) -> int | None:
        """Return the number in the label of the first channel."""
        number = self.label.removeprefix("SHOT ")
        return shot_in(number) if number != self.label else None

    def view(self) -> tuple[float, float, float, float, int]:
        """Return what the record length and the sample rate say."""
        interval_s, points = 1 / self.rate_hz, int(self.points)
        span_s = interval_s * points
        start_s = self.delay_s - span_s / 2 if self.is_delayed else -span_s * self.position_percent / 100
        middle_v = self.offset_v - self.position_divisions * self.scale_v
        return DIVISIONS_V * self.scale_v, middle_v, interval_s, start_s, points

    def acquired(self) -> None:
        """Count it."""
        self.acquisitions += 1

    def _set_state(self, call: Call) -> None:
        word = call.parameters[0].text.upper()
        if word not in ("RUN", "STOP", "ON", "OFF", "0", "1"):
            raise ScpiError(-224, word)
        if word in ("RUN", "ON", "1"):
            self.acquisitions = 0
            self.start(at_once=self.trigger_mode == "AUTO")
        else:
            self.halt()

    def _state(self, call: Call) -> str:
        self.record()
        return "1" if self.is_armed else "0"

    def _count(self, call: Call) -> str:
        self.record()
        return str(self.acquisitions)

    def _trigger_state(self, call: Call) -> str:
        self.record()
        return "READ" if self.is_armed else "SAV"

    def _set_bandwidth(self, call: Call) -> None:
        token = call.parameters[0]
        if token.kind == "character":
            Choices("FULl").read(token)
        else:
            read_number(token, HERTZ)

    def _set_level(self, call: Call) -> None:
        volts = read_within(call.parameters[0], VOLT, -100.0, 100.0, 0.0, self.report)
        self.levels_v = {**self.levels_v, call.suffixes[0]: volts}

    def _tell_level(self, call: Call) -> str:
        return answer_number(self.levels_v.get(call.suffixes[0], 0.0))

    def _all_events(self, call: Call) -> str:
        return self.status.all_errors() if self.status.errors else _NO_EVENT

    def _set_label(self, call: Call) -> None:
        self.label = read_name(call.parameters[0])[:LONGEST_LABEL]

    def _force(self, call: Call) -> None:
        self.force()

    def _held(self) -> RangeWindow:
        record = self.record()
        if record is None or self.source != "CH1":
            raise ScpiError(2244, "Waveform requested is not active")
        return record

    def _steps(self) -> int:
        """Return the steps of a word in one code."""
        return 1 << (round(8 * self.word_bytes) - self.model.bits) if self.word_bytes == 2 else 1

    def _described(self, name: str) -> str:
        record = self._held()
        volts, time = self.model.volt_digits - 1, self.model.time_digits - 1
        middle_v = (self.model.zero_code - record.zero_count) * record.volts_per_count
        first_s = record.start_s + record.housekeeping["trigger_phase_s"]
        count = min(int(self.last), record.counts.size) - int(self.first) + 1
        return {
            "XINcr": f"{record.sample_interval_s:.{time}E}",
            "XZEro": f"{first_s + (int(self.first) - 1) * record.sample_interval_s:.{time}E}",
            "YMUlt": f"{record.volts_per_count / self._steps():.{volts}E}",
            "YOFf": "0.0E+0",
            "YZEro": f"{middle_v:.{volts}E}",
            "NR_Pt": str(count),
            "PT_Off": "0",
            "BYT_Or": "MSB",
            "BN_Fmt": "RI" if self.encoding == "RIB" else "RP",
        }[name]

    def _curve(self, call: Call) -> str:
        record = self._held()
        codes = record.counts[int(self.first) - 1 : int(self.last)].astype(np.int32)
        if self.encoding == "RIB":
            codes -= self.model.code_count // 2
        if self.word_bytes == 1:
            return block(((codes >> (self.model.bits - 8)) & 0xFF).astype(np.uint8).tobytes())
        words = (codes * self._steps()) & 0xFFFF
        return block(words.astype(">u2").tobytes())

    def _field(self, name: str) -> Callable[[Call], str]:
        return lambda call: self._described(name)

    def _add_commands(self) -> None:
        add = self.tree.add
        add("ACQuire:STATE", Action(self._set_state, 1, 1), Action(self._state))
        add("ACQuire:NUMACq", query=Action(self._count))
        add("ALLEv", query=Action(self._all_events))
        add("TRIGger:A:LEVel:CH#", Action(self._set_level, 1, 1), Action(self._tell_level))
        add("CH#:BANdwidth", Action(self._set_bandwidth, 1, 1), Action(lambda call: f"{BANDWIDTH_HZ:.4E}"))
        add("TRIGger", Action(self._force, 1, 1))
        add("TRIGger:STATE", query=Action(self._trigger_state))
        add("CH#:LABel:NAMe", Action(self._set_label, 1, 1), Action(lambda call: quoted(self.label)))
        for name in ("XINcr", "XZEro", "YMUlt", "YOFf", "YZEro", "NR_Pt", "PT_Off", "BYT_Or", "BN_Fmt"):
            add(f"WFMOutpre:{name}", query=Action(self._field(name)))
        add("CURVe", query=Action(self._curve))
        add("BUSY", query=Action(self._state))

    def _dress_answers(self, common: set[str]) -> None:
        """Give every answer but those of the common headers the form that HEADer and VERBose ask for."""
        words = {setting.header: setting.choices for setting in _SETTINGS if isinstance(setting, Word)}
        words["TRIGger:STATE"] = _STATES
        for pattern, (command, query) in tuple(self.tree.actions.items()):
            if query and pattern not in common:
                dressed = self._dressed(pattern, query.run, words.get(pattern))
                self.tree.add(pattern, command, query._replace(run=dressed))

    def _dressed(self, pattern: str, run: Handler, words: Choices | None) -> Handler:
        def answer(call: Call) -> str | None:
            said = run(call)
            if words and said and self.verbose:
                said = words.full(said)
            if not self.headers:
                return said
            return f":{header_of(pattern, call.suffixes, self.verbose)} {said}"

        return answer


def _whole(count: float) -> str:
    return f"{count:.0f}"
