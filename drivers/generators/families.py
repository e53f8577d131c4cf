"""Which dialect a family of generators speaks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.generators.agilent_33220 import Agilent33220Dialect
from drivers.generators.keysight import KeysightDialect
from drivers.generators.rigol_dg import RigolDgDialect
from drivers.generators.siglent_sdg import SiglentSdgDialect
from drivers.generators.tektronix_afg import TektronixAfgDialect

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.generators.dialect import Dialect

_DIALECTS: dict[str, Callable[[], Dialect]] = {
    "keysight-33500": KeysightDialect,
    "keysight-33600": KeysightDialect,
    "agilent-33220": Agilent33220Dialect,
    "rigol-dg": RigolDgDialect,
    "tektronix-afg": TektronixAfgDialect,
    "siglent-sdg": SiglentSdgDialect,
}


def dialect_of(driver: str) -> Dialect:
    """Return the dialect of ``[generator] driver``, one of `belahil.generators.FAMILIES`."""
    return _DIALECTS[driver]()
