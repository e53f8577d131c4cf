"""Questions and answers over the GRM link, where each answer proves which question it belongs to."""

from __future__ import annotations

from collections import deque
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from belahil.errors import CorruptData, InstrumentError, InstrumentRefused, LinkError, LinkTimeout, StaleData
from belahil.grm_link import (
    SEQUENCE_COUNTS,
    Acknowledge,
    Framing,
    HousekeepingReport,
    IdentityReport,
    Reason,
    Refusal,
    SpecReport,
    Telemetry,
    Verb,
    WindowSegment,
    framed,
    packet_stream,
    read_answer,
    telecommand,
)
from belahil.interfaces import LinkCounts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.grm_link import Answer
    from belahil.interfaces import Clock, Link
    from belahil.values import WindowRequest

ANSWER_TIMEOUT_S = 2.0
READ_BYTES = 65536

A = TypeVar("A", Acknowledge, IdentityReport, SpecReport, HousekeepingReport, WindowSegment)


class GrmSession:
    """One client's side of the link; in step with the receiver, or it raises.

    After any `LinkError` the next question is preceded by abort and identify under new sequence counts,
    so that nothing older can be taken for its answer. It never repeats a question: the bench does.

    Parameters
    ----------
    link : Link
        To the receiver.
    clock : Clock
        For deadlines.
    framing : {"cobs", "raw"}
        COBS on serial lines, raw on USB.
    """

    def __init__(self, link: Link, clock: Clock, framing: Framing) -> None:
        self._link = link
        self._clock = clock
        self._framing: Framing = framing
        self._stream = packet_stream(Telemetry, framing)
        self._inbox: deque[Answer] = deque()
        self._sequence_count = 0
        self._in_step = False
        self._heard = False
        self._receiver_checks = False
        self._stale = 0
        self._last_stale = 0
        self._at_question = self.counts
        self.identity = ""

    @property
    def counts(self) -> LinkCounts:
        """What was dropped so far."""
        return LinkCounts(self._stream.damaged, self._stale)

    def ask(self, verb: Verb, kind: type[A], request: WindowRequest | None = None) -> A:
        """Send a command and return its answer.

        Parameters
        ----------
        verb : Verb
            What is asked.
        kind : type
            Of the answer.
        request : WindowRequest or None
            With ``Verb.ARM``.

        Raises
        ------
        InstrumentRefused
            With the receiver's reason.
        LinkError
            No proof that the command was carried out.
        """
        if not self._in_step:
            self._get_in_step()
        return self._exchange(verb, kind, request)

    def next_answer(self, request_id: int, kind: type[A], deadline_s: float, question: str) -> A:
        """Return the next answer to a request, dropping those to others.

        Parameters
        ----------
        request_id : int
            Of the command.
        kind : type
            Of the answer; an acknowledge that comes twice is dropped.
        deadline_s : float
            On the clock.
        question : str
            For messages.
        """
        expired = False
        with self.losing_step():
            while (answer := self._take(request_id, kind, question)) is None:
                if expired:
                    raise self._missing(request_id, question)
                expired = not self._fill(deadline_s, question)
        return answer

    @contextmanager
    def losing_step(self) -> Iterator[None]:
        """Note that a `LinkError` which passes through here costs the session its step."""
        try:
            yield
        except LinkError:
            self._in_step = False
            raise

    def send(self, verb: Verb, request: WindowRequest | None = None) -> int:
        """Send a command and return its request number, under which it will be answered."""
        # A receiver that sends no second checks may never have heard of them.
        command = telecommand(verb, self._sequence_count, request, checked=self._receiver_checks)
        self._sequence_count = (self._sequence_count + 1) % SEQUENCE_COUNTS
        self._at_question = self.counts
        with self.losing_step():
            self._link.write(framed(command.pack(), self._framing))
        return command.request_id

    def _exchange(self, verb: Verb, kind: type[A], request: WindowRequest | None = None) -> A:
        question = verb.name if request is None else f"{verb.name} of shot {request.shot}"
        request_id = self.send(verb, request)
        return self.next_answer(request_id, kind, self._clock.now_s() + ANSWER_TIMEOUT_S, question)

    def _get_in_step(self) -> None:
        self._link.clear()
        self._stream.end()
        self._inbox.clear()
        self._exchange(Verb.ABORT, Acknowledge)
        identity = " ".join(self._exchange(Verb.IDENTIFY, IdentityReport).text.split())
        if self.identity not in ("", identity):
            raise InstrumentError(f'the receiver was "{self.identity}" and now says "{identity}"')
        self.identity = identity
        self._in_step = True

    def _take(self, request_id: int, kind: type[A], question: str) -> A | None:
        while self._inbox:
            answer = self._inbox.popleft()
            if answer.request_id == request_id:
                if isinstance(answer, kind):
                    return answer
                if isinstance(answer, Refusal):
                    raise _refused(answer, question)
                if not isinstance(answer, Acknowledge):
                    raise CorruptData(
                        f"receiver, {question}: {type(answer).__name__} came, {kind.__name__} was due"
                    )
            self._stale += 1
            self._last_stale = answer.request_id
        return None

    def _fill(self, deadline_s: float, question: str) -> bool:
        """Read once; tell whether something came and time is left."""
        data = self._link.read(READ_BYTES, max(0.0, deadline_s - self._clock.now_s()))
        for packet in self._stream.feed(data) if data else self._stream.end():
            self._heard = True
            self._receiver_checks |= packet.checked
            try:
                answer = read_answer(packet)
            except CorruptData as error:
                raise CorruptData(f"receiver, {question}: {error}") from error
            if answer is not None:
                self._inbox.append(answer)
        return bool(data) and self._clock.now_s() < deadline_s

    def _missing(self, request_id: int, question: str) -> LinkError:
        before = f"receiver, {question}: no complete answer in time"
        # Whoever sent an intact packet speaks this link.
        after = "" if self._heard else "; is this the receiver's link?"
        damaged = self._stream.damaged - self._at_question.damaged
        stale = self._stale - self._at_question.stale
        if damaged:
            return CorruptData(f"{before}; {damaged} damaged, the last is a {self._stream.complaint}{after}")
        if stale:
            return StaleData(
                f"{before} under request number {request_id:08x}; {stale} came under others, "
                f"the last under {self._last_stale:08x}"
            )
        return LinkTimeout(before + after)


def _refused(refusal: Refusal, question: str) -> InstrumentRefused:
    known = refusal.reason in set(Reason)
    name = f" {Reason(refusal.reason).name}" if known else ""
    text = " ".join(refusal.text.split())
    return InstrumentRefused(
        f"receiver refused {question}: {text} (reason {refusal.reason}{name})", refusal.reason
    )
