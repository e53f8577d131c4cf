"""How ``belahil bench new`` finds the instruments of a laboratory: it lists, asks the user, asks them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from belahil.errors import BelahilError, RefusedInput

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.discovery import Candidate, Identified


@dataclass(frozen=True, slots=True)
class Place:
    """One instrument of a new bench file: its driver and where it is."""

    driver: str
    address: str
    visa_library: str = ""


def searched(probe: bool, ask: bool) -> tuple[Place | None, Place | None]:
    """Look for a generator and a digitizer, with a line for each thing found.

    Parameters
    ----------
    probe : bool
        Ask every candidate who it is, without asking the user first.
    ask : bool
        Ask the user: which candidates may be asked, and which instrument to take out of several.

    Returns
    -------
    generator, digitizer : Place or None
        None where none was found.

    Raises
    ------
    RefusedInput
        Several could be the one, and the user is not to be asked.
    """
    from drivers.discovery import search

    candidates, problems = search()
    for problem in problems:
        print(problem)
    for one in candidates:
        print(f"found {_named(one)}")
    if not candidates:
        print("found no VISA resource, serial port or USB device")
    answers = [answer for one in candidates if (answer := _asked(one, probe, ask)) is not None]
    return _chosen("generator", answers, ask), _chosen("digitizer", answers, ask)


def _named(one: Candidate) -> str:
    return f"{one.place}{f' ({one.description})' if one.description else ''}"


def _asked(one: Candidate, probe: bool, ask: bool) -> Identified | None:
    """Ask a candidate who it is, if the user agrees: bytes may do harm where something else listens."""
    from drivers.discovery import identified

    question = "*IDN?" if one.kind == "visa" else "the GRM link's identify"
    if not probe and not (ask and click.confirm(f"send {question} to {one.place}?", default=False)):
        return None
    try:
        answer = identified(one)
    except BelahilError as error:
        print(f"{one.place}: {error}")
        return None
    print(f"{one.place}: {answer.identity} ({_use(answer)})")
    return answer


def _use(answer: Identified) -> str:
    return f"{answer.part}, driver {answer.driver}" if answer.part else "no driver is for it"


def _chosen(part: str, answers: Sequence[Identified], ask: bool) -> Place | None:
    """Take the only instrument for a part of the bench, or the one that the user names."""
    fitting = [one for one in answers if one.part == part]
    if not fitting:
        return None
    places = [one.candidate.place for one in fitting]
    number = 0
    if len(fitting) > 1:
        if not ask:
            raise RefusedInput(f"{len(fitting)} instruments can be the {part}: {', '.join(places)}; name one")
        for place, one in enumerate(fitting, 1):
            print(f"{place}: {one.candidate.place}, {one.identity}")
        number = click.prompt(f"which is the {part}?", type=click.IntRange(1, len(fitting)), default=1) - 1
    one = fitting[number]
    visa = part == "digitizer" and one.candidate.kind == "visa"
    return Place(one.driver, ("visa:" if visa else "") + one.candidate.place, one.candidate.visa_library)
