"""What ``belahil bench parity`` does: a recording beside emulated instruments, and the file of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from pathlib import Path

    from belahil.config import BenchConfig
    from belahil.parity import Parity
    from belahil.recording import RecordedSession

IN_PROCESS = "emulated: calls within the process, without any line; no claim about an instrument"


@dataclass(frozen=True, slots=True)
class Beside:
    """A comparison with what was compared.

    Parameters
    ----------
    session : RecordedSession
        Of the recording.
    emulated : dict
        ``generator``, ``digitizer`` (models), ``bench`` (where its truth is from) and ``seed``.
    parity : Parity
        What was found.
    """

    session: RecordedSession
    emulated: dict[str, Any]
    parity: Parity


def beside(recording: Path, bench: str | None, examples: int) -> Beside:
    """Compare a recording with emulated instruments.

    Parameters
    ----------
    recording : Path
        File of ``--record``.
    bench : str or None
        Emulated bench in place of the recorded one.
    examples : int
        Differences that are kept for each question.

    Raises
    ------
    RefusedInput
        It is no recording, the bench is not an emulated one for these instruments, or nothing was answered.
    StorageError
        The recording is damaged at its beginning.
    """
    from belahil.parity_session import compared, introduced
    from belahil.recording import read_session
    from sim.answering import answering_bench

    session = read_session(recording)
    config = session.recorded if bench is None else _chosen(bench, session.recorded)
    who = introduced(session)
    there = answering_bench(
        config, who.identities, "raw" if who.framings.get("digitizer") == "raw" else "cobs", _streams(session)
    )
    emulated = {
        "generator": there.model.name,
        "digitizer": config.digitizer.driver,
        "bench": bench or "as recorded, with the usual truth",
        "seed": config.emulation.seed,
    }
    return Beside(session, emulated, compared(session, who.framings, there, examples))


def _chosen(bench: str, recorded: BenchConfig) -> BenchConfig:
    from belahil.config import load_bench

    config = load_bench(bench)
    if config.source not in ("emulated", "simulated"):
        raise RefusedInput(
            f"--bench {bench}: is {config.source}; needed is one whose instruments are emulated"
        )
    for part in ("generator", "digitizer"):
        ours, theirs = getattr(config, part).driver, getattr(recorded, part).driver
        if ours != theirs:
            raise RefusedInput(f"--bench {bench}: its {part} is {ours}, the recorded one {theirs}")
    return config


def _streams(session: RecordedSession) -> frozenset[str]:
    """Return the links of which messages have no end mark."""
    places = {
        "generator": session.recorded.generator.address,
        "digitizer": session.recorded.digitizer.link.removeprefix("visa:"),
    }
    return frozenset(
        name for name, place in places.items() if place.upper().endswith("SOCKET") or place.startswith("ASRL")
    )


def written(found: Beside, path: Path) -> None:
    """Write a comparison as JSON.

    Raises
    ------
    StorageError
        The file cannot be written.
    """
    import json

    from belahil.fingerprint import plain
    from belahil.provenance import belahil_version
    from belahil.storage import write_whole

    session, parity = found.session, found.parity
    facts = {
        "schema": 1,
        "software": belahil_version(),
        "recording": {
            "path": str(session.path),
            "belahil": session.belahil,
            "started": session.started,
            "source": session.source,
            "instruments": session.instruments,
        },
        "emulated": found.emulated,
        "latency_note": IN_PROCESS,
        "compared": parity.count,
        "differ": parity.differ,
        "measured": parity.measured,
        "kinds": parity.kinds,
        **plain(parity),
    }
    write_whole(path, json.dumps(facts, indent=1, ensure_ascii=False) + "\n")
