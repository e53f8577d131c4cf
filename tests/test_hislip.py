"""HiSLIP: PyVISA-py as a client, and the protocol's own rules, message by message (IVI-6.1, revision 1.0)."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import pyvisa
from hypothesis import example, given, settings
from hypothesis import strategies as st

from belahil.bench import open_bench
from belahil.config import parse_bench
from belahil.errors import LinkClosed
from belahil.generators import MODELS, GeneratorSetting
from belahil.stimuli import SampledPulse, Sine
from belahil.values import WindowRequest
from drivers.visa_link import VisaLink
from sim.devices.generator import GeneratorDevice
from sim.devices.scpi import ScpiDevice
from sim.transports.hislip import HislipPort, HislipWire
from sim.transports.hislip_messages import HEADER, Kind, Message
from tests.served import RawClient, port_of, served

NO_ERROR = '+0,"No error"'


class Port:
    """Where the generator plays into."""

    def __init__(self) -> None:
        self.triggers = 0

    def play(self, setting: GeneratorSetting) -> None:
        pass

    def trigger(self) -> bool:
        self.triggers += 1
        return True


class Client:
    """Both wires of a client, without a network."""

    def __init__(self, port: HislipPort, address: bytes = b"hislip0") -> None:
        self.sync, self.aside = port.wire(), port.wire()
        (answer,) = self.say(Message(Kind.INITIALIZE, 0, 0x01007878, address))
        assert (answer.kind, answer.control, answer.parameter >> 16) == (Kind.INITIALIZE_RESPONSE, 0, 0x0100)
        self.number = answer.parameter & 0xFFFF
        (answer,) = self.say_aside(Message(Kind.ASYNC_INITIALIZE, 0, self.number))
        assert answer.kind == Kind.ASYNC_INITIALIZE_RESPONSE
        self.id = 0xFFFFFF00

    def say(self, *messages: Message) -> list[Message]:
        self.sync.feed(b"".join(message.packed() for message in messages))
        return unpacked(self.sync.take())

    def say_aside(self, *messages: Message) -> list[Message]:
        self.aside.feed(b"".join(message.packed() for message in messages))
        return unpacked(self.aside.take())

    def data(self, text: bytes, delivered: int = 0, kind: Kind = Kind.DATA_END) -> Message:
        message = Message(kind, delivered, self.id, text)
        self.id = self.id + 2 & 0xFFFFFFFF
        return message

    def status(self, delivered: int = 0) -> int:
        (answer,) = self.say_aside(Message(Kind.ASYNC_STATUS_QUERY, delivered, self.id - 2))
        assert answer.kind == Kind.ASYNC_STATUS_RESPONSE
        return answer.control


def unpacked(data: bytes) -> list[Message]:
    """Read messages; every byte must belong to one."""
    messages = []
    while data:
        prologue, kind, control, parameter, length = HEADER.unpack_from(data)
        assert prologue == b"HS"
        assert len(data) >= HEADER.size + length
        messages.append(Message(kind, control, parameter, data[HEADER.size : HEADER.size + length]))
        data = data[HEADER.size + length :]
    return messages


@pytest.fixture
def device() -> ScpiDevice:
    return GeneratorDevice(MODELS["33522B"], Port())


@pytest.fixture
def port(device: ScpiDevice) -> HislipPort:
    return HislipPort([device], most_clients=3, now_s=lambda: 100.0)


@contextmanager
def opened(address: str) -> Iterator[Any]:
    manager = pyvisa.ResourceManager("@py")
    resource = manager.open_resource(address, timeout=10_000)
    try:
        yield resource
    finally:
        resource.close()
        manager.close()


# ---- PyVISA-py, over the network


def test_pyvisa_asks_polls_clears_and_sends_blocks() -> None:
    with served() as (places, _), opened(places.hislip_address) as generator:
        # ask, with the end of the message and no terminator needed
        assert generator.query("*IDN?").startswith("Agilent Technologies,33522B,")
        generator.write_termination = ""
        assert generator.query("*OPC?") == "1\n"
        # the status byte tells of an error
        assert generator.read_stb() == 0
        generator.write("FOO")
        assert generator.read_stb() & 4
        # a device clear drops the half of a message, and leaves errors
        generator.visalib.sessions[generator.session].interface._send_data_packet(b"DATA:ARB:DAC A,#41000")
        generator.clear()
        assert generator.query("SYST:ERR?").startswith("-113,")
        assert generator.query("SYST:ERR?").strip() == NO_ERROR
        # blocks of more than one message of the link, with line ends in them
        codes = np.resize(np.array([0x0A0A, 0x0D0A, -32767, 32767], np.int16), 700_000)
        generator.write_binary_values("DATA:ARB:DAC A,", codes, datatype="h", is_big_endian=True)
        assert generator.query("DATA:ATTR:POIN? A;:SYST:ERR?").strip() == f"+700000;{NO_ERROR}"


def test_pyvisa_reads_an_answer_of_many_messages(device: ScpiDevice) -> None:
    # given many waveforms, whose names make a long answer, and a client that takes short messages
    with served() as (places, _), opened(places.hislip_address) as generator:
        for number in range(60):
            generator.write(f"DATA:ARB:DAC W{number},1,2,3,4,5,6,7,8")
        generator.visalib.sessions[generator.session].interface.max_msg_size = 256
        names = generator.query("DATA:VOL:CAT?")
        assert names.strip().split(",")[1:] == [f'"W{number}"' for number in range(60)]
        assert generator.query("SYST:ERR?").strip() == NO_ERROR


def test_pyvisa_triggers_by_the_link() -> None:
    with served() as (places, _), opened(places.hislip_address) as generator:
        # PyVISA-py 0.8 has the message but no `assert_trigger` over HiSLIP.
        trigger = generator.visalib.sessions[generator.session].interface.trigger
        trigger()
        assert generator.query("SYST:ERR?").startswith("-211,")
        generator.write("BURS:MODE TRIG;:BURS:STAT ON;:TRIG:SOUR BUS;:OUTP ON")
        trigger()
        assert generator.query("*OPC?;:SYST:ERR?").strip() == f"1;{NO_ERROR}"


def test_our_own_driver_measures_over_hislip_what_it_measures_over_a_socket() -> None:
    stimuli = Sine(2.5e6, 0.05), SampledPulse(np.hanning(200) * 0.02, 80e6, start_s=1e-6)
    with served() as (places, _):
        counts = []
        for address in (places.address, places.hislip_address):
            text = f'[generator]\naddress = "{address}"\nvisa_library = "@py"\n'
            with open_bench(parse_bench(f'{text}[digitizer]\nlink = "{places.link}"\n')) as bench:
                counts.append([bench.measure(s, WindowRequest(7, 4)).window.counts for s in stimuli])
        np.testing.assert_array_equal(counts[0], counts[1])


def test_our_own_driver_tells_when_the_other_end_of_hislip_is_gone() -> None:
    with served() as (places, _):
        link = VisaLink(places.hislip_address, "@py")
        link.write(b"*IDN?\n")
        assert link.read(100, 5.0).startswith(b"Agilent")
        # an old answer on its way does not outlast a clear
        link.write(b"*IDN?\n")
        link.clear()
        link.write(b"*OPC?\n")
        assert link.read(100, 5.0) == b"1\n"
    with pytest.raises(LinkClosed, match="is gone"):
        _ask_thrice(link)
    link.close()


def _ask_thrice(link: VisaLink) -> None:
    for _ in range(3):  # a closed connection takes the first message
        link.write(b"*OPC?\n")
        link.read(100, 1.0)


# ---- the rules, without a network


def test_an_answer_carries_the_number_of_its_question(port: HislipPort) -> None:
    client = Client(port)
    for expected in (0xFFFFFF00, 0xFFFFFF02):
        (answer,) = client.say(client.data(b"*OPC?", 0 if expected == 0xFFFFFF00 else 1))
        assert answer == Message(Kind.DATA_END, 0, expected, b"1\n")
    # and a message may come in parts, and in any portions
    whole = client.data(b"*ID", 1, Kind.DATA).packed() + client.data(b"N?").packed()
    for place in range(len(whole)):
        client.sync.feed(whole[place : place + 1])
    (answer,) = unpacked(client.sync.take())
    assert answer.payload.startswith(b"Agilent")


def test_a_message_is_available_until_it_is_said_to_be_read(port: HislipPort) -> None:
    client = Client(port)
    assert client.status() & 16 == 0
    client.say(client.data(b"*OPC?"))
    assert client.status() & 16
    # a client whose next message is still on its way hears nothing of an older answer
    (answer,) = client.say_aside(Message(Kind.ASYNC_STATUS_QUERY, 0, client.id))
    assert answer.control & 16 == 0
    assert client.status(delivered=1) & 16 == 0
    assert client.status() & 16 == 0
    # then no error is made of it
    (answer,) = client.say(client.data(b"SYST:ERR?"))
    assert answer.payload.decode().strip() == NO_ERROR


def test_an_answer_that_was_not_read_is_error_410(port: HislipPort) -> None:
    client = Client(port)
    client.say(client.data(b"*OPC?"))
    # when the next question comes without a word of that answer
    (answer,) = client.say(client.data(b"SYST:ERR?"))
    assert answer.payload.startswith(b"-410,")


def test_a_question_behind_a_question_interrupts_it(port: HislipPort) -> None:
    client = Client(port)
    first, second = client.data(b"*OPC?"), client.data(b"SYST:ERR?")
    said = client.say(first, second)
    assert said[0] == Message(Kind.INTERRUPTED, 0, second.parameter)
    assert (said[1].kind, said[1].parameter) == (Kind.DATA_END, second.parameter)
    assert said[1].payload.startswith(b"-410,")
    assert unpacked(client.aside.take()) == [Message(Kind.ASYNC_INTERRUPTED, 0, second.parameter)]


def test_a_device_clear_drops_everything_between_its_two_halves(port: HislipPort) -> None:
    client = Client(port)
    client.say(client.data(b"DATA:ARB:DAC A,#41000xx", kind=Kind.DATA))
    assert client.say_aside(Message(Kind.ASYNC_DEVICE_CLEAR)) == [
        Message(Kind.ASYNC_DEVICE_CLEAR_ACKNOWLEDGE)
    ]
    assert client.say(client.data(b"FOO")) == []
    # overlapped mode is asked for, and not granted
    assert client.say(Message(Kind.DEVICE_CLEAR_COMPLETE, 1)) == [Message(Kind.DEVICE_CLEAR_ACKNOWLEDGE)]
    client.id = 0xFFFFFF00
    (answer,) = client.say(client.data(b"SYST:ERR?"))
    assert answer.payload.decode().strip() == NO_ERROR


def test_service_is_requested_once_for_each_reason(port: HislipPort) -> None:
    client = Client(port)
    client.say(client.data(b"*SRE 4"))
    client.say(client.data(b"FOO"))
    # when the error queue is not empty any more
    (request,) = unpacked(client.aside.take())
    assert (request.kind, request.control & 0x44) == (Kind.ASYNC_SERVICE_REQUEST, 0x44)
    # then a further error is no new reason, and the status query ends the request
    client.say(client.data(b"FOO"))
    assert unpacked(client.aside.take()) == []
    assert client.status() & 0x44 == 0x44
    assert client.status() & 0x44 == 0x04
    # and when the reason has gone and comes again, there is a new request
    client.say(client.data(b"*CLS"))
    assert unpacked(client.aside.take()) == []
    client.say(client.data(b"FOO"))
    (request,) = unpacked(client.aside.take())
    assert request.kind == Kind.ASYNC_SERVICE_REQUEST


def test_locks_keep_others_waiting_until_they_are_released(device: ScpiDevice) -> None:
    now_s = 0.0
    port = HislipPort([device], 4, lambda: now_s)
    holder, other = Client(port), Client(port)
    lock, release = Message(Kind.ASYNC_LOCK, 1, 500), Message(Kind.ASYNC_LOCK, 0)

    def control(said: list[Message]) -> int:
        (answer,) = said
        assert answer.kind == Kind.ASYNC_LOCK_RESPONSE
        return answer.control

    assert control(holder.say_aside(lock)) == 1
    assert control(holder.say_aside(lock)) == 3  # it has it
    assert other.say_aside(Message(Kind.ASYNC_LOCK_INFO)) == [Message(Kind.ASYNC_LOCK_INFO_RESPONSE, 1, 1)]
    # when another asks the instrument, it waits; its wish for the lock fails when its time is over
    assert other.say(other.data(b"*OPC?")) == []
    assert other.say_aside(lock) == []
    assert other.aside.due_s == 0.5
    now_s = 0.5
    assert control(unpacked(other.aside.take())) == 0
    # then a release lets it go on
    assert control(holder.say_aside(release)) == 1
    (answer,) = unpacked(other.sync.take())
    assert answer.payload == b"1\n"
    assert control(holder.say_aside(release)) == 3
    # and who leaves leaves no lock
    assert control(holder.say_aside(lock)) == 1
    assert other.say_aside(lock) == []
    holder.sync.gone()
    assert control(unpacked(other.aside.take())) == 1
    holder.aside.take()
    assert holder.aside.finished


def test_instruments_at_one_port_have_their_own_clients_and_locks(device: ScpiDevice) -> None:
    # given two instruments, for one client each
    port = HislipPort([device, ScpiDevice("another,b,c,d")], 1)
    first, second = Client(port), Client(port, b"HiSLIP1")
    assert first.number != second.number
    # when the first is locked, then the second is free, and its own
    (answer,) = first.say_aside(Message(Kind.ASYNC_LOCK, 1, 500))
    assert answer.control == 1
    assert second.say_aside(Message(Kind.ASYNC_LOCK_INFO)) == [Message(Kind.ASYNC_LOCK_INFO_RESPONSE, 0, 0)]
    (answer,) = second.say(second.data(b"*IDN?"))
    assert answer.payload == b"another,b,c,d\n"
    # and each has room for one client alone, whoever leaves the other
    second.sync.gone()
    assert Client(port, b"hislip1")
    with pytest.raises(AssertionError):
        Client(port)


def test_a_shared_lock_keeps_out_those_without_its_key(port: HislipPort) -> None:
    first, second, third = (Client(port) for _ in range(3))

    def lock(client: Client, key: bytes) -> int:
        (answer,) = client.say_aside(Message(Kind.ASYNC_LOCK, 1, 0, key))
        return answer.control

    assert (lock(first, b"we"), lock(second, b"we"), lock(third, b"they")) == (1, 1, 0)
    assert (len(first.say(first.data(b"*OPC?"))), len(second.say(second.data(b"*OPC?")))) == (1, 1)
    assert third.say(third.data(b"*OPC?")) == []
    assert lock(first, b"") == 1  # the exclusive one, from among those who share
    assert second.say(second.data(b"*OPC?", 1)) == []
    assert [first.say_aside(Message(Kind.ASYNC_LOCK, 0))[0].control for _ in range(3)] == [1, 2, 3]
    assert len(unpacked(second.sync.take())) == 1


@pytest.mark.parametrize(
    ("first", "code"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\n", 1),
        (Message(Kind.DATA_END, 0, 0, b"*IDN?").packed(), 3),
        (Message(Kind.INITIALIZE, 0, 0x01000000, b"hislip7").packed(), 3),
        (Message(Kind.INITIALIZE, 0, 0x00090000, b"hislip0").packed(), 3),
        (Message(Kind.ASYNC_INITIALIZE, 0, 77).packed(), 3),
        (Message(Kind.INITIALIZE, 0, 0x01000000).packed() + Message(Kind.DATA_END).packed(), 2),
        (Message(Kind.INITIALIZE, 0, 0x01000000).packed() * 2, 3),
    ],
)
def test_what_cannot_be_gone_on_with_is_a_fatal_error(port: HislipPort, first: bytes, code: int) -> None:
    wire = port.wire()
    wire.feed(first)
    *_, error = unpacked(wire.take())
    assert (error.kind, error.control) == (Kind.FATAL_ERROR, code)
    assert error.payload
    assert wire.finished
    assert port.sessions == {}


def test_one_client_too_many_is_told_so(port: HislipPort) -> None:
    clients = [Client(port) for _ in range(3)]
    wire = port.wire()
    wire.feed(Message(Kind.INITIALIZE, 0, 0x01000000).packed())
    (error,) = unpacked(wire.take())
    assert (error.kind, error.control) == (Kind.FATAL_ERROR, 4)
    # and when one leaves there is room, under a number that is free
    clients[1].aside.gone()
    assert Client(port).number not in (clients[0].number, clients[2].number)


@pytest.mark.parametrize(
    ("aside", "message", "code"),
    [
        (False, Message(99), 1),
        (False, Message(200), 3),
        (False, Message(Kind.ASYNC_STATUS_QUERY), 1),
        (False, Message(Kind.DATA_END, 8, 0, b"*IDN?"), 2),
        (False, Message(Kind.DATA, 0, 0, bytes((1 << 20) + 1)), 4),
        (True, Message(Kind.DATA_END, 0, 0, b"*IDN?"), 1),
        (True, Message(Kind.ASYNC_LOCK, 7), 2),
        (True, Message(Kind.ASYNC_REMOTE_LOCAL_CONTROL, 7), 2),
        (True, Message(Kind.ASYNC_STATUS_QUERY, 2), 2),
        (True, Message(Kind.ASYNC_MAX_MESSAGE_SIZE, 0, 0, b"abc"), 0),
    ],
)
def test_what_is_not_understood_costs_one_message(
    port: HislipPort, aside: bool, message: Message, code: int
) -> None:
    client = Client(port)
    (error,) = (client.say_aside if aside else client.say)(message)
    assert (error.kind, error.control) == (Kind.ERROR, code)
    assert error.payload
    # then the next is understood
    assert client.say_aside(Message(Kind.ASYNC_REMOTE_LOCAL_CONTROL, 3)) == [
        Message(Kind.ASYNC_REMOTE_LOCAL_RESPONSE)
    ]
    (answer,) = client.say(client.data(b"SYST:ERR?"))
    assert answer.payload.decode().strip() == NO_ERROR


def test_a_fatal_error_of_the_client_ends_both_connections(port: HislipPort) -> None:
    client = Client(port)
    assert client.say(Message(Kind.ERROR, 1, 0, b"never mind")) == []
    assert client.say(Message(Kind.FATAL_ERROR, 1, 0, b"enough")) == []
    client.aside.take()
    assert (client.sync.finished, client.aside.finished) == (True, True)


_MESSAGES = st.builds(
    Message,
    st.sampled_from([*Kind, 99, 200]),
    st.integers(0, 255) | st.sampled_from([0, 1]),
    st.integers(0, 0xFFFFFFFF) | st.integers(0, 3),
    st.sampled_from([b"", b"*IDN?", b"*OPC?\n*OPC?", b"*SRE 255", b"#", b"A #9", b"hislip0", b"key"])
    | st.binary(max_size=40),
)
_STREAM = st.lists(_MESSAGES.map(Message.packed) | st.binary(max_size=40), max_size=8).map(b"".join)


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 3), _STREAM), max_size=8), st.integers(1, 64))
@example([(0, struct.pack(">2sBBIQ", b"HS", 6, 0, 0, 2**63))], 16)
def test_no_bytes_break_the_server_and_all_it_says_are_messages(
    fed: list[tuple[int, bytes]], portion: int
) -> None:
    now_s = 0.0
    port = HislipPort([ScpiDevice("a,b,c,d")], 4, lambda: now_s)
    client, bystander = Client(port), Client(port)
    wires = [client.sync, client.aside, port.wire(), port.wire()]
    for index, stream in fed:
        # when anything arrives anywhere, in any portions
        for place in range(0, len(stream), portion):
            wires[index].feed(stream[place : place + portion])
        for wire in wires:
            _say(wire)
        now_s += 1e7
    # then, once its author has left, whoever else is there is served
    for wire in wires:
        wire.gone()
    (answer,) = bystander.say(bystander.data(b"*IDN?"))
    assert answer.payload == b"a,b,c,d\n"
    assert set(port.sessions) == {bystander.number}


def _say(wire: HislipWire) -> None:
    for message in unpacked(wire.take()):
        assert message.kind in set(Kind)
        assert len(message.payload) <= 1 << 20


def test_junk_from_the_network_stops_nobody() -> None:
    with served() as (places, _), RawClient(port_of(places.address)) as scpi:
        number = port_of(places.hislip_address)
        with opened(places.hislip_address) as generator:
            for junk in (b"\0" * 100, b"HS" + b"\xff" * 200, b"GET / HTTP/1.0\r\n\r\n"):
                with socket.create_connection(("127.0.0.1", number), timeout=10) as stranger:
                    stranger.sendall(junk)
                    said = b""
                    while part := stranger.recv(4096):
                        said += part
                (error,) = unpacked(said)
                assert error.kind == Kind.FATAL_ERROR
            # and one that leaves in the middle of a header
            with socket.create_connection(("127.0.0.1", number), timeout=10) as stranger:
                stranger.sendall(b"HS\0\0")
            assert generator.query("*OPC?").strip() == "1"
        assert scpi.ask(b"*OPC?\n") == b"1\n"
