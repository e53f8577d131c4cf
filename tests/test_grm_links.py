"""Serial and USB links: time-outs, what is ready, other ends that are gone, and the bench file's text."""

from __future__ import annotations

import errno
import os
import socket
import sys
import threading
import time
from array import array
from collections import deque
from types import SimpleNamespace

import pytest
import serial
import usb.core
from grm_bench import FakeReceiver, window_for

from belahil.clock import SystemClock
from belahil.errors import ConfigError, InstrumentError, LinkClosed, LinkError, LinkTimeout
from belahil.values import WindowRequest
from drivers import links_grm
from drivers.grm import GrmDigitizer
from drivers.links_grm import open_link
from drivers.serial_link import SerialLink, open_serial
from drivers.usb_link import UsbLink, open_usb
from sim.devices.grm import GrmDevice

# --- serial


def serial_pair() -> tuple[SerialLink, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link, framing = open_link(f"socket://127.0.0.1:{server.getsockname()[1]}")
        far, _ = server.accept()
    assert framing == "cobs"
    return link, far


def test_a_serial_link_gives_what_is_ready_and_waits_for_no_more() -> None:
    link, far = serial_pair()
    with far:
        far.sendall(bytes(5000))
        time.sleep(0.05)
        started = time.monotonic()

        assert link.read(65536, 5.0) == bytes(5000)
        assert time.monotonic() - started < 2.0


def test_a_serial_link_waits_for_the_first_byte_and_gives_up_in_time() -> None:
    link, far = serial_pair()
    with far:
        started = time.monotonic()
        assert link.read(100, 0.05) == b""
        assert 0.04 < time.monotonic() - started < 2.0

        threading.Timer(0.05, far.sendall, [b"abc"]).start()
        assert link.read(100, 5.0) == b"abc"


def test_a_serial_link_never_gives_more_than_asked() -> None:
    link = open_serial("loop://")
    link.write(b"abcdef")

    assert [link.read(1, 0.01), link.read(2, 0.01), link.read(9, 0.01)] == [b"a", b"bc", b"def"]
    link.write(b"old")
    link.clear()
    assert link.read(9, 0.01) == b""


def test_a_serial_link_tells_that_the_other_end_is_gone() -> None:
    link, far = serial_pair()
    far.close()

    with pytest.raises(LinkClosed, match="is gone"):
        link.read(10, 0.5)
    link.close()
    for verb in (lambda: link.read(1, 0.1), lambda: link.write(b"x"), link.clear):
        with pytest.raises(LinkClosed):
            verb()
    link.close()


def test_a_write_that_is_not_taken_is_a_time_out() -> None:
    class Full:
        name = "full"

        def write(self, data: bytes) -> int:
            raise serial.SerialTimeoutException("Write timeout")

    with pytest.raises(LinkTimeout, match="2 bytes were not taken"):
        SerialLink(Full()).write(b"ab")


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_receiver_behind_a_pseudo_terminal_is_measured() -> None:
    # Given a device in a thread at the far side of a pty
    far, near = os.openpty()
    device = GrmDevice(FakeReceiver())
    stop = threading.Event()

    def serve() -> None:
        while not stop.is_set():
            device.write(os.read(far, 4096))
            while data := device.read(4096):
                os.write(far, data)

    link, framing = open_link(f"serial://{os.ttyname(near)}?baud=115200")
    os.close(near)
    thread = threading.Thread(target=serve, daemon=True)
    thread.start()

    # When it is measured through the real pyserial
    digitizer = GrmDigitizer(link, SystemClock(), framing)
    request = WindowRequest(shot=3, gain_code=2)
    digitizer.arm(request)
    window = digitizer.read(5.0)

    # Then the whole window is there
    assert window.equals(window_for(request))
    stop.set()
    digitizer.close()
    thread.join(5.0)
    os.close(far)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_pseudo_terminal_that_hangs_up_is_a_closed_link() -> None:
    far, near = os.openpty()
    link = open_serial(os.ttyname(near))
    os.close(near)
    os.close(far)

    for verb in (lambda: link.read(1, 0.1), lambda: link.write(b"x")):
        with pytest.raises(LinkClosed):
            verb()
    link.close()


def test_a_port_that_is_not_there_is_one_clear_line() -> None:
    with pytest.raises(LinkClosed, match="serial link /dev/no-such-port does not open"):
        open_link("serial:///dev/no-such-port")


# --- USB


class FakeUsb:
    """A pyusb device with one interface; reads give what `ready` holds: bytes, or an error."""

    idVendor, idProduct = 0x1209, 0x0001  # noqa: N815  (pyusb's names)

    def __init__(self, addresses: tuple[int, ...] = (0x01, 0x82)) -> None:
        self.ready: deque[bytes | Exception] = deque()
        self.written: list[bytes] = []
        self.timeouts_ms: list[int] = []
        self.taken: int | None = None
        self.interface = [
            SimpleNamespace(bEndpointAddress=address, bmAttributes=2, read=self.read, write=self.write)
            for address in addresses
        ]

    def set_configuration(self) -> None: ...

    def get_active_configuration(self) -> dict:
        return {(0, 0): self.interface}

    def read(self, count: int, timeout_ms: int) -> array:
        self.timeouts_ms.append(timeout_ms)
        ready = self.ready.popleft() if self.ready else usb.core.USBTimeoutError("", -7, errno.ETIMEDOUT)
        if isinstance(ready, Exception):
            raise ready
        return array("B", ready[:count])

    def write(self, data: bytes, timeout_ms: int) -> int:
        self.written.append(data)
        if self.ready and isinstance(self.ready[0], Exception):
            raise self.ready.popleft()
        return len(data) if self.taken is None else self.taken


def test_a_usb_link_reads_transfers_and_time_outs() -> None:
    device = FakeUsb()
    link = UsbLink(device)
    device.ready.extend([b"one", b"two"])

    assert [link.read(64, 0.2), link.read(64, 0.0), link.read(64, 1e-9)] == [b"one", b"two", b""]
    # 0 would mean for ever
    assert device.timeouts_ms == [200, 1, 1]


def test_an_empty_transfer_is_no_time_out() -> None:
    device = FakeUsb()
    link = UsbLink(device)
    device.ready.extend([b"", b"next"])

    assert link.read(64, 0.1) == b"next"


def test_a_usb_link_clears_what_is_ready() -> None:
    device = FakeUsb()
    link = UsbLink(device)
    device.ready.extend([b"old"] * 5)

    link.clear()

    assert link.read(64, 0.1) == b""


def test_a_usb_write_is_all_or_a_time_out() -> None:
    device = FakeUsb()
    link = UsbLink(device)

    link.write(b"abc")
    assert device.written == [b"abc"]

    device.taken = 2
    with pytest.raises(LinkTimeout, match="2 of 3 bytes"):
        link.write(b"abc")
    device.ready.append(usb.core.USBTimeoutError("", -7, errno.ETIMEDOUT))
    with pytest.raises(LinkTimeout, match="0 of 3 bytes"):
        link.write(b"abc")


@pytest.mark.parametrize(
    ("number", "kind"), [(errno.ENODEV, LinkClosed), (errno.EPIPE, LinkError), (errno.EIO, LinkError)]
)
def test_a_usb_device_that_is_gone_is_told_from_one_that_stumbles(number: int, kind: type[LinkError]) -> None:
    device = FakeUsb()
    link = UsbLink(device)
    device.ready.append(usb.core.USBError("trouble", None, number))

    with pytest.raises(LinkError, match="1209:0001") as failure:
        link.read(64, 0.1)

    assert type(failure.value) is kind


def test_a_closed_usb_link_stays_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usb.util, "dispose_resources", lambda device: None)
    link = UsbLink(FakeUsb())

    link.close()
    link.close()

    with pytest.raises(LinkClosed):
        link.read(64, 0.1)


def test_a_usb_device_without_bulk_endpoints_is_refused() -> None:
    with pytest.raises(InstrumentError, match="no bulk OUT endpoint"):
        UsbLink(FakeUsb(addresses=(0x82,)))


def test_a_usb_device_is_found_by_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def find(backend: object, **wanted: object) -> FakeUsb | None:
        asked.append((backend, wanted))
        return FakeUsb() if wanted["idProduct"] == 0x0A else None

    monkeypatch.setattr(usb.core, "find", find)

    link, framing = open_link("usb:1209:a:SN:7", usb_backend="bus")
    assert (type(link), framing) == (UsbLink, "raw")
    assert asked == [("bus", {"idVendor": 0x1209, "idProduct": 0x0A, "serial_number": "SN:7"})]
    with pytest.raises(LinkClosed, match="1209:000b is not connected"):
        open_link("usb:1209:b")


@pytest.mark.parametrize(
    ("error", "kind", "says"),
    [
        (usb.core.NoBackendError("No backend available"), InstrumentError, "install libusb"),
        (usb.core.USBError("Access denied", None, errno.EACCES), LinkClosed, "Access denied"),
    ],
)
def test_usb_that_does_not_open_says_why(
    monkeypatch: pytest.MonkeyPatch, error: Exception, kind: type[Exception], says: str
) -> None:
    def find(backend: object, **wanted: object) -> None:
        raise error

    monkeypatch.setattr(usb.core, "find", find)

    with pytest.raises(kind, match=says):
        open_usb(0x1209, 1)


# --- the text of a bench file


@pytest.mark.parametrize(
    ("text", "port", "baud"),
    [
        ("serial:COM3", "COM3", 921600),
        ("serial:///dev/ttyUSB0?baud=115200", "/dev/ttyUSB0", 115200),
        ("serial:/dev/ttyUSB0", "/dev/ttyUSB0", 921600),
        ("serial:loop://", "loop://", 921600),
    ],
)
def test_a_serial_text_names_port_and_rate(
    monkeypatch: pytest.MonkeyPatch, text: str, port: str, baud: int
) -> None:
    opened = []
    monkeypatch.setattr(links_grm, "open_serial", lambda *asked: opened.append(asked))

    open_link(text)

    assert opened == [(port, baud)]


@pytest.mark.parametrize(
    "text",
    [
        "serial:",
        "serial:COM3?baud=fast",
        "serial:COM3?baud=0",
        "serial:COM3?parity=N",
        "tty",
        "usb:1209",
        "usb:x:y",
        "socket://127.0.0.1",
        "socket://127.0.0.1:",
        "socket://127.0.0.1:0",
        "socket://127.0.0.1:65536",
        "socket://127.0.0.1:port",
        "socket://:5026",
        "socket:127.0.0.1:5026",
    ],
)
def test_a_text_of_no_known_form_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"\[digitizer\] link") as caught:
        open_link(text)
    assert ("a port from 1 to 65535" in str(caught.value)) == text.startswith("socket:")
