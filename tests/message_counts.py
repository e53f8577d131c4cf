"""How many damaged messages a test sends: few by default, more in the slow tests, a million on demand."""

from __future__ import annotations

import pytest
from _pytest.mark.structures import ParameterSet


def counts(few: int, many: int = 100_000) -> list[ParameterSet]:
    """Return the numbers of messages as parameters of a test; `-m million` chooses the largest."""
    return [
        pytest.param(few),
        pytest.param(many, marks=[pytest.mark.slow, pytest.mark.timeout(1800)]),
        pytest.param(1_000_000, marks=[pytest.mark.million, pytest.mark.timeout(4 * 3600)]),
    ]
