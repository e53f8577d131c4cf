"""A Siglent oscilloscope of the SDS1000X-E series, as its older messages make it appear.

Words and the internal state register are those of the public programming guide. Assumed: how answers
without headers are spelt, the codes of ``CMR?`` and ``EXR?`` for errors that the guide does not tell apart,
that the first point of the waveform setup takes any whole number, and that the trigger delay, which is
positive for later times, is about the middle of the screen.

What this does not model: answers with headers (``CHDR SHORT`` and ``LONG`` are taken and not followed),
sparse waveforms, and other triggers than the external one. Averages, unit and skew, and level, slope and
coupling of a channel as the trigger are remembered and told alone; measurements (``PAVA?``) and pictures
(``SCDP``) are not here.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from sim.devices.generator_settings import Number, Word
from sim.devices.oscilloscopes.acquisition import LARGEST_SHOT, ScopeDevice, ScopeFront, ScopePort, block
from sim.devices.scpi.numeric import SECOND, VOLT
from sim.devices.scpi.parameters import Choices, read_integer
from sim.devices.scpi.parser import Token, Unit
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Branch, Call, Found

TRIGGER_READY, SIGNAL_ACQUIRED = 1 << 13, 1
CODES_A_DIVISION = 25
_DEPTH = re.compile(r"(\d+(?:\.\d+)?)([KM])", re.IGNORECASE)
_WORD = re.compile(r"[A-Z0-9.+-]{1,16}", re.IGNORECASE | re.ASCII)
_CHANNELS = ("C1", "C2", "C3", "C4")
_FACTORS = {"K": 1000, "M": 1_000_000}
_LARGEST_POINT = LARGEST_SHOT + 1
_SLOPES = Choices("POS", "NEG", "WINDOW")
_ACQUISITIONS = Choices("SAMPLING", "PEAK_DETECT", "AVERAGE", "HIGH_RES")
_AVERAGES = (4, 16, 32, 64, 128, 256, 512, 1024)
# What the registers tell of an error in the queue (a public driver lists them); else the last of each.
_COMMAND_CODES = {-113: 1, -101: 2, -103: 3, -109: 4, -141: 5, -151: 6, -108: 7, -114: 1}
_EXECUTION_CODES = {-221: 22, -222: 25, -224: 25}
_OTHER_COMMAND, _OTHER_EXECUTION = 12, 21
_WORDS = (
    Word("CHDR", "headers", Choices("OFF", "SHORT", "LONG")),
    Word("C#:TRA", "trace", Choices("ON", "OFF")),
    Word("C#:UNIT", "unit", Choices("V", "A")),
    Word("C#:INVS", "inverted", Choices("OFF", "ON")),
    Word("C#:TRCP", "trigger_coupling", Choices("AC", "DC", "HFREJ", "LFREJ")),
    Word("C#:CPL", "coupling", Choices("A1M", "D1M", "GND")),
    Word("EX:TRSL", "trigger_slope", _SLOPES),
    Word("C#:TRSL", "channel_slope", _SLOPES),
    Word("TRMD", "trigger_mode", Choices("AUTO", "NORM", "SINGLE", "STOP")),
)
_NUMBERS = (
    Number("C#:ATTN", "probe", None, 0.1, 10000.0, 1.0),
    Number("C#:VDIV", "division_v", VOLT, 5e-4, 10.0, 1.0),
    Number("C#:OFST", "offset_v", VOLT, -100.0, 100.0, 0.0),
    Number("TDIV", "division_s", SECOND, 1e-9, 100.0, 1e-6),
    Number("TRDL", "delay_s", SECOND, -5000.0, 5000.0, 0.0),
    Number("C#:SKEW", "skew_s", SECOND, -1e-7, 1e-7, 0.0),
    Number("EX:TRLV", "trigger_v", VOLT, -100.0, 100.0, 0.0),
    Number("C#:TRLV", "channel_v", VOLT, -100.0, 100.0, 0.0),
)


class SiglentScope(ScopeDevice):
    """One oscilloscope; its first channel and its external trigger are connected.

    Parameters
    ----------
    port, front
        See `ScopeDevice`.
    """

    kept_fields = (
        *(setting.field for setting in (*_WORDS, *_NUMBERS)),
        *("trigger_select", "bandwidth_limits", "depth", "setup", "acquisition", "averages"),
    )

    def __init__(self, port: ScopePort, front: ScopeFront) -> None:
        self.command_code = self.execution_code = 0
        super().__init__(port, front)
        self._set_defaults()
        for word in _WORDS:
            word.enter(self.tree, lambda call: self)
        for number in _NUMBERS:
            number.enter(self.tree, lambda call: self)
            self.tree.add(number.header, self._setter(number.header), Action(self._told(number.field)))
        self._add_commands()

    def _set_defaults(self) -> None:
        self.headers, self.trace, self.coupling, self.acquisition = "SHORT", "ON", "D1M", "SAMPLING"
        self.trigger_slope, self.trigger_mode, self.trigger_select = "POS", "AUTO", "EDGE,SR,C1,HT,OFF"
        self.probe, self.division_v, self.offset_v, self.division_s = 1.0, 1.0, 0.0, 1e-6
        self.delay_s = self.trigger_v = self.channel_v = 0.0
        self.channel_slope, self.averages = "POS", 16
        self.unit, self.inverted, self.trigger_coupling, self.skew_s = "V", "OFF", "DC", 0.0
        self.bandwidth_limits = dict.fromkeys(_CHANNELS, "OFF")
        self.depth = self.model.record_lengths[0]
        self.setup = {"SP": 0, "NP": 0, "FP": 0}
        self.state = 0

    def reset(self) -> None:
        """Bring all settings to their defaults and stop."""
        self.halt()
        self._set_defaults()

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were, and stop."""
        super().bring_back(kept)
        self.trigger_mode = "STOP"

    def shot(self) -> int | None:
        """Return what is before the first point of the waveform setup; nothing is before 0."""
        return self.setup["FP"] - 1 if self.setup["FP"] else None

    def view(self) -> tuple[float, float, float, float, int]:
        """Return what fills the screen: the whole memory."""
        if self.inverted == "ON":
            raise ScpiError(-221, "not emulated: an inverted channel")
        span_s = self.division_s * self.model.divisions
        full_scale_v = self.division_v / CODES_A_DIVISION * self.model.code_count
        interval_s = self.interval_over(span_s, self.depth)
        start_s = self.delay_s - interval_s * self.depth / 2
        return full_scale_v, -self.offset_v, interval_s, start_s, self.depth

    def acquired(self) -> None:
        """Tell of a new signal, and stop."""
        self.state |= SIGNAL_ACQUIRED
        self.trigger_mode = "STOP"

    def report(self, error: ScpiError) -> None:
        """Put an error into the queue, and its code into the register of its kind."""
        super().report(error)
        if error.is_command_error:
            self.command_code = _COMMAND_CODES.get(error.code, _OTHER_COMMAND)
        else:
            self.execution_code = _EXECUTION_CODES.get(error.code, _OTHER_EXECUTION)

    def _clear(self, call: Call) -> None:
        self.cancel()
        self.status.clear()
        self.command_code = self.execution_code = 0

    def _take_command_code(self, call: Call) -> str:
        code, self.command_code = self.command_code, 0
        return str(code)

    def _take_execution_code(self, call: Call) -> str:
        code, self.execution_code = self.execution_code, 0
        return str(code)

    def _set_acquisition(self, call: Call) -> None:
        word = _ACQUISITIONS.read(call.parameters[0])
        if len(call.parameters) > 1:
            if word != "AVERAGE":
                raise ScpiError(-108, "ACQW")
            self.averages = _averages_of(call.parameters[1])
        self.acquisition = word

    def _tell_acquisition(self, call: Call) -> str:
        return f"AVERAGE,{self.averages}" if self.acquisition == "AVERAGE" else self.acquisition

    def _set_averages(self, call: Call) -> None:
        self.averages = _averages_of(call.parameters[0])

    def _setter(self, header: str) -> Action:
        command = self.tree.find(header.replace("#", "1"), self.tree.root).action
        return Action(command.run, command.least, command.most)

    def _told(self, field: str) -> Callable[[Call], str]:
        return lambda call: f"{getattr(self, field):.2E}"

    def _set_mode(self, call: Call) -> None:
        mode = call.parameters[0].text.upper()
        if mode not in ("AUTO", "NORM", "SINGLE", "STOP"):
            raise ScpiError(-224, mode)
        self.halt()
        self.trigger_mode = mode
        if mode == "SINGLE":
            self._arm()

    def _arm(self) -> None:
        self.start()
        self.state |= TRIGGER_READY

    def _stop(self, call: Call) -> None:
        self.halt()
        self.trigger_mode = "STOP"

    def _take_state(self, call: Call) -> str:
        self.record()
        taken, self.state = self.state, 0
        return str(taken)

    def _status(self, call: Call) -> str:
        self.record()
        return "Ready" if self.is_armed else "Stop"

    def _rate(self, call: Call) -> str:
        return f"{1 / self.interval_over(self.division_s * self.model.divisions, self.depth):.2E}"

    def _set_depth(self, call: Call) -> None:
        found = _DEPTH.fullmatch(call.parameters[0].text)
        if self.trigger_mode == "STOP":
            raise ScpiError(-221, "the memory depth is taken only while it runs")
        depth = float(found[1]) * _FACTORS[found[2].upper()] if found else 0
        if depth not in self.model.record_lengths:
            raise ScpiError(-222, "14K, 140K, 1.4M, 14M")
        self.depth = round(depth)

    def _tell_depth(self, call: Call) -> str:
        return f"{self.depth // 1000}K" if self.depth < 1_000_000 else f"{self.depth / 1e6:g}M"

    def _set_setup(self, call: Call) -> None:
        for name, value in _pairs(call.parameters, self.setup):
            self.setup[name] = read_integer(value, 0, _LARGEST_POINT)

    def _set_select(self, call: Call) -> None:
        self.trigger_select = _words(call.parameters)

    def _set_limit(self, call: Call) -> None:
        words = _words(call.parameters).split(",")
        if len(words) % 2 or not set(words[::2]) <= set(_CHANNELS) or not set(words[1::2]) <= {"ON", "OFF"}:
            raise ScpiError(-224, ",".join(words))
        self.bandwidth_limits.update(zip(words[::2], words[1::2], strict=True))

    def _tell_limits(self, call: Call) -> str:
        return ",".join(f"{channel},{limit}" for channel, limit in self.bandwidth_limits.items())

    def _found(self, unit: Unit, branch: Branch) -> Found:
        """Find each header from the root: these words know no branches."""
        return super()._found(unit, self.tree.root)

    def _waveform(self, call: Call) -> str:
        record = self.record()
        if call.parameters[0].text.upper() != "DAT2":
            raise ScpiError(-224, call.parameters[0].text)
        if record is None or call.suffixes[0] != 1:
            raise ScpiError(-230, "no waveform data")
        first, count = self.setup["FP"], self.setup["NP"] or record.counts.size
        codes = record.counts[first : first + count] - self.model.code_count // 2
        # A line feed more than the message needs: what comes next must read over it.
        return "DAT2," + block(codes.astype(np.int8).tobytes(), 9) + "\n"

    def _add_commands(self) -> None:
        add = self.tree.add
        add("TRMD", Action(self._set_mode, 1, 1), Action(lambda call: self.trigger_mode))
        add("ACQW", Action(self._set_acquisition, 1, 2), Action(self._tell_acquisition))
        add("AVGA", Action(self._set_averages, 1, 1), Action(lambda call: str(self.averages)))
        add("*CLS", Action(self._clear))
        add("CMR", query=Action(self._take_command_code))
        add("EXR", query=Action(self._take_execution_code))
        add("ARM", Action(lambda call: self._arm()))
        add("STOP", Action(self._stop))
        add("FRTR", Action(lambda call: self.force()))
        add("INR", query=Action(self._take_state))
        add("SAST", query=Action(self._status))
        add("SARA", query=Action(self._rate))
        add("SANU", query=Action(self._tell_depth, 0, 1))
        add("MSIZ", Action(self._set_depth, 1, 1), Action(self._tell_depth))
        setup = Action(lambda call: ",".join(f"{name},{value}" for name, value in self.setup.items()))
        add("WFSU", Action(self._set_setup, 2, 6), setup)
        add("TRSE", Action(self._set_select, 1, 9), Action(lambda call: self.trigger_select))
        add("BWL", Action(self._set_limit, 2, 8), Action(self._tell_limits))
        # Behind its line feed too many no other answer could follow.
        add("C#:WF", query=Action(self._waveform, 1, 1, ends_message=True))


def _averages_of(token: Token) -> int:
    averages = read_integer(token, _AVERAGES[0], _AVERAGES[-1])
    if averages not in _AVERAGES:
        raise ScpiError(-222, ", ".join(map(str, _AVERAGES)))
    return averages


def _words(tokens: tuple[Token, ...]) -> str:
    for one in tokens:
        if not _WORD.fullmatch(one.text):
            raise ScpiError(-224, one.text)
    return ",".join(one.text.upper() for one in tokens)


def _pairs(tokens: tuple[Token, ...], known: dict[str, int]) -> list[tuple[str, Token]]:
    names = [token.text.upper() for token in tokens[::2]]
    if len(tokens) % 2 or not set(names) <= set(known):
        raise ScpiError(-224, ",".join(names))
    return list(zip(names, tokens[1::2], strict=True))
