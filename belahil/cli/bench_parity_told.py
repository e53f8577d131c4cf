"""What ``belahil bench parity`` prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.cli.bench_parity import IN_PROCESS
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from belahil.cli.bench_parity import Beside
    from belahil.parity import Difference, Latency, Parity, Row

_QUESTION, _EXAMPLE = 30, 34
_AFTER = 160


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
    yield from _errors(parity)
    yield from _differences(parity)
    yield from _windows(parity)
    yield from _latencies(parity.latencies)
    yield from _events(parity)
    yield ""
    equal = parity.count - parity.differ - parity.measured
    noise = f", {parity.measured} but for what was measured" if parity.measured else ""
    kinds = ", ".join(f"{count} {kind}" for kind, count in parity.kinds.items())
    by_kind = f" ({kinds})" if kinds else ""
    yield f"{parity.count} answers compared: {equal} equal{noise}, {parity.differ} differ{by_kind}"


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


def _errors(parity: Parity) -> Iterator[str]:
    """Tell which error each gave to which command: what says most about an emulation."""
    from belahil.parity_grm import reason_name

    found = [(row, one) for row in parity.rows for one in row.differences if one.kind == "error"]
    if found:
        yield ""
        yield "errors that differ:"
    for row, one in found:
        yield from _both(row, one)
    if parity.errors:
        yield ""
        yield "errors that both gave:"
    scpi = {row.link for row in parity.rows if row.question.startswith("*")}
    for same in parity.errors:
        name = "" if same.link in scpi else f" {reason_name(same.code)}"
        yield f"  {same.link} {same.code:+d}{name}: {same.count}"


def _differences(parity: Parity) -> Iterator[str]:
    differing = [row for row in parity.rows if row.differ > row.kinds.get("error", 0)]
    if differing:
        yield ""
        yield "what else differs:"
    for row in differing:
        shown = [one for one in row.differences if one.kind not in ("error", "measured")]
        for one in shown:
            yield from _both(row, one)
        left = row.differ - row.kinds.get("error", 0) - len(shown)
        if left:
            yield f"  {row.link}, {row.question}: {left} more"


def _both(row: Row, one: Difference) -> Iterator[str]:
    yield f"  record {one.record}, {row.link}, {row.question}: {one.kind}"
    yield f"    recorded  {_cut(one.recorded, 200)}"
    yield f"    emulated  {_cut(one.emulated, 200)}"
    if one.raised_by:
        yield f"    raised by {_cut(one.raised_by, 200)}"
    if one.after:
        yield f"    after     {_last(one.after)}"


def _last(after: Sequence[str]) -> str:
    """Tell the last commands; questions only where there was nothing else."""
    from belahil.scpi_text import header_of

    units = [unit for unit in after if not header_of(unit).endswith("?")] or list(after)
    kept: list[str] = []
    while units and sum(map(len, kept)) + len(units[-1]) < _AFTER:
        kept.insert(0, _cut(units.pop(), _AFTER))
    left = [f"{len(units)} more"] if units else []
    return "; ".join([*left, *kept])


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
