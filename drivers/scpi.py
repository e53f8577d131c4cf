"""Questions to a SCPI instrument, where each answer proves which question it belongs to.

Each question carries a number that comes back with its answer: ``*ESE?;*ESE n;...;*ESE?``. The event status
enable register of IEEE 488.2 serves as the echo, since every instrument has it and nothing else here uses it.
So a late, doubled or cut answer is never taken for the answer of another question. The number of the question
before comes first: where it is another one, another program has asked meanwhile.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from belahil.errors import (
    CorruptData,
    InstrumentError,
    Interfered,
    LinkClosed,
    LinkError,
    LinkTimeout,
    StaleData,
)
from drivers.patience import Patience

if TYPE_CHECKING:
    from belahil.interfaces import Clock, Link

ANSWER_TIMEOUT_S = 2.0
RESET_TIMEOUT_S = 10.0
UPLOAD_BYTES_PER_S = 100e3
NO_ERROR, TRIGGER_IGNORED = 0, -211
_ERRORS_AT_MOST = 64
_READ_BYTES = 65536
_SHOWN_BYTES = 40
_FIELD = re.compile(r'(?:[^;"]|"[^"]*")+')
_ERROR = re.compile(r'([+-]?\d+),"(.*)"', re.DOTALL)


class ScpiSession:
    """One instrument; in step with it, or an error is raised.

    After any `LinkError` the link is cleared and the instrument must name itself as before. A question is
    never repeated here: the caller knows what may be repeated.

    Parameters
    ----------
    link : Link
        To the instrument.
    clock : Clock
        For deadlines, and for the number of the first question: two programs rarely begin with the same.
    name : str
        For messages, for example an address.

    Raises
    ------
    LinkError
        No instrument answers, or not twice the same.
    """

    def __init__(self, link: Link, clock: Clock, name: str) -> None:
        self._link = link
        self._clock = clock
        self._name = name
        self._tag = int(clock.now_s() * 1e6) % 255
        self._work_s = 0.0
        self._in_step = True
        self._rest = b""
        self.identity = ""
        self._get_in_step()
        first, self.identity = self.identity, ""
        self._identify()
        if first != self.identity:
            raise CorruptData(f'{name}: the instrument was "{first}" and now says "{self.identity}"')

    def send(self, *commands: str) -> None:
        """Send commands as one message; a later question tells what became of them."""
        if "*RST" in commands:
            self._work_s = max(self._work_s, RESET_TIMEOUT_S - ANSWER_TIMEOUT_S)
            # IEEE 488.2 leaves the register as it is; an instrument that does not has our mark all the same.
            commands = (*commands, f"*ESE {self._tag}")
        self._write((";".join(commands) + "\n").encode("ascii"))

    def send_block(self, header: str, data: bytes) -> None:
        """Send a command whose last parameter is a definite-length block (IEEE 488.2, 7.7.6).

        Parameters
        ----------
        header : str
            Up to the block, with its comma or blank.
        data : bytes
            Any bytes.
        """
        length = str(len(data))
        self.send_raw(f"{header}#{len(length)}{length}", data)

    def send_raw(self, header: str, data: bytes) -> None:
        """Send a command that ends with bytes as they are; `header` must tell how many."""
        self._work_s += len(data) / UPLOAD_BYTES_PER_S
        self._write(header.encode("ascii") + data + b"\n")

    def ask_raw(self, query: str, before: bytes, count: int) -> bytes:
        """Ask for bytes which have no length of their own: `count` of them after `before`.

        Nothing but the bytes themselves proves that they answer this question.

        Raises
        ------
        LinkError
            No such answer; the session is in step again, unless the link is closed or silent.
        """
        if not self._in_step:
            self._get_in_step()
        try:
            self._write(f"{query}\n".encode("ascii"))
            patience = self._patience()
            said = bytearray(self._rest)
            while (start := said.find(before)) < 0 or len(said) < start + len(before) + count + 1:
                data = self._read(patience)
                if not data:
                    raise LinkTimeout(
                        f"{self._name}: {query} is answered by {len(said)} of "
                        f"{len(before) + count + 1} bytes in {patience}"
                    )
                said += data
        except LinkClosed:
            raise
        except LinkError:
            self.recover()
            raise
        stop = start + len(before) + count
        self._rest = bytes(said[stop:]).removeprefix(b"\n")
        return bytes(said[stop - count : stop])

    def ask(self, *queries: str) -> list[str]:
        """Send queries as one message and return the answer to each.

        Raises
        ------
        Interfered
            Another program has asked the instrument since our last question.
        LinkError
            No proof of an answer; the session is in step again, unless the link is closed or silent.
        """
        if not self._in_step:
            self._get_in_step()
        try:
            before, tag = self._tag, self._next_tag()
            self._write(f"*ESE?;*ESE {tag};{';'.join(queries)};*ESE?\n".encode("ascii"))
            fields = self._fields(self._patience())
            self._check_marks(fields, before, tag, len(queries))
            return fields[1:-1]
        except LinkClosed:
            raise
        except LinkError:
            self.recover()
            raise

    def ask_block(self, query: str, before: str = "") -> bytes:
        """Send one query whose answer is a definite-length block, and return what is in the block.

        The marked question behind it proves that nothing else was on its way. Line feeds that some
        instruments send after a block are read over.

        Parameters
        ----------
        query : str
            One query.
        before : str
            What the answer has in front of its block.

        Raises
        ------
        LinkError
            No proof of an answer; the session is in step again, unless the link is closed or silent.
        """
        if not self._in_step:
            self._get_in_step()
        try:
            self._write(f"{query}\n".encode("ascii"))
            data = self._block(before.encode("ascii"), self._patience())
            mark, tag = self._tag, self._next_tag()
            self._write(f"*ESE?;*ESE {tag};*ESE?\n".encode("ascii"))
            patience = self._patience()
            fields = [""]
            while fields == [""]:
                fields = self._fields(patience)
            self._check_marks(fields, mark, tag, 0)
            return data
        except LinkClosed:
            raise
        except LinkError:
            self.recover()
            raise

    def errors(self) -> list[tuple[int, str]]:
        """Empty the instrument's error queue, oldest first.

        Returns
        -------
        list of tuple of int and str
            SCPI number and text.
        """
        found: list[tuple[int, str]] = []
        while len(found) < _ERRORS_AT_MOST:
            number, text = read_error(self.ask(":SYST:ERR?")[0])
            if number == NO_ERROR:
                break
            found.append((number, text))
        return found

    def recover(self) -> None:
        """Clear the link and find the same instrument again.

        Raises
        ------
        LinkError
            It cannot be found.
        """
        self._in_step = False
        self._get_in_step()

    def pause(self, duration_s: float) -> None:
        """Let the instrument do what it was told."""
        if duration_s > 0:
            self._clock.sleep_s(duration_s)

    def close(self) -> None:
        """Let go of the link."""
        self._link.close()

    def _get_in_step(self) -> None:
        self._link.clear()
        self._rest = b""
        self._identify()
        self._in_step = True

    def _identify(self) -> None:
        """Ask for the name, and drop what answers older questions."""
        tag = self._next_tag()
        # IEEE 488.2 wants *IDN? to be the last query of a message.
        self._write(f"*ESE {tag};*ESE?;*IDN?\n".encode("ascii"))
        patience = self._patience()
        fields: list[str] = []
        try:
            while len(fields) != 2 or _number(fields[0]) != tag:
                fields = self._fields(patience)
        except LinkTimeout as error:
            raise self._unnamed(fields, tag, error) from error
        if self.identity not in ("", fields[1]):
            raise InstrumentError(
                f'{self._name}: the instrument was "{self.identity}" and now says "{fields[1]}"'
            )
        self.identity = fields[1]

    def _check_marks(self, fields: list[str], before: int, tag: int, count: int) -> None:
        """Check that an answer to so many questions belongs to them, and that nobody asked between."""
        if _number(fields[-1]) != tag:
            raise self._wrong(fields, tag)
        if len(fields) != count + 2:
            raise CorruptData(f"{self._name}: {count} questions, answer {';'.join(fields)!r}")
        if _number(fields[0]) != before:
            raise Interfered(
                f"{self._name}: another program speaks to the instrument: after our question number "
                f"{before} its *ESE register holds {fields[0]}"
            )

    def _next_tag(self) -> int:
        self._tag = self._tag % 255 + 1
        return self._tag

    def _write(self, message: bytes) -> None:
        try:
            self._link.write(message)
        except LinkError:
            self._in_step = False
            raise

    def _patience(self) -> Patience:
        """Begin to wait for an answer: longer after what takes an instrument its time."""
        allowed_s, self._work_s = ANSWER_TIMEOUT_S + self._work_s, 0.0
        return Patience(self._clock, allowed_s, ANSWER_TIMEOUT_S)

    def _read(self, patience: Patience) -> bytes:
        """Read once; empty when the time is over."""
        data = self._link.read(_READ_BYTES, patience.left_s())
        if data:
            patience.came(len(data))
        return data

    def _fields(self, patience: Patience) -> list[str]:
        """Read a line and cut it at its semicolons; at least one field."""
        line = self._rest
        while b"\n" not in line:
            data = self._read(patience)
            if not data:
                begun = f"; it began with {bytes(line[:_SHOWN_BYTES])!r}" if line else ""
                raise LinkTimeout(f"{self._name}: no answer that ends with a line feed in {patience}{begun}")
            line += data
        line, _, self._rest = line.partition(b"\n")
        return _FIELD.findall(line.decode("latin-1").strip()) or [""]

    def _block(self, before: bytes, patience: Patience) -> bytes:
        """Read ``#``, one digit, so many digits, and so many bytes; what follows stays unread."""
        self._have(len(before) + 2, patience)
        if not self._rest.startswith(before):
            raise CorruptData(f"{self._name}: answer {self._rest[:_SHOWN_BYTES]!r} begins without {before!r}")
        self._rest = self._rest[len(before) :]
        head = self._rest[:2]
        if not re.fullmatch(rb"#[1-9]", head):
            raise CorruptData(f"{self._name}: answer {self._rest[:_SHOWN_BYTES]!r} is no block")
        begin = 2 + int(head[1:])
        self._have(begin, patience)
        count = self._rest[2:begin]
        if not count.isdigit():
            raise CorruptData(f"{self._name}: answer {self._rest[:_SHOWN_BYTES]!r} is no block")
        end = begin + int(count)
        self._have(end, patience)
        data, self._rest = self._rest[begin:end], self._rest[end:]
        return data

    def _have(self, count: int, patience: Patience) -> None:
        """Read until so many bytes of an answer are there."""
        parts, size = [self._rest], len(self._rest)
        while size < count:
            data = self._read(patience)
            if not data:
                raise LinkTimeout(f"{self._name}: {size} of {count} bytes of a block came in {patience}")
            parts.append(data)
            size += len(data)
        self._rest = b"".join(parts)

    def _unnamed(self, said: list[str], tag: int, silence: LinkTimeout) -> LinkError:
        """Say why an instrument could not be identified: the last thing it said, or that it said nothing."""
        if said:
            answer = ";".join(said)
            if _number(said[0]) is not None:
                return StaleData(
                    f"{self._name}: answer {answer!r} belongs to another question than number {tag}"
                )
            return CorruptData(
                f"{self._name}: answers {answer!r} without our *ESE mark: to '*ESE {tag};*ESE?;*IDN?' "
                f"it has to answer '{tag};' and its identity"
            )
        if self.identity:
            return silence
        return LinkTimeout(f"{silence}; is this the generator's address, and not the receiver's?")

    def _wrong(self, fields: list[str], tag: int) -> LinkError:
        said = ";".join(fields)
        if _number(fields[-1]) is None:
            return CorruptData(f"{self._name}: answer {said!r} does not end with the number {tag}")
        return StaleData(f"{self._name}: answer {said!r} belongs to another question than number {tag}")


def read_error(answer: str) -> tuple[int, str]:
    """Read one entry of an error queue, such as ``+0,"No error"``.

    Raises
    ------
    CorruptData
        It is none.
    """
    match = _ERROR.fullmatch(answer)
    if match is None:
        raise CorruptData(f"{answer!r} is no entry of an error queue")
    return int(match[1]), match[2]


def _number(field: str) -> int | None:
    return int(field) if re.fullmatch(r"\+?\d{1,3}", field) else None
