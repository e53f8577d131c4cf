"""The SCPI session: an answer proves its question, or a typed error comes."""

from __future__ import annotations

import errno
import re
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyvisa.constants import ResourceAttribute

from belahil.clock import SystemClock
from belahil.errors import (
    ConfigError,
    CorruptData,
    InstrumentError,
    Interfered,
    LinkClosed,
    LinkError,
    LinkTimeout,
    StaleData,
)
from drivers import scpi
from drivers.patience import Patience
from drivers.scpi import ScpiSession, read_error
from drivers.visa_link import VisaLink

IDENTITY = "Agilent Technologies,33522B,1,2"


class ScriptedLink:
    """An instrument that answers by a table; `disturb` changes or withholds what it sends."""

    def __init__(self) -> None:
        self.table = {"*IDN?": IDENTITY, "A?": "1", "B?": '"x;y"', ":SYST:ERR?": '+0,"No error"'}
        self.sent: list[bytes] = []
        self.arriving: list[bytes] = []
        self.disturb = lambda answer: [answer]
        self.clears = 0
        self.now = 0.0
        self._enable = ""

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        answers = []
        for unit in data.decode("latin-1").strip().split(";"):
            if unit.startswith("*ESE "):
                self._enable = "+" + unit[5:]
            elif unit == "*ESE?":
                answers.append(self._enable)
            elif unit.endswith("?"):
                answers.append(self.table[unit])
        if answers:
            self.arriving += self.disturb((";".join(answers) + "\n").encode())

    def read(self, count: int, timeout_s: float) -> bytes:
        if self.arriving:
            return self.arriving.pop(0)
        self.now += timeout_s
        return b""

    def clear(self) -> None:
        self.clears += 1
        self.arriving.clear()

    def close(self) -> None:
        self.sent.append(b"closed")

    def now_s(self) -> float:
        return self.now

    def sleep_s(self, duration_s: float) -> None:
        self.now += duration_s


def _session() -> tuple[ScpiSession, ScriptedLink]:
    link = ScriptedLink()
    return ScpiSession(link, link, "here"), link


def test_questions_are_numbered_and_answers_cut_outside_of_quotes() -> None:
    # given a session
    session, link = _session()
    assert session.identity == IDENTITY
    # when two things are asked, one of which answers with a semicolon in quotes
    answers = session.ask("A?", "B?")
    # then both come, and the message carried a number of its own
    assert answers == ["1", '"x;y"']
    assert re.fullmatch(rb"\*ESE\?;\*ESE \d+;A\?;B\?;\*ESE\?\n", link.sent[-1])


def test_numbers_go_round_without_zero() -> None:
    session, link = _session()
    for _ in range(300):
        assert session.ask("A?") == ["1"]
    numbers = [int(found) for found in re.findall(rb"\*ESE (\d+);A", b"".join(link.sent))]
    assert numbers == [(index + 2) % 255 + 1 for index in range(300)]


def test_an_answer_in_pieces_is_put_together() -> None:
    session, link = _session()
    link.disturb = lambda answer: [answer[:1], answer[1:4], answer[4:]]
    assert session.ask("A?", "B?") == ["1", '"x;y"']


@pytest.mark.parametrize(
    ("disturbed", "error"),
    [
        (lambda answer: [], LinkTimeout),
        (lambda answer: [answer[:-2]], LinkTimeout),
        (lambda answer: [answer[:2] + b"\n"], StaleData),
        (lambda answer: [b"7" + answer[2:]], Interfered),
        (lambda answer: [b"what;\n"], CorruptData),
        (lambda answer: [b"\n"], CorruptData),
        (lambda answer: [b"1;2;" + answer], CorruptData),
        (lambda answer: [b"7;" + answer.replace(b"+3", b"+2")], StaleData),
    ],
)
def test_what_is_no_proof_is_an_error_and_the_session_is_in_step_again(
    disturbed: object, error: type[LinkError]
) -> None:
    # given a session whose next answer is disturbed, once
    session, link = _session()

    def once(answer: bytes) -> list[bytes]:
        link.disturb = lambda intact: [intact]
        return disturbed(answer)  # type: ignore[operator,no-any-return]

    link.disturb = once
    # when something is asked
    with pytest.raises(error, match="here"):
        session.ask("A?")
    # then the link was cleared, the instrument has named itself, and the next question is answered
    assert link.sent[-1].endswith(b"*IDN?\n")
    assert session.ask("A?", "B?") == ["1", '"x;y"']


def test_a_late_answer_is_never_the_answer_of_the_next_question() -> None:
    # given an answer that comes only after its time-out, past any clearing
    session, link = _session()
    late: list[bytes] = []

    def delayed(answer: bytes) -> list[bytes]:
        if late:
            link.disturb = lambda intact: [intact]
            return [*late, answer]
        late.append(answer)
        return []

    link.disturb = delayed
    with pytest.raises(LinkTimeout, match="no answer that ends with a line feed in 2 s"):
        session.ask("A?")
    assert link.now == 2.0
    # when the next question is asked, another answer is due
    link.table["A?"] = "2"
    # then that one comes
    assert session.ask("A?") == ["2"]


def test_another_instrument_on_the_same_link_is_refused() -> None:
    session, link = _session()
    link.table["*IDN?"] = "Agilent Technologies,33521B,9,2"
    link.disturb = lambda answer: [] if b"+3" in answer else [answer]
    with pytest.raises(InstrumentError, match=r'was "Agilent .*33522B,1,2" and now says ".*33521B'):
        session.ask("A?")


def test_an_instrument_that_names_itself_differently_twice_is_not_opened() -> None:
    link = ScriptedLink()
    answers = iter([IDENTITY, IDENTITY.replace("2B", "0B")])
    link.disturb = lambda answer: [answer.replace(IDENTITY.encode(), next(answers).encode())]
    with pytest.raises(CorruptData, match="now says"):
        ScpiSession(link, link, "here")


def test_silence_after_a_time_out_stays_an_error_until_the_instrument_is_back() -> None:
    session, link = _session()
    link.disturb = lambda answer: []
    for _ in range(2):
        with pytest.raises(LinkTimeout):
            session.ask("A?")
    link.disturb = lambda answer: [answer]
    assert session.ask("A?") == ["1"]


def test_an_instrument_without_our_mark_is_shown_with_what_it_answers() -> None:
    # given an instrument that does not know *ESE?, and answers with its identity alone
    link = ScriptedLink()
    link.disturb = lambda answer: [answer.partition(b";")[2]]
    # when it is opened, then its answer is shown, and the mark that was due
    with pytest.raises(CorruptData, match=rf"here: answers '{IDENTITY}' without our \*ESE mark: .*'1;' and"):
        ScpiSession(link, link, "here")


def test_an_instrument_with_another_mark_is_told_so() -> None:
    link = ScriptedLink()
    link.disturb = lambda answer: [b"7;" + IDENTITY.encode() + b"\n"]
    with pytest.raises(StaleData, match=f"here: answer '7;{IDENTITY}' belongs to another question than num"):
        ScpiSession(link, link, "here")


@pytest.mark.parametrize(
    ("disturbed", "said"),
    [
        (lambda answer: [], r"in 2 s; is this the generator's address, and not the receiver's\?"),
        (lambda answer: [b"\0\x04\x08d"], r"in 2 s; it began with b'\\x00\\x04\\x08d'; is this the gen"),
    ],
)
def test_silence_at_the_first_question_raises_the_question_of_the_address(
    disturbed: object, said: str
) -> None:
    link = ScriptedLink()
    link.disturb = disturbed  # type: ignore[assignment]
    with pytest.raises(LinkTimeout, match=f"here: no answer that ends with a line feed {said}"):
        ScpiSession(link, link, "here")


def test_the_error_queue_is_emptied_in_order() -> None:
    session, link = _session()
    queue = ['-222,"Data out of range; clipped"', '+785,"no such arb"', '+0,"No error"']
    link.disturb = lambda answer: [answer.replace(b'+0,"No error"', queue.pop(0).encode())]
    assert session.errors() == [(-222, "Data out of range; clipped"), (785, "no such arb")]


@pytest.mark.parametrize("answer", ["", "0", "+0", '+0,"No error', 'x,"No error"', "No error"])
def test_what_is_no_queue_entry_is_corrupt(answer: str) -> None:
    with pytest.raises(CorruptData):
        read_error(answer)


def test_a_block_says_its_length() -> None:
    session, link = _session()
    session.send_block("DATA X,", b"\n" * 12)
    session.send("C 1", "D 2")
    assert link.sent[-2:] == [b"DATA X,#212" + b"\n" * 12 + b"\n", b"C 1;D 2\n"]
    session.close()
    assert link.sent[-1] == b"closed"


@given(
    value=st.from_regex(r"[!#-:<-~]{1,6}", fullmatch=True),
    place=st.integers(0, 40),
    bit=st.integers(0, 7),
    kind=st.sampled_from(["flip", "cut", "double", "drop"]),
)
def test_one_damage_gives_the_right_number_of_fields_or_an_error(
    value: str, place: int, bit: int, kind: str
) -> None:
    # given an instrument whose next answer is damaged at one place
    session, link = _session()
    link.table["A?"] = value

    def damaged(answer: bytes) -> list[bytes]:
        link.disturb = lambda intact: [intact]
        at = place % len(answer)
        flipped = answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]
        return {"flip": [flipped], "cut": [answer[:at]], "double": [answer, answer], "drop": []}[kind]

    link.disturb = damaged
    # when it is asked twice
    for _ in range(2):
        try:
            answer = session.ask("A?", "B?")
        except LinkError:
            continue
        # then an answer differs from the right one in that place at most: its number is its own
        assert len(answer) == 2
        assert kind == "flip" or answer == [value, '"x;y"']


class SlowLink(ScriptedLink):
    """A link whose bytes come in portions, each some time after the one before."""

    def __init__(self, portion_bytes: int, pause_s: float, begin_s: float = 0.0) -> None:
        super().__init__()
        self._portion_bytes, self._pause_s, self.begin_s = portion_bytes, pause_s, begin_s
        self._wait_s = 0.0

    def write(self, data: bytes) -> None:
        super().write(data)
        whole = b"".join(self.arriving)
        cuts = range(0, len(whole), self._portion_bytes)
        self.arriving = [whole[at : at + self._portion_bytes] for at in cuts]
        self._wait_s = self.begin_s

    def read(self, count: int, timeout_s: float) -> bytes:
        if not self.arriving or self._wait_s > timeout_s:
            self._wait_s -= timeout_s
            self.now += timeout_s
            return b""
        self.now += self._wait_s
        self._wait_s = self._pause_s
        return self.arriving.pop(0)


def test_an_answer_may_take_as_long_as_its_bytes_keep_coming() -> None:
    # given a line that carries 1000 bytes a second
    link = SlowLink(500, 0.5)
    session = ScpiSession(link, link, "here")
    # when it brings an answer of 20 kB, it takes 20 s, and comes whole
    link.table["A?"] = "7" * 20_000
    assert session.ask("A?") == [link.table["A?"]]
    link.table["A?"] = "#520000" + "x" * 20_000
    assert session.ask_block("A?") == b"x" * 20_000
    assert link.now > 35
    # and when it falls silent in the middle, that says how far it came
    link.disturb = lambda answer: [answer[:3000]]
    with pytest.raises(LinkTimeout, match=r"^here: 3000 of 20007 bytes of a block came in 4\.5 s$"):
        session.ask_block("A?")


def test_bytes_that_trickle_do_not_keep_a_question_for_ever() -> None:
    clock = ScriptedLink()
    patience = Patience(clock, 2.0, 2.0)
    while patience.left_s() and clock.now < 1000:
        clock.now += 1.9
        patience.came(1)
    assert clock.now < 5
    assert str(patience) == f"{clock.now:.3g} s"


@pytest.mark.parametrize(
    ("work", "longest_s"),
    [
        (lambda session: session.send("FOO 1"), 2.0),
        (lambda session: session.send("*RST", "*CLS"), 10.0),
        (lambda session: session.send_raw("FOO ", bytes(300_000)), 5.0),
    ],
)
def test_work_that_takes_an_instrument_its_time_is_waited_for(
    work: Callable[[ScpiSession], None], longest_s: float
) -> None:
    for late_s, comes in ((longest_s - 0.1, True), (longest_s + 0.1, False)):
        link = SlowLink(4096, 0.0)
        session = ScpiSession(link, link, "here")
        work(session)
        link.begin_s = late_s
        with nullcontext() if comes else pytest.raises(LinkTimeout):
            assert session.ask("A?") == ["1"]


# On real sockets, with pyvisa-py.


@contextmanager
def _served(*behaviours: str) -> Iterator[str]:
    """Serve connections one after the other; each behaves as told from its third message on."""
    listener = socket.create_server(("127.0.0.1", 0))

    def attend(connection: socket.socket, behaviour: str) -> None:
        with connection, connection.makefile("rb") as lines:
            mark = b"0"
            for count, line in enumerate(lines):
                number = re.search(rb"\*ESE (\d+)", line)
                before, mark = mark, number[1] if number else b""
                asked = before + b";1;" + mark if number else b"1;"
                answer = mark + b";" + IDENTITY.encode() if b"IDN" in line else asked
                if count < 2 or behaviour == "sound":
                    connection.sendall(answer + b"\n")
                elif behaviour == "close":
                    return
                elif behaviour == "cut":
                    connection.sendall(answer[:1])

    def accept() -> None:
        for behaviour in behaviours:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            threads.append(threading.Thread(target=attend, args=(connection, behaviour)))
            threads[-1].start()
        listener.close()

    threads = [threading.Thread(target=accept)]
    threads[0].start()
    try:
        yield f"TCPIP::127.0.0.1::{listener.getsockname()[1]}::SOCKET"
    finally:
        listener.close()
        for thread in threads:
            thread.join(5)


@pytest.mark.parametrize("behaviour", ["mute", "cut"])
def test_a_slow_socket_is_a_time_out_and_a_new_connection_is_in_step(
    behaviour: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scpi, "ANSWER_TIMEOUT_S", 0.2)
    with _served(behaviour, "sound") as address:
        session = ScpiSession(VisaLink(address, "@py"), SystemClock(), address)
        with pytest.raises(LinkTimeout):
            session.ask("A?")
        assert session.ask("A?") == ["1"]
        session.close()


def test_a_socket_sends_each_message_at_once() -> None:
    # A question after a command would wait for the acknowledgement of the command otherwise.
    with _served("sound") as address, closing(VisaLink(address, "@py")) as link:
        at_once = link._resource.get_visa_attribute(ResourceAttribute.tcpip_nodelay)
        assert at_once


def test_a_closed_socket_is_told_from_a_slow_one(monkeypatch: pytest.MonkeyPatch) -> None:
    # given an instrument that closes in the middle of a question, and does not come back
    monkeypatch.setattr(scpi, "ANSWER_TIMEOUT_S", 0.2)
    with _served("close") as address:
        session = ScpiSession(VisaLink(address, "@py"), SystemClock(), address)
        # when it is asked, then its link is closed, not late
        with pytest.raises(LinkClosed, match=r"nobody answers at TCPIP::127\.0\.0\.1"):
            session.ask("A?")
        session.close()


def test_a_connection_that_was_closed_in_a_question_is_no_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    # given an instrument that closes in the middle of a question, and takes the next connection
    monkeypatch.setattr(scpi, "ANSWER_TIMEOUT_S", 0.2)
    with _served("close", "sound") as address:
        session = ScpiSession(VisaLink(address, "@py"), SystemClock(), address)
        # when it is asked, then the error says that it closed, and another question is answered
        with pytest.raises(LinkError, match=f"^{address}: the instrument closed the connection$") as caught:
            session.ask("A?")
        assert not isinstance(caught.value, LinkClosed)
        assert session.ask("A?") == ["1"]
        session.close()


def test_an_address_where_nobody_answers_is_one_clear_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    address = f"TCPIP::127.0.0.1::{port}::SOCKET"
    with (
        closing(VisaLink(address, "@py")) as link,
        pytest.raises(LinkClosed, match=f"nobody answers at {address}: .*refused") as caught,
    ):
        ScpiSession(link, SystemClock(), address)
    assert caught.value.exit_status == 3
    assert "\n" not in str(caught.value)


def test_only_who_has_answered_can_be_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    # given links to an instrument, one of which has brought an answer, when the network has no way there
    with _served("sound", "sound") as address:
        fresh, used = VisaLink(address, "@py"), VisaLink(address, "@py")
        used.write(b"A?\n")
        assert used.read(100, 2.0) == b"1;\n"
        for link, said in ((fresh, f"nobody answers at {address}"), (used, f"{address} is gone")):

            def unreachable(data: bytes) -> None:
                raise OSError(errno.EHOSTUNREACH, "No route to host")

            monkeypatch.setattr(link._resource, "write_raw", unreachable)
            # then the first was never there, and the second is gone
            with pytest.raises(LinkClosed, match=f"^{said}: .*No route to host"):
                link.write(b"A?\n")
            link.close()


def test_an_address_that_is_none_is_refused_input() -> None:
    with pytest.raises(ConfigError, match='address = "COM"') as caught:
        VisaLink("COM", "@py")
    assert caught.value.exit_status == 2


def test_a_library_that_is_not_there_is_named() -> None:
    with pytest.raises(InstrumentError, match='visa_library = "@nowhere"'):
        VisaLink("TCPIP::127.0.0.1::1::SOCKET", "@nowhere")
