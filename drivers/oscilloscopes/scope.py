"""An oscilloscope as a digitizer, at the analog output of the receiver under test.

An oscilloscope returns no shot index. What proves that a window belongs to its request: before arming it is
stopped, and the registers that tell of acquisitions are emptied. The shot is written into the instrument by
the message that starts it. It has to say that it is armed since then, and that the trigger came since then.
After the record was read, the shot has to stand in it still. An answer that was left over is found by the
marks of the SCPI session, before and behind each block. A bit that a bus turns inside a block is not found:
SCPI has no checksum, and relies on those of USB and TCP.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from belahil.errors import CorruptData, InstrumentError, LinkClosed, LinkError, LinkTimeout, StaleData
from belahil.interfaces import LinkCounts
from belahil.oscilloscopes import check_request, setting_for, window_of
from drivers.oscilloscopes.dialect import Item, agrees

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from belahil.interfaces import Clock
    from belahil.oscilloscopes import ScopeSetting
    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest
    from drivers.oscilloscopes.dialect import ScopeDialect
    from drivers.scpi import ScpiSession

ARMING_TIMEOUT_S = 2.0
FIRST_WAIT_S, LONGEST_WAIT_S = 1e-3, 20e-3


class ScopeDigitizer:
    """An oscilloscope that digitizes one window at a time.

    Parameters
    ----------
    session : ScpiSession
        To the instrument; closed by `close`.
    clock : Clock
        For deadlines.
    dialect : ScopeDialect
        Of its family.
    spec : DigitizerSpec
        Rate and longest window that the bench asks for.
    full_scale_v : float
        Span of all codes, V.

    Raises
    ------
    InstrumentError
        Another instrument answers.
    """

    def __init__(
        self,
        session: ScpiSession,
        clock: Clock,
        dialect: ScopeDialect,
        spec: DigitizerSpec,
        full_scale_v: float,
    ) -> None:
        if not dialect.known.match(session.identity):
            raise InstrumentError(
                f'"{session.identity}" is no oscilloscope of this driver; it is for those like '
                f"{dialect.model.maker},{dialect.model.name}"
            )
        self._session = session
        self._clock = clock
        self._dialect = dialect
        self._full_scale_v = full_scale_v
        self._set: ScopeSetting | None = None
        self._armed: tuple[WindowRequest, ScopeSetting] | None = None
        self._is_open = True
        self.spec = spec

    @property
    def identity(self) -> str:
        """What the oscilloscope calls itself."""
        return self._session.identity

    @property
    def dropped(self) -> LinkCounts:
        """Nothing: what does not belong is an error here."""
        return LinkCounts()

    def arm(self, request: WindowRequest) -> None:
        """Ask for one window; returns when the oscilloscope waits for its trigger, or has its record.

        Raises
        ------
        LimitExceeded
            No oscilloscope can do that; nothing was sent.
        LinkError
            No proof that the oscilloscope is set and armed.
        """
        self._check_open()
        self._armed = None
        check_request(request, self.spec)
        setting = setting_for(request, self.spec, self._dialect.model, self._full_scale_v)
        with self._losing_settings():
            session, dialect = self._session, self._dialect
            session.send(dialect.stop)
            if setting != self._set:
                self._send(dialect.items(setting, session.identity))
                self._set = setting
            dialect.forget(session)
            session.send(dialect.mark(request.shot).command, dialect.start)
            self._wait("the oscilloscope does not say that it is armed", ARMING_TIMEOUT_S, dialect.is_armed)
            if request.trigger == "immediate":
                session.send(dialect.force)
        self._armed = request, setting

    def read(self, timeout_s: float) -> RangeWindow:
        """Return the window of the last `arm`.

        Raises
        ------
        LinkTimeout, CorruptData, StaleData, LinkClosed
            Never a window of another shot. Arm again before the next read.
        InstrumentError
            Nothing is armed.
        """
        self._check_open()
        if self._armed is None:
            raise InstrumentError("the oscilloscope was asked for a window before it was armed")
        (request, setting), self._armed = self._armed, None
        with self._losing_settings():
            session, dialect = self._session, self._dialect
            self._wait(f"window of shot {request.shot}: no trigger came", timeout_s, dialect.is_done)
            record = dialect.record(session, setting)
            mark = dialect.mark(request.shot)
            found = session.ask(mark.query)[0] if mark.query else mark.expected
            if not agrees(str(found), mark):
                raise StaleData(f"window of shot {request.shot}: the oscilloscope is marked {found}")
            return window_of(record, request, setting, dialect.model)

    def close(self) -> None:
        """Stop the oscilloscope and let go of the link; never raises for a dead link."""
        if not self._is_open:
            return
        self._is_open = False
        with suppress(InstrumentError):
            self._session.send(self._dialect.stop)
        self._session.close()

    def _check_open(self) -> None:
        if not self._is_open:
            raise LinkClosed("the oscilloscope's driver was closed")

    def _send(self, items: tuple[Item, ...]) -> None:
        """Set what the items say and read all of it back."""
        self._session.send(*(item.command for item in items))
        told = [item for item in items if item.query]
        answers = self._session.ask(*(item.query for item in told))
        for item, answer in zip(told, answers, strict=True):
            if not agrees(answer, item):
                raise CorruptData(f"the oscilloscope was sent {item.command} and says {answer}{self._said()}")

    def _wait(self, what: str, timeout_s: float, is_so: Callable[[ScpiSession], bool]) -> None:
        """Ask until it is so; more and more seldom."""
        deadline_s, pause_s = self._clock.now_s() + timeout_s, FIRST_WAIT_S
        while not is_so(self._session):
            if self._clock.now_s() >= deadline_s:
                raise LinkTimeout(f"{what} within {timeout_s:g} s{self._said()}")
            self._clock.sleep_s(pause_s)
            pause_s = min(2 * pause_s, LONGEST_WAIT_S)

    def _said(self) -> str:
        """Return what is in the error queue, for a message, where there is one."""
        found = self._session.errors() if self._dialect.tells_errors else ()
        return "".join(f'; error {number:+d},"{text}"' for number, text in found)

    @contextmanager
    def _losing_settings(self) -> Iterator[None]:
        """After any failure of the link nothing is known of the settings."""
        try:
            yield
        except LinkError:
            self._set = None
            raise
