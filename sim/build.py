"""From a bench file to simulated instruments, or to endpoints where the real drivers find emulated ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from belahil.bench import Bench, Endpoints
from belahil.errors import ConfigError
from belahil.oscilloscopes import SCOPES
from sim.generator_path import true_model
from sim.plant import Plant

if TYPE_CHECKING:
    from belahil.config import BenchConfig
    from sim.oscilloscope import ScopeReceiver

VISA_ADDRESS = "TCPIP0::emulated::inst0::INSTR"
SCOPE_ADDRESS = "TCPIP0::emulated-scope::inst0::INSTR"


def bench(config: BenchConfig) -> Bench:
    """Build the simulated bench of a bench file.

    Parameters
    ----------
    config : BenchConfig
        Its ``[emulation]`` is the truth, its other tables are what the bench is told.

    Returns
    -------
    Bench
        With its output off.

    Raises
    ------
    ConfigError
        A truth that cannot be.
    """
    from sim.instruments import SimulatedDigitizer, SimulatedGenerator
    from sim.simulated_scope import SimulatedScope

    scope = scope_receiver(config)
    plant = Plant(config, scope)
    generator = SimulatedGenerator(plant, true_model(config), config.generator.load_ohm)
    digitizer = SimulatedDigitizer(plant) if scope is None else SimulatedScope(plant, scope)
    return Bench(generator, digitizer, config, plant.clock)


def scope_receiver(config: BenchConfig) -> ScopeReceiver | None:
    """Return the receiver behind an oscilloscope; None where the receiver has its own converters."""
    from sim.oscilloscope import ScopeReceiver

    return ScopeReceiver(config) if config.digitizer.driver in SCOPES else None


def endpoints(config: BenchConfig) -> Endpoints:
    """Put emulated devices over one plant beneath the vendor libraries.

    Parameters
    ----------
    config : BenchConfig
        Its link is ``emulated:serial`` or ``emulated:usb``, or ``emulated:visa`` for an oscilloscope.

    Raises
    ------
    ConfigError
        A truth that cannot be, or a link that is not emulated.
    """
    from sim.devices.generator_families import generator_device
    from sim.devices.grm import GrmDevice
    from sim.transports.visa_library import EmulatedVisa

    scope = scope_receiver(config)
    plant = Plant(config, scope)
    visa = EmulatedVisa(plant.clock)
    reached: dict[str, Any] = {}
    link = config.digitizer.link
    if scope is not None and link == "emulated:visa":
        from sim.devices.oscilloscopes.families import DEVICES

        visa.plug(SCOPE_ADDRESS, DEVICES[config.digitizer.driver](plant, scope))
        reached["visa_scope_address"] = SCOPE_ADDRESS
    elif link == "emulated:serial":
        from sim.transports.serial_port import register_serial

        receiver = GrmDevice(plant, "cobs", plant.clock)
        reached["serial_url"] = register_serial(receiver, plant.clock, config.digitizer.receiver)
    elif link == "emulated:usb":
        from sim.transports.usb_backend import EmulatedUsb

        usb = EmulatedUsb(GrmDevice(plant, "raw", plant.clock), plant.clock)
        reached |= {"usb_backend": usb, "usb_id": usb.usb_id}
    else:
        raise ConfigError(
            f'link = "{link}": emulated are emulated:serial and emulated:usb, '
            "and emulated:visa for an oscilloscope"
        )
    generator = generator_device(true_model(config), plant)
    visa.plug(VISA_ADDRESS, generator)
    return Endpoints(visa_library=visa, visa_address=VISA_ADDRESS, clock=plant.clock, **reached)
