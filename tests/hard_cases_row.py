"""What a row of the table of hard cases is; see `hard_cases`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class HardCase:
    """One row.

    Parameters
    ----------
    name : str
        For ever; tests and reports cite it.
    case : str
        What is fed in.
    tolerance : float
        The largest error allowed, as `meaning` says.
    meaning : str
        Of the error.
    error : callable
        Runs this package on the case and returns its largest error against the reference that its docstring
        names. What has no number (a status, a refusal) it asserts itself.
    naive : callable or None
        The error of an obvious way, which its docstring names: above the tolerance, nan where it gives no
        number, inf where it raises.
    """

    name: str
    case: str
    tolerance: float
    meaning: str
    error: Callable[[], float]
    naive: Callable[[], float] | None = None


def worst(*errors: float) -> float:
    """Return the largest error; nan where one is nan, which `max` would drop or keep by its place."""
    return next((one for one in errors if one != one), max(errors))


def error_or_inf(way: Callable[[], float], expected: type[Exception], said: str) -> float:
    """Return what a naive way returns, inf where it raises what is expected of it."""
    try:
        return way()
    except expected as raised:
        if said not in str(raised):
            raise
        return float("inf")
