"""The few verbs that drivers, simulated instruments and emulated devices share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel
    from belahil.receiver import DigitizerSpec
    from belahil.stimuli import Stimulus
    from belahil.values import RangeWindow, WindowRequest


@dataclass(frozen=True, slots=True)
class LinkCounts:
    """What a link dropped since it was opened.

    Parameters
    ----------
    damaged : int
        Packets that came broken.
    stale : int
        Intact packets that answered an older question, or answered twice.
    """

    damaged: int = 0
    stale: int = 0


class FunctionGenerator(Protocol):
    """Plays a stimulus; all volts are volts into its ``load_ohm`` setting.

    Opening one switches its output off. After `close` every verb but `close` raises `LinkClosed`; `identity`
    and `limits` answer as before. `belahil.conformance.check_generator` tries all of this on any object.
    """

    @property
    def identity(self) -> str:
        """Answer of the instrument to who it is."""
        ...

    @property
    def limits(self) -> GeneratorModel:
        """Limits and grids of the model in `identity`."""
        ...

    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        """Load a stimulus and return what will really be played; preparing that again changes nothing.

        An output that is off stays off. One that is on may be off afterwards.

        Parameters
        ----------
        stimulus : Stimulus
            In volts into the load setting.
        trigger : {"immediate", "generator", "digitizer"}
            Who will start it: it runs freely, our `trigger`, or the external input. A sampled pulse cannot
            run freely; the other stimuli are never started, whatever is named.

        Raises
        ------
        LimitExceeded
            The model cannot make it, or it cannot be started so; nothing was changed.
        InstrumentError
            The instrument failed or refused; the next `prepare` works if the instrument does.
        """
        ...

    def output(self, on: bool) -> None:
        """Connect or disconnect the output; doing so again changes nothing.

        Raises
        ------
        InstrumentError
            The instrument failed or refused.
        """
        ...

    def trigger(self) -> None:
        """Start a stimulus that was prepared with ``trigger="generator"``, as often as wanted.

        Raises
        ------
        InstrumentRefused
            None waits for it.
        LinkError
            No proof that it was sent.
        """
        ...

    def close(self) -> bool:
        """Switch the output off and let go of the link; never raises for a dead link.

        Returns
        -------
        bool
            Whether the instrument confirmed that its output is off; the same when it is closed again.
        """
        ...


@runtime_checkable
class Confirming(Protocol):
    """A generator that can tell whether somebody else has set it; others need no such verb."""

    def confirm(self, whole: bool = False) -> None:
        """Prove that nobody else has set the instrument since the last `prepare` or `output`.

        Parameters
        ----------
        whole : bool
            Compare all settings, as costly as that may be; otherwise what one short question tells.

        Raises
        ------
        Interfered
            Somebody has; the next `prepare` sets everything.
        InstrumentError
            No proof; the next `prepare` sets everything too.
        """
        ...


class Digitizer(Protocol):
    """Digitizes one window at a time.

    After `close` `arm` and `read` raise `LinkClosed`; `identity` and `spec` answer as before.
    `belahil.conformance.check_digitizer` tries all of this on any object.
    """

    @property
    def identity(self) -> str:
        """Answer of the instrument to who it is."""
        ...

    @property
    def spec(self) -> DigitizerSpec:
        """What the instrument reports of itself."""
        ...

    @property
    def dropped(self) -> LinkCounts:
        """What its link dropped since it was opened; never less than before."""
        ...

    def arm(self, request: WindowRequest) -> None:
        """Ask for one window, in place of any before; returns when the instrument has accepted.

        The delay is rounded to whole sample intervals.

        Raises
        ------
        RefusedInput
            No instrument could, or this one's `spec` says that it cannot (`LimitExceeded`); nothing was sent.
        InstrumentRefused
            With the instrument's reason.
        LinkError
            No proof that the request arrived.

        Notes
        -----
        After any of these nothing is armed, and the next `arm` works if the instrument does.
        """
        ...

    def read(self, timeout_s: float) -> RangeWindow:
        """Return the window of the last `arm`, proved by its shot index, and only once.

        Parameters
        ----------
        timeout_s : float
            When no trigger comes, `LinkTimeout` is raised after this time: at most a tenth of it and half a
            second later.

        Raises
        ------
        LinkTimeout, CorruptData, StaleData, LinkClosed
            Never a wrong window. Arm again before the next read.
        InstrumentRefused
            The instrument could not capture it, and says why.
        InstrumentError
            Nothing is armed; told at once.
        """
        ...

    def close(self) -> None:
        """Let go of the link; never raises, neither for a dead link nor when it is closed already."""
        ...


class Link(Protocol):
    """Bytes both ways."""

    def write(self, data: bytes) -> None:
        """Send all of `data`, or raise `LinkError`."""
        ...

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return up to `count` bytes; empty when none came in time.

        Raises
        ------
        LinkClosed
            The other end is gone.
        """
        ...

    def clear(self) -> None:
        """Drop what is on its way in both directions."""
        ...

    def close(self) -> None:
        """Let go."""
        ...


class Clock(Protocol):
    """Time for deadlines and settling; emulated benches advance it without sleeping."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Wait."""
        ...
