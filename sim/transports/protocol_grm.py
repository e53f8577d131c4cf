"""Handler of ``grm://`` URLs; pyserial finds it by this name of the module and of the class."""

from __future__ import annotations

from sim.transports.serial_port import EmulatedPort as Serial

__all__ = ["Serial"]
