"""Where the drivers of a bench get their links: from instruments, recorded or not, or from a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from belahil.interfaces import Link

LEFT_ON = "the generator did not confirm that its output is off: switch it off by hand"


class LinkSource(Protocol):
    """What stands between the drivers of a bench and the libraries that open links."""

    @property
    def left_on(self) -> str:
        """What to tell when the generator did not confirm that its output is off; empty: nothing."""
        ...

    def opened(self, name: str, open_link: Callable[[], tuple[Link, str]]) -> tuple[Link, str]:
        """Return a link, and how messages are framed on it.

        Parameters
        ----------
        name : str
            Of the instrument: "generator" or "digitizer".
        open_link : callable
            Opens the real one; it returns the link and the framing. Not called in a replay.

        Raises
        ------
        ConfigError, InstrumentError
            As `open_link` does, or did when it was recorded.
        """
        ...

    def note(self, kind: Any, facts: Mapping[str, Any]) -> None:
        """Note facts of the session: "instruments" or "run"."""
        ...

    def leaving(self) -> None:
        """Note that the bench is being closed."""
        ...

    def check(self) -> None:
        """Raise what was held back so that the bench could be closed.

        Raises
        ------
        StorageError
            The recording could not be written.
        InstrumentError
            The replay did not go the way of its recording, or that is damaged.
        """
        ...

    def close(self) -> None:
        """Let go of the recording; raises nothing."""
        ...


class DirectLinks:
    """Links as they are opened, with nothing between."""

    left_on = LEFT_ON

    def opened(self, name: str, open_link: Callable[[], tuple[Link, str]]) -> tuple[Link, str]:
        """Open the link."""
        return open_link()

    def note(self, kind: Any, facts: Mapping[str, Any]) -> None:
        """Nothing is noted."""

    def leaving(self) -> None:
        """Nothing is noted."""

    def check(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Nothing is held."""
