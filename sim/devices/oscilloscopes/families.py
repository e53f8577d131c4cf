"""The emulated oscilloscopes by the name of their driver in a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.devices.oscilloscopes.infiniivision import InfiniiVision
from sim.devices.oscilloscopes.rigol_ds import RigolScope
from sim.devices.oscilloscopes.siglent_sds import SiglentScope
from sim.devices.oscilloscopes.tektronix_mso import TektronixScope

if TYPE_CHECKING:
    from sim.devices.oscilloscopes.acquisition import ScopeDevice

DEVICES: dict[str, type[ScopeDevice]] = {
    "keysight-infiniivision": InfiniiVision,
    "rigol-ds1000z": RigolScope,
    "siglent-sds": SiglentScope,
    "tektronix-mso": TektronixScope,
}
