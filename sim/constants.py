"""Constants of nature; exact in the SI since 2019."""

from __future__ import annotations

from typing import Final

SPEED_OF_LIGHT_M_PER_S: Final = 299792458.0
PLANCK_J_S: Final = 6.62607015e-34
ELEMENTARY_CHARGE_C: Final = 1.602176634e-19
