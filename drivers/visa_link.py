"""An instrument behind PyVISA as a link."""

from __future__ import annotations

import math
import select
import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from belahil.errors import ConfigError, InstrumentError, LinkClosed, LinkError, LinkTimeout
from drivers.visa_portion import portion

if TYPE_CHECKING:
    from types import ModuleType

WRITE_TIMEOUT_S = 5.0
# A short message fits into what stands before an instrument; setting a time-out costs as much as sending it.
SHORT_BYTES, SHORT_TIMEOUT_S = 4096, 1.0
LOCK_TIMEOUT_S = 1.0
# PyVISA asks for so many bytes at once; a longer answer comes in several portions.
_CHUNK_BYTES = 65536
# HiSLIP of PyVISA-py tells by RuntimeError that the other end is gone or out of step.
_RAISED = (OSError, RuntimeError)


class VisaLink:
    """A VISA session for an instrument whose messages end with a line feed.

    Parameters
    ----------
    address : str
        VISA resource name.
    library : object or str
        A PyVISA library, or its name; empty for PyVISA's own choice.

    Raises
    ------
    ConfigError
        The address is no resource name.
    LinkClosed
        Nobody is there, or another program has locked the instrument.
    InstrumentError
        There is no such VISA library.

    Notes
    -----
    The instrument is locked for this session where library and link can (HiSLIP, VXI-11, vendors' libraries):
    a second program is refused before it has said anything. Raw sockets and serial lines have no locks.

    A raw socket cannot be cleared: `clear` connects anew, unless nothing was sent yet. An instrument that
    stalls for longer than a time-out may still carry out what the old connection brought.
    """

    def __init__(self, address: str, library: Any = "") -> None:
        import pyvisa

        self._pyvisa: ModuleType = pyvisa
        self._address = address
        try:
            self._manager = pyvisa.ResourceManager(library)
        except (OSError, ValueError, pyvisa.errors.Error) as error:
            raise InstrumentError(f'visa_library = "{library}" does not load: {_line(error)}') from error
        self._timeout_s = WRITE_TIMEOUT_S
        self._why_closed = "the link was closed"
        self._resource: Any = self._opened()
        self._is_socket = self._resource.resource_class == "SOCKET"
        self._is_fresh = True
        self._has_answered = False

    def _opened(self) -> Any:
        try:
            resource: Any = self._manager.open_resource(self._address)
        except Exception as error:  # PyVISA's back ends let errors of all kinds through here
            if _status(error) == "error_invalid_resource_name":
                raise ConfigError(
                    f'[generator] address = "{self._address}" is no VISA resource name, '
                    "such as TCPIP::HOST::PORT::SOCKET or USB::VID::PID::SERIAL::INSTR"
                ) from error
            raise LinkClosed(f"nobody answers at {self._address}: {_line(error)}") from error
        resource.read_termination = "\n"
        self._timeout_s = math.nan  # of a new session
        self._set_timeout(resource, WRITE_TIMEOUT_S)
        if resource.resource_class == "SOCKET":
            self._send_at_once(resource)
        if not self._locked(resource):
            with suppress(OSError, self._pyvisa.errors.Error):
                resource.close()
            raise LinkClosed(
                f"{self._address}: another program has locked the instrument; one at a time may use it"
            )
        return resource

    def _locked(self, resource: Any) -> bool:
        """Lock the instrument for us; False when another has, True also where there are no locks."""
        try:
            resource.lock_excl(timeout=LOCK_TIMEOUT_S * 1e3)
        except (*_RAISED, NotImplementedError, self._pyvisa.errors.Error) as error:
            if _status(error) == "error_resource_locked":
                return False
        else:
            return True
        # PyVISA-py speaks the locks of HiSLIP, but not by VISA's verb.
        request = getattr(self._interface_of(resource), "async_lock_request", None)
        if request is None:
            return True
        try:
            return bool(request(LOCK_TIMEOUT_S) != "failure")
        except _RAISED as error:
            raise LinkClosed(f"nobody answers at {self._address}: {_line(error)}") from error

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises
        ------
        LinkTimeout
            The instrument does not take it.
        LinkClosed
            It is gone.
        LinkError
            The bus failed.
        """
        self._is_fresh = False
        resource = self._connected()
        try:
            if len(data) > SHORT_BYTES or not self._timeout_s >= SHORT_TIMEOUT_S:
                self._set_timeout(resource, WRITE_TIMEOUT_S)
            resource.write_raw(data)
        except (*_RAISED, self._pyvisa.errors.Error) as error:
            raise self._failed(error) from error

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return bytes up to a line feed, the end of a message or the time-out; empty when none came in time.

        Parameters
        ----------
        count : int
            Of bytes at most.
        timeout_s : float
            VISA counts whole milliseconds, at least one.

        Raises
        ------
        LinkClosed
            The instrument is gone.
        LinkError
            The bus failed, or the instrument closed the connection; `clear` connects anew.
        """
        resource = self._connected()
        try:
            self._set_timeout(resource, timeout_s)
            data = portion(resource, min(count, _CHUNK_BYTES))
            self._has_answered = True
            return data
        except (*_RAISED, self._pyvisa.errors.Error) as error:
            if _status(error) != "error_timeout":
                raise self._failed(error) from error
            if self._hung_up():
                raise LinkError(f"{self._address}: the instrument closed the connection") from error
            return b""

    def clear(self) -> None:
        """Drop what is on its way: by device clear, or else by a new connection.

        Raises
        ------
        LinkClosed
            The instrument is gone.
        LinkError
            The bus failed.
        """
        if self._is_fresh and self._is_socket:
            return
        if not self._is_socket:
            resource = self._connected()
            try:
                self._set_timeout(resource, WRITE_TIMEOUT_S)
                resource.clear()
                return
            except RuntimeError:
                # A back end that cannot clear, or (HiSLIP of PyVISA-py) finds an old answer on the way.
                pass
            except (OSError, self._pyvisa.errors.Error) as error:
                if _status(error) != "error_nonsupported_operation":
                    raise self._failed(error) from error
        self.close()
        try:
            self._resource = self._opened()
        except LinkClosed as error:
            self._why_closed = f"lost when it was connected anew: {error}"
            raise
        self._is_fresh = True

    def close(self) -> None:
        """Let go of the session; never raises."""
        resource, self._resource = self._resource, None
        if resource is not None:
            with suppress(OSError, self._pyvisa.errors.Error):
                resource.close()

    def _send_at_once(self, resource: Any) -> None:
        """Let no message wait until the one before is acknowledged, which takes some 40 ms."""
        line = self._line_of(resource)
        if line is not None:
            # Where the other end is already gone, the first write tells.
            with suppress(OSError):
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return
        with suppress(NotImplementedError, self._pyvisa.errors.Error):
            resource.set_visa_attribute(self._pyvisa.constants.ResourceAttribute.tcpip_nodelay, True)

    def _line_of(self, resource: Any) -> socket.socket | None:
        """Return the socket of a session of pyvisa-py, whose attributes do not reach it."""
        line = self._interface_of(resource)
        return line if isinstance(line, socket.socket) else None

    def _interface_of(self, resource: Any) -> Any:
        """Return what a session of pyvisa-py speaks through; None of other libraries."""
        session = getattr(self._manager.visalib, "sessions", {}).get(resource.session)
        return getattr(session, "interface", None)

    def _hung_up(self) -> bool:
        """Whether the other end closed a socket of pyvisa-py, which waits for it all the same."""
        line = self._line_of(self._resource)
        if line is None:
            return False
        try:
            ready, _, _ = select.select([line], [], [], 0)
            return bool(ready) and not line.recv(1, socket.MSG_PEEK)
        except OSError:
            return True

    def _set_timeout(self, resource: Any, timeout_s: float) -> None:
        if timeout_s != self._timeout_s:
            resource.timeout = max(1, math.ceil(timeout_s * 1e3))
            self._timeout_s = timeout_s

    def _connected(self) -> Any:
        if self._resource is None:
            raise LinkClosed(f"{self._address}: {self._why_closed}")
        return self._resource

    def _failed(self, error: Exception) -> LinkError:
        status = _status(error)
        if status == "error_timeout":
            return LinkTimeout(f"{self._address}: the instrument takes no more bytes")
        gone = status in ("error_connection_lost", "error_resource_not_found", "error_invalid_object")
        gone |= "dropped by server" in str(error)
        if gone or isinstance(error, (OSError, self._pyvisa.errors.InvalidSession)):
            # Sockets of pyvisa-py connect in the background: only the first write learns of it.
            if not self._has_answered or isinstance(error, ConnectionRefusedError):
                return LinkClosed(f"nobody answers at {self._address}: {_line(error)}")
            return LinkClosed(f"{self._address} is gone: {_line(error)}")
        return LinkError(f"{self._address}: {_line(error)}")


def _status(error: Exception) -> str:
    """Name of the VISA status in an error; empty when there is none."""
    return str(getattr(getattr(error, "error_code", None), "name", ""))


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
