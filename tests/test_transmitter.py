"""The laser's own pulse on benches without hardware: its shape at the cut, its delay, equality of links."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import xarray
from small_run import begin, outcome

from belahil import butterworth
from belahil.bench import open_bench
from belahil.config import BenchConfig, EmulatedTransmitter, parse_bench
from belahil.errors import ConfigError, InstrumentRefused
from belahil.stimuli import SampledPulse, Sine, TransmittedPulse
from belahil.values import PRODUCTS, RangeWindow, Shot, WindowRequest
from sim.build import bench as simulated_bench
from sim.draws import Draws
from sim.kernel import Kernel
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape
from sim.pulse_threshold import cut_pulse
from sim.transmitter import Transmitter

LINKS = ("simulated", "emulated:serial", "emulated:usb")
INTERVAL_S = 12.5e-9
SIGMA_S, TAIL_S, DELAY_S = 5.4e-9 / FWHM_OF_SIGMA, 3e-9, 500e-9
STEADY = {"energy_jitter": 0.0}
FINE = {"gain_by_code": (1.0,) * 16, "adc_bits": 16, "adc_full_scale_v": 0.1}
QUIET = {"noise_rms_v_by_code": (0.0,) * 16}


def bench_file(
    link: str = "simulated", receiver: dict[str, Any] | None = None, **transmitter: Any
) -> BenchConfig:
    config = parse_bench(
        f'[generator]\naddress = "{link.partition(":")[0]}"\n[digitizer]\nlink = "{link}"\n'
        "[emulation]\nseed = 5\n"
    )
    hidden = config.emulation
    hidden = msgspec.structs.replace(
        hidden,
        transmitter=msgspec.structs.replace(hidden.transmitter, **transmitter),
        receiver=msgspec.structs.replace(hidden.receiver, **(receiver or {})),
    )
    return msgspec.structs.replace(config, emulation=hidden)


def asked(shot: int, samples: int = 120, **more: Any) -> WindowRequest:
    return WindowRequest(shot, 4, samples, source="transmit", **more)


def windows(config: BenchConfig, shots: int, samples: int = 120) -> list[RangeWindow]:
    with simulated_bench(config) as bench:
        return [bench.measure(TransmittedPulse(), asked(shot, samples)).window for shot in range(shots)]


def true_times_s(shot: int, samples: int, seed: int = 5) -> np.ndarray:
    """When the samples of a shot are really taken, after the shot pulse."""
    return (Draws(seed, shot).uniform("sampling_phase") + np.arange(samples)) * INTERVAL_S


# ---- one pulse on every link


def test_equal_seeds_give_equal_windows_and_candidates_on_every_link() -> None:
    # Given the default transmitter behind three links
    def session(link: str) -> list[Shot]:
        with open_bench(bench_file(link, jitter_s=2e-9)) as bench:
            bench.measure(Sine(1e6, 0.05), WindowRequest(90, 4, 500))
            return [
                bench.measure(TransmittedPulse(), asked(10 * place + code, 300, products=products))
                for place, products in enumerate(PRODUCTS)
                for code in (0, 4)
            ]

    simulated, *emulated = map(session, LINKS)
    # Then they are equal in every bit, candidates included
    for shots in emulated:
        for direct, shot in zip(simulated, shots, strict=True):
            assert shot.window.equals(direct.window)
            assert shot.window.candidates == direct.window.candidates
            assert shot.played == TransmittedPulse()
    assert simulated[0].window.candidates == ()
    assert all(shot.window.candidates for shot in simulated[2:])


def test_a_shot_is_the_same_alone_and_in_a_row_and_whatever_was_played() -> None:
    config = bench_file(jitter_s=2e-9)
    row = windows(config, 6)
    with simulated_bench(config) as bench:
        bench.measure(Sine(3e6, 0.1), WindowRequest(70, 4, 500))
        alone = bench.measure(TransmittedPulse(), asked(5)).window
        # And the generator's next stimulus is seen again
        sine = bench.measure(Sine(3e6, 0.1), WindowRequest(71, 4, 500)).window
    assert alone.equals(row[5])
    assert np.ptp(sine.volts) > 0.4


def test_a_window_that_no_shot_pulse_starts_is_refused() -> None:
    with simulated_bench(bench_file()) as bench, pytest.raises(InstrumentRefused) as caught:
        bench._digitizer.arm(asked(1))
    assert "trigger immediate; allowed: trigger digitizer" in str(caught.value)
    assert caught.value.reason == 7


def test_a_run_keeps_the_pulse_and_its_candidates(tmp_path: Path) -> None:
    # Given shots of an emulated bench in a run
    requests = [asked(shot, 300, products=PRODUCTS[shot % 3]) for shot in range(6)]
    with begin(tmp_path / "run") as run, open_bench(bench_file("emulated:usb")) as bench:
        shots = [
            run.shot(one, lambda one=one: bench.measure(TransmittedPulse(), one))  # type: ignore[misc]
            for one in requests
        ]
        run.finish(outcome(figures={}))
    # Then the data file has each, and what the range finder made of it
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        meanings = data["stimulus"].attrs["flag_meanings"].split()
        assert {meanings[kind] for kind in data["stimulus"].values} == {"transmitted_pulse"}
        assert data["sample_count"].values.tolist() == [300, 0, 0] * 2
        assert data["candidate_count"].values.tolist() == [len(shot.window.candidates) for shot in shots]
        for row, shot in enumerate(shots):
            for place, one in enumerate(shot.window.candidates):
                assert data["candidate_arrival_s"].values[row, place] == one.arrival_s
    assert len(shots[1].window.candidates) == 4


# ---- its shape at the cut


def test_an_uncut_pulse_is_that_of_the_same_laser_behind_the_same_filter() -> None:
    # Given a fibre that passes everything, and the closed form of pulse and filter
    config = bench_file(receiver=FINE | QUIET, threshold=0.0, **STEADY)
    shape = PulseShape((PulsePiece(1.0, SIGMA_S, TAIL_S),))
    peak = shape.density(np.linspace(-1e-9, 8e-9, 20001)).max()
    closed = Kernel(shape, butterworth.poles(19e6, 3), gain=20e-3 / peak)
    for window in windows(config, 5):
        expected_v = closed.exact(true_times_s(window.shot, 120) - DELAY_S)
        # Then samples agree to half a count, and 4e-5 of the peak for straight lines
        allowed_v = window.volts_per_count / 2 + 4e-5 * 20e-3
        assert np.abs(window.volts - expected_v).max() <= allowed_v
        assert expected_v.max() > 5e-3


@pytest.mark.parametrize("threshold", [0.17, 0.22, 0.6])
def test_a_hard_cut_leaves_nothing_below_the_threshold(threshold: float) -> None:
    # Given the impulse response by another library, and a fine sum over the cut pulse
    from scipy.signal import butter, residue

    step_s = 2e-12
    places_s = np.arange(-25e-9, 60e-9, step_s) + step_s / 2
    cut = PulseShape((PulsePiece(1.0, SIGMA_S, TAIL_S),)).density(places_s)
    cut /= cut.max()
    cut[cut < threshold] = 0.0
    weights, poles, _ = residue(*butter(3, 2 * math.pi * 19e6, analog=True))
    config = bench_file(receiver=FINE | QUIET, threshold=threshold, **STEADY)
    (window,) = windows(config, 1)
    lags_s = true_times_s(0, 120)[:, None] - DELAY_S - places_s
    after = np.maximum(lags_s, 0)
    impulse = sum((w * np.exp(p * after)).real for w, p in zip(weights, poles, strict=True)) * (lags_s > 0)

    # Then samples are those of the sum: an edge that falls between two of its places misses at most half of
    # one at each end, times the largest impulse response
    allowed_v = window.volts_per_count / 2 + 20e-3 * (2 * step_s / 2 * np.abs(impulse).max() + 4e-5)
    assert np.abs(window.volts - 20e-3 * (impulse @ cut) * step_s).max() <= allowed_v


@pytest.mark.parametrize("threshold", [0.17, 0.22])
def test_the_threshold_of_the_fits_is_the_emulated_one(threshold: float) -> None:
    # Given the model that a fit of the threshold uses, behind the closed form of the filter
    shape = cut_pulse(PulseShape((PulsePiece(1.0, SIGMA_S, TAIL_S),)), threshold)
    closed = Kernel(shape, butterworth.poles(19e6, 3), gain=20e-3 / shape.relative.max())
    for window in windows(bench_file(receiver=FINE | QUIET, threshold=threshold, **STEADY), 3):
        expected_v = closed.exact(true_times_s(window.shot, 120) - DELAY_S)
        allowed_v = window.volts_per_count / 2 + 4e-5 * 20e-3
        assert np.abs(window.volts - expected_v).max() <= allowed_v


def test_cuts_at_the_cut() -> None:
    uncut = Transmitter(EmulatedTransmitter(threshold=0.0)).mean
    hard = Transmitter(EmulatedTransmitter(threshold=0.2)).mean
    soft = Transmitter(EmulatedTransmitter(threshold=0.2, cut="soft", cut_width=0.1)).mean
    nearly = Transmitter(EmulatedTransmitter(threshold=0.2, cut="soft", cut_width=1e-6)).mean
    times_s = np.linspace(-20e-9, 40e-9, 3001)
    u, h, s, n = (one.at(times_s) / 20e-3 for one in (uncut, hard, soft, nearly))

    # Straight lines between break points are the error, 4e-5
    clear = np.abs(u - 0.2) > 1e-3
    np.testing.assert_allclose(h[clear], np.where(u >= 0.2, u, 0.0)[clear], rtol=0, atol=1e-4)
    share = np.clip((u - 0.15) / 0.1, 0, 1)
    # At the kink at 0.25 the slope against u falls from 3.5 to 1; a line across it misses a quarter of that
    # times the step in u between break points.
    steps = np.abs(np.diff(uncut.volts)).max() / 20e-3
    np.testing.assert_allclose(s, u * share, rtol=0, atol=2.5 / 4 * steps)
    # and a soft cut of no width is the hard one, but for one break point at each edge
    clear = np.abs(u - 0.2) > steps
    np.testing.assert_allclose(n[clear], h[clear], rtol=0, atol=1e-4)
    # No cut changes the peak.
    for pulse in (uncut, hard, soft):
        assert pulse.volts.max() == pytest.approx(20e-3, rel=4e-5)


def test_a_table_of_the_same_pulse_gives_the_same_window(tmp_path: Path) -> None:
    file = tmp_path / "pulse.csv"
    times_s = np.linspace(-18e-9, 90e-9, 6000)
    density = PulseShape((PulsePiece(1.0, SIGMA_S, TAIL_S),)).density(times_s)
    np.savetxt(file, np.column_stack([times_s, density]), delimiter=",", header="time_s,relative")
    told = {"receiver": FINE | QUIET, **STEADY}
    (closed,) = windows(bench_file(**told), 1)
    (table,) = windows(bench_file(**told, pulse="table", table=str(file)), 1)
    assert np.abs(closed.counts.astype(int) - table.counts).max() <= 1


# ---- when it comes


def centroid_s(window: RangeWindow) -> float:
    """Centroid on the receiver's own grid."""
    volts = window.volts
    return float(np.arange(volts.size) @ volts / volts.sum() * window.sample_interval_s)


@pytest.mark.parametrize(("delay_s", "threshold"), [(500e-9, 0.17), (507.3e-9, 0.17), (500e-9, 0.0)])
def test_the_delay_comes_back(delay_s: float, threshold: float) -> None:
    # Given shots at random sampling phases
    config = bench_file(receiver=FINE | QUIET, delay_s=delay_s, threshold=threshold, **STEADY)
    found_s = np.array([centroid_s(window) for window in windows(config, 200)])
    # Then their centroids are the delay, the light's own centroid, the filter's (2 / wc for three poles,
    # 16.753 ns), less the half sample by which the receiver's grid begins late on average
    optical = Transmitter(config.emulation.transmitter).mean
    times_s = optical.start_s + np.arange(optical.volts.size) / optical.sample_rate_hz
    own_s = float(times_s @ optical.volts / optical.volts.sum())
    expected_s = delay_s + own_s + 2 / (2 * math.pi * 19e6) - INTERVAL_S / 2
    error_s = found_s.std(ddof=1) / math.sqrt(found_s.size)
    assert abs(found_s.mean() - expected_s) < 4 * error_s
    # whose phases fill a sample evenly: a standard deviation of n even draws is known to 1 / sqrt(5 n)
    assert found_s.std() == pytest.approx(INTERVAL_S / math.sqrt(12), rel=4 / math.sqrt(5 * 200))


def test_candidates_move_with_the_delay() -> None:
    # Given the best candidates of noisy windows, at two delays of the same shots
    def arrivals_s(delay_s: float) -> np.ndarray:
        with simulated_bench(bench_file(delay_s=delay_s)) as bench:
            return np.array(
                [
                    bench.measure(TransmittedPulse(), asked(shot, 300, products="candidates"))
                    .window.candidates[0]
                    .arrival_s
                    for shot in range(40)
                ]
            )

    # Then a delay longer by ten whole samples moves each by as much, but for other noise beneath it. White
    # noise of 1/45 of the peak moves a Gaussian of 20 ns by 0.24 ns; ours is coloured, and twice there.
    moved_s = arrivals_s(500e-9 + 10 * INTERVAL_S) - arrivals_s(500e-9)
    assert abs(moved_s.mean() - 10 * INTERVAL_S) < 5 * moved_s.std(ddof=1) / math.sqrt(40)
    assert moved_s.std() < 1.5e-9


def test_energy_and_time_jitter_as_declared() -> None:
    shots = 400
    # Areas in windows without noise: the energy alone
    steady = windows(bench_file(receiver=FINE | QUIET, **STEADY), shots)
    jittered = windows(bench_file(receiver=FINE | QUIET, energy_jitter=0.05), shots)
    ratio = [b.volts.sum() / a.volts.sum() for a, b in zip(steady, jittered, strict=True)]
    assert np.std(ratio) == pytest.approx(0.05, rel=4.5 / math.sqrt(2 * shots))
    assert np.mean(ratio) == pytest.approx(1, abs=4.5 * 0.05 / math.sqrt(shots))
    # and where it moves in time, it moves by as much
    moving = windows(bench_file(receiver=FINE | QUIET, jitter_s=20e-9, **STEADY), shots)
    moved_s = [centroid_s(b) - centroid_s(a) for a, b in zip(steady, moving, strict=True)]
    assert np.std(moved_s) == pytest.approx(20e-9, rel=4.5 / math.sqrt(2 * shots))


def test_noise_under_the_pulse_is_the_receivers() -> None:
    loud, quiet = windows(bench_file(), 60, 300), windows(bench_file(receiver=QUIET), 60, 300)
    noise_v = np.concatenate([a.volts - b.volts for a, b in zip(loud, quiet, strict=True)])
    # 0.83 mV rms, and each window was rounded: two roundings of 0.49 mV / sqrt(12)
    expected_v = math.hypot(0.83e-3, math.sqrt(2) * loud[0].volts_per_count / math.sqrt(12))
    # One sample in two is independent.
    assert np.sqrt(np.mean(noise_v**2)) == pytest.approx(expected_v, rel=4.5 / math.sqrt(60 * 300))


# ---- what cannot be


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"cut_width": 0.1}, 'cut_width = 0.1: must be 0 with cut = "hard"'),
        ({"cut": "soft"}, 'cut_width = 0 with cut = "soft" and threshold = 0.17: must be above 0, to 1.66'),
        ({"cut": "soft", "cut_width": 1.7}, "must be above 0, to 1.66"),
        ({"tail_s": 1e-6}, "[emulation.transmitter] tail_s = 1e-06: must be at most 100 times fwhm_s"),
        ({"pulse": "table", "table": "no-such-file"}, "no-such-file"),
    ],
)
def test_a_transmitter_that_cannot_be_is_told_when_the_bench_opens(
    changed: dict[str, Any], said: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        open_bench(bench_file(**changed))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_table_that_is_no_pulse_names_its_key(tmp_path: Path) -> None:
    file = tmp_path / "pulse.txt"
    file.write_text("0 1 2\n1 2 3\n")
    with pytest.raises(ConfigError, match=r"\[emulation.transmitter\] table = .*: has 3 columns"):
        open_bench(bench_file(pulse="table", table=str(file)))


def test_no_pulse_is_made_before_somebody_asks() -> None:
    transmitter = Transmitter(EmulatedTransmitter())
    assert "mean" not in vars(transmitter)
    assert isinstance(transmitter.pulse(Draws(1, 1)), SampledPulse)
