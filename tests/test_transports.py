"""Where emulated devices plug in: what vendor libraries see of them."""

from __future__ import annotations

import errno
import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest
import pyvisa
import serial
import usb.core
import usb.util
from pyvisa.constants import ResourceAttribute, StatusCode, TriggerProtocol

from belahil.errors import LinkClosed, LinkError
from drivers.serial_link import open_serial
from sim.devices.scpi import ScpiDevice
from sim.plant import PlantClock
from sim.transports.channels import LineWire, PtyChannel, ScpiWire
from sim.transports.serial_port import register_serial
from sim.transports.server_loop import Server
from sim.transports.usb_backend import EmulatedUsb
from sim.transports.visa_library import EmulatedVisa

NAME = "USB0::0x0957::0x2C07::MY1::INSTR"


class Messages:
    """An instrument whose answers a test puts in."""

    def __init__(self, *answers: bytes) -> None:
        self.answers = list(answers)
        self.written: list[tuple[bytes, bool]] = []

    def write(self, data: bytes, end: bool = True) -> None:
        self.written.append((data, end))

    def read(self) -> bytes | None:
        return self.answers.pop(0) if self.answers else None

    def clear(self) -> None:
        self.answers.clear()

    def read_stb(self) -> int:
        return 0x50 if self.answers else 0


class Line:
    """The far end of a line: it says back what it is told."""

    def __init__(self) -> None:
        self.held = b""

    def write(self, data: bytes) -> None:
        self.held += data

    def read(self, max_bytes: int) -> bytes:
        taken, self.held = self.held[:max_bytes], self.held[max_bytes:]
        return taken

    @property
    def waiting(self) -> int:
        return len(self.held)

    def clear(self) -> None:
        self.held = b""


@contextmanager
def _visa(device: Messages) -> Iterator[tuple[pyvisa.resources.MessageBasedResource, PlantClock]]:
    clock = PlantClock()
    manager = pyvisa.ResourceManager(EmulatedVisa(clock).plug(NAME, device))
    with closing(manager.open_resource(NAME)) as resource:
        assert isinstance(resource, pyvisa.resources.USBInstrument)
        yield resource, clock


# The VISA library.


def test_a_read_ends_at_the_end_at_a_termination_character_or_at_the_count() -> None:
    device = Messages(b"ab\ncd\nef", b"ab\ncd\n")
    more = StatusCode.success_max_count_read
    with _visa(device) as (resource, _), resource.ignore_warning(more):
        library, session = resource.visalib, resource.session
        resource.read_termination = "\n"
        assert library.read(session, 2) == (b"ab", more)
        assert library.read(session, 9) == (b"\n", StatusCode.success_termination_character_read)
        assert library.read(session, 3) == (b"cd\n", StatusCode.success_termination_character_read)
        # the end of the message counts more than the count
        assert library.read(session, 2) == (b"ef", StatusCode.success)
        resource.read_termination = None
        assert library.read(session, 99) == (b"ab\ncd\n", StatusCode.success)


def test_an_empty_read_is_the_expired_time_out() -> None:
    with _visa(Messages()) as (resource, clock):
        resource.timeout = 1500
        with pytest.raises(pyvisa.VisaIOError) as caught:
            resource.read()
        assert caught.value.error_code == StatusCode.error_timeout
        assert clock.now_s() == 1.5
        resource.timeout = None
        with pytest.raises(pyvisa.VisaIOError):
            resource.read()
        assert clock.now_s() == 1.5


def test_writes_carry_end_unless_it_is_switched_off() -> None:
    device = Messages()
    with _visa(device) as (resource, _):
        resource.write("A")
        resource.send_end = False
        resource.write_raw(b"B")
    assert device.written == [(b"A\r\n", True), (b"B", False)]


def test_clear_status_byte_trigger_and_flush_reach_the_device() -> None:
    device = Messages(b"12\n", b"34\n")
    with _visa(device) as (resource, _):
        assert resource.read_stb() == 0x50
        assert resource.read_bytes(1) == b"1"
        resource.flush(pyvisa.constants.BufferOperation.discard_read_buffer)
        assert resource.read_raw() == b"34\n"
        device.answers = [b"56\n"]
        resource.clear()
        assert resource.read_stb() == 0
        resource.assert_trigger()
        assert device.written == [(b"*TRG\n", True)]
        resource.visalib.assert_trigger(resource.session, TriggerProtocol.default)


def test_a_trigger_before_the_rest_of_an_answer_was_read_interrupts_it() -> None:
    # given an instrument whose answer was read in part
    clock = PlantClock()
    manager = pyvisa.ResourceManager(EmulatedVisa(clock).plug(NAME, ScpiDevice("A,B,C,D")))
    with closing(manager.open_resource(NAME)) as resource:
        assert isinstance(resource, pyvisa.resources.USBInstrument)
        resource.write("*IDN?")
        assert resource.read_bytes(1) == b"A"
        # when it is triggered, then the rest is gone, which is an error, as is the trigger here
        resource.assert_trigger()
        assert [resource.query("SYST:ERR?")[:4] for _ in range(3)] == ["-410", "-211", '+0,"']


def test_names_attributes_and_what_is_not_there() -> None:
    clock = PlantClock()
    library = EmulatedVisa(clock).plug(NAME, Messages()).plug("GPIB0::3::INSTR", Messages())
    manager = pyvisa.ResourceManager(library)
    assert manager.list_resources() == ("USB0::0x0957::0x2C07::MY1::0::INSTR", "GPIB0::3::INSTR")
    assert manager.list_resources("GPIB?*") == ("GPIB0::3::INSTR",)
    with closing(manager.open_resource("GPIB::3")) as resource:
        assert resource.resource_name == "GPIB0::3::INSTR"
        assert resource.timeout == 2000
        for verb in (resource.visalib.get_attribute, lambda *at: resource.visalib.set_attribute(*at, 1)):
            with pytest.raises(pyvisa.VisaIOError) as caught:
                verb(resource.session, ResourceAttribute.asrl_baud_rate)
            assert caught.value.error_code == StatusCode.error_nonsupported_attribute
        session = resource.session
    for refused, status in (
        (lambda: manager.open_resource("GPIB0::4::INSTR"), StatusCode.error_resource_not_found),
        (lambda: library.read(session, 1), StatusCode.error_invalid_object),
    ):
        with pytest.raises(pyvisa.VisaIOError) as caught:
            refused()
        assert caught.value.error_code == status
    with pytest.raises(ValueError, match="only INSTR"):
        library.plug("TCPIP::127.0.0.1::5025::SOCKET", Messages())


def test_benches_do_not_share_a_library() -> None:
    clock = PlantClock()
    first, second = (pyvisa.ResourceManager(EmulatedVisa(clock).plug(NAME, Messages())) for _ in range(2))
    first.close()
    second.open_resource(NAME).close()


def test_a_device_that_is_gone_is_a_lost_connection() -> None:
    device = Messages()
    device.clear = device.read = device.write = _gone  # type: ignore[assignment,method-assign]
    with _visa(device) as (resource, _):
        for verb in (resource.clear, resource.read_raw, lambda: resource.write("A")):
            with pytest.raises(pyvisa.VisaIOError) as caught:
                verb()
            assert caught.value.error_code == StatusCode.error_connection_lost


def _gone(*_: object) -> None:
    raise ConnectionResetError("unplugged")


# The serial line.


def test_a_serial_line_reads_what_there_is_and_then_waits() -> None:
    clock = PlantClock()
    url = register_serial(Line(), clock)
    with serial.serial_for_url(url, timeout=2.5, baudrate=921600) as port:
        assert port.write(b"hello") == 5
        assert port.in_waiting == 5
        assert port.read(3) == b"hel"
        assert clock.now_s() == 0
        assert port.read(3) == b"lo"
        assert clock.now_s() == 2.5
        port.timeout = 0
        assert port.read(1) == b""
        assert clock.now_s() == 2.5
        port.write(b"x")
        port.reset_input_buffer()
        assert port.in_waiting == 0
        port.timeout = None
        with pytest.raises(serial.SerialException, match="no time-out"):
            port.read(1)
        with pytest.raises(serial.SerialException, match="already open"):
            port.open()
    # then the line is unplugged
    with pytest.raises(serial.SerialException, match="no emulated device is there"):
        serial.serial_for_url(url)
    with pytest.raises(serial.SerialException, match="not open"):
        port.read(1)


def test_a_serial_device_that_is_gone_closes_the_link() -> None:
    line = Line()
    link = open_serial(register_serial(line, PlantClock()))
    line.write = line.read = _gone  # type: ignore[assignment,method-assign]
    for verb in (lambda: link.write(b"x"), lambda: link.read(1, 1.0)):
        with pytest.raises(LinkClosed, match="disconnected: unplugged"):
            verb()
    link.close()


# The USB bus.


def test_a_usb_device_has_two_bulk_endpoints_and_one_owner() -> None:
    clock = PlantClock()
    bus = EmulatedUsb(Line(), clock, 0x1234, 0x5678)
    assert usb.core.find(backend=bus, idVendor=0x1234, idProduct=1) is None
    device = usb.core.find(backend=bus, idVendor=0x1234, idProduct=0x5678)
    device.set_configuration()
    addresses = [endpoint.bEndpointAddress for endpoint in device.get_active_configuration()[(0, 0)]]
    assert addresses == [0x01, 0x81]
    assert device.write(0x01, b"hello", 100) == 5
    assert bytes(device.read(0x81, 3, 100)) == b"hel"
    assert bytes(device.read(0x81, 512, 100)) == b"lo"
    with pytest.raises(usb.core.USBTimeoutError) as caught:
        device.read(0x81, 512, 300)
    assert (caught.value.errno, clock.now_s()) == (errno.ETIMEDOUT, 0.3)
    with pytest.raises(usb.core.USBError) as refused:
        device.ctrl_transfer(0xC0, 1)
    assert refused.value.errno == errno.EPIPE
    second = usb.core.find(backend=bus)
    with pytest.raises(usb.core.USBError, match="in use"):
        second.set_configuration()
    usb.util.dispose_resources(device)
    second.set_configuration()
    usb.util.dispose_resources(second)


def test_a_usb_device_that_is_gone_is_no_device() -> None:
    line = Line()
    device = usb.core.find(backend=EmulatedUsb(line, PlantClock()))
    device.set_configuration()
    line.write = line.read = _gone  # type: ignore[assignment,method-assign]
    for verb in (lambda: device.write(0x01, b"x"), lambda: device.read(0x81, 1)):
        with pytest.raises(usb.core.USBError) as caught:
            verb()
        assert caught.value.errno == errno.ENODEV
    usb.util.dispose_resources(device)


# The server.


@contextmanager
def _running(server: Server) -> Iterator[None]:
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield
    finally:
        server.stop()
        thread.join(10)
        assert not thread.is_alive()


def _asked(client: socket.socket, message: bytes) -> bytes:
    client.sendall(message)
    return client.makefile("rb").readline()


def _connected(port: int) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port), timeout=10)
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return client


def test_several_clients_get_the_answers_to_their_own_messages() -> None:
    device = ScpiDevice("maker,model,1,2")
    with Server() as server:
        port = server.listen(lambda: ScpiWire(device), "127.0.0.1", 0, most_clients=2)
        with _running(server), _connected(port) as first, _connected(port) as second:
            # given a client in the middle of a message
            first.sendall(b"*ESE 7;*E")
            # when another one asks, then it gets its own answer
            assert _asked(second, b"*IDN?\n") == b"maker,model,1,2\n"
            assert _asked(first, b"SE?\r\n") == b"+7\n"
            # and a third one is sent away
            with _connected(port) as third:
                assert third.recv(1) == b""
            # and the place of one that left is free again
            second.close()
            assert _asked(first, b"*ESE?\n") == b"+7\n"
            with _connected(port) as fourth:
                assert _asked(fourth, b"*ESE?\n") == b"+7\n"
                # an answer that nobody waits for harms nobody
                fourth.sendall(b"*IDN?\n" * 1000)
            assert _asked(first, b"*ESE?\n") == b"+7\n"


def test_a_block_may_hold_line_feeds_wherever_the_stream_is_cut() -> None:
    device = ScpiDevice("maker,model,1,2")
    wire = ScpiWire(device)
    message = b"DISP #213" + b"\n" * 13 + b";*IDN?\n*ESE?\n"
    for place in range(len(message)):
        device.clear()
        wire.feed(message[:place])
        wire.feed(message[place:])
        # the header is unknown here, so the rest of its message is dropped, and no more than that
        assert wire.take() == b"+0\n"
        assert len(device.status.errors) == 1
        device.status.errors.clear()


def test_a_link_has_one_client_and_takes_more_than_a_socket_holds() -> None:
    line = Line()
    with Server() as server:
        port = server.listen(lambda: LineWire(line), "127.0.0.1", 0, most_clients=1)
        with _running(server):
            link = open_serial(f"socket://127.0.0.1:{port}")
            # when far more is on its way than buffers hold
            said = bytes(range(256)) * 4096
            sender = threading.Thread(target=link.write, args=(said,))
            sender.start()
            heard = b""
            while len(heard) < len(said):
                part = link.read(1 << 16, 10.0)
                assert part
                heard += part
            sender.join()
            # then all of it comes back, in order
            assert heard == said
            link.close()


def test_a_port_that_is_taken_is_one_clear_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, Server() as server:
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"127.0.0.1:{port}: Address already in use"):
            server.listen(lambda: LineWire(Line()), "127.0.0.1", port, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_a_pseudo_terminal_carries_every_byte() -> None:
    with Server() as server:
        channel = PtyChannel()
        server.attach(channel, lambda: LineWire(Line()))
        with _running(server):
            for _ in range(2):  # a client may leave and come back
                link = open_serial(channel.path)
                said = bytes(range(256)) * 8
                link.write(said)
                heard = b""
                while len(heard) < len(said):
                    heard += link.read(4096, 10.0)
                assert heard == said
                link.close()
    assert not os.path.exists(channel.path)
