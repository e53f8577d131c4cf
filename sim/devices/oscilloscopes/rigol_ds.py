"""A Rigol oscilloscope of the DS1000Z series with an external trigger, as messages make it appear.

Preamble, pieces and states are those of the public programming guides of these series. Assumed: an external
trigger input at the two-channel models, times without the trigger's place between two samples, that a new
start forgets the old record, that the screen's own waveform (mode NORMal) is the record's samples at equal
steps, and ``:WAVeform:POINts``, which public drivers use and the guides do not have.

Averages are remembered and told alone; of an inverted channel no record is taken, and error -221 tells of
it. What this does not model: automatic memory depth, measurements, pictures of the screen, and other
triggers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.devices.generator_settings import Number, Switch, Word
from sim.devices.oscilloscopes.acquisition import ScopeDevice, ScopeFront, ScopePort, Sources, block
from sim.devices.scpi.numeric import SECOND, VOLT, read_number
from sim.devices.scpi.parameters import Choices, read_integer
from sim.devices.scpi.parser import Token
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.values import RangeWindow

LARGEST_PIECE = {"BYTE": 250_000, "WORD": 125_000}
CODES_A_DIVISION = 25
SCREEN_POINTS = 1200
_SHOT_BITS = 32
_SOURCES = Sources("EXT", "AC")


def _answer_number(value: float) -> str:
    return f"{value:.6e}"


def _answer_whole(value: float) -> str:
    return str(round(value))


class _Limits(Choices):
    """The bandwidth's limit, which begins with a digit, or none."""

    def read(self, token: Token) -> str:
        """Return what was sent."""
        return "20M" if token.text.upper() == "20M" else super().read(token)


_SETTINGS = (
    Switch("CHANnel#:DISPlay", "display"),
    Word("CHANnel#:COUPling", "coupling", Choices("AC", "DC", "GND")),
    Word("CHANnel#:BWLimit", "bandwidth_limit", _Limits("OFF")),
    Switch("CHANnel#:VERNier", "vernier"),
    Number("CHANnel#:PROBe", "probe", None, 0.01, 1000.0, 10.0),
    Number("CHANnel#:SCALe", "scale_v", VOLT, 1e-3, 100.0, 1.0),
    Number("CHANnel#:OFFSet", "offset_v", VOLT, -1000.0, 1000.0, 0.0),
    Word("TIMebase:MODE", "timebase", Choices("MAIN", "XY", "ROLL")),
    Number("TIMebase[:MAIN]:SCALe", "scale_s", SECOND, 5e-9, 50.0, 1e-6),
    Number("TIMebase[:MAIN]:OFFSet", "position_s", SECOND, -500.0, 5000.0, 0.0),
    Word("TRIGger:MODE", "trigger_mode", Choices("EDGE", "PULSe", "SLOPe", "SPI", "TIMeout")),
    Word("TRIGger:EDGe:SOURce", "trigger_source", _SOURCES),
    Word("TRIGger:EDGe:SLOPe", "trigger_slope", Choices("POSitive", "NEGative", "RFALl")),
    Number("TRIGger:EDGe:LEVel", "trigger_v", VOLT, -100.0, 100.0, 0.0),
    Word("TRIGger:SWEep", "sweep", Choices("AUTO", "NORMal", "SINGle")),
    Switch("CHANnel#:INVert", "inverted"),
    Number("ACQuire:AVERages", "averages", None, 2.0, 1024.0, 2.0, step=1.0),
    Word("ACQuire:TYPE", "acquisition", Choices("NORMal", "AVERages", "PEAK", "HRESolution")),
    Word("WAVeform:SOURce", "source", _SOURCES),
    Word("WAVeform:MODE", "mode", Choices("NORMal", "MAXimum", "RAW")),
    Word("WAVeform:FORMat", "format", Choices("WORD", "BYTE", "ASCii")),
)


class RigolScope(ScopeDevice):
    """One oscilloscope; its first channel and its external trigger are connected.

    Parameters
    ----------
    port, front
        See `ScopeDevice`.
    """

    kept_fields = (
        *(setting.field for setting in _SETTINGS),
        *("depth", "first", "last", "spi_bits", "spi_data"),
    )

    signed = False

    def __init__(self, port: ScopePort, front: ScopeFront) -> None:
        super().__init__(port, front)
        self._set_defaults()
        for setting in _SETTINGS:
            answer = _answer_whole if setting.field == "averages" else _answer_number
            setting.enter(self.tree, lambda call: self, answer)
        self._add_commands()

    def _set_defaults(self) -> None:
        self.display, self.vernier, self.inverted, self.averages = True, False, False, 2.0
        self.coupling, self.bandwidth_limit = "DC", "OFF"
        self.probe, self.scale_v, self.offset_v = 10.0, 1.0, 0.0
        self.timebase, self.scale_s, self.position_s = "MAIN", 1e-6, 0.0
        self.trigger_mode, self.trigger_source, self.trigger_slope = "EDGE", "CHAN1", "POS"
        self.trigger_v, self.sweep = 0.0, "AUTO"
        self.acquisition, self.depth = "NORM", self.model.record_lengths[0]
        self.source, self.mode, self.format = "CHAN1", "NORM", "BYTE"
        self.first, self.last = 1, SCREEN_POINTS
        self.spi_bits, self.spi_data = 8, 82
        self.is_running = False

    def reset(self) -> None:
        """Bring all settings to their defaults and stop."""
        self.halt()
        self._set_defaults()

    def shot(self) -> int | None:
        """Return the data of the SPI trigger, where it is wide enough."""
        return self.spi_data if self.spi_bits == _SHOT_BITS else None

    def view(self) -> tuple[float, float, float, float, int]:
        """Return what fills the screen: the whole memory."""
        if self.inverted:
            raise ScpiError(-221, "not emulated: an inverted channel")
        span_s = self.scale_s * self.model.divisions
        full_scale_v = self.scale_v / CODES_A_DIVISION * self.model.code_count
        interval_s = self.interval_over(span_s, self.depth)
        start_s = self.position_s - interval_s * self.depth / 2
        return full_scale_v, -self.offset_v, interval_s, start_s, self.depth

    def acquired(self) -> None:
        """Stop after a single sweep."""
        self.is_running = False

    def _run_on(self, call: Call) -> None:
        # Only single sweeps take records here.
        self.halt()
        self.is_running = True

    def _single(self, call: Call) -> None:
        self.sweep, self.is_running = "SING", True
        self.start()

    def _stop(self, call: Call) -> None:
        self.halt()
        self.is_running = False

    def _force(self, call: Call) -> None:
        self.force()

    def _status(self, call: Call) -> str:
        self.record()
        if not self.is_running:
            return "STOP"
        return "WAIT" if self.is_armed else "RUN"

    def _set_depth(self, call: Call) -> None:
        asked = read_number(call.parameters[0]).value
        if not self.is_running:
            raise ScpiError(-221, "the memory depth is taken only while it runs")
        if asked not in self.model.record_lengths:
            raise ScpiError(-222, "12000, 120000, 1200000, 12000000")
        self.depth = round(asked)

    def _rate(self, call: Call) -> str:
        return f"{1 / self.interval_over(self.scale_s * self.model.divisions, self.depth):.6e}"

    def _edge(self, field: str, call: Call) -> None:
        setattr(self, field, read_integer(call.parameters[0], 1, self.model.record_lengths[-1]))

    def _set_points(self, call: Call) -> None:
        most = self.model.record_lengths[-1] - self.first + 1
        self.last = self.first - 1 + read_integer(call.parameters[0], 1, most)

    def _step(self, record: RangeWindow) -> int:
        """Return how many samples there are for a point of the waveform that is read."""
        return 1 if self.mode != "NORM" else record.counts.size // SCREEN_POINTS

    def _held(self) -> RangeWindow:
        record = self.record()
        if record is None:
            raise ScpiError(-230, "no waveform data")
        return record

    def _data(self, call: Call) -> str:
        record = self._held()
        if self.source != "CHAN1" or self.is_running:
            raise ScpiError(-230, "no waveform data")
        held, most = record.counts[:: self._step(record)], LARGEST_PIECE.get(self.format, 15625)
        if not self.first <= self.last <= min(self.first + most - 1, held.size):
            raise ScpiError(-222, f"points {self.first} to {self.last}; at most {most} at once")
        codes = held[self.first - 1 : self.last]
        if self.format == "ASC":
            volts = (codes - record.zero_count) * record.volts_per_count
            return block(",".join(f"{volt:.6e}" for volt in volts).encode(), 9)
        return block(codes.astype(np.uint8 if self.format == "BYTE" else "<u2").tobytes(), 9)

    def _preamble(self, call: Call) -> str:
        return ",".join(self._described().values())

    def _field(self, name: str) -> Callable[[Call], str]:
        return lambda call: self._described()[name]

    def _described(self) -> dict[str, str]:
        """Return the fields of the preamble."""
        record = self._held()
        return {
            "format": {"BYTE": "0", "WORD": "1", "ASC": "2"}[self.format],
            "type": {"NORM": "0", "MAX": "1", "RAW": "2"}[self.mode],
            "points": str(self.last - self.first + 1),
            "count": "1",
            "XINCrement": f"{record.sample_interval_s * self._step(record):.6e}",
            "XORigin": f"{record.start_s:.6e}",
            "XREFerence": "0",
            "YINCrement": f"{record.volts_per_count:.6e}",
            "YORigin": str(round(record.zero_count - self.model.zero_code)),
            "YREFerence": str(self.model.zero_code),
        }

    def _set_spi(self, field: str, least: int, most: int, call: Call) -> None:
        setattr(self, field, read_integer(call.parameters[0], least, most))

    def _add_commands(self) -> None:
        add = self.tree.add
        add("RUN", Action(self._run_on))
        add("STOP", Action(self._stop))
        add("SINGle", Action(self._single))
        add("TFORce", Action(self._force))
        add("CLEar", Action(lambda call: None))
        add("TRIGger:STATus", query=Action(self._status))
        add("ACQuire:MDEPth", Action(self._set_depth, 1, 1), Action(lambda call: str(self.depth)))
        add("ACQuire:SRATe", query=Action(self._rate))
        first = Action(lambda call: self._edge("first", call), 1, 1)
        last = Action(lambda call: self._edge("last", call), 1, 1)
        add("WAVeform:STARt", first, Action(lambda call: str(self.first)))
        add("WAVeform:STOP", last, Action(lambda call: str(self.last)))
        add("WAVeform:PREamble", query=Action(self._preamble))
        points = Action(lambda call: str(self.last - self.first + 1))
        add("WAVeform:POINts", Action(self._set_points, 1, 1), points)
        for name in ("XINCrement", "XORigin", "XREFerence", "YINCrement", "YORigin", "YREFerence"):
            add(f"WAVeform:{name}", query=Action(self._field(name)))
        add("WAVeform:DATA", query=Action(self._data))
        width = Action(lambda call: self._set_spi("spi_bits", 4, _SHOT_BITS, call), 1, 1)
        data = Action(lambda call: self._set_spi("spi_data", 0, (1 << self.spi_bits) - 1, call), 1, 1)
        add("TRIGger:SPI:WIDTh", width, Action(lambda call: str(self.spi_bits)))
        add("TRIGger:SPI:DATA", data, Action(lambda call: str(self.spi_data)))
