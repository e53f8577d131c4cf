"""One receiver at several places: it has one client at a time, and tells a further one so."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

from belahil.errors import InstrumentRefused
from belahil.grm_link import Reason
from sim.devices.grm import GrmDevice
from sim.transports.channels import LineWire

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest
    from sim.transports.serial_port import ByteDevice

TAKEN = "the receiver serves another client; one at a time"


class OneReceiver:
    """Gives the receiver to the first client that comes, and to the next one when that has left.

    Parameters
    ----------
    connect : callable
        Makes the byte face of the receiver; each client gets a new one, so nothing of the last is left.
    tell : callable
        Takes a line about a client that was refused.
    """

    def __init__(self, connect: Callable[[], ByteDevice], tell: Callable[[str], None]) -> None:
        self._connect = connect
        self._tell = tell
        self._holder: object = None

    def wire(self) -> LineWire:
        """Return a new client's wire: to the receiver, or to one that refuses every command."""
        if self._holder is not None:
            self._tell(f"a client was refused: {TAKEN}")
            return LineWire(GrmDevice(_TakenReceiver()))
        self._holder = wire = LineWire(self._connect(), self._release)
        return wire

    def _release(self) -> None:
        self._holder = None


class _TakenReceiver:
    """A receiver that somebody else has."""

    @property
    def identity(self) -> str:
        """Refuse."""
        self._refuse()

    @property
    def spec(self) -> DigitizerSpec:
        """Refuse."""
        self._refuse()

    def arm(self, request: WindowRequest) -> None:
        """Refuse."""
        self._refuse()

    def collect(self) -> RangeWindow | None:
        """Return nothing: it is never armed."""
        return None

    def abort(self) -> None:
        """Do nothing: what is armed is somebody else's."""

    def housekeeping(self) -> Mapping[str, float]:
        """Refuse."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise InstrumentRefused(TAKEN, Reason.OTHER)
