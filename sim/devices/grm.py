"""The byte face of a receiver: the GRM link's other end, over whatever captures the windows."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

from belahil.errors import BelahilError, InstrumentRefused
from belahil.grm_link import (
    MAX_SEGMENT_BYTES,
    RECEIVER_SERVICE,
    SEQUENCE_COUNTS,
    Acknowledge,
    HousekeepingReport,
    IdentityReport,
    Reason,
    Refusal,
    SpecReport,
    Telecommand,
    Verb,
    framed,
    packet_stream,
    read_command,
    segments,
    telemetry,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from belahil.grm_link import Answer, Framing
    from belahil.interfaces import Clock
    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest

LONGEST_DELAY_S = 1.0
"""Assumed: 150 000 km of range, more than any altimeter sees."""


class Receiver(Protocol):
    """What captures the windows: the plant's side of the device."""

    @property
    def identity(self) -> str:
        """What it calls itself."""
        ...

    @property
    def spec(self) -> DigitizerSpec:
        """What it reports of its converters."""
        ...

    def arm(self, request: WindowRequest) -> None:
        """Prepare one window, in place of any that was armed before.

        Raises
        ------
        InstrumentRefused
            What `spec` does not exclude but cannot be had all the same.
        """
        ...

    def collect(self) -> RangeWindow | None:
        """Return the armed window once it has been captured; None before."""
        ...

    def abort(self) -> None:
        """Forget what is armed."""
        ...

    def housekeeping(self) -> Mapping[str, float]:
        """Named numbers, SI units in the names."""
        ...


class GrmDevice:
    """A receiver that is spoken to in bytes.

    Parameters
    ----------
    receiver : Receiver
        Captures the windows.
    framing : {"cobs", "raw"}
        COBS on a serial line, raw packets on USB.
    clock : Clock or None
        Stamps the telemetry; without one all stamps are 0.
    segment_bytes : int
        Payload octets of a window in one packet.

    Notes
    -----
    What this does not model: the pace of a line (everything is there at once), the size of a real
    receiver's buffers, and time between the commands of a client.
    """

    def __init__(
        self,
        receiver: Receiver,
        framing: Framing = "cobs",
        clock: Clock | None = None,
        segment_bytes: int = MAX_SEGMENT_BYTES,
    ) -> None:
        self._receiver = receiver
        self._framing: Framing = framing
        self._clock = clock
        self._segment_bytes = segment_bytes
        self._commands = packet_stream(Telecommand, framing)
        self._ready: deque[bytes] = deque()
        self._armed: int | None = None
        self._sequence_count = 0

    def write(self, data: bytes) -> None:
        """Take bytes from the client: any portion of a serial line's, or one whole USB transfer."""
        commands = self._commands.feed(data)
        if self._framing == "raw":
            commands += self._commands.end()
        for command in commands:
            self._carry_out(command)

    def read(self, max_bytes: int) -> bytes:
        """Give what is ready, whole packets while they fit; sends a window that has been captured."""
        self._collect()
        taken: list[bytes] = []
        while self._ready and len(self._ready[0]) <= max_bytes:
            taken.append(self._ready.popleft())
            max_bytes -= len(taken[-1])
        if self._ready and not taken:
            taken.append(self._ready[0][:max_bytes])
            self._ready[0] = self._ready[0][max_bytes:]
        return b"".join(taken)

    @property
    def waiting(self) -> int:
        """Bytes that are ready; a window that has been captured counts."""
        self._collect()
        return sum(map(len, self._ready))

    def clear(self) -> None:
        """Drop what is ready, as a line does when its buffers are cleared."""
        self._ready.clear()

    def _carry_out(self, command: Telecommand) -> None:
        request_id = command.request_id
        try:
            verb, request = read_command(command)
            answer = self._arm(request_id, request) if request else self._answer(verb, request_id)
        except BelahilError as error:
            if (command.service, command.subtype) == (RECEIVER_SERVICE, Verb.ARM):
                self._disarm()
            answer = Refusal(request_id, _number(error), str(error))
        self._send(answer)

    def _answer(self, verb: Verb, request_id: int) -> Answer:
        match verb:
            case Verb.IDENTIFY:
                return IdentityReport(request_id, self._receiver.identity)
            case Verb.SPEC:
                return SpecReport(request_id, self._receiver.spec)
            case Verb.HOUSEKEEPING:
                return HousekeepingReport(request_id, self._receiver.housekeeping())
        self._disarm()
        self._ready.clear()
        return Acknowledge(request_id)

    def _arm(self, request_id: int, request: WindowRequest) -> Answer:
        self._disarm()
        check(request, self._receiver.spec)
        self._receiver.arm(request)
        self._armed = request_id
        return Acknowledge(request_id)

    def _disarm(self) -> None:
        if self._armed is not None:
            self._receiver.abort()
        self._armed = None

    def _collect(self) -> None:
        if self._armed is None:
            return
        try:
            window = self._receiver.collect()
        except BelahilError as error:
            request_id, self._armed = self._armed, None
            self._send(Refusal(request_id, Reason.NOT_CAPTURED, str(error)))
            return
        if window is not None:
            request_id, self._armed = self._armed, None
            for segment in segments(window, request_id, self._segment_bytes):
                self._send(segment)

    def _send(self, answer: Answer) -> None:
        time_s = self._clock.now_s() if self._clock else 0.0
        packet = telemetry(answer, self._sequence_count, time_s, checked=True)
        self._sequence_count = (self._sequence_count + 1) % SEQUENCE_COUNTS
        self._ready.append(framed(packet.pack(), self._framing))


def check(request: WindowRequest, spec: DigitizerSpec) -> None:
    """Refuse what a receiver with this spec cannot do, as its link would.

    Raises
    ------
    InstrumentRefused
        With the `Reason`, what was asked and what is allowed.
    """
    codes = spec.gain_codes or (None,)
    if request.gain_code not in codes:
        raise InstrumentRefused(
            f"gain code {request.gain_code}; allowed: {', '.join(map(str, codes))}", Reason.GAIN_CODE
        )
    if not 1 <= request.sample_count <= spec.max_sample_count:
        raise InstrumentRefused(
            f"{request.sample_count} samples; allowed: 1 to {spec.max_sample_count}", Reason.SAMPLE_COUNT
        )
    if not 0 <= request.delay_s <= LONGEST_DELAY_S:
        raise InstrumentRefused(
            f"delay of {request.delay_s} s; allowed: 0 to {LONGEST_DELAY_S:g} s", Reason.DELAY
        )
    if request.trigger not in spec.triggers:
        raise InstrumentRefused(
            f"trigger {request.trigger}; allowed: {', '.join(spec.triggers)}", Reason.TRIGGER
        )
    if request.products not in spec.products:
        raise InstrumentRefused(
            f"products {request.products}; allowed: {', '.join(spec.products)}", Reason.PRODUCTS
        )


def _number(error: BelahilError) -> int:
    reason = error.reason if isinstance(error, InstrumentRefused) else 0
    return reason if 0 < reason < 1 << 16 else Reason.OTHER
