"""What a report tells of a measurement beside its results."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from belahil.recording import recorded_session

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.run import Run

MARK = "What this does not model:"


def conditions(run: Run) -> dict[str, str]:
    """Circumstances of a run, by name."""
    bench, generator, digitizer = run.config.bench, run.config.generator, run.config.digitizer
    return {
        "windows": str(len(run.shots())),
        "options": "; ".join(f"{key}: {_told(value)}" for key, value in run.begun.options.items()),
        "command": run.begun.command,
        **({"replay of": str(session)} if (session := recorded_session(run.config)) else {}),
        **({"recorded windows": Path(run.begun.recorded).name} if run.begun.recorded else {}),
        "between generator and cut": f"load setting {generator.load_ohm:g} ohm, attenuation "
        f"{generator.attenuation_db:g} dB, input resistance of the receiver {digitizer.input_ohm:g} ohm",
        "interlock": f"max_vpp = {generator.max_vpp:g} at the cut",
        "timing": f"trigger by the {bench.trigger}, {bench.settle_s:g} s after each change of stimulus or "
        "gain code",
    }


def _told(value: object) -> str:
    if isinstance(value, dict):
        # A characterized receiver is all that is in its own report.
        return str(value.get("origin") or ", ".join(f"{key} {one}" for key, one in value.items()))
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value))
    return "default" if value is None else str(value)


def not_modelled(run: Run) -> list[str]:
    """What our own emulation leaves out, in the words of each part of it that is loaded.

    Nothing where real addresses or a recording answered: what stands behind them is not known here.
    """
    return [] if {"hardware", "replay"} & {run.config.source, run.begun.source} else left_out()


def left_out() -> list[str]:
    """What the loaded parts of `sim` leave out, a paragraph each in their own words."""
    rooms = sorted(name for name in sys.modules if name.startswith("sim."))
    return [
        f"{name.rpartition('.')[2].replace('_', ' ')}: {paragraph}"
        for name in rooms
        for paragraph in _paragraphs(name)
    ]


def _paragraphs(name: str) -> Iterator[str]:
    module = sys.modules[name]
    own = [thing for thing in vars(module).values() if getattr(thing, "__module__", None) == name]
    for thing in [module, *filter(inspect.isclass, own)]:
        _, mark, after = (inspect.getdoc(thing) or "").partition(MARK)
        if mark:
            yield " ".join(after.split("\n\n")[0].replace("`", "").split())
