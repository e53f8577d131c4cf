"""A device that answers SCPI messages: the message exchange and the commands that all instruments have."""

from __future__ import annotations

from collections import deque

from sim.devices.scpi.framing import Framer, Message
from sim.devices.scpi.parameters import read_integer
from sim.devices.scpi.parser import Unit, parse
from sim.devices.scpi.status import OPERATION_COMPLETE, Register, ScpiError, Status
from sim.devices.scpi.tree import Action, Branch, Call, HeaderTree

SCPI_VERSION = "1999.0"
INPUT_CAPACITY = 1 << 26  # bytes; assumed
OUTPUT_CAPACITY = 1024  # answers; assumed


class ScpiDevice:
    """Takes bytes and gives bytes; nothing here waits, sleeps, or raises because of what it was sent.

    Answers queue up until they are read, as they do on a raw socket; a device that is asked again before
    it was read does not report -410. After a command error the rest of the message is dropped, after any
    other error it goes on (assumed). Commands are complete when the message is: ``*OPC`` and ``*WAI`` find
    nothing to wait for.

    Parameters
    ----------
    identity : str
        Answer to ``*IDN?``.
    channels : int
        Largest numeric suffix.
    """

    def __init__(self, identity: str, channels: int = 1) -> None:
        self.identity = identity
        self.status = Status()
        self.tree = HeaderTree(channels)
        self._framer = Framer(INPUT_CAPACITY)
        self._output: deque[bytes] = deque()
        self._add_common_commands()

    def write(self, data: bytes, end: bool = False) -> None:
        """Take bytes; execute each message that they complete.

        Parameters
        ----------
        data : bytes
            Any part of the stream.
        end : bool
            Whether the link marked the last byte as the end of a message.
        """
        for message in self._framer.feed(data, end):
            self._execute(message)

    def read(self) -> bytes | None:
        """Return the next complete answer with its line feed, None when there is none."""
        return self._output.popleft() if self._output else None

    def clear(self) -> None:
        """Device clear: drop what was sent in part and what was not read; settings and errors stay."""
        self._framer.reset()
        self._output.clear()

    def read_stb(self) -> int:
        """Return the status byte; bit 6 is the master summary, since service requests are not emulated."""
        return self.status.byte(bool(self._output))

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

    def report(self, error: ScpiError) -> None:
        """Put an error into the queue without stopping the command."""
        self.status.report(error)

    def _execute(self, message: Message) -> None:
        branch, answers, commanded = self.tree.root, list[str](), False
        for unit in parse(message):
            try:
                branch, answer = self._run(unit, branch)
            except ScpiError as error:
                self.report(error)
                commanded = True
                if error.is_command_error:
                    break
            else:
                commanded |= answer is None
                if answer is not None:
                    answers.append(answer)
        if commanded:
            self.settled()
        if answers:
            self._answer(";".join(answers))

    def _run(self, unit: Unit | ScpiError, branch: Branch) -> tuple[Branch, str | None]:
        if isinstance(unit, ScpiError):
            raise ScpiError(unit.code, unit.detail)
        found = self.tree.find(unit.header, branch)
        count = len(unit.parameters)
        if count > found.action.most:
            raise ScpiError(-108, unit.header)
        if count < found.action.least:
            raise ScpiError(-109, unit.header)
        return found.branch, found.action.run(Call(found.suffixes, unit.parameters))

    def _answer(self, text: str) -> None:
        if len(self._output) == OUTPUT_CAPACITY:
            self.report(ScpiError(-430))
        else:
            self._output.append(text.encode("latin-1") + b"\n")

    def _add_common_commands(self) -> None:
        status, add = self.status, self.tree.add

        def set_event_enable(call: Call) -> None:
            status.event_enable = read_integer(call.parameters[0], 0, 255)

        def set_service_enable(call: Call) -> None:
            status.service_enable = read_integer(call.parameters[0], 0, 255)

        def complete(call: Call) -> None:
            status.events |= OPERATION_COMPLETE

        add("*IDN", query=Action(lambda call: self.identity))
        add("*RST", Action(lambda call: self.reset()))
        add("*CLS", Action(lambda call: status.clear()))
        add("*TRG", Action(lambda call: self.triggered()))
        add("*WAI", Action(lambda call: None))
        add("*OPC", Action(complete), Action(lambda call: "1"))
        add("*TST", query=Action(lambda call: "+0"))
        add("*ESR", query=Action(lambda call: f"{status.take_events():+d}"))
        add("*STB", query=Action(lambda call: f"{self.read_stb():+d}"))
        add("*ESE", Action(set_event_enable, 1, 1), Action(lambda call: f"{status.event_enable:+d}"))
        add("*SRE", Action(set_service_enable, 1, 1), Action(lambda call: f"{status.service_enable:+d}"))
        add("SYSTem:ERRor[:NEXT]", query=Action(lambda call: status.next_error()))
        add("SYSTem:VERSion", query=Action(lambda call: SCPI_VERSION))
        self._add_register("STATus:QUEStionable", status.questionable)
        self._add_register("STATus:OPERation", status.operation)

    def _add_register(self, header: str, register: Register) -> None:
        def set_enable(call: Call) -> None:
            register.enable = read_integer(call.parameters[0], 0, 32767)

        self.tree.add(f"{header}[:EVENt]", query=Action(lambda call: f"{register.take_event():+d}"))
        self.tree.add(f"{header}:CONDition", query=Action(lambda call: f"{register.condition:+d}"))
        self.tree.add(
            f"{header}:ENABle", Action(set_enable, 1, 1), Action(lambda call: f"{register.enable:+d}")
        )
