"""The receiver digitizer on the GRM link (``docs/grm-link.md``)."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from belahil.errors import InstrumentError, LinkClosed
from belahil.grm_link import (
    Acknowledge,
    HousekeepingReport,
    SpecReport,
    Verb,
    WindowAssembler,
    WindowSegment,
)
from drivers.grm_rules import check_window
from drivers.grm_session import GrmSession

if TYPE_CHECKING:
    from belahil.grm_link import Framing
    from belahil.interfaces import Clock, Link, LinkCounts
    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest


class GrmDigitizer:
    """A receiver that digitizes range windows, one client at a time.

    Parameters
    ----------
    link : Link
        To the receiver; closed here when nobody answers.
    clock : Clock
        For deadlines.
    framing : {"cobs", "raw"}
        COBS on serial lines, raw on USB.

    Raises
    ------
    LinkError
        No receiver of this link answers, or one whose spec breaks the rules of the link.
    """

    def __init__(self, link: Link, clock: Clock, framing: Framing = "cobs") -> None:
        self._link = link
        self._clock = clock
        self._session = GrmSession(link, clock, framing)
        self._armed: tuple[WindowRequest, int] | None = None
        self._is_open = True
        try:
            self._spec = self._session.ask(Verb.SPEC, SpecReport).spec
        except BaseException:
            link.close()
            raise

    @property
    def identity(self) -> str:
        """What the receiver calls itself."""
        return self._session.identity

    @property
    def spec(self) -> DigitizerSpec:
        """What the receiver reported of its converters when the link was opened."""
        return self._spec

    @property
    def dropped(self) -> LinkCounts:
        """Damaged and stale packets that were dropped since the link was opened."""
        return self._session.counts

    def arm(self, request: WindowRequest) -> None:
        """Ask for one window; an older one that was not read is dropped.

        Raises
        ------
        LimitExceeded
            A value does not fit the link; nothing was sent.
        InstrumentRefused
            With the receiver's reason.
        LinkError
            No proof that the receiver has accepted.
        """
        self._check_open()
        self._armed = None
        accepted = self._session.ask(Verb.ARM, Acknowledge, request)
        self._armed = request, accepted.request_id

    def read(self, timeout_s: float) -> RangeWindow:
        """Return the window of the last `arm`.

        Parameters
        ----------
        timeout_s : float
            For the whole window.

        Raises
        ------
        InstrumentRefused
            The receiver could not capture the window, and says why.
        LinkTimeout, CorruptData, StaleData, LinkClosed
            Never a wrong window. Arm again before the next read.
        InstrumentError
            Nothing is armed.
        """
        self._check_open()
        if self._armed is None:
            raise InstrumentError("the receiver was asked for a window before it was armed")
        (request, request_id), self._armed = self._armed, None
        with self._session.losing_step():
            window = self._assembled(request, request_id, self._clock.now_s() + timeout_s)
            check_window(window, request, self._spec)
        return window

    def housekeeping(self) -> dict[str, float]:
        """Return what the receiver tells of itself now."""
        self._check_open()
        return dict(self._session.ask(Verb.HOUSEKEEPING, HousekeepingReport).values)

    def close(self) -> None:
        """Disarm the receiver and let go of the link; nothing more when it is closed again."""
        if not self._is_open:
            return
        self._is_open = False
        with suppress(InstrumentError):
            self._session.send(Verb.ABORT)
        self._link.close()

    def _check_open(self) -> None:
        if not self._is_open:
            raise LinkClosed("the receiver's driver was closed")

    def _assembled(self, request: WindowRequest, request_id: int, deadline_s: float) -> RangeWindow:
        assembler = WindowAssembler(request_id, request.shot)
        question = f"window of shot {request.shot}"
        while True:
            segment = self._session.next_answer(request_id, WindowSegment, deadline_s, question)
            window = assembler.add(segment)
            if window is not None:
                return window
