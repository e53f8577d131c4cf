"""A USB device with bulk endpoints as a link."""

from __future__ import annotations

import errno
import math
from contextlib import suppress
from typing import Any

from belahil.errors import InstrumentError, LinkClosed, LinkError, LinkTimeout

WRITE_TIMEOUT_S = 2.0
_LONGEST_TRANSFER_BYTES = 65536
_CLEAR_READS = 64
_GONE = (errno.ENODEV, errno.ESHUTDOWN, errno.EBADF)


class UsbLink:
    """The first bulk endpoints of a USB device's first interface.

    Parameters
    ----------
    device : usb.core.Device
        Configured here.
    """

    def __init__(self, device: Any) -> None:
        self._device: Any = device
        self._name = f"USB {device.idVendor:04x}:{device.idProduct:04x}"
        device.set_configuration()
        interface = device.get_active_configuration()[(0, 0)]
        self._out = self._bulk(interface, into_host=False)
        self._in = self._bulk(interface, into_host=True)

    def _bulk(self, interface: Any, into_host: bool) -> Any:
        import usb.util

        wanted = usb.util.ENDPOINT_IN if into_host else usb.util.ENDPOINT_OUT
        for endpoint in interface:
            bulk = usb.util.endpoint_type(endpoint.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK
            if bulk and usb.util.endpoint_direction(endpoint.bEndpointAddress) == wanted:
                return endpoint
        raise InstrumentError(f"{self._name} has no bulk {'IN' if into_host else 'OUT'} endpoint")

    def write(self, data: bytes) -> None:
        """Send all of `data` in one transfer.

        Raises
        ------
        LinkTimeout
            The device does not take it.
        LinkClosed
            It is gone.
        """
        sent = self._transfer(self._out.write, data, WRITE_TIMEOUT_S)
        if sent != len(data):
            raise LinkTimeout(f"{self._name}: {sent or 0} of {len(data)} bytes were taken")

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return one transfer; empty when none came in time.

        Parameters
        ----------
        count : int
            At most so many bytes; a multiple of the endpoint's size, as USB demands.
        timeout_s : float
            Resolution 1 ms, at least 1 ms.

        Raises
        ------
        LinkClosed
            The device is gone.
        """
        # A transfer of a multiple of the endpoint's size ends with an empty one, which says nothing.
        for _ in range(2):
            data = self._transfer(self._in.read, count, timeout_s)
            if data is None:
                break
            if len(data):
                return bytes(data)
        return b""

    def clear(self) -> None:
        """Drop what the device has ready."""
        for _ in range(_CLEAR_READS):
            if not self.read(_LONGEST_TRANSFER_BYTES, 1e-3):
                return

    def close(self) -> None:
        """Let go of the device."""
        import usb.util

        if self._device is not None:
            with suppress(OSError):
                usb.util.dispose_resources(self._device)
            self._device = None

    def _transfer(self, verb: Any, argument: bytes | int, timeout_s: float) -> Any:
        import usb.core

        if self._device is None:
            raise LinkClosed(f"{self._name} was closed")
        try:
            # For libusb a time-out of 0 means for ever.
            return verb(argument, max(1, math.ceil(timeout_s * 1e3)))
        except usb.core.USBTimeoutError:
            return None
        except usb.core.USBError as error:
            kind = LinkClosed if error.errno in _GONE else LinkError
            raise kind(f"{self._name}: {error}") from error


def open_usb(vendor: int, product: int, serial_number: str | None = None, backend: Any = None) -> UsbLink:
    """Open a USB device by its numbers.

    Raises
    ------
    LinkClosed
        It is not connected, or cannot be opened.
    InstrumentError
        It has no bulk endpoints, or there is no libusb.
    """
    import usb.core

    wanted: dict[str, Any] = {"idVendor": vendor, "idProduct": product}
    if serial_number is not None:
        wanted["serial_number"] = serial_number
    name = f"USB device {vendor:04x}:{product:04x}" + (f" number {serial_number}" if serial_number else "")
    try:
        device = usb.core.find(backend=backend, **wanted)
        if device is None:
            raise LinkClosed(f"{name} is not connected")
        return UsbLink(device)
    except usb.core.NoBackendError as error:
        raise InstrumentError(f"{name}: pyusb finds no libusb; install libusb-1.0") from error
    except usb.core.USBError as error:
        raise LinkClosed(f"{name} does not open: {error}") from error
