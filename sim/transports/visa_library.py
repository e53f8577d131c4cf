"""Emulated instruments beneath PyVISA, inside the process; PyVISA takes the library as an object."""

from __future__ import annotations

import itertools
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from pyvisa import constants, rname
from pyvisa.attributes import AttributesByID
from pyvisa.constants import ResourceAttribute, StatusCode
from pyvisa.highlevel import VisaLibraryBase
from pyvisa.typing import VISARMSession, VISASession
from pyvisa.util import LibraryPath

from sim.devices.scpi import ScpiDevice

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from belahil.interfaces import Clock

_NUMBERS = itertools.count(1)


class MessageDevice(Protocol):
    """An instrument of IEEE 488.2: program messages in, response messages out."""

    def write(self, data: bytes, end: bool = True) -> None:
        """Take bytes; `end` tells that the message ends with them."""
        ...

    def read(self) -> bytes | None:
        """Give the next response message with its line feed; None when there is none."""
        ...

    def clear(self) -> None:
        """Do what a device clear does."""
        ...

    def read_stb(self) -> int:
        """Give the status byte, as a serial poll does."""
        ...


@dataclass(slots=True)
class _Session:
    device: MessageDevice
    attributes: dict[int, Any]
    unread: bytearray = field(default_factory=bytearray)


class EmulatedVisa(VisaLibraryBase):
    """A VISA library whose instruments are Python objects.

    Parameters
    ----------
    clock : Clock
        Its time advances by each time-out that expires; nothing sleeps.

    Notes
    -----
    Every object is a library of its own: PyVISA keeps one resource manager for each, so benches do not share.
    What this does not model: locks, service requests, and the pace of a bus.
    """

    _clock: Clock

    def __new__(cls, clock: Clock) -> EmulatedVisa:
        """Make a library that PyVISA has not seen before."""
        library = super().__new__(cls, LibraryPath(f"emulated-{next(_NUMBERS)}", "user specified"))
        assert isinstance(library, cls)
        library._clock = clock
        return library

    def _init(self) -> None:
        self._devices: dict[str, MessageDevice] = {}
        self._sessions: dict[int, _Session] = {}
        self._handles = itertools.count(1)

    @staticmethod
    def get_library_paths() -> Iterable[LibraryPath]:
        """Return nothing: this library is handed over as an object."""
        return ()

    @staticmethod
    def get_debug_info() -> list[str]:
        """Return a line for ``pyvisa-info``."""
        return ["instruments emulated inside the process"]

    def plug(self, resource_name: str, device: MessageDevice | ScpiDevice) -> EmulatedVisa:
        """Make a device reachable by a resource name.

        Parameters
        ----------
        resource_name : str
            Of class INSTR: its messages carry END.
        device : MessageDevice or ScpiDevice
            Answers at once or not at all. With the latter messages are exchanged as IEEE 488.2 has it: it
            learns when it is read, and when it is not.

        Raises
        ------
        ValueError
            The name is not of class INSTR.
        """
        if rname.ResourceName.from_string(resource_name).resource_class != "INSTR":
            raise ValueError(f"{resource_name}: only INSTR resources can be emulated in the process")
        if isinstance(device, ScpiDevice):
            device.own.exchange = "message"
        self._devices[rname.to_canonical_name(resource_name)] = device
        return self

    def open_default_resource_manager(self) -> tuple[VISARMSession, StatusCode]:
        """Open the resource manager."""
        return VISARMSession(next(self._handles)), self.handle_return_value(None, StatusCode.success)

    def list_resources(self, session: VISARMSession, query: str = "?*::INSTR") -> tuple[str, ...]:
        """List what is plugged in and matches `query`."""
        found: tuple[str, ...] = rname.filter(list(self._devices), query)
        return found

    def open(
        self,
        session: VISARMSession,
        resource_name: str,
        access_mode: constants.AccessModes = constants.AccessModes.no_lock,
        open_timeout: int = 0,
    ) -> tuple[VISASession, StatusCode]:
        """Open a session to a device that is plugged in."""
        name = rname.to_canonical_name(resource_name)
        if name not in self._devices:
            self.handle_return_value(None, StatusCode.error_resource_not_found)
        handle = VISASession(next(self._handles))
        self._sessions[handle] = _Session(self._devices[name], _attributes(name))
        return handle, self.handle_return_value(handle, StatusCode.success)

    def close(self, session: Any) -> StatusCode:
        """Close a session, or the resource manager."""
        self._sessions.pop(session, None)
        return self.handle_return_value(session, StatusCode.success)

    def write(self, session: VISASession, data: bytes) -> tuple[int, StatusCode]:
        """Hand over a message, with END unless that is switched off."""
        opened = self._opened(session)
        self._send(session, bytes(data), bool(opened.attributes[ResourceAttribute.send_end_enabled]))
        return len(data), self.handle_return_value(session, StatusCode.success)

    def _send(self, session: VISASession, data: bytes, end: bool) -> None:
        """Hand over bytes; with the rest of an answer unread that is an interruption."""
        opened = self._opened(session)
        if opened.unread and isinstance(opened.device, ScpiDevice):
            opened.unread.clear()
            opened.device.own.interrupted()
        with self._telling(session):
            opened.device.write(data, end)

    def read(self, session: VISASession, count: int) -> tuple[bytes, StatusCode]:
        """Give at most `count` bytes of one response message.

        The status is success at its end, else success_termination_character_read or
        success_max_count_read (VPP-4.3, viRead). With nothing to say the time-out has expired.
        """
        opened = self._opened(session)
        unread, attributes = opened.unread, opened.attributes
        if not unread:
            with self._telling(session):
                message = opened.device.read()
            if not message:
                self._expire(session, attributes[ResourceAttribute.timeout_value])
            unread += message or b""
        stop, status = min(count, len(unread)), StatusCode.success_max_count_read
        if attributes[ResourceAttribute.termchar_enabled]:
            found = unread.find(attributes[ResourceAttribute.termchar], 0, stop)
            if found >= 0:
                stop, status = found + 1, StatusCode.success_termination_character_read
        if stop == len(unread):
            status = StatusCode.success
        taken = bytes(unread[:stop])
        del unread[:stop]
        return taken, self.handle_return_value(session, status)

    def _expire(self, session: VISASession, timeout_ms: int) -> None:
        if timeout_ms == constants.VI_TMO_INFINITE:
            timeout_ms = 0  # No clock can wait that long: the caller learns at once.
        self._clock.sleep_s(timeout_ms / 1e3)
        self.handle_return_value(session, StatusCode.error_timeout)

    def clear(self, session: VISASession) -> StatusCode:
        """Clear the device and what was not read."""
        opened = self._opened(session)
        opened.unread.clear()
        with self._telling(session):
            opened.device.clear()
        return self.handle_return_value(session, StatusCode.success)

    def flush(self, session: VISASession, mask: constants.BufferOperation) -> StatusCode:
        """Drop the unread rest of a message when `mask` asks for it; nothing else is buffered."""
        discard = constants.BufferOperation
        if mask & (discard.discard_read_buffer | discard.discard_read_buffer_no_io):
            self._opened(session).unread.clear()
        return self.handle_return_value(session, StatusCode.success)

    def read_stb(self, session: VISASession) -> tuple[int, StatusCode]:
        """Poll the status byte."""
        value = self._opened(session).device.read_stb()
        return value, self.handle_return_value(session, StatusCode.success)

    def assert_trigger(self, session: VISASession, protocol: constants.TriggerProtocol) -> StatusCode:
        """Trigger the device, which does what ``*TRG`` does."""
        self._send(session, b"*TRG\n", True)
        return self.handle_return_value(session, StatusCode.success)

    def get_attribute(self, session: Any, attribute: Any) -> tuple[Any, StatusCode]:
        """Give an attribute as it was set, else VISA's default."""
        known = self._opened(session).attributes
        status = StatusCode.success if attribute in known else StatusCode.error_nonsupported_attribute
        return known.get(attribute), self.handle_return_value(session, status)

    def set_attribute(self, session: VISASession, attribute: ResourceAttribute, state: Any) -> StatusCode:
        """Set an attribute that the resource has."""
        known = self._opened(session).attributes
        if attribute not in known:
            return self.handle_return_value(session, StatusCode.error_nonsupported_attribute)
        known[attribute] = state
        return self.handle_return_value(session, StatusCode.success)

    def disable_event(
        self, session: VISASession, event_type: constants.EventType, mechanism: constants.EventMechanism
    ) -> StatusCode:
        """Do nothing: there are no events."""
        return StatusCode.success

    def discard_events(
        self, session: VISASession, event_type: constants.EventType, mechanism: constants.EventMechanism
    ) -> StatusCode:
        """Do nothing: there are no events."""
        return StatusCode.success

    @contextmanager
    def _telling(self, session: VISASession) -> Iterator[None]:
        """Say in VISA's way that a device is gone."""
        try:
            yield
        except ConnectionError:
            self.handle_return_value(session, StatusCode.error_connection_lost)

    def _opened(self, session: int) -> _Session:
        if session not in self._sessions:
            self.handle_return_value(None, StatusCode.error_invalid_object)
        return self._sessions[session]


def _attributes(name: str) -> dict[int, Any]:
    """Return the attributes of a resource: VISA's defaults where it has one, and what its name says."""
    parsed = rname.ResourceName.from_string(name)
    interface = parsed.interface_type_const
    found: dict[int, Any] = {
        number: kind.default
        for number, kind in AttributesByID.items()
        if kind.in_resource((interface, parsed.resource_class)) and isinstance(kind.default, int | float)
    }
    found.update(
        {
            ResourceAttribute.interface_type: interface,
            ResourceAttribute.resource_class: parsed.resource_class,
            ResourceAttribute.resource_name: name,
            ResourceAttribute.timeout_value: 2000,
            ResourceAttribute.termchar: 10,
            ResourceAttribute.termchar_enabled: False,
            ResourceAttribute.send_end_enabled: True,
        }
    )
    return found
