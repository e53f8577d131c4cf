"""Checks of what a user may choose of a campaign, in the words of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from collections.abc import Mapping


def refuse_few(options: object, least: Mapping[str, int]) -> None:
    """Refuse whole numbers below what statistics need.

    Parameters
    ----------
    options : object
        Has the numbers as attributes.
    least : mapping of str to int
        Smallest allowed number by attribute.

    Raises
    ------
    RefusedInput
        With the option's name on the command line, which is that of the attribute.
    """
    for name, fewest in least.items():
        given = getattr(options, name)
        if given < fewest:
            raise RefusedInput(f"--{name.replace('_', '-')} {given}: at least {fewest} is needed")


def refuse_outside(name: str, values: tuple[float, ...], low: float, high: float) -> None:
    """Refuse numbers that are not within two bounds, these included.

    Parameters
    ----------
    name : str
        Of the option, without dashes before it.
    values : tuple of float
        In the option's unit, as the bounds.
    low, high : float
        Bounds.

    Raises
    ------
    RefusedInput
        For the first that is outside, or no number.
    """
    for value in values:
        if not low <= value <= high:
            raise RefusedInput(f"--{name} {value:g}: allowed is {low:g} to {high:g}")
