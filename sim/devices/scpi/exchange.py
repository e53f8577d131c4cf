"""Message exchange of one client: its input, its answers, and the errors of its order (IEEE 488.2, 6.3)."""

from __future__ import annotations

from collections import deque
from typing import Literal, Protocol

from sim.devices.scpi.framing import Framer, Message
from sim.devices.scpi.status import ScpiError

Exchange = Literal["stream", "message"]

INPUT_CAPACITY = 1 << 26  # bytes; assumed
OUTPUT_CAPACITY = 1024  # answers; assumed


class Instrument(Protocol):
    """What a connection leads to."""

    def execute(self, message: Message, connection: Connection) -> None:
        """Do what a message says, and hand its answer to the connection."""
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
        self._output: deque[bytes] = deque()
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
        if data and self.exchange == "message":
            self._interrupt()
        for message in self._framer.feed(data, end):
            if self.exchange == "message":
                self._interrupt()
            self._instrument.execute(message, self)

    def read(self) -> bytes | None:
        """Return the next complete answer with its line feed, None when there is none."""
        self._instrument.follow()
        if self._output:
            return self._output.popleft()
        if self.exchange == "message" and not self.owed:
            self._framer.reset()
            self._instrument.report(ScpiError(-420))
        return None

    def clear(self) -> None:
        """Device clear: drop what was sent in part and what was not read; settings and errors stay."""
        self._framer.reset()
        self._output.clear()
        self._instrument.forget(self)

    def read_stb(self) -> int:
        """Return the status byte; bit 6 is the master summary, since service requests are not emulated."""
        self._instrument.follow()
        return self._instrument.status_byte(bool(self._output))

    def interrupted(self) -> None:
        """Take notice from the link that an answer which it holds will not be read: error -410."""
        self._output.clear()
        self._instrument.report(ScpiError(-410))

    def answer(self, text: str) -> None:
        """Queue an answer; when nobody reads any, -430."""
        if len(self._output) >= self.capacity:
            self._instrument.report(ScpiError(-430))
        else:
            self._output.append(text.encode("latin-1") + b"\n")

    @property
    def has_answer(self) -> bool:
        """Whether an answer waits to be read."""
        return bool(self._output)

    def _interrupt(self) -> None:
        self._instrument.follow()
        if self._output:
            self.interrupted()
        elif self.owed:
            self._instrument.forget(self)
            self._instrument.report(ScpiError(-410))
