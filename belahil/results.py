"""The files that a finished run leaves beside its summary: data, figures, report."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from belahil.storage import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from belahil.export import ManyShots
    from belahil.outcome import Outcome
    from belahil.receiver import DigitizerSpec
    from belahil.verdict import Check


def write_results(
    folder: Path,
    summary: Mapping[str, Any],
    shots: ManyShots,
    outcome: Outcome,
    checks: Sequence[Check],
    conditions: Mapping[str, str],
    not_modelled: Sequence[str],
    tell: Callable[[str], None] = lambda step: None,
    digitizer: DigitizerSpec | None = None,
) -> None:
    """Write ``data.nc``, the figures, ``report.json`` and ``report.html``.

    Parameters
    ----------
    folder : Path
        The run folder; ``bench.toml`` or ``scene.toml`` is in it.
    summary : mapping
        As ``summary.json`` will say it; writing that file, last, is left to the caller.
    shots : ManyShots
        Read twice.
    outcome : Outcome
        From the procedure.
    checks : sequence of Check
        Values beside their limits.
    conditions : mapping of str to str
        Circumstances by name.
    not_modelled : sequence of str
        What an emulation or simulation leaves out.
    tell : callable
        Told what begins: "writing", "drawing".
    digitizer : DigitizerSpec or None
        What the receiver reported of itself.

    Raises
    ------
    StorageError
        A file could not be written.
    """
    from belahil.export import write_data
    from belahil.report import material, save_figures, write_page

    tell("writing")
    write_data(folder / "data.nc", shots, outcome.tables, summary, outcome.numbers, digitizer)
    told = material(outcome, checks, {**conditions, **outcome.conditions}, not_modelled)
    tell("drawing")
    told["figures"] = save_figures(folder, outcome.figures, summary["source"])
    write_whole(folder / "report.json", json.dumps(told, indent=2, ensure_ascii=False) + "\n")
    write_page(folder, summary, told)
