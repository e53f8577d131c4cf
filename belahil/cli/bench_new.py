"""What ``belahil bench new`` does: from options, a search and the user's answers to a bench file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from pathlib import Path

_KINDS = {"emulated": "emulated:serial", "simulated": "simulated"}
DEFAULTS = {"load_ohm": 50.0, "attenuation_db": 0.0, "max_vpp": 0.5}
_QUESTIONS = {
    "load_ohm": "load setting of the generator, ohm (inf is allowed)",
    "attenuation_db": "attenuation between generator and receiver, dB",
    "max_vpp": "largest span that the receiver's input may see, V peak to peak",
}


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the user said; None where nothing was said.

    Parameters
    ----------
    driver, address : str or None
        Of the generator.
    digitizer, link, receiver : str or None
        Driver, link and preset of the digitizer.
    load_ohm, attenuation_db, max_vpp : float or None
        As in ``[generator]``.
    """

    driver: str | None
    address: str | None
    digitizer: str | None
    link: str | None
    receiver: str | None
    load_ohm: float | None
    attenuation_db: float | None
    max_vpp: float | None


def written_bench(file: Path, wanted: Wanted, search: bool | None, probe: bool, defaults: bool) -> None:
    """Write a bench file.

    Parameters
    ----------
    file : Path
        To be made.
    wanted : Wanted
        Goes before what is found.
    search : bool or None
        Look for instruments; None: only where a user sits at the terminal and has named none.
    probe : bool
        Ask every candidate who it is.
    defaults : bool
        Ask the user nothing.

    Raises
    ------
    RefusedInput
        The file is there already, or the bench cannot be.
    """
    from belahil.cli.bench_file import bench_file
    from belahil.config import parse_bench
    from belahil.oscilloscopes import SCOPES
    from belahil.storage import write_whole

    if file.exists():
        raise RefusedInput(f"{file}: is there already; give another name")
    named = wanted.address is not None or wanted.link is not None
    if search is None:
        search = probe or (not named and not defaults and sys.stdin.isatty())
    driver, address, link, digitizer = wanted.driver, wanted.address, wanted.link, wanted.digitizer
    visa_library = ""
    if search:
        from belahil.cli.bench_search import searched

        generator, receiver = searched(probe, not defaults)
        if generator is not None and address is None:
            driver, address = driver or generator.driver, generator.address
            visa_library = generator.visa_library
        if receiver is not None and link is None:
            digitizer, link = digitizer or receiver.driver, receiver.address
            visa_library = visa_library or receiver.visa_library
        address, link = _missing(address, link, not defaults)
    digitizer = digitizer or "grm"
    address = address or "emulated"
    if link is None:
        if address not in _KINDS:
            raise click.UsageError(f"--address {address} needs --link too, for example {_example(digitizer)}")
        link = "emulated:visa" if digitizer in SCOPES and address == "emulated" else _KINDS[address]
    text = bench_file(
        driver or "keysight-33500",
        address,
        link,
        wanted.receiver or ("analog" if digitizer in SCOPES else "bela-grm"),
        digitizer=digitizer,
        visa_library=visa_library,
        **_numbers(wanted, search and not defaults),
    )
    parse_bench(text, str(file))
    write_whole(file, text)
    print(f"bench file: {file}; try it with: belahil bench check {file}")


def _missing(address: str | None, link: str | None, ask: bool) -> tuple[str | None, str | None]:
    """Say which half of a bench was not found, and let the user tell where it is."""
    if address is None and link is None:
        print("no instrument is known, the bench is emulated")
        return address, link
    if address is None:
        print("no generator was found")
        address = click.prompt("VISA resource name of the generator") if ask else None
        if address is None:
            raise click.UsageError("a real receiver needs a real generator: give --address")
    if link is None and address not in _KINDS:
        print("no receiver was found")
        link = click.prompt("link of the receiver, such as serial:COM3") if ask else None
    return address, link


def _example(digitizer: str) -> str:
    from belahil.oscilloscopes import SCOPES

    if digitizer in SCOPES:
        return "visa:TCPIP::192.0.2.1::INSTR"
    return "serial:COM3, or for an oscilloscope its --digitizer and visa:RESOURCE"


def _numbers(wanted: Wanted, ask: bool) -> dict[str, float]:
    """Take the numbers of the generator from options, the user, or their defaults."""
    found: dict[str, float] = {}
    for key, default in DEFAULTS.items():
        said = getattr(wanted, key)
        if said is None:
            said = click.prompt(_QUESTIONS[key], type=float, default=default) if ask else default
        found[key] = float(said)
    return found
