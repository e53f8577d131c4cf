"""What clients of a served bench meet: several of them, those that leave, slow lines, and strangers."""

from __future__ import annotations

import os
import socket
import sys
import time

import pytest
import serial

from belahil.bench import open_bench
from belahil.config import parse_bench
from belahil.errors import InstrumentRefused, LinkError
from belahil.stimuli import NoSignal
from belahil.values import WindowRequest
from drivers.serial_link import open_serial
from sim.transports.one_receiver import TAKEN
from sim.transports.server import Serving, serve
from tests.served import RawClient, port_of, served

NO_PTY = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
NO_ERROR = b'+0,"No error"'


def _client_bench(address: str, link: str) -> str:
    return (
        f'[generator]\naddress = "{address}"\nvisa_library = "@py"\nattenuation_db = 6.0\n'
        f'[digitizer]\nlink = "{link}"\n'
    )


def test_clients_end_their_lines_as_they_like_and_a_block_is_never_cut() -> None:
    block = bytes([10, 13, 34, 39]) * 64  # line ends and quotes
    with served() as (places, _), RawClient(port_of(places.address)) as client:
        for end in (b"\n", b"\r\n"):
            assert client.ask(b"*IDN?" + end).startswith(b"Agilent Technologies,33522B,")
            client.line.sendall(b"DATA:VOL:CLE" + end)
            client.line.sendall(b"DATA:ARB:DAC A,#3256" + block + end)
            assert client.ask(b"DATA:ATTR:POIN? A" + end) == b"+128\n"
            assert client.ask(b"SYST:ERR?" + end).strip() == NO_ERROR


def test_a_client_that_leaves_in_the_middle_of_a_block_leaves_nothing_behind() -> None:
    with served() as (places, _):
        port = port_of(places.address)
        with RawClient(port) as other:
            # given a client that is waiting, and one that announces more than it sends
            leaving = RawClient(port)
            assert leaving.ask(b"*IDN?\n")
            leaving.line.sendall(b"DATA:ARB:DAC A,#41000" + b"\n" * 100)
            # when that one leaves, or its connection is torn
            leaving.line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            leaving.close()
            # then the other goes on, and the next finds a clean input and no waveform
            assert other.ask(b"*IDN?\n").startswith(b"Agilent")
            with RawClient(port) as following:
                assert following.ask(b"SYST:ERR?\n").strip() == NO_ERROR
                assert b'"A"' not in following.ask(b"DATA:VOL:CAT?\n")


def test_a_second_driver_is_told_that_the_receiver_is_taken() -> None:
    with served() as (places, lines):
        text = _client_bench(places.address, places.link)
        with open_bench(parse_bench(text)) as first:
            first.measure(NoSignal(), WindowRequest(0, 4))
            # when another driver comes to the same receiver
            with pytest.raises(InstrumentRefused, match=TAKEN):
                open_bench(parse_bench(text))
            # then whoever serves knows, and the first measures on
            assert lines == [f"a client was refused: {TAKEN}"]
            first.measure(NoSignal(), WindowRequest(1, 4))
        # and when the first has left, there is room
        with open_bench(parse_bench(text)) as second:
            second.measure(NoSignal(), WindowRequest(2, 4))
        assert len(lines) == 1


def test_too_many_clients_are_sent_away_and_said() -> None:
    with served() as (places, lines):
        port = port_of(places.address)
        clients = [RawClient(port) for _ in range(16)]
        assert all(client.ask(b"*OPC?\n") == b"1\n" for client in clients)
        with RawClient(port) as further:
            assert further.line.recv(1) == b""
        assert clients[0].ask(b"*OPC?\n") == b"1\n"
        (line,) = lines
        assert f"port {port}: 127.0.0.1:" in line
        assert line.endswith("was sent away: 16 clients are there")
        for client in clients:
            client.close()


@NO_PTY
def test_generator_and_receiver_are_at_pseudo_terminals_too() -> None:
    with served(Serving(pty=True)) as (places, lines):
        # the receiver speaks no SCPI, so HiSLIP has one instrument
        assert places.hislip_link == ""
        path = places.pty_address.removeprefix("ASRL").removesuffix("::INSTR")
        # given a client that leaves a block unfinished, and closes
        with serial.Serial(path, timeout=10) as leaving:
            leaving.write(b"*IDN?\r\n")
            assert leaving.readline().startswith(b"Agilent")
            leaving.write(b"DATA:ARB:DAC A,#41000" + b"\n" * 100)
        _until_gone()
        # then the next one finds a clean input
        with serial.Serial(path, timeout=10) as following:
            following.write(b"SYST:ERR?\n")
            assert following.readline().strip() == NO_ERROR
        # and the receiver is one, wherever its client is
        link = places.pty_link.removeprefix("serial:")
        with open_bench(parse_bench(_client_bench(places.address, places.link))):
            with pytest.raises(InstrumentRefused, match=TAKEN):
                open_bench(parse_bench(_client_bench(places.address, places.pty_link)))
            assert lines == [f"a client was refused: {TAKEN}"]
        _until_gone()
        with open_bench(parse_bench(_client_bench(places.address, places.pty_link))) as bench:
            bench.measure(NoSignal(), WindowRequest(0, 4))
    assert not os.path.exists(link)


def _until_gone() -> None:
    """Wait until the server has looked at its pseudo-terminals, which it does 20 times a second."""
    time.sleep(0.2)


def test_a_slow_line_carries_a_window_no_faster_than_its_rate() -> None:
    baud, latency_s = 921600.0, 0.03
    with served(Serving(baud=baud, latency_s=latency_s)) as (places, _):
        with open_bench(parse_bench(_client_bench(places.address, places.link))) as bench:
            # when a window of n samples is measured
            begun_s = time.monotonic()
            window = bench.measure(NoSignal(), WindowRequest(0, 4)).window
            taken_s = time.monotonic() - begun_s
        # then its bytes took their time, and the answers to arming and reading their latency
        assert taken_s >= 2 * window.counts.size * 10 / baud + latency_s
        # and the network is not slowed down, but its answers wait
        with RawClient(port_of(places.address)) as client:
            begun_s = time.monotonic()
            assert client.ask(b"*OPC?\n") == b"1\n"
            assert time.monotonic() - begun_s >= latency_s


def test_a_client_may_ask_thousands_of_questions_before_it_reads() -> None:
    with served() as (places, _), RawClient(port_of(places.address)) as client:
        client.line.sendall(b"*ESE 5;*ESE?\n" * 5000)
        assert [client.ask(b"") for _ in range(5000)] == [b"+5\n"] * 5000
        assert client.ask(b"SYST:ERR?\n").strip() == NO_ERROR


def test_a_client_that_does_not_read_does_not_stop_the_others() -> None:
    with served() as (places, _):
        port = port_of(places.address)
        with RawClient(port) as deaf, RawClient(port) as other:
            # when one asks for far more than buffers hold and reads nothing
            deaf.line.settimeout(0.5)
            with pytest.raises(TimeoutError):
                deaf.line.sendall(b"*IDN?\n" * 3_000_000)
            # then others are served
            assert other.ask(b"*OPC?\n") == b"1\n"


@pytest.mark.parametrize(("host", "warned"), [("127.0.0.1", False), ("localhost", False), ("0.0.0.0", True)])
def test_whoever_listens_to_strangers_is_warned(host: str, warned: bool) -> None:
    with served(Serving(host=host)) as (places, lines):
        assert [line.startswith("listening at 0.0.0.0: whoever") for line in lines] == [True] * warned
        # and the place that is told can be reached from elsewhere
        assert "0.0.0.0" not in places.address


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this computer has no IPv6")
def test_this_computer_is_reached_by_ipv6_too() -> None:
    with served(Serving(host="::1")) as (places, lines):
        # then places are told with brackets, and who cannot use them; nobody is warned of strangers
        assert places.address.startswith("TCPIP::[::1]::")
        assert [line.partition(":")[0] for line in lines] == ["PyVISA takes no name with ["]
        port = int(places.address.split("::")[-2])
        with socket.create_connection(("::1", port), timeout=10) as client:
            client.sendall(b"*OPC?\n")
            assert client.makefile("rb").readline() == b"1\n"
        open_serial(places.link).close()


@pytest.mark.parametrize(
    ("host", "why"),
    [("nonsense.invalid", "not known|No address|failure"), ("a" * 70, "no name can be so|not known")],
)
def test_a_host_without_an_address_is_told_in_one_line(host: str, why: str) -> None:
    with pytest.raises(
        LinkError, match=rf"^--host {host}: .*({why}).*; allowed: a name or an address"
    ) as told:
        serve(parse_bench(""), lambda places: None, Serving(host=host))
    assert "\n" not in str(told.value)


def test_ports_are_free_again_when_the_server_has_stopped() -> None:
    with served() as (places, _):
        ports = port_of(places.address), port_of(places.link)
        clients = [RawClient(port) for port in ports]
        assert clients[0].ask(b"*OPC?\n") == b"1\n"
    with served(Serving(scpi_port=ports[0], link_port=ports[1])) as (again, _):
        assert (port_of(again.address), port_of(again.link)) == ports
        open_serial(again.link).close()
    for client in clients:
        client.close()
