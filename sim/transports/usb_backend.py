"""An emulated USB device beneath pyusb: ``usb.core.find(backend=EmulatedUsb(device, clock))``."""

from __future__ import annotations

import errno
from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import usb.core
import usb.util
from usb.backend import IBackend

if TYPE_CHECKING:
    from array import array
    from collections.abc import Iterator

    from belahil.interfaces import Clock
    from sim.transports.serial_port import ByteDevice

# Vendor and product number that pid.codes keeps for private tests.
VENDOR, PRODUCT = 0x1209, 0x0001
OUT, IN = 0x01, 0x81
_PACKET_BYTES = 512
_CONFIGURATION = 1
_USB_2_0, _HIGH_SPEED = 0x0200, 3
_LIBUSB_NO_DEVICE, _LIBUSB_TIMEOUT, _LIBUSB_PIPE = -4, -7, -9


class EmulatedUsb(IBackend):  # type: ignore[misc]
    """A bus with one device that has a bulk endpoint for each direction.

    Parameters
    ----------
    device : ByteDevice
        Answers at once or not at all.
    clock : Clock
        Its time advances by each time-out that expires; nothing sleeps.
    vendor, product : int
        Numbers of the device.

    Notes
    -----
    What this does not model: the pace of a bus, the 512-byte packets that a transfer is made of, strings,
    and control requests.
    """

    def __init__(
        self, device: ByteDevice, clock: Clock, vendor: int = VENDOR, product: int = PRODUCT
    ) -> None:
        self._device = device
        self._clock = clock
        self.usb_id = vendor, product
        self._open = False

    def enumerate_devices(self) -> list[ByteDevice]:
        """List the one device."""
        return [self._device]

    def get_device_descriptor(self, dev: Any) -> SimpleNamespace:
        """Describe the device: vendor-specific, USB 2.0, high speed."""
        vendor, product = self.usb_id
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=usb.util.DESC_TYPE_DEVICE,
            bcdUSB=_USB_2_0,
            bDeviceClass=0xFF,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=vendor,
            idProduct=product,
            bcdDevice=0x0100,
            iManufacturer=0,
            iProduct=0,
            iSerialNumber=0,
            bNumConfigurations=1,
            address=1,
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=_HIGH_SPEED,
        )

    def get_configuration_descriptor(self, dev: Any, config: int) -> SimpleNamespace:
        """Describe the one configuration."""
        _only(config, 1)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=usb.util.DESC_TYPE_CONFIG,
            wTotalLength=32,
            bNumInterfaces=1,
            bConfigurationValue=_CONFIGURATION,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=0,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Describe the one interface."""
        _only(config, 1)
        _only(intf, 1)
        _only(alt, 1)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=usb.util.DESC_TYPE_INTERFACE,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=2,
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Describe the bulk endpoints, out first."""
        _only(ep, 2)
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=usb.util.DESC_TYPE_ENDPOINT,
            bEndpointAddress=(OUT, IN)[ep],
            bmAttributes=usb.util.ENDPOINT_TYPE_BULK,
            wMaxPacketSize=_PACKET_BYTES,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, dev: Any) -> ByteDevice:
        """Open it for one owner.

        Raises
        ------
        usb.core.USBError
            It is open already.
        """
        if self._open:
            raise usb.core.USBError("the emulated device is in use", None, errno.EBUSY)
        self._open = True
        return self._device

    def close_device(self, dev_handle: Any) -> None:
        """Close it."""
        self._open = False

    def get_configuration(self, dev_handle: Any) -> int:
        """Give the one configuration."""
        return _CONFIGURATION

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: array[int], timeout: int) -> int:
        """Hand over one transfer."""
        with _telling():
            self._device.write(data.tobytes())
        return len(data)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        """Fill `buff` with what is ready.

        Raises
        ------
        usb.core.USBTimeoutError
            There is nothing: the time-out has expired.
        """
        with _telling():
            data = self._device.read(len(buff))
        if not data:
            self._clock.sleep_s(timeout / 1e3)
            raise usb.core.USBTimeoutError("Operation timed out", _LIBUSB_TIMEOUT, errno.ETIMEDOUT)
        buff[: len(data)] = type(buff)("B", data)
        return len(data)

    def ctrl_transfer(self, *request: Any) -> int:
        """Refuse: the device has no control requests.

        Raises
        ------
        usb.core.USBError
            Always.
        """
        raise usb.core.USBError("Pipe error", _LIBUSB_PIPE, errno.EPIPE)

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        """Tell that no kernel driver holds it."""
        return False

    def _accept(self, *_: Any) -> None:
        """Accept what changes nothing here."""

    set_configuration = set_interface_altsetting = claim_interface = release_interface = _accept
    clear_halt = reset_device = _accept


@contextmanager
def _telling() -> Iterator[None]:
    """Say in pyusb's way that the device is gone."""
    try:
        yield
    except ConnectionError as error:
        raise usb.core.USBError(f"No such device: {error}", _LIBUSB_NO_DEVICE, errno.ENODEV) from error


def _only(index: int, count: int) -> None:
    # pyusb looks for more until an IndexError tells that there is none.
    if index >= count:
        raise IndexError(index)
