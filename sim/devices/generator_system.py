"""What a 33500B or 33600A keeps beside its channels: their ties, clock, display, states and network.

All of it is remembered and answered, and none of it acts. Headers and words are those of the public manual;
after-reset values and the network's addresses are those of the manual from memory, so they are assumed.
"""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING

from sim.devices.generator_settings import Number, Setting, Switch, Word
from sim.devices.scpi.numeric import HERTZ
from sim.devices.scpi.parameters import Choices, read_integer, read_name
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel
    from sim.devices.scpi import ScpiDevice

Reset = tuple[Setting, str | float | bool]

_FACTORY_NAMES = ("AUTO_RECALL", "STATE_1", "STATE_2", "STATE_3", "STATE_4")
_LAN = "SYSTem:COMMunicate:LAN"
_ADDRESSES = {"IPADdress": "169.254.5.21", "SMASk": "255.255.0.0", "GATeway": "0.0.0.0"}
_WHICH = Choices("CURRent", "STATic")

KEPT_SWITCHES = (Switch(f"{_LAN}:DHCP", "dhcp"), Switch("MEMory:STATe:RECall:AUTO", "recalls_at_start"))
NO_SETTINGS = frozenset(f"{_LAN}:{word}" for word in _ADDRESSES) | {row.header for row in KEPT_SWITCHES}
"""What outlasts ``*RST`` and belongs to no state; after-reset values are the factory's."""


def system_settings(model: GeneratorModel) -> tuple[Reset, ...]:
    """Return the settings of the instrument as a whole, each with its value after a reset.

    Parameters
    ----------
    model : GeneratorModel
        Channels are tied where there are two.
    """
    return (*_clock_and_display(), *(_ties(model.max_sine_hz) if model.channels > 1 else ()))


def _clock_and_display() -> tuple[Reset, ...]:
    units = "DISPlay:UNIT"
    return (
        (Word("ROSCillator:SOURce", "clock_source", Choices("INTernal", "EXTernal")), "INT"),
        (Switch("ROSCillator:SOURce:AUTO", "clock_auto"), True),
        (Word(f"{units}:ARBRate", "shown_rate", Choices("SRATe", "FREQuency", "PERiod")), "SRAT"),
        (Word(f"{units}:PULSe", "shown_pulse", Choices("WIDTh", "DUTY")), "WIDT"),
        (Word(f"{units}:RATE", "shown_frequency", Choices("FREQuency", "PERiod")), "FREQ"),
        (Word(f"{units}:SWEep", "shown_sweep", Choices("STARtstop", "CENTerspan")), "STAR"),
        (Word(f"{units}:VOLTage", "shown_voltage", Choices("AMPLitudeoff", "HIGHlow")), "AMPL"),
        (Word("DISPlay:VIEW", "shown_view", Choices("STANdard", "TEXT", "GRAPh", "DUAL")), "STAN"),
    )


def _ties(most_hz: float) -> tuple[Reset, ...]:
    source, modes = "[SOURce#:]", Choices("OFFSet", "RATio")
    frequency, rate = f"{source}FREQuency:COUPle", f"{source}RATE:COUPle"
    ratio = (None, 1e-3, 1e3, 1.0)
    return (
        (Switch(f"{source}VOLTage:COUPle[:STATe]", "voltages_tied"), False),
        (Switch(f"{frequency}[:STATe]", "frequencies_tied"), False),
        (Word(f"{frequency}:MODE", "frequency_tie", modes), "OFFS"),
        (Number(f"{frequency}:OFFSet", "frequency_tie_hz", HERTZ, -most_hz, most_hz, 0.0), 0.0),
        (Number(f"{frequency}:RATio", "frequency_tie_ratio", *ratio), 1.0),
        (Switch(f"{rate}[:STATe]", "rates_tied"), False),
        (Word(f"{rate}:MODE", "rate_tie", modes), "OFFS"),
        (Number(f"{rate}:RATio", "rate_tie_ratio", *ratio), 1.0),
        (Word("DISPlay:FOCus", "shown_channel", Choices("CH1", "CH2")), "CH1"),
    )


def marker_settings(model: GeneratorModel) -> tuple[Setting, ...]:
    """Return the settings of a channel's marker, of its sync signal, and of what is added to it.

    Parameters
    ----------
    model : GeneratorModel
        Gives the limits of points and frequencies; another channel can be added where there is one.
    """
    marker, sync = "[SOURce#:]MARKer", "OUTPut#:SYNC"
    sources = Choices("CH1", "CH2", "NONE")
    combine = (Word("[SOURce#:]COMBine:FEED", "combined", sources),) if model.channels > 1 else ()
    return (
        Number(f"{marker}:CYCLe", "marker_cycle", None, 2.0, 1e8, 2.0, step=1.0),
        Number(f"{marker}:FREQuency", "marker_hz", HERTZ, model.min_sine_hz, model.max_sine_hz, 500.0),
        Number(f"{marker}:POINt", "marker_point", None, 4.0, model.max_points - 3.0, 10.0, step=1.0),
        Word(f"{sync}:MODE", "sync_mode", Choices("NORMal", "CARRier", "MARKer")),
        Word(f"{sync}:POLarity", "sync_polarity", Choices("NORMal", "INVerted")),
        *combine,
    )


def add_system_commands(device: ScpiDevice) -> None:
    """Add what is no setting: names of states, remote and local control, the network, the clock in use."""
    device.tree.add("ROSCillator:SOURce:CURRent", query=Action(lambda call: "INT"))
    for switch in KEPT_SWITCHES:
        setattr(device, switch.field, switch.field == "dhcp")
        switch.enter(device.tree, lambda call: device)
    for word in ("LOCal", "REMote", "RWLock"):
        device.tree.add(f"SYSTem:{word}", Action(lambda call: None))
    _add_states(device)
    _add_network(device)


def _add_states(device: ScpiDevice) -> None:
    names, memory, add = list(_FACTORY_NAMES), device.memory, device.tree.add

    def place(call: Call) -> int:
        return read_integer(call.parameters[0], *memory.places)

    def name(call: Call) -> None:
        chosen = read_name(call.parameters[1]) if len(call.parameters) > 1 else _FACTORY_NAMES[place(call)]
        names[place(call)] = chosen

    def delete(call: Call) -> None:
        memory.states.pop(place(call), None)
        names[place(call)] = _FACTORY_NAMES[place(call)]

    add("MEMory:NSTates", query=Action(lambda call: device.status.integer(len(names))))
    add("MEMory:STATe:CATalog", query=Action(lambda call: ",".join(map(_quoted, names))))
    add(
        "MEMory:STATe:NAME",
        Action(name, 1, 2),
        Action(lambda call: _quoted(names[place(call)]), 1, 1),
    )
    add("MEMory:STATe:DELete", Action(delete, 1, 1))
    add("MEMory:STATe:VALid", query=Action(lambda call: f"{place(call) in memory.states:d}", 1, 1))


def _add_network(device: ScpiDevice) -> None:
    for word, factory in _ADDRESSES.items():
        _add_address(device, f"{_LAN}:{word}", factory)
    device.tree.add(f"{_LAN}:UPDate", Action(lambda call: None))


def _add_address(device: ScpiDevice, header: str, factory: str) -> None:
    address = factory

    def set_it(call: Call) -> None:
        nonlocal address
        text = read_name(call.parameters[0])
        try:
            address = str(ipaddress.IPv4Address(text))
        except ValueError as error:
            raise ScpiError(-224, text) from error

    def get_it(call: Call) -> str:
        for token in call.parameters:
            _WHICH.read(token)
        return _quoted(address)

    device.tree.add(header, Action(set_it, 1, 1), Action(get_it, 0, 1))


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'
