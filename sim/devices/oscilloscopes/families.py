"""The emulated oscilloscopes by the name of their driver in a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.devices.oscilloscopes.infiniivision import InfiniiVision

if TYPE_CHECKING:
    from sim.devices.oscilloscopes.acquisition import ScopeDevice

DEVICES: dict[str, type[ScopeDevice]] = {
    "keysight-infiniivision": InfiniiVision,
}
