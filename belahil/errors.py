"""The error tree, and when to use which.

Every message is one line: what was asked, what came back, what is allowed. The class says whose move is
next, and ``exit_status`` is what the command line returns for it.

==================  ======  =====================================================================
class               status  use it when
==================  ======  =====================================================================
RefusedInput        2       the user asked for something that is not allowed; nothing was done
InstrumentError     3       an instrument or a link failed; measured data are kept
WorkerLost          3       processes or machines that compute for us are gone; finished work is kept
StorageError        4       our own files could not be written or read back
ConformanceFailed   1       a driver breaks what its protocol promises
==================  ======  =====================================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class BelahilError(Exception):
    """Root of all errors that belahil raises on purpose."""

    exit_status = 70


class RefusedInput(BelahilError):
    """A request that was refused before anything was sent or played."""

    exit_status = 2


class ConfigError(RefusedInput):
    """A bench or scene file with an unknown key, a wrong type or an impossible value."""


class InterlockRefused(RefusedInput):
    """A stimulus whose voltage at the cut would exceed ``max_vpp / 2``."""


class LimitExceeded(RefusedInput):
    """A stimulus or window that the named instrument cannot make."""


class InstrumentError(BelahilError):
    """An instrument or its link failed."""

    exit_status = 3


class InstrumentRefused(InstrumentError):
    """An instrument answered, and said no.

    Parameters
    ----------
    message : str
        One line for the user.
    reason : int
        The instrument's own number for its reason (SCPI error number, GRM refusal code).
    """

    def __init__(self, message: str, reason: int = 0) -> None:
        super().__init__(message)
        self.reason = reason


class LinkError(InstrumentError):
    """The link to an instrument gave no proof that an answer belongs to its question.

    The bench may repeat a measurement after any of these except `LinkClosed`.
    """


class LinkTimeout(LinkError, TimeoutError):
    """Nothing, or not enough, arrived before the deadline."""


class CorruptData(LinkError):
    """Something arrived that fails its checksum, its count or its read-back."""


class StaleData(LinkError):
    """Something valid arrived that answers an older question."""


class Interfered(LinkError):
    """Another program, or a hand at its panel, has set an instrument meanwhile: what it did is not ours."""


class LinkClosed(LinkError, ConnectionError):
    """The other end is gone; repeating cannot help."""


class ReplayDiffers(InstrumentError):
    """What is asked of a recording is not what was recorded.

    Parameters
    ----------
    message : str
        One line for the user.
    excerpt : sequence of str
        Lines that show the recorded and the present exchange beside each other.
    """

    def __init__(self, message: str, excerpt: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.excerpt = tuple(excerpt)


class RecordingEnds(ReplayDiffers):
    """A recording ended before its replay did."""


class WorkerLost(BelahilError):
    """Processes or machines that compute for us are gone."""

    exit_status = 3


class ConformanceFailed(BelahilError):
    """A driver breaks what its protocol promises.

    Parameters
    ----------
    message : str
        One line with every rule that fails.
    failures : sequence of object
        The results of those rules.
    """

    exit_status = 1

    def __init__(self, message: str, failures: Sequence[object] = ()) -> None:
        super().__init__(message)
        self.failures = tuple(failures)


class StorageError(BelahilError):
    """A run folder could not be created, written, or read back intact."""

    exit_status = 4
