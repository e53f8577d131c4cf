"""Constants of nature, exact in the SI since 2019, and of Mercury."""

from __future__ import annotations

from typing import Final

SPEED_OF_LIGHT_M_PER_S: Final = 299792458.0
PLANCK_J_S: Final = 6.62607015e-34
ELEMENTARY_CHARGE_C: Final = 1.602176634e-19

MERCURY_GM_M3_PER_S2: Final = 22031.868551e9
"""Gravity times mass of Mercury (JPL DE440; Park et al., Astron. J. 161:105, 2021)."""
MERCURY_RADIUS_M: Final = 2439.4e3
"""Mean radius, from which altitudes count (IAU; Archinal et al., Celest. Mech. Dyn. Astr. 130:22, 2018)."""
