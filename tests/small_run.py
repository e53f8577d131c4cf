"""A run without instruments: windows made of their own index, and the outcome of a small procedure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.config import BenchConfig, emulated
from belahil.outcome import BudgetLine, Outcome, Table
from belahil.run import Run
from belahil.stimuli import NoSignal, Sine
from belahil.values import Estimate, RangeWindow, Shot, WindowRequest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 200
INSTRUMENTS = {
    "generator": "Agilent Technologies,33522B,EMULATED,0",
    "digitizer": "belahil,bela-grm,EMULATED,0",
}


def requested(shot: int) -> WindowRequest:
    return WindowRequest(shot, shot % 3, SAMPLES)


def made(shot: int, samples: int = SAMPLES) -> Shot:
    """What a bench would measure: noise that depends on the shot alone."""
    counts = np.random.default_rng(shot).integers(-100, 100, samples).astype(np.int16)
    window = RangeWindow(
        counts,
        1e-3 / 3,
        2048.5,
        12.5e-9,
        1e-7 * shot,
        shot % 3,
        shot,
        shot % 2,
        (),
        {"board_k": 290.0 + shot},
    )
    played = Sine(1e6 * (shot + 1), 0.05, 1e-3) if shot % 4 else NoSignal()
    return Shot(played, window, f"2030-01-01T00:00:{shot % 60:02}.{shot % 1000:03}+00:00", 1 + (shot == 5))


def begin(folder: Path, config: BenchConfig | None = None, **changes: Any) -> Run:
    words: dict[str, Any] = {
        "procedure": "noise",
        "config": config or emulated(),
        "options": {"codes": (0, 1, 2), "span": float("inf")},
        "seed": 7,
        "plan": {"windows": 12, "levels": (0.1, 0.3)},
        "instruments": INSTRUMENTS,
    }
    return Run.create(folder, **(words | changes))


def measure(run: Run, count: int) -> list[int]:
    """Measure shots 0 to `count`; return the indexes that were really measured."""
    taken: list[int] = []

    def take(shot: int) -> Shot:
        taken.append(shot)
        return made(shot)

    for shot in range(count):
        run.shot(requested(shot), lambda shot=shot: take(shot))  # type: ignore[misc]
    return taken


def figure() -> Figure:
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(4, 3), layout="constrained")
    drawn.set_label("Noise < 1 mV & more")
    drawn.subplots().plot([0, 1, 2], [1, 3, 2])
    return drawn


def outcome(**changes: Any) -> Outcome:
    gain = Estimate(5.1934, 0.0123, "1")
    words: dict[str, Any] = {
        "results": {
            "gain_codes": [
                {
                    "code": 0,
                    "gain": gain.as_json(),
                    "cutoff": Estimate(19.0123e6, 3456.0, "Hz").as_json(),
                    "order": {"free": Estimate(3.01, 0.02, "1").as_json(), "integer": 3},
                    "status": "ok",
                },
                {
                    "code": 1,
                    "gain": None,
                    "cutoff": None,
                    "order": {"free": None, "integer": None},
                    "status": "no_usable_point",
                },
            ],
            "best_code": 0,
        },
        "tables": {
            "codes": Table(
                {
                    "code": (np.arange(3), "1", "gain code"),
                    "gain": (np.ma.masked_array([5.1, 5.2, 0.0], [False, False, True]), "1", "gain"),
                    "status": (np.array(["ok", "ok", "no_usable_point"]), "", "status of the gain"),
                },
                "code",
            )
        },
        "figures": {"noise": figure},
        "budget": [
            BudgetLine("gain, code 0", "[generator] uncertainty.amplitude_relative", 0.0121, "1", 0.97),
            BudgetLine("gain, code 0", "noise", 2.1e-3, "1", 0.03),
        ],
        "notes": ["Room temperature was not recorded."],
        "verdict_values": {"gain": [("code 0", gain), ("code 1", None)]},
    }
    return Outcome(**(words | changes))
