"""The dialects by the name of their driver in a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.oscilloscopes.infiniivision import InfiniiVisionDialect

if TYPE_CHECKING:
    from drivers.oscilloscopes.dialect import ScopeDialect

DIALECTS: dict[str, ScopeDialect] = {
    "keysight-infiniivision": InfiniiVisionDialect(),
}
