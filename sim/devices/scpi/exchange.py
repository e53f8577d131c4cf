"""Message exchange of one client: its input, its answers, and the errors of its order (IEEE 488.2, 6.3)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Literal, Protocol

from sim.devices.scpi.framing import Framer, Message
from sim.devices.scpi.status import ScpiError

Exchange = Literal["stream", "message"]

INPUT_CAPACITY = 1 << 26  # bytes; assumed
OUTPUT_CAPACITY = 1024  # answers; assumed


class Instrument(Protocol):
    """What a connection leads to."""

    def execute(self, message: Message, connection: Connection) -> Iterator[None]:
        """Do what a message says, and hand its answer to the connection; yield between its units."""
        ...

    def report(self, error: ScpiError) -> None:
        """Put an error into the queue."""
        ...

    def follow(self) -> None:
        """Take notice of what has ended in the meantime."""
        ...

    def status_byte(self, message_available: bool) -> int:
        """Return the status byte."""
        ...

    def forget(self, connection: Connection) -> None:
        """Owe this connection no answer any more."""
        ...


class Connection:
    """What one client has sent and not read; several of them share an instrument.

    How much a transport knows decides the kind of exchange, for each connection by itself:

    - ``"message"``: it marks the end of messages and asks the instrument when the client reads, as a VISA
      INSTR resource, USBTMC, GPIB and HiSLIP do. A message that comes before the answer to the last one was
      read is error -410, and that answer is gone; a read with nothing asked is -420.
    - ``"stream"``: it is a stream of bytes both ways, as a raw socket or a serial line. Nobody can tell there
      what was read, so answers simply follow each other, and both errors do not exist.

    Parameters
    ----------
    instrument : Instrument
        Where messages are carried out.
    exchange : {"stream", "message"}
        Which of the two.
    """

    def __init__(self, instrument: Instrument, exchange: Exchange = "stream") -> None:
        self._instrument = instrument
        self.exchange: Exchange = exchange
        self._framer = Framer(INPUT_CAPACITY)
        self._sent: deque[tuple[bytes, bool]] = deque()
        self._work: Iterator[None] | None = None
        self._output: deque[bytes] = deque()
        self.unread_bytes = 0
        """How long the answers are that wait to be read."""
        self.capacity = OUTPUT_CAPACITY
        """Most answers that wait to be read."""
        self.owed = False
        """Whether an answer has still to come when something ends."""

    def write(self, data: bytes, end: bool = False) -> None:
        """Take bytes; execute each message that they complete.

        Parameters
        ----------
        data : bytes
            Any part of the stream.
        end : bool
            Whether the link marked the last byte as the end of a message.
        """
        self.push(data, end)
        self.go_on()

    def push(self, data: bytes, end: bool = False) -> None:
        """Take bytes as `write` does, for `go_on`."""
        if data and self.exchange == "message":
            self._interrupt()
        self._sent.append((data, end))

    def go_on(self, may: Callable[[], bool] = lambda: True) -> bool:
        """Execute what was pushed, at least one unit of a message, and then as long as `may` says so.

        Returns
        -------
        bool
            False when something may be left.
        """
        work, self._work = self._work or self._executed(), None
        for _ in work:
            if not may():
                self._work = work
                return False
        return True

    def _executed(self) -> Iterator[None]:
        while self._sent:
            self._framer.has_end = self.exchange == "message"
            for message in self._framer.feed(*self._sent.popleft()):
                if self.exchange == "message":
                    self._interrupt()
                yield from self._instrument.execute(message, self)
                yield

    def read(self) -> bytes | None:
        """Return the next complete answer with its line feed, None when there is none."""
        self._instrument.follow()
        if self._output:
            answer = self._output.popleft()
            self.unread_bytes -= len(answer)
            return answer
        if self.exchange == "message" and not self.owed:
            self._framer.reset()
            self._instrument.report(ScpiError(-420))
        return None

    def clear(self) -> None:
        """Device clear: drop what was sent in part and what was not read; settings and errors stay."""
        self._sent.clear()
        self._work = None
        self._framer.reset()
        self._drop_answers()
        self._instrument.forget(self)

    def read_stb(self) -> int:
        """Return the status byte; bit 6 is the master summary, since service requests are not emulated."""
        self._instrument.follow()
        return self._instrument.status_byte(bool(self._output))

    def interrupted(self) -> None:
        """Take notice from the link that an answer which it holds will not be read: error -410."""
        self._drop_answers()
        self._instrument.report(ScpiError(-410))

    def answer(self, text: str) -> None:
        """Queue an answer; when nobody reads any, -430."""
        if len(self._output) >= self.capacity:
            self._instrument.report(ScpiError(-430))
        else:
            answer = text.encode("latin-1") + b"\n"
            self._output.append(answer)
            self.unread_bytes += len(answer)

    @property
    def has_answer(self) -> bool:
        """Whether an answer waits to be read."""
        return bool(self._output)

    def _drop_answers(self) -> None:
        self._output.clear()
        self.unread_bytes = 0

    def _interrupt(self) -> None:
        self._instrument.follow()
        if self._output:
            self.interrupted()
        elif self.owed:
            self._instrument.forget(self)
            self._instrument.report(ScpiError(-410))
