"""The same counts on every link: the real drivers over emulated links against the plant itself."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from faulty_bench import FaultyBench
from pyvisa.rname import to_canonical_name

from belahil.bench import Endpoints, open_bench
from belahil.config import (
    BenchConfig,
    BenchTable,
    DigitizerTable,
    EmulatedGenerator,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    Interleave,
)
from belahil.errors import InstrumentError, LinkClosed
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus
from belahil.values import WindowRequest
from drivers import build
from sim.build import endpoints
from sim.faults import FaultPlan

PLACES = {
    "simulated": ("simulated", "simulated"),
    "serial": ("emulated", "emulated:serial"),
    "usb": ("emulated", "emulated:usb"),
}
RNG = np.random.default_rng(5)
STIMULI: tuple[Stimulus, ...] = (
    NoSignal(),
    Sine(1e6, 0.05),
    Sine(12.3456789e6, 0.003, -0.0011),
    SampledPulse(RNG.uniform(-0.02, 0.02, 300), 80e6, start_s=2e-6),
    SampledPulse(RNG.uniform(-0.2, 0.2, 5), 33.3e6, 1e-6, "hold"),
    SampledPulse(np.zeros(3), 80e6),
    Sine(1e6, 0.05),
)
TRUTH = EmulationTable(
    seed=11,
    generator=EmulatedGenerator(bits=10, amplitude_error=0.01, flatness=-0.02, bandwidth_hz=60e6),
    receiver=EmulatedReceiver(
        cutoff_hz=17.1e6,
        order=2,
        highpass_hz=5e3,
        clock_ppm=13.0,
        adc_full_scale_v=1.7,
        interleave=Interleave(0.01, 2e-3, 40e-12),
        input_ohm=52.0,
    ),
)


def _config(place: str, trigger: str, driver: str, load_ohm: float) -> BenchConfig:
    address, link = PLACES[place]
    return BenchConfig(
        bench=BenchTable(trigger=trigger, trigger_delay_s=0.5e-6),  # type: ignore[arg-type]
        generator=GeneratorTable(driver=driver, address=address, load_ohm=load_ohm, attenuation_db=6.0),
        digitizer=DigitizerTable(link=link),
        emulation=TRUTH,
    )


@pytest.mark.parametrize("trigger", ["generator", "digitizer"])
@pytest.mark.parametrize(("driver", "load_ohm"), [("keysight-33500", 50.0), ("keysight-33600", float("inf"))])
def test_equal_seeds_give_equal_counts_on_every_link(trigger: str, driver: str, load_ohm: float) -> None:
    # given the same hidden truth behind three kinds of links
    shots = {}
    for place in PLACES:
        with open_bench(_config(place, trigger, driver, load_ohm)) as bench:
            # when the same plan is measured
            shots[place] = [
                bench.measure(stimulus, WindowRequest(10 * index + code, code, samples, delay_s=1e-7))
                for index, stimulus in enumerate(STIMULI)
                for code, samples in ((4, 16064), (11, 777))
            ]
    # then each window and what was played are equal, at the first attempt
    for place in ("serial", "usb"):
        for reference, shot in zip(shots["simulated"], shots[place], strict=True):
            assert shot.window.equals(reference.window)
            assert shot.played == reference.played
            assert shot.attempt == 1
    # and the pulses did reach the receiver
    quiet, loud = (np.std(shots["usb"][index].window.volts[:400]) for index in (0, 6))
    assert loud > 2 * quiet


def test_an_unchanged_stimulus_costs_the_generator_one_short_question() -> None:
    # given a bench whose messages are counted, and a pulse that was measured
    plan = FaultPlan([])
    with FaultyBench(_config("serial", "digitizer", "keysight-33500", 50.0), plan).open() as bench:
        bench.measure(STIMULI[3], WindowRequest(0, 4))
        before = plan.messages["visa", "to_device"]
        # when it is measured again with another gain code
        bench.measure(STIMULI[3], WindowRequest(1, 5))
        # then the generator is only asked whether all is as it was
        assert plan.messages["visa", "to_device"] == before + 1


@pytest.mark.parametrize("place", ["serial", "usb"])
def test_after_closing_the_output_is_off_and_nothing_is_kept(place: str) -> None:
    config = _config(place, "generator", "keysight-33500", 50.0)
    ends = endpoints(config)
    generator = _generator_of(ends)
    with build.bench(config, ends) as bench:
        bench.measure(Sine(1e6, 0.05), WindowRequest(0, 4))
        assert generator.channels[0].output
    assert not generator.channels[0].output
    # then no registry of a vendor library holds the devices any longer
    gone = weakref.ref(generator)
    del ends, generator, bench
    gc.collect()
    assert gone() is None


def test_without_a_receiver_the_generator_is_left_as_it_was() -> None:
    # given a generator that plays, perhaps for another program, and a receiver whose line is dead
    config = _config("serial", "generator", "keysight-33500", 50.0)
    ends = endpoints(config)
    generator = _generator_of(ends)
    generator.write(b"OUTP ON\n")
    # when the bench is opened
    with pytest.raises(LinkClosed, match="no emulated device is there"):
        build.bench(config, replace(ends, serial_url="grm://nobody-0"))
    # then the generator is not ours, and was not touched
    assert generator.channels[0].output


def _generator_of(ends: Endpoints) -> Any:
    return ends.visa_library._devices[to_canonical_name(ends.visa_address)]


def test_a_generator_of_the_other_family_is_refused() -> None:
    config = _config("serial", "generator", "keysight-33600", 50.0)
    ends = endpoints(config)
    wrong = msgspec.structs.replace(
        config, generator=msgspec.structs.replace(config.generator, driver="keysight-33500")
    )
    with pytest.raises(
        InstrumentError, match=r'driver = "keysight-33500" is for .*33522B; at .* is ".*33622A'
    ):
        build.bench(wrong, ends)
