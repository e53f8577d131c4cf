"""One receiver: a played pulse and an optical echo meet the same filter, noise, converters, range finder."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from msgspec import structs
from scenes import BARE, with_

from belahil.bench import open_bench
from belahil.config import BenchConfig, EmulatedReceiver, Interleave, SmallSignal, parse_bench
from belahil.receiver import BELA_GRM, GALA_LIKE, ReceiverSpec
from belahil.stimuli import SampledPulse, Sine
from belahil.values import PRODUCTS, Products, RangeWindow, Shot, WindowRequest
from sim.chain import Chain
from sim.rfm import RangeFinder
from sim.scene import Scene

LINKS = ("simulated", "emulated:serial", "emulated:usb")
SEED = 11
NOISE_V = 0.83e-3
SILENT = structs.replace(BARE, seed=SEED)
NOISY = with_(SILENT, noise={"dark_rms_v": NOISE_V})
ODD = with_(
    SILENT,
    electronics={
        "cutoff_hz": 16.3e6,
        "order": 4,
        "highpass_hz": 4e3,
        "small_signal": SmallSignal(-0.5, 2e-5),
        "adc_bits": 13,
        "adc_full_scale_v": 1.7,
        "clock_ppm": 31.0,
        "interleave": Interleave(0.01, 1e-3, 40e-12),
    },
)
GALA = structs.replace(SILENT, receiver="gala-like")


def bench_file(scene: Scene, link: str, seed: int = SEED) -> BenchConfig:
    """A bench whose hidden receiver is that of the scene."""
    config = parse_bench(
        "[generator]\ndriver = 'keysight-33600'\n"
        f"address = '{link.partition(':')[0]}'\nattenuation_db = 20.0\n"
        f"[digitizer]\nlink = '{link}'\nreceiver = '{scene.receiver}'\n[emulation]\nseed = {seed}\n"
    )
    truth = scene.truth
    receiver = EmulatedReceiver(**{name: getattr(truth, name) for name in truth.__struct_fields__})
    return structs.replace(config, emulation=structs.replace(config.emulation, receiver=receiver))


@cache
def chain_of(scene: Scene) -> Chain:
    return Chain(scene)


def asked(scene: Scene, shot: int, products: Products = "window") -> WindowRequest:
    """400 samples round the echo."""
    return replace(chain_of(scene).correlation_window(shot, 400), products=products)


def played(
    scene: Scene, link: str, shots: range, products: Products = "window", seed: int = SEED
) -> list[Shot]:
    """The mean echo of a scene, played by the generator; noise is the receiver's."""
    pulse = chain_of(scene).stimulus(sample_rate_hz=1e9)
    with open_bench(bench_file(scene, link, seed)) as bench:
        return [bench.measure(pulse, asked(scene, shot, products)) for shot in shots]


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize(
    "scene", [SILENT, NOISY, ODD, GALA], ids=["silent", "noisy", "odd receiver", "another instrument"]
)
def test_a_played_echo_and_the_optical_one_give_the_same_samples(scene: Scene, link: str) -> None:
    # Given a chain, and a bench with its receiver and its seed
    chain = chain_of(scene)
    for shot in played(scene, link, range(3)):
        stimulus = shot.played
        assert isinstance(stimulus, SampledPulse)
        optical = chain.window(shot.window.shot, asked(scene, shot.window.shot))
        # Then what comes to the converters differs by one step of the generator at most: its grid of 2^14
        # codes from -peak to +peak is missed by half a step, which the filter makes less than twice as
        # large. That is far below a count, so counts differ by one, where rounding falls the other way.
        step_v = 2 * np.abs(stimulus.volts).max() / 2**14 * scene.gain
        assert step_v < 0.05 * optical.volts_per_count
        differs = shot.window.counts.astype(int) - optical.counts
        assert np.abs(differs).max() <= 1
        # and seldom: as often as a rounding edge lies within the step and the lines' 1e-4 of the peak
        near = 2 * (step_v + 1e-4 * np.ptp(optical.volts)) / optical.volts_per_count
        assert np.count_nonzero(differs) <= 5 + 3 * near * differs.size
        assert np.ptp(optical.counts) > 20
        assert shot.window.start_s == optical.start_s


def test_noise_of_another_seed_is_another_draw_of_the_same_kind() -> None:
    # Given 60 windows from the chain, and 60 from a bench with another seed, each less its own silent one
    shots = range(60)
    chain, silent = chain_of(NOISY), chain_of(SILENT)
    optical = [
        chain.window(k, asked(NOISY, k)).volts - silent.window(k, asked(SILENT, k)).volts for k in shots
    ]
    loud, quiet = (played(scene, "emulated:usb", shots, seed=12) for scene in (NOISY, SILENT))
    bench = [a.window.volts - b.window.volts for a, b in zip(loud, quiet, strict=True)]

    spectra, rms_v = [], []
    for noise in (np.array(optical), np.array(bench)):
        rms_v.append(float(noise.std()))
        power = np.abs(np.fft.rfft(noise, axis=1)[:, 1:-1]) ** 2
        spectra.append(power.mean(axis=0))
    # Then rms agrees; one sample in two is independent
    assert rms_v[0] / rms_v[1] == pytest.approx(1, abs=4.5 * math.sqrt(2 / (60 * 400)))
    # and so does the spectrum in eight bands of equal numbers of lines (60 windows times 24 lines each)
    a, b = (np.array([part.mean() for part in np.array_split(one, 8)]) for one in spectra)
    lines = 60 * (spectra[0].size // 8)
    assert np.abs(np.log(a / b)).max() < 4.5 * math.sqrt(2 / lines)
    # nor are both the same draws
    assert np.abs(np.corrcoef(np.ravel(optical), np.ravel(bench))[0, 1]) < 4.5 * math.sqrt(2 / (60 * 400))


@pytest.mark.parametrize("scene", [NOISY, GALA], ids=["noisy", "another instrument"])
def test_candidates_of_every_bench_are_those_of_the_range_finder_on_the_same_window(scene: Scene) -> None:
    # Given the same shots as windows, as candidates and with correlation windows, on three links
    shots = range(4)
    found = {
        (link, products): [shot.window for shot in played(scene, link, shots, products)]
        for link in LINKS
        for products in PRODUCTS
    }
    finder = chain_of(scene).range_finder
    for k in shots:
        whole = found["simulated", "window"][k]
        assert whole.candidates == ()
        for products in PRODUCTS[1:]:
            expected = finder.report(whole, products)
            assert expected.candidates[0].amplitude_v > 5e-3
            # Then each is equal in every bit, with the samples of the window only where they were asked for
            for link in LINKS:
                window: RangeWindow = found[link, products][k]
                assert window.equals(expected)
                assert window.candidates == expected.candidates
                assert window.counts.size == (whole.counts.size if products == "window_and_candidates" else 0)
        # and a correlation window says where it lies
        for one in found["emulated:serial", "correlation_windows"][k].candidates:
            size = len(one.correlation_window)
            assert size == chain_of(scene).scene.receiver_spec.correlation_window_samples
            stretch = whole.counts[one.first_sample : one.first_sample + size]
            assert one.correlation_window == tuple(stretch.tolist())


def test_the_chain_finds_the_same_pulse_as_the_bench() -> None:
    # Given one shot with the same noise in both, whose counts differ by one here and there
    (shot,) = played(NOISY, "emulated:serial", range(7, 8), "candidates")
    optical = chain_of(NOISY).candidates(7, asked(NOISY, 7))[0]
    bench = shot.window.candidates[0]
    # Then the best candidate is the same to what so few counts can move it
    assert bench.arrival_s == pytest.approx(optical.arrival_s, abs=0.5e-9)
    assert bench.amplitude_v == pytest.approx(optical.amplitude_v, abs=shot.window.volts_per_count)


@pytest.mark.parametrize("spec", [BELA_GRM, GALA_LIKE], ids=lambda spec: spec.name)
@pytest.mark.parametrize("link", ["simulated", "emulated:usb"])
def test_a_clipped_window_of_candidates_says_so(spec: ReceiverSpec, link: str) -> None:
    # Given a receiver whose converters clip most of a window
    text = (
        f"[generator]\naddress = '{link.partition(':')[0]}'\n[digitizer]\nlink = '{link}'\n"
        f"receiver = '{spec.name}'\n[emulation.receiver]\nadc_full_scale_v = 1e-3\n"
    )
    with open_bench(parse_bench(text)) as bench:
        whole, bare = (
            bench.measure(Sine(1e6, 0.05), WindowRequest(1, 4, 1000, products=products)).window
            for products in ("window", "candidates")
        )
    assert whole.saturated > 900
    assert bare.saturated == whole.saturated
    assert bare.candidates == RangeFinder.of(spec).candidates(whole)
