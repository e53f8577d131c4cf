"""The dialects by the name of their driver in a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.oscilloscopes.infiniivision import InfiniiVisionDialect
from drivers.oscilloscopes.rigol_ds import RigolDialect
from drivers.oscilloscopes.siglent_sds import SiglentDialect
from drivers.oscilloscopes.tektronix_mso import TektronixDialect

if TYPE_CHECKING:
    from drivers.oscilloscopes.dialect import ScopeDialect

DIALECTS: dict[str, ScopeDialect] = {
    "keysight-infiniivision": InfiniiVisionDialect(),
    "rigol-ds1000z": RigolDialect(),
    "siglent-sds": SiglentDialect(),
    "tektronix-mso": TektronixDialect(),
}
