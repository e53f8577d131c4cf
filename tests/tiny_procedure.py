"""A procedure of a few short windows, which stands where ``procedures.characterize`` stands."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from belahil.bench import Bench
from belahil.config import BenchConfig
from belahil.outcome import Outcome
from belahil.run import Run
from belahil.stimuli import Sine
from belahil.values import Estimate, Shot, WindowRequest

SAMPLES = 64


@dataclass(frozen=True)
class GainOptions:
    codes: tuple[int, ...] | None = None
    amplitudes_vpp: tuple[float, ...] = (0.03,)
    frequencies_hz: tuple[float, ...] | None = (1e6, 5e6)
    dark_windows: int = 1


@dataclass(frozen=True)
class Plan:
    codes: tuple[int, ...]
    amplitudes_vpp: tuple[float, ...]
    frequencies_hz: tuple[float, ...]

    @property
    def shots(self) -> list[tuple[Sine, WindowRequest]]:
        played = [
            (Sine(hz, volts), code)
            for volts in self.amplitudes_vpp
            for hz in self.frequencies_hz
            for code in self.codes
        ]
        return [(sine, WindowRequest(shot, code, SAMPLES)) for shot, (sine, code) in enumerate(played)]

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def plan(bench: Bench, options: GainOptions) -> Plan:
    made = Plan(options.codes or (3, 4), options.amplitudes_vpp, options.frequencies_hz or (1e6,))
    for sine, request in made.shots:
        bench.check(sine, request)
    return made


def measure(bench: Bench, run: Run, plan: Plan, progress: Callable[[int, int], None] | None = None) -> None:
    for done, (sine, request) in enumerate(plan.shots, start=1):
        run.shot(request, lambda sine=sine, request=request: bench.measure(sine, request))  # type: ignore[misc]
        if progress is not None:
            progress(done, len(plan.shots))


def analyse(plan: Plan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    levels: dict[int, list[float]] = {}
    for shot in shots:
        assert shot.window.gain_code is not None
        levels.setdefault(shot.window.gain_code, []).append(float(np.std(shot.window.volts)))
    rows = []
    for code in plan.codes:
        gain = Estimate(sum(levels[code]), 0.01).as_json()
        rows.append({"code": code, "gain": gain, "cutoff": None, "input_noise_rms": None, "status": "tiny"})
    values = [(f"code {row['code']}", Estimate(row["gain"]["value"], 0.01)) for row in rows]
    results = {"gain_codes": rows, "best_code": plan.codes[0], "best_code_runner_up": None}
    return Outcome(results, verdict_values={"gain": values})
