"""Gains by amplitude scatter as their uncertainties say, whatever the pooled filter does to them."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hidden_receivers import found

from belahil.butterworth import magnitude
from belahil.config import (
    EmulatedReceiver,
    EmulationTable,
    GeneratorUncertainty,
    SmallSignal,
    simulated,
)
from procedures.butterworth_fit import fit_filter
from procedures.characterize import AMPLITUDES_VPP, GainOptions
from procedures.gain_amplitudes import AmplitudeRow, amplitude_rows
from procedures.gain_points import Points
from procedures.sine_design import DENSITY_FREEDOM
from procedures.small_signal import first_harmonic

LINEAR, DEAD = SmallSignal(), SmallSignal(deadband_v=0.1e-3)
FREQUENCIES_HZ = np.concatenate([np.geomspace(0.1e6, 8e6, 8), np.linspace(10e6, 38e6, 12)])
GAIN, CUTOFF_HZ, HIGHPASS_HZ, NOISE_V = 5.19, 19e6, 8e3, 1.1e-5


def drawn(small: SmallSignal, rng: np.random.Generator) -> Points:
    """Draw gains of one code, and their uncertainties as a record tells them."""
    amplitude, frequency = (one.ravel() for one in np.meshgrid(AMPLITUDES_VPP, FREQUENCIES_HZ))
    shape = magnitude(frequency, CUTOFF_HZ, 3, HIGHPASS_HZ)
    harmonic = first_harmonic(amplitude / 2 * shape, small.deadband_v, small.cubic_per_v2)
    gain_u = NOISE_V / (amplitude / 2)
    told_u = gain_u * np.sqrt(rng.chisquare(DENSITY_FREEDOM, gain_u.size) / DENSITY_FREEDOM)
    gain = GAIN * shape * harmonic + gain_u * rng.standard_normal(gain_u.size)
    return Points(
        shot=np.arange(gain.size),
        code=np.full(gain.size, 4),
        amplitude_vpp=amplitude,
        frequency_hz=frequency,
        played_vpp=amplitude,
        gain=gain,
        gain_u=told_u,
        gain_rms=gain,
        gain_peak=gain,
        status=np.full(gain.size, "ok"),
    )


def rows_of(points: Points, *shifts: tuple[str, np.ndarray]) -> tuple[AmplitudeRow, ...]:
    fit = fit_filter(points.frequency_hz, points.gain, points.gain_u).integer
    return amplitude_rows(4, fit, points, shifts)


def width(values: np.ndarray) -> float:
    """Return the standard deviation about the mean of each column, over all columns."""
    return float(np.sqrt(np.mean(np.var(values, axis=0, ddof=1))))


@pytest.mark.parametrize("small", [LINEAR, DEAD])
def test_gains_scatter_as_their_uncertainties_say(small: SmallSignal) -> None:
    # given many draws of the points of one receiver
    rng = np.random.default_rng([2030, 8])
    runs = [rows_of(drawn(small, rng)) for _ in range(40)]

    def column(name: str) -> np.ndarray:
        return np.array([[getattr(row, name) for row in rows] for rows in runs])

    gain, spread, own = (column(name) for name in ("sine_fit", "sine_fit_u", "scatter_u"))
    # then each gain scatters as it says
    pulls = (gain - gain.mean(axis=0)) / spread
    assert 0.9 < width(pulls) < 1.1
    if small == LINEAR:
        assert 0.9 < np.sqrt(np.mean(((gain - GAIN) / spread) ** 2)) < 1.1
    else:
        # more than its own points explain
        assert width((gain - gain.mean(axis=0))[:, -1:] / own[:, -1:]) > 1.2
    # and what the filter does is common to all amplitudes: it is not in their differences
    apart, apart_u = gain[:, :-1] - gain[:, -1:], np.hypot(own[:, :-1], own[:, -1:])
    assert 0.9 < width((apart - apart.mean(axis=0)) / apart_u) < 1.1


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("highpass_hz", [0.0, 8e3])
@pytest.mark.parametrize("small", [LINEAR, DEAD])
def test_gains_of_a_bench_scatter_as_their_uncertainties_say(small: SmallSignal, highpass_hz: float) -> None:
    # given runs of one receiver that differ by their chance alone
    receiver = EmulatedReceiver(small_signal=small, highpass_hz=highpass_hz)
    told = []
    for seed in range(48):
        config = msgspec.structs.replace(simulated(), emulation=EmulationTable(seed=seed, receiver=receiver))
        rows = found(config, GainOptions(codes=(4, 6))).results["gain_by_amplitude"]
        told.append([[row["sine_fit"][key] for key in ("value", "standard_uncertainty")] for row in rows])
    gain, spread = np.moveaxis(np.array(told), 2, 0)
    pulls = (gain - gain.mean(axis=0)) / spread
    # then the pulls have a width of one
    assert 0.9 < width(pulls) < 1.1
    if small == LINEAR:
        assert receiver.gain_by_code is None
        truth = np.where(np.arange(gain.shape[1]) < 5, 5.19, gain.mean())
        assert 0.9 < np.sqrt(np.mean(((gain - truth) / spread)[:, :5] ** 2)) < 1.1
    # and two runs differ by no more than chance: one of these 240 is beyond 4.3 once in 240 times
    assert np.max(np.abs(pulls[1::2] - pulls[::2])) / np.sqrt(2) < 4.3


def test_what_is_declared_is_in_the_uncertainty_and_in_the_budget() -> None:
    # given a generator that is declared to 1 % and by 50 uV
    base = simulated()
    declared = GeneratorUncertainty(amplitude_relative=0.01, amplitude_v=50e-6)
    config = msgspec.structs.replace(
        base, generator=msgspec.structs.replace(base.generator, uncertainty=declared)
    )
    # when a receiver is characterized
    outcome = found(config, GainOptions(codes=(4,), amplitudes_vpp=(13e-3, 50e-3)))
    # then each gain has both beside its scatter, and a budget that makes it up
    for row, words in zip(outcome.results["gain_by_amplitude"], ("13 mVpp", "50 mVpp"), strict=True):
        lines = [one for one in outcome.budget if one.quantity == f"gain at {words}, code 4"]
        whole = row["sine_fit"]["standard_uncertainty"]
        assert len(lines) == 3
        assert np.hypot.reduce([one.value for one in lines]) == pytest.approx(whole, rel=1e-12)
        parts = {one.source.rpartition(".")[2]: one.value / row["sine_fit"]["value"] for one in lines}
        assert parts["amplitude_relative"] == pytest.approx(0.01, rel=1e-9)
        # 1 V at the cut is 1 V of the setting here
        assert parts["amplitude_v"] == pytest.approx(50e-6 / row["amplitude_vpp"], rel=0.05)
        assert 0 < row["filter_u"] < whole


def test_another_order_that_fits_as_well_counts() -> None:
    # given points far below the cut-off, which several orders fit
    rng = np.random.default_rng(5)
    points = drawn(LINEAR, rng)
    few = points.frequency_hz < 0.45 * CUTOFF_HZ
    points = Points(*(getattr(points, name)[few] for name in Points.__dataclass_fields__))
    fit = fit_filter(points.frequency_hz, points.gain, points.gain_u).integer
    assert fit.rivals
    # then their gains lie within the uncertainty
    for row in amplitude_rows(4, fit, points, ()):
        assert row.filter_u > 0
        for rival in fit.rivals:
            (other,) = (
                one for one in amplitude_rows(4, rival, points, ()) if one.amplitude_vpp == row.amplitude_vpp
            )
            assert abs(other.sine_fit - row.sine_fit) < 1.2 * row.sine_fit_u
