"""Random hidden receivers, and what a characterization should find of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from belahil.bench import open_bench
from belahil.config import (
    BenchConfig,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    Interleave,
    simulated,
)
from procedures import characterize
from procedures.characterize import GainOptions

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.outcome import Outcome
    from belahil.values import Shot, WindowRequest

CODES = tuple(range(16))


@dataclass(frozen=True)
class InMemory:
    """A run without a folder."""

    shots: list[Shot]

    def shot(self, request: WindowRequest, measure: Callable[[], Shot], why: Callable[[], str] = str) -> Shot:
        self.shots.append(measure())
        return self.shots[-1]


def found(config: BenchConfig, options: GainOptions) -> Outcome:
    """Characterize in memory."""
    run = InMemory([])
    with open_bench(config) as bench:
        plan = characterize.plan(bench, options)
        characterize.measure(bench, run, plan)
    return characterize.analyse(plan, run.shots, config)


def hidden(number: int) -> BenchConfig:
    """Draw receiver `number`: the ranges are those that the harness promises to measure."""
    rng = np.random.default_rng([2026, number])
    least = rng.uniform(1.0, 4.0)
    gains = np.sort(least * np.geomspace(1, rng.uniform(4.0, 40.0 / least), 16))
    noise = rng.uniform(0.5e-3, 3e-3, 16)
    receiver = EmulatedReceiver(
        cutoff_hz=float(rng.uniform(12e6, 28e6)),
        order=int(rng.integers(2, 5)),
        highpass_hz=float(rng.choice([0.0, rng.uniform(2e3, 20e3)])),
        gain_by_code=tuple(gains.tolist()),
        noise_rms_v_by_code=tuple(noise.tolist()),
        clock_ppm=float(rng.uniform(-50, 50)),
        interleave=Interleave(
            gain=float(rng.uniform(-0.01, 0.01)),
            offset_v=float(rng.uniform(-2e-3, 2e-3)),
            skew_s=float(rng.uniform(-50e-12, 50e-12)),
        ),
    )
    return msgspec.structs.replace(
        simulated(),
        generator=GeneratorTable(address="simulated", attenuation_db=float(rng.uniform(0, 20))),
        emulation=EmulationTable(seed=number, receiver=receiver),
    )


def pulls(config: BenchConfig, outcome: Outcome) -> dict[str, list[float]]:
    """Return (found - true) / standard uncertainty of everything that was found."""
    truth = config.emulation.receiver
    assert truth.cutoff_hz is not None
    assert truth.gain_by_code is not None
    assert truth.noise_rms_v_by_code is not None
    results = outcome.results
    pairs: list[tuple[str, dict[str, Any] | None, float]] = [
        ("clock", results["clock_ppm"], truth.clock_ppm),
        ("interleave gain", results["interleave"]["gain"], truth.interleave.gain),
        ("interleave offset", results["interleave"]["offset_v"], truth.interleave.offset_v),
        ("interleave skew", results["interleave"]["skew_s"], truth.interleave.skew_s),
    ]
    for one in results["gain_codes"]:
        code = one["code"]
        pairs += [
            ("gain", one["gain"], truth.gain_by_code[code]),
            ("cut-off", one["cutoff"], truth.cutoff_hz),
            ("noise", one["noise_rms"], truth.noise_rms_v_by_code[code]),
        ]
        if truth.highpass_hz:
            pairs.append(("high-pass", one["highpass"], truth.highpass_hz))
    collected: dict[str, list[float]] = {}
    for name, measured, true in pairs:
        if measured is not None:
            pull = (measured["value"] - true) / measured["standard_uncertainty"]
            collected.setdefault(name, []).append(pull)
    return collected
