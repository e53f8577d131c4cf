"""What ``belahil bench parity`` does: a recording beside emulated instruments, as lines and as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from belahil.config import BenchConfig
    from belahil.parity import Difference, Latency, Parity, Row
    from belahil.recording import RecordedSession

_QUESTION, _EXAMPLE = 30, 34
_AFTER = 5
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
        **plain(parity),
    }
    write_whole(path, json.dumps(facts, indent=1, ensure_ascii=False) + "\n")


def report_lines(found: Beside) -> Iterator[str]:
    """Yield a comparison as lines for the terminal."""
    session, parity = found.session, found.parity
    yield f"recording {session}"
    yield (
        f"emulated: {found.emulated['generator']} and {found.emulated['digitizer']}, bench "
        f"{found.emulated['bench']}, seed {found.emulated['seed']}"
    )
    for link in dict.fromkeys(row.link for row in parity.rows):
        yield ""
        yield f"{link}: {session.instruments.get(link, 'did not say who it is')}"
        yield from _rows([row for row in parity.rows if row.link == link])
    yield from _differences(parity)
    yield from _errors(parity)
    yield from _windows(parity)
    yield from _latencies(parity.latencies)
    yield from _events(parity)
    yield ""
    equal = parity.count - parity.differ - parity.measured
    noise = f", {parity.measured} but for what was measured" if parity.measured else ""
    yield f"{parity.count} answers compared: {equal} equal{noise}, {parity.differ} differ"


def _rows(rows: Sequence[Row]) -> Iterator[str]:
    cells: list[tuple[str, ...]] = [("", "count", "equal", "measured", "differ", "recorded", "emulated")]
    for row in rows:
        counts = (str(number or "") for number in (row.count, row.equal, row.measured, row.differ))
        cells.append(
            (
                _cut(row.question, _QUESTION),
                *counts,
                _cut(row.recorded, _EXAMPLE),
                "" if row.recorded == row.emulated else _cut(row.emulated, _EXAMPLE),
            )
        )
    yield from _columns(cells, right=range(1, 5))


def _columns(cells: Sequence[tuple[str, ...]], right: Sequence[int]) -> Iterator[str]:
    widths = [max(len(row[place]) for row in cells) for place in range(len(cells[0]))]
    for row in cells:
        laid = (
            cell.rjust(widths[place]) if place in right else cell.ljust(widths[place])
            for place, cell in enumerate(row)
        )
        yield "  ".join(laid).rstrip()


def _cut(text: str, most: int) -> str:
    shown = "".join(letter if letter.isprintable() else "." for letter in text)
    return shown if len(shown) <= most else f"{shown[: most - 3]}..."


def _differences(parity: Parity) -> Iterator[str]:
    differing = [row for row in parity.rows if row.differ]
    if differing:
        yield ""
        yield "what differs:"
    for row in differing:
        shown = [one for one in row.differences if one.kind != "measured"]
        for one in shown:
            yield f"  record {one.record}, {row.link}, {row.question}: {one.kind}"
            yield from _both(one)
        if row.differ > len(shown):
            yield f"  {row.link}, {row.question}: {row.differ - len(shown)} more"


def _both(one: Difference) -> Iterator[str]:
    yield f"    recorded  {_cut(one.recorded, 200)}"
    yield f"    emulated  {_cut(one.emulated, 200)}"
    if one.raised_by:
        yield f"    raised by {_cut(one.raised_by, 200)}"
    if one.after:
        left = f"{len(one.after) - _AFTER} more; " if len(one.after) > _AFTER else ""
        yield f"    after     {left}{_cut('; '.join(one.after[-_AFTER:]), 200)}"


def _errors(parity: Parity) -> Iterator[str]:
    from belahil.parity_grm import reason_name

    if parity.errors:
        yield ""
        yield "errors that both gave:"
    scpi = {row.link for row in parity.rows if row.question.startswith("*")}
    for one in parity.errors:
        name = "" if one.link in scpi else f" {reason_name(one.code)}"
        yield f"  {one.link} {one.code:+d}{name}: {one.count}"


def _windows(parity: Parity) -> Iterator[str]:
    if not parity.windows:
        return
    yield ""
    yield "windows, counts of the converter:"
    cells: list[tuple[str, ...]] = [("", "mean", "rms", "peak")]
    for one in parity.windows:
        cells += [
            (f"recorded, median of {one.count}", *_numbers(one.recorded)),
            (f"emulated, median of {one.count}", *_numbers(one.emulated)),
            ("largest difference in a pair", *_numbers(one.largest_difference)),
        ]
    yield from _columns(cells, right=range(1, 4))


def _numbers(three: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{number:.4g}" for number in three)


def _latencies(latencies: Sequence[Latency]) -> Iterator[str]:
    if not latencies:
        return
    yield ""
    yield "latency: median, 90 %, 99 %, largest"
    cells: list[tuple[str, ...]] = [("", "", "count", "recorded", "emulated")]
    for one in latencies:
        times = (
            ", ".join(sized(time_s, "s", 3) for time_s in side) for side in (one.recorded_s, one.emulated_s)
        )
        cells.append((one.link, one.kind, str(one.count), *times))
    yield from _columns(cells, right=range(2, 3))
    yield IN_PROCESS


def _events(parity: Parity) -> Iterator[str]:
    if parity.events:
        yield ""
        yield "links:"
    for event in parity.events:
        yield f"  record {event.record}{', ' if event.link else ''}{event.link}: {event.what}"
    if parity.passed_over:
        yield f"  {parity.passed_over} questions were passed over for it, up to the next clear of their link"
