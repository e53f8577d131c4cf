"""What a measuring command does about ``--record`` and ``--bench replay:FILE``."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput, ReplayDiffers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from belahil.recording import RecordedSession


def check_record(record: Path | None, folder: Path) -> None:
    """Refuse a recording inside the run folder, which must be empty when the run begins.

    Raises
    ------
    RefusedInput
        With the way out.
    """
    if record is not None and folder.absolute() in record.absolute().parents:
        raise RefusedInput(f"--record {record}: lies in the run folder; put it beside {folder}")


def filled(session: RecordedSession | None, procedure: str, chosen: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the options, where the user gave none those of the recorded run of the same procedure."""
    if session is None or session.procedure != procedure:
        return chosen
    told = {key: value for key, value in chosen.items() if value is not None}
    return {**(session.options or {}), **told}


def differing(session: RecordedSession | None, procedure: str, options: Mapping[str, Any]) -> str:
    """Tell how a procedure and its options differ from the recorded ones; empty when they do not."""
    from belahil.fingerprint import difference, plain

    if session is None or not session.procedure:
        return ""
    if session.procedure != procedure:
        return f"recorded was {session.procedure}, and this is {procedure}"
    found = difference(session.options, plain(options))
    return "" if found is None else f"the options are not those of the recording: {found}"


@contextmanager
def compared(session: RecordedSession | None, differs: str, quiet: bool = False) -> Iterator[None]:
    """Tell what is replayed and how it differs, and say so again on the error of a replay.

    Parameters
    ----------
    session : RecordedSession or None
        None: nothing is replayed.
    differs : str
        From `differing`.
    quiet : bool
        Tell it only on the error.
    """
    from belahil.provenance import belahil_version

    if session is None:
        yield
        return
    notes = [differs] if differs else []
    if session.belahil != belahil_version():
        notes.append(f"recorded with belahil {session.belahil}, this is {belahil_version()}")
    if not quiet:
        print(f"replay of {session}", *notes, sep="\n", file=sys.stderr, flush=True)
    try:
        yield
    except ReplayDiffers as error:
        for note in notes:
            error.add_note(note)
        raise
