"""A Siglent SDG2000X function generator, as messages make it appear.

A command is a channel, a word, and names with values (``C1:BSWV FRQ,1000``). What cannot be is changed
without a word; only what cannot be understood is queued. Settings, their order and their digits are as owners
of such instruments have measured them and published, see docs/instruments.md.

Modulation and sweeps are off, and tell it; switching one on is error -221, and while it is off nothing else
of it changes. The synchronous output is remembered and told alone.

What this does not model: modulation, sweeps, harmonics, noise, pulses with their own timing; built-in
waveforms by their index; TrueArb against DDS, which plays the same points here; what firmware refuses in
TrueArb.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.devices.generator_base import EmulatedGenerator, GeneratorPort
from sim.devices.generators.siglent_sdg_channel import SdgChannel, UserWaves
from sim.devices.generators.siglent_sdg_words import (
    change_arb,
    change_burst,
    change_output,
    change_polarity,
    change_rate,
    change_sync,
    change_wave,
    keep_off,
    pairs_of,
    shown_arb,
    shown_burst,
    shown_off,
    shown_output,
    shown_polarity,
    shown_rate,
    shown_sync,
    shown_wave,
)
from sim.devices.generators.siglent_wavedata import WaveConnection
from sim.devices.scpi.parameters import read_block, read_name
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Branch, Call

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.generators import GeneratorModel
    from sim.devices.scpi.exchange import Connection, Exchange
    from sim.devices.scpi.parser import Unit

_MOST_PARAMETERS = 80


class SiglentSdg(EmulatedGenerator):
    """An SDG2000X.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids.
    port : GeneratorPort
        As for `EmulatedGenerator`, and so are the others.
    """

    channels: list[SdgChannel]
    signed = False

    def __init__(
        self,
        model: GeneratorModel,
        port: GeneratorPort,
        serial_number: str = "EMULATED",
        firmware: str = "0.00-emulated",
    ) -> None:
        super().__init__(model, port, serial_number, firmware)
        self._waves = UserWaves(model)
        self._set_defaults()
        self._add_commands()

    def _set_defaults(self) -> None:
        count = self.model.channels
        self.channels = [SdgChannel(self.model, _unheard, waves=self._waves) for _ in range(count)]

    def reset(self) -> None:
        """Bring all settings to their defaults; waveforms in memory stay."""
        self._set_defaults()

    def connect(self, exchange: Exchange) -> Connection:
        """Give a client a connection that takes the bare points of waveforms."""
        return WaveConnection(self, exchange)

    def _run(self, unit: Unit | ScpiError, branch: Branch, last: list[str]) -> tuple[Branch, str | None]:
        """Run a unit; headers always begin at the root, for there is no tree."""
        return super()._run(unit, self.tree.root, last)

    def _choose(self, call: Call) -> SdgChannel:
        return self.channels[call.suffixes[0] - 1]

    def _add_commands(self) -> None:
        self._add("OUTPut", change_output, shown_output, "OUTP")
        self._add("BSWV", change_wave, shown_wave)
        self._add("SRATE", change_rate, shown_rate)
        self._add("ARWV", change_arb, shown_arb)
        self._add("BTWV", self._burst, shown_burst)
        self._add("MDWV", keep_off, shown_off)
        self._add("SWWV", keep_off, shown_off)
        self._add("SYNC", change_sync, shown_sync)
        self._add("INVT", change_polarity, shown_polarity)
        self.tree.add("C#:WVDT", Action(self._upload, 4, _MOST_PARAMETERS))
        self.tree.add("WVDT", query=Action(self._uploaded, 1, 2))
        self.tree.add("STL", query=Action(lambda call: f"STL {self._waves.listed()}", 0, 1))

    def _add(
        self,
        word: str,
        change: Callable[[SdgChannel, list[tuple[str, str]]], None],
        show: Callable[[SdgChannel], str],
        short: str = "",
    ) -> None:
        def set_it(call: Call) -> None:
            change(self._choose(call), pairs_of(call.parameters))

        def get_it(call: Call) -> str:
            return f"C{call.suffixes[0]}:{short or word} {show(self._choose(call))}"

        self.tree.add(f"C#:{word}", Action(set_it, 1, _MOST_PARAMETERS), Action(get_it))

    def _burst(self, channel: SdgChannel, pairs: list[tuple[str, str]]) -> None:
        change_burst(channel, pairs)
        waits = channel.burst and channel.source == "BUS"
        if any(key == "MTRIG" for key, _ in pairs) and waits and channel is self.channels[0]:
            self.triggered()

    def _upload(self, call: Call) -> None:
        *words, last = call.parameters
        pairs = dict(pairs_of(tuple(words)))
        self._waves.store(pairs.get("WVNM", ""), read_block(last))

    def _uploaded(self, call: Call) -> str:
        name = read_name(call.parameters[-1])
        data = self._waves.codes(name).astype("<i2").tobytes()
        head = f"WVDT WVNM,{name},LENGTH,{len(data)}B,FREQ,1000HZ,AMPL,4V,OFST,0V,PHASE,0,WAVEDATA,"
        return head + data.decode("latin-1")


def _unheard(_: ScpiError) -> None:
    """Take the error that other families would queue when they change a value."""
