"""Sampled pulses through generator, filter and converters, beside an integral with none of our formulas."""

from __future__ import annotations

import math
from dataclasses import dataclass
from zlib import crc32

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, signal

from belahil.bench import open_bench
from belahil.config import BenchConfig, Interleave
from belahil.generators import FULL_CODE
from belahil.stimuli import SampledPulse
from belahil.values import WindowRequest

PULSES = 200
SAMPLES = 160
NS = 1e-9


@dataclass(frozen=True)
class Case:
    """A random pulse, the hidden receiver that sees it, and when."""

    config: BenchConfig
    pulse: SampledPulse
    delay_s: float


def _case(number: int, link: str) -> Case:
    rng = np.random.default_rng([20260, number])
    order = int(rng.integers(1, 5))
    cutoff_hz = rng.uniform(5e6, 28e6)
    bandwidth_hz = (math.inf, cutoff_hz, cutoff_hz * (1 + 1e-7), rng.uniform(3e6, 80e6))[number % 4]
    trigger = ("generator", "digitizer")[number // 2 % 2]
    full_scale_v = rng.uniform(0.2, 2.0)
    config = BenchConfig()
    emulation = msgspec.structs.replace(
        config.emulation,
        seed=number,
        generator=msgspec.structs.replace(config.emulation.generator, bandwidth_hz=bandwidth_hz),
        receiver=msgspec.structs.replace(
            config.emulation.receiver,
            cutoff_hz=cutoff_hz,
            order=order,
            highpass_hz=float(rng.choice([0.0, 10 ** rng.uniform(3, 5.5)])),
            gain_by_code=(1.0,) * 16,
            noise_rms_v_by_code=(0.0,) * 16,
            adc_bits=int(rng.integers(12, 17)),
            adc_full_scale_v=full_scale_v,
            clock_ppm=rng.uniform(-50, 50),
            interleave=Interleave(skew_s=rng.uniform(-50e-12, 50e-12)),
        ),
    )
    config = msgspec.structs.replace(
        config,
        emulation=emulation,
        bench=msgspec.structs.replace(
            config.bench, trigger=trigger, trigger_delay_s=float(rng.choice([0.0, 123e-9]))
        ),
        generator=msgspec.structs.replace(
            config.generator, max_vpp=4.0, address="simulated" if link == "simulated" else "emulated"
        ),
        digitizer=msgspec.structs.replace(config.digitizer, link=link),
    )
    points = rng.uniform(-1, 1, int(rng.integers(2, 150))) * 0.45 * full_scale_v
    pulse = SampledPulse(
        points,
        round(rng.uniform(20e6, 250e6), 6),
        start_s=float(rng.integers(50, 950)) * NS,  # it begins with a jump: one interval is needed before
        interpolation=("linear", "hold")[number % 2],
    )
    return Case(config, pulse, float(rng.choice([0.0, 400e-9, rng.uniform(0, 900e-9)])))


def _system(config: BenchConfig) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """State space of filter and output stage in nanoseconds, from scipy's own Butterworth."""
    truth, output = config.emulation.receiver, config.emulation.generator
    assert truth.order is not None
    assert truth.cutoff_hz is not None
    rate = 2 * np.pi * NS
    zeros, poles, gain = signal.butter(truth.order, rate * truth.cutoff_hz, analog=True, output="zpk")
    if truth.highpass_hz:
        zeros, poles = np.append(zeros, 0.0), np.append(poles, -rate * truth.highpass_hz)
    if math.isfinite(output.bandwidth_hz):
        poles, gain = np.append(poles, -rate * output.bandwidth_hz), gain * rate * output.bandwidth_hz
    a, b, c, _ = signal.zpk2ss(zeros, poles, gain)
    return a, b[:, 0], c[0]


def _integral(case: Case, played: SampledPulse, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Filtered volts: lsim from break point to break point, then the matrix exponential of what is left."""
    a, b, c = _system(case.config)
    interval = 1 / (played.sample_rate_hz * NS)
    linear = played.interpolation == "linear"
    volts = np.append(played.volts, 0.0)
    pieces = played.volts.size - 1 if linear else played.volts.size
    states = signal.lsim(
        (a, b[:, None], c[None, :], 0.0), volts[: pieces + 1], np.arange(pieces + 1) * interval, interp=linear
    )[2]
    states = states.reshape(pieces + 1, -1)
    found = np.zeros(times_s.size)
    for n, since in enumerate(((times_s - played.start_s) / NS).tolist()):
        if since < 0:
            continue
        piece = min(int(since / interval), pieces)
        level = volts[piece] if piece < pieces else 0.0
        slope = (volts[piece + 1] - level) / interval if linear and piece < pieces else 0.0
        # the state, its input and the slope of the input, all three moved on by one exponential
        size = b.size
        joint = np.zeros((size + 2, size + 2))
        joint[:size, :size], joint[:size, size], joint[size, size + 1] = a, b, 1.0
        start = np.concatenate([states[piece], [level, slope]])
        found[n] = c @ (linalg.expm(joint * (since - piece * interval)) @ start)[:size]
    return found


def _times_s(case: Case, shot: int) -> NDArray[np.float64]:
    """True sample times after the generator's trigger, with the phase of the keyed draw."""
    truth, bench = case.config.emulation.receiver, case.config.bench
    key = np.random.SeedSequence(case.config.emulation.seed, spawn_key=(shot, crc32(b"sampling_phase")))
    phase = np.random.Generator(np.random.SFC64(key)).random()
    interval_s = 12.5e-9 / (1 + truth.clock_ppm * 1e-6)
    n = np.arange(SAMPLES)
    skewed = np.where(n % 2, -truth.interleave.skew_s / 2, truth.interleave.skew_s / 2)
    sign = 1 if bench.trigger == "generator" else -1
    edges = round(case.delay_s * 80e6)
    return sign * bench.trigger_delay_s + (phase + edges + n) * interval_s + skewed


@pytest.mark.parametrize(
    ("link", "numbers"),
    [
        pytest.param("emulated:serial", range(PULSES), marks=pytest.mark.slow),
        ("emulated:serial", range(0, PULSES, 10)),
        ("emulated:usb", range(0, PULSES, 10)),
        ("simulated", range(0, PULSES, 10)),
    ],
)
def test_counts_of_random_pulses_are_those_of_an_independent_integral(link: str, numbers: range) -> None:
    seen, worst = 0, 0.0
    for number in numbers:
        # given a random pulse, and a receiver and generator with random hidden truth but no noise
        case = _case(number, link)
        shot = 1000 + number
        with open_bench(case.config) as bench:
            # when it is measured
            request = WindowRequest(shot, 4, SAMPLES, case.delay_s)
            taken = bench.measure(case.pulse, request)
        # then it was played as asked, to half a step of the converter
        played, window = taken.played, taken.window
        assert isinstance(played, SampledPulse)
        step_v = 1.001 * np.max(np.abs(case.pulse.volts)) / FULL_CODE  # amplitudes have four digits
        asked = np.zeros(played.volts.size)
        asked[1 : 1 + case.pulse.volts.size] = case.pulse.volts  # after the zero at which the burst rests
        assert np.max(np.abs(played.volts - asked)) <= step_v / 2
        assert abs(played.start_s + 1 / played.sample_rate_hz - case.pulse.start_s) <= 0.501 * NS
        # and every count is within 1 of the independent integral
        volts = _integral(case, played, _times_s(case, shot))
        expected = volts / window.volts_per_count + window.zero_count
        difference = window.counts - expected
        assert np.max(np.abs(difference)) <= 1, f"pulse {number}"
        seen += bool(np.ptp(window.counts) > 100)
        worst = max(worst, float(np.max(np.abs(difference))))
    # and not by luck: they agree to half a count and a part in 1e8 of the span, with pulses in most windows
    assert worst <= 0.5 + 65536 * 1e-8
    assert seen > 0.6 * len(numbers)
