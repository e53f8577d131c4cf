"""A SCPI instrument as a state machine: bytes in, bytes out (IEEE 488.2-1992, SCPI-1999)."""

from __future__ import annotations

from sim.devices.scpi.device import ScpiDevice

__all__ = ["ScpiDevice"]
