"""Emulated instruments that take bytes at once, without a vendor library or a line before them.

Who compares them with recorded ones writes what was written there. They call themselves as those did, and
behave as their families do.

What this does not model: the pace of a line, and what is lost on it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from belahil.errors import LimitExceeded
from belahil.generators import family_of, model_of
from sim.build import scope_receiver
from sim.devices.generator_families import generator_device
from sim.devices.grm import GrmDevice
from sim.devices.oscilloscopes.families import DEVICES
from sim.generator_path import true_model
from sim.plant import Plant, PlantClock

if TYPE_CHECKING:
    from collections.abc import Mapping

    from belahil.config import BenchConfig
    from belahil.generators import GeneratorModel
    from belahil.grm_link import Framing
    from sim.devices.scpi import ScpiDevice

_MOST_BYTES = 1 << 26


class AnsweringMessages:
    """A SCPI device at once.

    Parameters
    ----------
    device : ScpiDevice
        Any.
    is_stream : bool
        Whether its link marks no ends of messages, as a raw socket or a serial line.
    """

    def __init__(self, device: ScpiDevice, is_stream: bool) -> None:
        self.device = device
        self._is_stream = is_stream
        device.own.exchange = "stream" if is_stream else "message"

    def write(self, data: bytes) -> None:
        """Take a message."""
        self.device.write(data, not self._is_stream)

    def read(self) -> bytes:
        """Give the next answer whole; empty where there is none."""
        return self.device.read() or b""

    def clear(self) -> None:
        """Do what a device clear does."""
        self.device.clear()

    @property
    def error_count(self) -> int:
        """Entries in the error queue."""
        return len(self.device.status.errors)


class AnsweringReceiver:
    """A receiver on the GRM link at once.

    Parameters
    ----------
    device : GrmDevice
        Any.
    """

    error_count = 0

    def __init__(self, device: GrmDevice) -> None:
        self.device = device

    def write(self, data: bytes) -> None:
        """Take a telecommand."""
        self.device.write(data)

    def read(self) -> bytes:
        """Give all packets that are ready."""
        found = bytearray()
        while more := self.device.read(_MOST_BYTES):
            found += more
        return bytes(found)

    def clear(self) -> None:
        """Drop what is ready."""
        self.device.clear()


@dataclass(frozen=True, slots=True)
class AnsweringBench:
    """Both instruments of a bench on one plant.

    Parameters
    ----------
    clock : PlantClock
        Of the plant.
    generator, digitizer : AnsweringMessages or AnsweringReceiver
        The instruments.
    model : GeneratorModel
        Of the generator.
    """

    clock: PlantClock
    generator: AnsweringMessages
    digitizer: AnsweringMessages | AnsweringReceiver
    model: GeneratorModel


def answering_bench(
    config: BenchConfig, identities: Mapping[str, str], framing: Framing, streams: frozenset[str]
) -> AnsweringBench:
    """Build the emulated instruments of a bench.

    Parameters
    ----------
    config : BenchConfig
        Its ``[emulation]`` is the truth.
    identities : mapping
        What ``generator`` and ``digitizer`` call themselves, and so of which model the generator is; the
        usual ones where nothing is said.
    framing : {"cobs", "raw"}
        Of a receiver's link.
    streams : frozenset of str
        Links that mark no ends of messages.

    Raises
    ------
    ConfigError
        A truth that cannot be.
    """
    scope = scope_receiver(config)
    plant = Plant(config, scope)
    model = _model(config, identities.get("generator", ""))
    generator = generator_device(model, plant)
    generator.identity = identities.get("generator", generator.identity)
    receiver: AnsweringMessages | AnsweringReceiver
    if scope is None:
        plant.identity = identities.get("digitizer", plant.identity)
        receiver = AnsweringReceiver(GrmDevice(plant, framing, plant.clock))
    else:
        device = DEVICES[config.digitizer.driver](plant, scope)
        device.identity = identities.get("digitizer", device.identity)
        receiver = AnsweringMessages(device, "digitizer" in streams)
    return AnsweringBench(plant.clock, AnsweringMessages(generator, "generator" in streams), receiver, model)


def _model(config: BenchConfig, identity: str) -> GeneratorModel:
    """Return the model that answered where it is one of the driver's family, else the family's usual one."""
    usual = true_model(config)
    with suppress(LimitExceeded):
        found = model_of(identity)
        if family_of(found) == family_of(usual):
            rate_hz = config.emulation.generator.sample_rate_hz
            return replace(found, max_arb_rate_hz=rate_hz or found.max_arb_rate_hz)
    return usual
