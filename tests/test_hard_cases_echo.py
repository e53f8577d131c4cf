from __future__ import annotations

import pytest
from hard_cases_echo import ECHO_CASES


@pytest.mark.parametrize("name", ECHO_CASES)
def test_hard_case(name: str) -> None:
    ECHO_CASES[name].check()
