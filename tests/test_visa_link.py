"""The link over PyVISA: what came before a time-out, time-outs of writes, and why a link is closed."""

from __future__ import annotations

import ctypes
import socket
import threading
from contextlib import closing, contextmanager, nullcontext
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from pyvisa.constants import StatusCode
from pyvisa.errors import VisaIOError

from belahil.errors import LinkClosed
from drivers.visa_link import WRITE_TIMEOUT_S, VisaLink
from drivers.visa_portion import portion
from sim.devices.scpi import ScpiDevice
from sim.plant import PlantClock
from sim.transports.visa_library import EmulatedVisa

if TYPE_CHECKING:
    from collections.abc import Iterator

ADDRESS = "USB0::0x0957::0x2C07::MY1::INSTR"


@contextmanager
def _listening() -> Iterator[tuple[socket.socket, str]]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener, f"TCPIP::127.0.0.1::{listener.getsockname()[1]}::SOCKET"


def test_what_came_before_a_time_out_is_not_lost() -> None:
    # given an instrument that sends the beginning of a line, and the rest much later
    with _listening() as (listener, address), closing(VisaLink(address, "@py")) as link:
        instrument, _ = listener.accept()
        with instrument:
            instrument.sendall(b"abc")
            # then each read returns what is there
            assert link.read(4096, 0.1) == b"abc"
            assert link.read(4096, 0.05) == b""
            later = threading.Timer(0.05, instrument.sendall, [b"def\n"])
            later.start()
            assert link.read(4096, 2.0) == b"def\n"
            later.join()


@pytest.mark.parametrize("came", [b"abc", b""])
def test_a_vendors_library_counts_what_it_has_put_into_the_buffer(came: bytes) -> None:
    # given a library that PyVISA calls through ctypes: an error is raised after the buffer was filled
    def read(session: int, buffer: Any, count: int, got: Any) -> None:
        ctypes.memmove(buffer, came, len(came))
        ctypes.cast(got, ctypes.POINTER(ctypes.c_uint32))[0] = len(came)
        raise VisaIOError(StatusCode.error_timeout)

    resource = SimpleNamespace(
        visalib=SimpleNamespace(lib=SimpleNamespace(viRead=read)),
        session=1,
        ignore_warning=lambda *statuses: nullcontext(),
    )
    if came:
        assert portion(resource, 100) == came
    else:
        with pytest.raises(VisaIOError):
            portion(resource, 100)


def test_a_write_has_its_own_time_out_after_any_read(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = PlantClock()
    link = VisaLink(ADDRESS, EmulatedVisa(clock).plug(ADDRESS, ScpiDevice("a,b,c,d")))
    seen: list[float] = []
    for verb in ("write_raw", "clear"):
        monkeypatch.setattr(link._resource, verb, lambda *data: seen.append(link._resource.timeout))
    # when it is written to and cleared after reads that hardly waited
    for act in (lambda: link.write(b"*IDN?\n"), link.clear):
        link.read(100, 0.001)
        act()
    # then each had the time that a write has
    assert seen == [1e3 * WRITE_TIMEOUT_S] * 2
    # and a short message makes do with the time of a question, a long one does not
    for message, limit_s in ((b"*IDN?\n", 2.0), (bytes(5000), WRITE_TIMEOUT_S)):
        link.read(100, 2.0)
        link.write(message)
        assert seen.pop() == 1e3 * limit_s
    link.close()


def test_a_link_that_was_lost_keeps_the_reason() -> None:
    # given an instrument that is gone for good
    with _listening() as (_, address):
        link = VisaLink(address, "@py")
        link.write(b"*IDN?\n")
    link._opened = _refused  # type: ignore[method-assign]
    with pytest.raises(LinkClosed, match="nobody answers"):
        link.clear()
    # then nobody is told that it was closed
    for verb in (lambda: link.write(b"*IDN?\n"), lambda: link.read(100, 0.01)):
        with pytest.raises(LinkClosed, match="connected anew: nobody answers there: timed out"):
            verb()
    link.close()


def _refused() -> Any:
    raise LinkClosed("nobody answers there: timed out")
