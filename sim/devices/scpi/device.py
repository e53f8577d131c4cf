"""A device that answers SCPI messages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim.devices.scpi.common import add_common_commands
from sim.devices.scpi.exchange import Connection, Exchange
from sim.devices.scpi.framing import Message
from sim.devices.scpi.learn import Memory, learned
from sim.devices.scpi.parser import Unit, parse
from sim.devices.scpi.status import OPERATION_COMPLETE, QUEUE_DEPTH, ScpiError, Status
from sim.devices.scpi.tree import Branch, Call, Found, HeaderTree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.interfaces import Clock

MOST_ANSWER_BYTES = 1 << 24
"""A question is not answered any more when those before it in its message gave more (assumed)."""


class _OwnClock:
    """Time of a device that stands alone: it moves when the device waits."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Time since the device was made, s."""
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        """Let time pass."""
        self._now_s += max(duration_s, 0.0)


class ScpiDevice:
    """Takes bytes and gives bytes; nothing here waits, sleeps, or raises because of what it was sent.

    After a command error the rest of the message is dropped, after any other error it goes on (assumed).
    ``*WAI`` and ``*OPC?`` let the clock pass to the end of what a command began; ``*OPC?`` answers to
    something that does not end when that is stopped, and ``*WAI`` goes on at once (assumed). `write` and
    `read` are those of its `own` connection, which is a stream until it is told otherwise.

    Parameters
    ----------
    identity : str
        Answer to ``*IDN?``.
    channels : int
        Largest numeric suffix.
    queue_depth : int
        Most errors that are kept.
    signed : bool
        Whether whole numbers are answered with a plus sign.
    options : str
        Answer to ``*OPT?``; "0" says that there are none (IEEE 488.2, 10.20).
    clock : Clock, optional
        What time passes on; without one the device has its own.
    """

    learns = False
    """Whether it answers ``*LRN?``, which IEEE 488.2 leaves to the instrument."""
    learn_first: tuple[str, ...] = ()
    """Headers that ``*LRN?`` names before the others, since those depend on them."""
    learn_not: frozenset[str] = frozenset()
    """Headers that ``*LRN?`` leaves out: other names of a setting, and what is no setting."""

    def __init__(
        self,
        identity: str,
        channels: int = 1,
        *,
        queue_depth: int = QUEUE_DEPTH,
        signed: bool = True,
        options: str = "0",
        clock: Clock | None = None,
    ) -> None:
        self.identity = identity
        self.options = options
        self.status = Status(queue_depth, signed)
        self.tree = HeaderTree(channels)
        self.memory = Memory()
        self._clock: Clock = clock or _OwnClock()
        self._over_at_s = -math.inf
        self._announce = False
        self._owed: set[Connection] = set()
        self.own = self._speaking = self.connect("stream")
        self._answers: list[str] = []
        add_common_commands(self)

    def connect(self, exchange: Exchange) -> Connection:
        """Give a client its own input and answers; settings, errors and registers are everybody's."""
        return Connection(self, exchange)

    def write(self, data: bytes, end: bool = False) -> None:
        """Take bytes from the own connection, see `Connection.write`."""
        self.own.write(data, end)

    def read(self) -> bytes | None:
        """Return the next complete answer with its line feed, None when there is none."""
        return self.own.read()

    def clear(self) -> None:
        """Do what a device clear does, see `Connection.clear`."""
        self.own.clear()

    def read_stb(self) -> int:
        """Return the status byte, see `Connection.read_stb`."""
        return self.own.read_stb()

    def triggered(self) -> None:
        """Do what ``*TRG`` does.

        Raises
        ------
        ScpiError
            -211 when the device does not wait for one.
        """
        raise ScpiError(-211)

    def reset(self) -> None:
        """Bring all settings to their defaults, as ``*RST`` does."""

    def settled(self) -> None:
        """Take notice that a message has changed settings."""

    def power_on(self) -> None:
        """Switch off and on again: settings, registers, errors and answers begin anew."""
        self.cancel()
        self.reset()
        self.status.power_on()
        self.own.clear()
        self.settled()

    def report(self, error: ScpiError) -> None:
        """Put an error into the queue without stopping the command."""
        self.status.report(error)

    def begin(self, duration_s: float) -> None:
        """Begin something that takes time, which ``*OPC`` and ``*WAI`` wait for; infinity: until `stop`."""
        self._over_at_s = self._clock.now_s() + duration_s

    def stop(self) -> None:
        """End what was begun."""
        self._over_at_s = -math.inf

    def follow(self) -> None:
        """Tell those who wait for what has ended."""
        if not (self._announce or self._owed) or self._over_at_s > self._clock.now_s():
            return
        if self._announce:
            self.status.events |= OPERATION_COMPLETE
        owed = tuple(self._owed)
        self.cancel()
        for connection in owed:
            connection.answer("1")

    def announce_completion(self) -> None:
        """Set the bit of ``*OPC`` once what was begun has ended."""
        self._announce = True
        self.follow()

    def wait(self) -> bool:
        """Let time pass until what was begun has ended; False when it never does."""
        left_s = self._over_at_s - self._clock.now_s()
        if 0 < left_s < math.inf:
            self._clock.sleep_s(left_s)
            self._over_at_s = -math.inf
        self.follow()
        return left_s < math.inf

    def owe(self) -> None:
        """Answer "1" to the client that speaks once what was begun has ended."""
        self._owed.add(self._speaking)
        self._speaking.owed = True

    def forget(self, connection: Connection) -> None:
        """Owe a client no answer any more."""
        connection.owed = False
        self._owed.discard(connection)

    def cancel(self) -> None:
        """Announce no completion, and owe none, as ``*CLS`` and ``*RST`` do."""
        self._announce = False
        for connection in tuple(self._owed):
            self.forget(connection)

    def status_byte(self, message_available: bool) -> int:
        """Return the status byte of a client that has, or has not, an answer to read."""
        return self.status.byte(message_available)

    def own_status_byte(self) -> int:
        """Return the status byte for the client that speaks; answers of the same message count."""
        return self.status_byte(bool(self._answers) or self._speaking.has_answer)

    def learn(self) -> str:
        """Return the message that brings all settings back."""
        return learned(self.tree, self.learn_first, self.learn_not)

    def kept(self) -> object:
        """Return all settings, for `bring_back`; a device without a family has none."""
        return None

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were; what cannot be had any more is reported."""

    def execute(self, message: Message, connection: Connection) -> Iterator[None]:
        """Carry out a message and hand its answer, if it has one, to the connection.

        It yields between units: there messages of others may come in between.
        """
        answers: list[str] = []
        last: list[str] = []
        branch, commanded, held = self.tree.root, False, 0
        try:
            for place, unit in enumerate(parse(message)):
                if place:
                    yield
                self._speaking, self._answers = connection, answers
                if self._announce or self._owed:
                    self.follow()
                try:
                    branch, answer = self._run(unit, branch, last)
                except ScpiError as error:
                    self.report(error)
                    commanded = True
                    if error.is_command_error:
                        break
                else:
                    commanded |= answer is None
                    if answer is not None:
                        held = self._hold(answer, answers, held)
                self._speaking, self._answers = self.own, []
        finally:
            self._speaking, self._answers = self.own, []
            if commanded:
                self.settled()
        if answers:
            connection.answer(";".join(answers))

    def _hold(self, answer: str, answers: list[str], held: int) -> int:
        """Keep an answer for the end of its message; where they are too long, all are dropped: -430."""
        if held > MOST_ANSWER_BYTES:
            if answers:
                answers.clear()
                self.report(ScpiError(-430))
            return held
        answers.append(answer)
        return held + len(answer)

    def _run(self, unit: Unit | ScpiError, branch: Branch, last: list[str]) -> tuple[Branch, str | None]:
        """Run a unit; `last` names a query of this message that no other may follow."""
        if isinstance(unit, ScpiError):
            raise ScpiError(unit.code, unit.detail)
        found = self._found(unit, branch)
        if found.is_query:
            if last:
                raise ScpiError(-440, last[0])
            if found.action.ends_message:
                last.append(unit.header)
        return found.branch, found.action.run(Call(found.suffixes, unit.parameters))

    def _found(self, unit: Unit, branch: Branch) -> Found:
        found = self.tree.find(unit.header, branch)
        count = len(unit.parameters)
        if count > found.action.most:
            raise ScpiError(-108, unit.header)
        if count < found.action.least:
            raise ScpiError(-109, unit.header)
        return found
