"""An emulated bench with a fault plan beneath the vendor libraries, and what is measured on it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.bench import Bench, Endpoints
from belahil.config import BenchConfig, BenchTable, DigitizerTable, EmulationTable, GeneratorTable
from belahil.errors import InstrumentError, LinkClosed
from belahil.recording import Recorder
from belahil.stimuli import NoSignal, SampledPulse, Sine
from belahil.values import WindowRequest
from drivers.build import bench
from sim.build import VISA_ADDRESS
from sim.devices.generator_families import generator_device
from sim.devices.grm import GrmDevice
from sim.faulty_devices import FaultyLine, FaultyMessages
from sim.generator_path import true_model
from sim.plant import Plant
from sim.transports.serial_port import register_serial
from sim.transports.usb_backend import EmulatedUsb
from sim.transports.visa_library import EmulatedVisa

if TYPE_CHECKING:
    from pathlib import Path

    from belahil.generators import GeneratorModel
    from belahil.stimuli import Stimulus
    from belahil.values import Shot
    from sim.faults import FaultPlan

_SAMPLES = 48
_PULSE = np.array([0.0, 0.02, 0.1, 0.03, -0.01, 0.0, 0.0, 0.0, 0.0])
# The second pulse is the first one shifted: all statistics of its points are the same.
SCRIPT: tuple[tuple[Stimulus, WindowRequest], ...] = (
    (NoSignal(), WindowRequest(10, 4, _SAMPLES)),
    (Sine(3e6, 0.05), WindowRequest(11, 4, _SAMPLES)),
    (Sine(5e6, 0.05, 0.01), WindowRequest(12, 5, _SAMPLES)),
    (SampledPulse(_PULSE, 80e6), WindowRequest(13, 5, _SAMPLES)),
    (SampledPulse(np.roll(_PULSE, 1), 80e6), WindowRequest(14, 5, _SAMPLES)),
    (SampledPulse(np.roll(_PULSE, 1), 80e6), WindowRequest(15, 3, _SAMPLES)),
    (Sine(5e6, 0.08, 0.01), WindowRequest(16, 4, _SAMPLES)),
)


def config(link: str, trigger: str = "generator", driver: str = "keysight-33500") -> BenchConfig:
    """Return a bench with GRM link "serial" or "usb"."""
    return BenchConfig(
        bench=BenchTable(trigger=trigger),  # type: ignore[arg-type]
        generator=GeneratorTable(driver=driver),
        digitizer=DigitizerTable(link=f"emulated:{link}"),
        emulation=EmulationTable(seed=7),
    )


def _played_by(stimulus: Stimulus, model: GeneratorModel) -> Stimulus:
    """Return a stimulus no faster than a model plays it."""
    if isinstance(stimulus, SampledPulse):
        return replace(stimulus, sample_rate_hz=min(stimulus.sample_rate_hz, model.max_arb_rate_hz))
    return stimulus


class FaultyBench:
    """Opens the real drivers over a plant whose links fail as planned."""

    def __init__(self, config: BenchConfig, plan: FaultPlan) -> None:
        self.plant = Plant(config)
        self.generator: Any = generator_device(true_model(config), self.plant)
        self._config = config
        self._plan = plan

    def open(self, record: Path | None = None) -> Bench:
        clock = self.plant.clock
        framing = "cobs" if self._config.digitizer.link.endswith("serial") else "raw"
        line = FaultyLine(GrmDevice(self.plant, framing, clock), framing, self._plan)
        visa = EmulatedVisa(clock).plug(VISA_ADDRESS, FaultyMessages(self.generator, self._plan))
        if framing == "cobs":
            ends = Endpoints(visa, VISA_ADDRESS, serial_url=register_serial(line, clock), clock=clock)
        else:
            usb = EmulatedUsb(line, clock)
            ends = Endpoints(visa, VISA_ADDRESS, usb_backend=usb, usb_id=usb.usb_id, clock=clock)
        if record is None:
            return bench(self._config, ends)
        recorder = Recorder(record, self._config, clock)
        try:
            return bench(self._config, replace(ends, clock=recorder.clock, links=recorder))
        except InstrumentError:
            recorder.close()
            raise

    def measured(self) -> list[Shot | InstrumentError]:
        """Run the script and close; a shot that failed is its error, and a closed link ends the script."""
        found: list[Shot | InstrumentError] = []
        try:
            with self.open() as opened:
                for stimulus, request in SCRIPT:
                    try:
                        found.append(opened.measure(_played_by(stimulus, opened.generator_model), request))
                    except LinkClosed:
                        raise
                    except InstrumentError as error:
                        found.append(error)
        except InstrumentError as error:
            found.append(error)
        return found
