"""Benches with an oscilloscope: every driver, simulated and emulated, whole or with a link that fails."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.config import BenchConfig, parse_bench
from belahil.stimuli import NoSignal, SampledPulse, Sine
from belahil.values import WindowRequest
from drivers import build
from sim.build import SCOPE_ADDRESS, endpoints
from sim.faulty_devices import FaultyMessages
from sim.transports.visa_library import EmulatedVisa

if TYPE_CHECKING:
    from belahil.bench import Bench, Endpoints
    from belahil.stimuli import Stimulus
    from sim.devices.oscilloscopes.acquisition import ScopeDevice
    from sim.faults import FaultPlan

_TEXT = """
[bench]
trigger_delay_s = 3e-7
[generator]
address = "{address}"
[digitizer]
driver = "{driver}"
link = "{link}"
receiver = "analog"
{digitizer}
[emulation]
seed = 5
[emulation.receiver]
clock_ppm = 20.0
{receiver}
"""
PULSE = SampledPulse(np.array([0.0, 0.01, 0.05, 0.02, -0.01, 0.0]), 50e6, start_s=1e-6)
SCRIPT: tuple[tuple[Stimulus, WindowRequest], ...] = (
    (NoSignal(), WindowRequest(10, None, 400)),
    (Sine(3e6, 0.05), WindowRequest(11, None, 10000)),
    (Sine(3e6, 0.05), WindowRequest(12, None, 400, delay_s=1.23e-6)),
    (PULSE, WindowRequest(13, None, 400, delay_s=4.6e-7)),
    (PULSE, WindowRequest(14, None, 400)),
    (Sine(5e6, 0.09, 0.002), WindowRequest(400_000_015, None, 401)),
)


def config(driver: str, kind: str = "emulated", digitizer: str = "", receiver: str = "") -> BenchConfig:
    """Return a bench of one driver; `digitizer` and `receiver` are lines for those tables."""
    link = "emulated:visa" if kind == "emulated" else kind
    return parse_bench(
        _TEXT.format(address=kind, driver=driver, link=link, digitizer=digitizer, receiver=receiver)
    )


def device_of(ends: Endpoints) -> ScopeDevice:
    """Return the emulated oscilloscope among endpoints."""
    device: ScopeDevice = ends.visa_library._devices[SCOPE_ADDRESS]
    return device


def opened(config: BenchConfig, plan: FaultPlan | None = None, device: Any = None) -> Bench:
    """Open the real drivers; the oscilloscope's link fails as planned, or another device is in its place."""
    ends = endpoints(config)
    there = device_of(ends) if device is None else device(ends)
    if plan is not None:
        there = FaultyMessages(there, plan)
    visa: EmulatedVisa = ends.visa_library
    visa.plug(SCOPE_ADDRESS, there)
    return build.bench(config, replace(ends, visa_library=visa))
