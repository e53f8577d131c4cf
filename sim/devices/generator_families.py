"""Which emulated device stands for a generator model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.generators import family_of
from sim.devices.generator import GeneratorDevice
from sim.devices.generators.agilent_33220 import Agilent33220
from sim.devices.generators.rigol_dg import RigolDg
from sim.devices.generators.siglent_sdg import SiglentSdg
from sim.devices.generators.tektronix_afg import TektronixAfg

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.generators import GeneratorModel
    from sim.devices.generator import GeneratorPort
    from sim.devices.scpi import ScpiDevice

_DEVICES: dict[str, Callable[[GeneratorModel, GeneratorPort], ScpiDevice]] = {
    "keysight-33500": GeneratorDevice,
    "keysight-33600": GeneratorDevice,
    "agilent-33220": Agilent33220,
    "rigol-dg": RigolDg,
    "tektronix-afg": TektronixAfg,
    "siglent-sdg": SiglentSdg,
}


def generator_device(model: GeneratorModel, port: GeneratorPort) -> ScpiDevice:
    """Build the emulated generator of a model.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids; its name says of which family it is.
    port : GeneratorPort
        What its first channel plays into.
    """
    return _DEVICES[family_of(model)](model, port)
