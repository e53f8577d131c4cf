"""Instruments that may be there: VISA resources, serial ports, USB devices; and who they say they are.

`search` only asks the libraries of this computer and sends nothing to any instrument. `identified` sends a
question, which a device of another kind may take for something else: ask the user before.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from belahil.clock import SystemClock
from belahil.errors import BelahilError, InstrumentError, LimitExceeded, LinkTimeout
from belahil.generators import family_of, model_of

if TYPE_CHECKING:
    from collections.abc import Iterator

VISA_LIBRARIES = ("", "@py")
"""PyVISA's own choice, and PyVISA-py, which finds what needs no vendor's library."""
ANSWER_TIMEOUT_S = 2.0
_NOT_OURS = ("ASRL",)  # serial ports are listed by pyserial
_HUB, _TEST_AND_MEASUREMENT = 9, (0xFE, 3)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place where an instrument may be.

    Parameters
    ----------
    kind : {"visa", "serial", "usb"}
        Which library knows it.
    place : str
        As a bench file spells it: a VISA resource name, ``serial:PORT``, ``usb:VID:PID[:SERIAL]``.
    description : str
        What the library tells of it; may be empty.
    visa_library : str
        The library that lists a VISA resource.
    """

    kind: Literal["visa", "serial", "usb"]
    place: str
    description: str = ""
    visa_library: str = ""


@dataclass(frozen=True, slots=True)
class Identified:
    """Who answered at a place.

    Parameters
    ----------
    candidate : Candidate
        Where.
    identity : str
        Its answer.
    part : {"generator", "digitizer", ""}
        What it can be on a bench; empty for an instrument that no driver is for.
    driver : str
        Of the bench file; empty for none.
    """

    candidate: Candidate
    identity: str
    part: Literal["generator", "digitizer", ""] = ""
    driver: str = ""


def search() -> tuple[list[Candidate], list[str]]:
    """List where instruments may be; nothing is sent to them.

    Returns
    -------
    found : list of Candidate
        VISA resources, serial ports, USB devices with bulk endpoints.
    problems : list of str
        A line for each library that could not be asked.
    """
    found: list[Candidate] = []
    problems: list[str] = []
    for name, listing in (("PyVISA", _visa), ("pyserial", _serial), ("pyusb", _usb)):
        try:
            found += listing()
        except Exception as error:  # vendors' libraries fail in ways of their own; the others are still asked
            problems.append(f"{name} cannot be asked: {' '.join(str(error).split()) or type(error).__name__}")
    return found, problems


def identified(candidate: Candidate) -> Identified:
    """Ask who is there: ``*IDN?`` over VISA, the GRM link's identify over serial lines and USB.

    Raises
    ------
    InstrumentError
        Nobody answers, or not as such an instrument does.
    """
    if candidate.kind == "visa":
        return _told_by_visa(candidate)
    from drivers.grm import GrmDigitizer
    from drivers.links_grm import open_link

    link, framing = open_link(candidate.place)
    try:
        receiver = GrmDigitizer(link, SystemClock(), framing)
    except BaseException:
        link.close()
        raise
    receiver.close()
    return Identified(candidate, receiver.identity, "digitizer", "grm")


def _visa() -> Iterator[Candidate]:
    import pyvisa

    listed: dict[str, str] = {}
    failed: list[Exception] = []
    for library in VISA_LIBRARIES:
        try:
            manager = pyvisa.ResourceManager(library)
            for name in manager.list_resources("?*"):
                listed.setdefault(name, library)
        except Exception as error:  # one library is enough
            failed.append(error)
    if len(failed) == len(VISA_LIBRARIES):
        raise failed[0]
    for name, library in listed.items():
        if not name.startswith(_NOT_OURS):
            yield Candidate("visa", name, visa_library=library)


def _serial() -> Iterator[Candidate]:
    from serial.tools import list_ports

    for port in sorted(list_ports.comports()):
        told = "" if port.description in (None, "n/a") else str(port.description)
        yield Candidate("serial", f"serial:{port.device}", told)


def _usb() -> Iterator[Candidate]:
    import usb.core

    for device in usb.core.find(find_all=True) or ():
        if device.bDeviceClass == _HUB or not _has_bulk(device):
            continue
        place, words = f"usb:{device.idVendor:04x}:{device.idProduct:04x}", []
        # Names need the right to open the device.
        with suppress(Exception):
            words = [word for word in (device.manufacturer, device.product) if word]
        with suppress(Exception):
            place += f":{device.serial_number}" if device.serial_number else ""
        yield Candidate("usb", place, " ".join(words))


def _has_bulk(device: Any) -> bool:
    """Tell whether a device has bulk endpoints both ways, and is none that VISA speaks with."""
    import usb.util

    ways = set()
    for configuration in device:
        for interface in configuration:
            if (interface.bInterfaceClass, interface.bInterfaceSubClass) == _TEST_AND_MEASUREMENT:
                return False
            for endpoint in interface:
                if usb.util.endpoint_type(endpoint.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK:
                    ways.add(usb.util.endpoint_direction(endpoint.bEndpointAddress))
    return len(ways) == 2


def _told_by_visa(candidate: Candidate) -> Identified:
    from drivers.visa_link import VisaLink

    link = VisaLink(candidate.place, candidate.visa_library)
    try:
        link.write(b"*IDN?\n")
        answer = link.read(4096, ANSWER_TIMEOUT_S).decode("latin-1").strip()
    finally:
        with suppress(BelahilError):
            link.close()
    if not answer:
        raise LinkTimeout(f"{candidate.place}: no answer to *IDN? in {ANSWER_TIMEOUT_S:g} s")
    if answer.count(",") < 2:
        raise InstrumentError(f"{candidate.place}: {answer[:80]!r} is no answer to *IDN?")
    with suppress(LimitExceeded):
        return Identified(candidate, answer, "generator", family_of(model_of(answer)))
    from drivers.oscilloscopes.families import DIALECTS

    for driver, dialect in DIALECTS.items():
        if dialect.known.match(answer):
            return Identified(candidate, answer, "digitizer", driver)
    return Identified(candidate, answer)
