"""One read of a VISA session that keeps what came before a time-out, which PyVISA's own verbs drop."""

from __future__ import annotations

import ctypes
from typing import Any


def portion(resource: Any, count: int) -> bytes:
    """Read once, and return what came until a line feed, the end of a message, `count` bytes or the time-out.

    Parameters
    ----------
    resource : pyvisa.resources.MessageBasedResource
        Open, with its time-out set.
    count : int
        Of bytes at most.

    Raises
    ------
    pyvisa.errors.Error
        Any but a time-out; that one when nothing came.
    """
    from pyvisa.constants import StatusCode

    library = resource.visalib
    sessions, lower = getattr(library, "sessions", None), getattr(library, "lib", None)
    with resource.ignore_warning(StatusCode.success_device_not_present, StatusCode.success_max_count_read):
        if sessions is not None and resource.session in sessions:
            return _of_python(resource, sessions[resource.session], count)
        if hasattr(lower, "viRead"):
            return _of_vendor(resource, lower, count)
        return bytes(library.read(resource.session, count)[0])


def _of_python(resource: Any, session: Any, count: int) -> bytes:
    """Read a session of PyVISA-py, which returns bytes beside its status."""
    data, status = session.read(count)
    if not data:
        resource.visalib.handle_return_value(resource.session, status)
    return bytes(data)


def _of_vendor(resource: Any, library: Any, count: int) -> bytes:
    """Read by a vendor's library, which counts what it put into our buffer also when it fails."""
    from pyvisa.errors import VisaIOError

    buffer, got = ctypes.create_string_buffer(count), ctypes.c_uint32()
    try:
        library.viRead(resource.session, buffer, count, ctypes.byref(got))
    except VisaIOError:
        if not got.value:
            raise
    return buffer.raw[: got.value]
