"""The commands that all instruments have: those of IEEE 488.2, SYSTem:ERRor and STATus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.devices.scpi.parameters import read_boolean, read_integer
from sim.devices.scpi.registers import ALL_BITS, Register
from sim.devices.scpi.status import MASTER_BIT
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    from sim.devices.scpi.device import ScpiDevice

SCPI_VERSION = "1999.0"


def add_common_commands(device: ScpiDevice) -> None:
    """Enter them into the device's tree."""
    _add_identity(device)
    _add_registers(device)
    _add_completion(device)
    _add_memory(device)
    _add_errors(device)
    for header, register in (
        ("STATus:QUEStionable", device.status.questionable),
        ("STATus:OPERation", device.status.operation),
    ):
        _add_status(device, header, register)
    device.tree.add("STATus:PRESet", Action(lambda call: device.status.preset()))


def _add_identity(device: ScpiDevice) -> None:
    add = device.tree.add
    # Their answers have no form that tells where they end (IEEE 488.2, 8.7.11).
    add("*IDN", query=Action(lambda call: device.identity, ends_message=True))
    add("*OPT", query=Action(lambda call: device.options, ends_message=True))
    add("*TST", query=Action(lambda call: device.status.integer(0)))
    add("*TRG", Action(lambda call: device.triggered()))
    add("SYSTem:VERSion", query=Action(lambda call: SCPI_VERSION))


def _add_registers(device: ScpiDevice) -> None:
    status, add = device.status, device.tree.add

    def clear(call: Call) -> None:
        device.cancel()
        status.clear()

    def set_event_enable(call: Call) -> None:
        status.event_enable = read_integer(call.parameters[0], 0, 255)

    def set_service_enable(call: Call) -> None:
        status.service_enable = read_integer(call.parameters[0], 0, 255) & ~MASTER_BIT

    def set_power_on_clear(call: Call) -> None:
        status.power_on_clear = read_boolean(call.parameters[0])

    add("*CLS", Action(clear))
    add("*ESR", query=Action(lambda call: status.integer(status.take_events())))
    add("*STB", query=Action(lambda call: status.integer(device.own_status_byte())))
    add("*ESE", Action(set_event_enable, 1, 1), Action(lambda call: status.integer(status.event_enable)))
    add("*SRE", Action(set_service_enable, 1, 1), Action(lambda call: status.integer(status.service_enable)))
    add("*PSC", Action(set_power_on_clear, 1, 1), Action(lambda call: f"{status.power_on_clear:d}"))


def _add_completion(device: ScpiDevice) -> None:
    add = device.tree.add

    def ask_completion(call: Call) -> str | None:
        if device.wait():
            return "1"
        device.owe()
        return None

    def wait(call: Call) -> None:
        device.wait()

    add("*OPC", Action(lambda call: device.announce_completion()), Action(ask_completion))
    add("*WAI", Action(wait))


def _add_memory(device: ScpiDevice) -> None:
    add, memory = device.tree.add, device.memory

    def reset(call: Call) -> None:
        device.cancel()
        device.stop()
        device.reset()

    def place(call: Call) -> int:
        return read_integer(call.parameters[0], *memory.places)

    def save(call: Call) -> None:
        memory.states[place(call)] = device.kept()

    add("*RST", Action(reset))
    add("*SAV", Action(save, 1, 1))
    add("*RCL", Action(lambda call: device.bring_back(memory.state(place(call))), 1, 1))
    if device.learns:
        add("*LRN", query=Action(lambda call: device.learn(), ends_message=True))


def _add_errors(device: ScpiDevice) -> None:
    status, add, error = device.status, device.tree.add, "SYSTem:ERRor"
    add(f"{error}[:NEXT]", query=Action(lambda call: status.next_error()))
    add(f"{error}:ALL", query=Action(lambda call: status.all_errors()))
    add(f"{error}:COUNt", query=Action(lambda call: status.integer(len(status.errors))))
    add(f"{error}:CODE[:NEXT]", query=Action(lambda call: status.next_code()))
    add(f"{error}:CODE:ALL", query=Action(lambda call: status.all_codes()))


def _add_status(device: ScpiDevice, header: str, register: Register) -> None:
    integer, add = device.status.integer, device.tree.add

    def add_mask(name: str, field: str) -> None:
        def set_it(call: Call) -> None:
            setattr(register, field, read_integer(call.parameters[0], 0, ALL_BITS))

        add(f"{header}:{name}", Action(set_it, 1, 1), Action(lambda call: integer(getattr(register, field))))

    add(f"{header}[:EVENt]", query=Action(lambda call: integer(register.take_event())))
    add(f"{header}:CONDition", query=Action(lambda call: integer(register.condition)))
    add_mask("ENABle", "enable")
    add_mask("PTRansition", "positive")
    add_mask("NTRansition", "negative")
