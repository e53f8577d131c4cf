"""The text of a bench file's ``[digitizer] link``, opened."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from belahil.errors import ConfigError
from drivers.serial_link import DEFAULT_BAUD, open_serial
from drivers.usb_link import open_usb

if TYPE_CHECKING:
    from belahil.grm_link import Framing
    from belahil.interfaces import Link


def open_link(link: str, usb_backend: Any = None) -> tuple[Link, Framing]:
    """Open a link by its text in a bench file.

    Parameters
    ----------
    link : str
        ``serial:PORT[?baud=N]``, ``socket://host:port`` or ``usb:VID:PID[:SERIAL]`` (hexadecimal).
    usb_backend : object or None
        A pyusb backend; None lets pyusb choose.

    Returns
    -------
    tuple of Link and str
        The framing that belongs to it.

    Raises
    ------
    ConfigError
        The text is not of that form.
    LinkClosed
        Nobody is there.
    """
    if link.startswith("usb:"):
        match = re.fullmatch(r"usb:([0-9a-fA-F]{1,4}):([0-9a-fA-F]{1,4})(?::(.+))?", link)
        if match is None:
            raise ConfigError(f'[digitizer] link = "{link}": usb:VID:PID[:SERIAL] with hexadecimal numbers')
        vendor, product, number = match.groups()
        return open_usb(int(vendor, 16), int(product, 16), number, usb_backend), "raw"
    if link.startswith("socket:"):
        _check_socket(link)
        return open_serial(link), "cobs"
    port, _, query = link.removeprefix("serial:").removeprefix("//").partition("?")
    options = parse_qs(query, keep_blank_values=True)
    baud = options.pop("baud", [str(DEFAULT_BAUD)])[-1]
    if not link.startswith("serial:") or not port or options or not baud.isdecimal() or int(baud) == 0:
        raise ConfigError(
            f'[digitizer] link = "{link}": serial:PORT[?baud=N], socket://host:port or usb:VID:PID[:SERIAL]'
        )
    return open_serial(port, int(baud)), "cobs"


def _check_socket(link: str) -> None:
    try:
        place = urlsplit(link)
        whole = place.netloc and place.hostname and place.port
    except ValueError:
        whole = None
    if not whole:
        raise ConfigError(
            f'[digitizer] link = "{link}": socket://host:port, with a port from 1 to 65535, '
            "such as socket://127.0.0.1:5026"
        )
