"""Figures of a digitizer from records that are written down, against their closed form and other programs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sine_records import CODE_V, COUNT, RATE_HZ, filtered_noise

from procedures.coherent import coherent_frequency
from procedures.sine_harmonics import HarmonicPlan, Harmonics
from procedures.sine_quality import SineQuality, sine_quality
from procedures.spectral_lines import find_lines, spectrum

SPAN_V = 2.0


@dataclass(frozen=True)
class Converter:
    """A digitizer with everything that is measured here."""

    amplitude_v: float
    noise_v: float
    square: float = 0.0  # of the volts, per V
    cube: float = 0.0  # per V^2
    gain: float = 0.0
    offset_v: float = 0.0
    skew_s: float = 0.0

    def records(self, rng: np.random.Generator, frequency_hz: float, count: int) -> np.ndarray:
        noise, number = filtered_noise(), np.arange(COUNT)
        sign = np.where(number % 2, -1.0, 1.0)
        time = number / RATE_HZ + sign * self.skew_s / 2
        made = []
        for _ in range(count):
            volts = self.amplitude_v * np.sin(2 * np.pi * frequency_hz * time + rng.uniform(0, 2 * np.pi))
            volts += self.square * volts**2 + self.cube * volts**3 + self.noise_v * noise.draw(rng, COUNT)
            volts = volts * (1 + sign * self.gain / 2) + sign * self.offset_v / 2
            made.append(np.rint(volts / CODE_V) * CODE_V)
        return np.array(made)

    def amplitudes(self) -> tuple[float, float, float]:
        """Of sine, second and third harmonic: sin^2 and sin^3 by their formulas."""
        a = self.amplitude_v
        return a + 0.75 * self.cube * a**3, self.square * a**2 / 2, abs(self.cube) * a**3 / 4

    def sinad_db(self, frequency_hz: float) -> float:
        sine, second, third = self.amplitudes()
        noise = self.noise_v**2 + CODE_V**2 / 12
        distortion = (second**2 + third**2) / 2
        # Of the image: half of the gain difference in phase, half of the time difference in quadrature.
        image = (sine * self.gain / 2) ** 2 / 2 + (sine * math.pi * frequency_hz * self.skew_s) ** 2 / 2
        return 10 * math.log10(sine**2 / 2 / (noise + distortion + image + (self.offset_v / 2) ** 2))

    def thd_db(self) -> float:
        sine, second, third = self.amplitudes()
        return 10 * math.log10((second**2 + third**2) / sine**2)


def measured(converter: Converter, rng: np.random.Generator, wanted_hz: float = 5e6) -> SineQuality:
    frequency_hz = coherent_frequency(wanted_hz, RATE_HZ, COUNT)
    records = converter.records(rng, frequency_hz, 4)
    return sine_quality(HarmonicPlan(frequency_hz, RATE_HZ, COUNT, True).fit(records), SPAN_V, RATE_HZ)


@pytest.mark.parametrize(
    ("converter", "wanted_hz"),
    [
        (Converter(0.9, 0.8e-3, square=2e-3, cube=3e-3), 1e6),
        (Converter(0.9, 2e-3, gain=0.004, offset_v=1e-3, skew_s=20e-12, cube=1e-3), 12e6),
        (Converter(0.3, 5e-3, square=2e-2, gain=-0.01), 5e6),
    ],
)
def test_stated_uncertainties_hold_over_many_records(converter: Converter, wanted_hz: float) -> None:
    # given 40 sets of four records each
    rng = np.random.default_rng(1)
    frequency_hz = coherent_frequency(wanted_hz, RATE_HZ, COUNT)
    plan = HarmonicPlan(frequency_hz, RATE_HZ, COUNT, True)
    pulls = []
    for _ in range(40):
        # when each is measured
        found = sine_quality(plan.fit(converter.records(rng, frequency_hz, 4)), SPAN_V, RATE_HZ)
        assert found.thd.value is not None
        pulls.append(
            [
                (one.value - true) / one.standard_uncertainty
                for one, true in (
                    (found.sinad, converter.sinad_db(frequency_hz)),
                    (found.thd.value, converter.thd_db()),
                    (found.noise_rms, math.hypot(converter.noise_v, CODE_V / math.sqrt(12))),
                )
            ]
        )
    # then the pulls have mean 0 within 4 standard errors, and width 1 within 3.5
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(40))
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=3.5 / math.sqrt(80))


def by_bins(records: np.ndarray, cycles: int) -> dict[str, float]:
    """Plain bins of a discrete Fourier transform: what a coherent sine allows, and nothing clever."""
    power = np.mean([2 * np.abs(np.fft.rfft(one)) ** 2 / COUNT**2 for one in records], axis=0)
    power[0], power[-1] = power[0] / 2, power[-1] / 2
    sine = power[cycles]
    others = power.copy()
    others[0] = others[cycles] = 0.0
    bins = [min(h * cycles % COUNT, COUNT - h * cycles % COUNT) for h in range(2, 11)]
    # What noise puts into each of them, by the bins beside it.
    noise = np.array([np.median(power[max(one - 40, 1) : one + 40]) for one in bins])
    spread = np.sqrt(np.sum((2 * power[bins] * noise + noise**2) / len(records)))
    distortion = np.sum(power[bins] - noise)
    residual = np.sum(others)
    return {
        "sinad": 10 * np.log10(sine / residual),
        "thd": 10 * np.log10(distortion / sine),
        "thd_u": 10 / np.log(10) * spread / distortion,
        "sfdr": 10 * np.log10(sine / np.max(others)),
        "enob": np.log2(SPAN_V / np.sqrt(12 * residual)),
        "noise_rms": np.sqrt(residual - np.sum(power[bins]) - power[COUNT // 2 - cycles] - power[-1]),
    }


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("wanted_hz", [1e6, 9e6, 28e6])
def test_an_independent_implementation_agrees_within_the_uncertainty(seed: int, wanted_hz: float) -> None:
    # given a coherent sine through a random converter
    rng = np.random.default_rng([7, seed])
    converter = Converter(
        amplitude_v=float(rng.uniform(0.2, 0.9)),
        noise_v=float(rng.uniform(0.5e-3, 4e-3)),
        square=float(rng.uniform(5e-3, 2e-2)),
        cube=float(rng.uniform(-2e-2, 2e-2)),
        gain=float(rng.uniform(-0.01, 0.01)),
        offset_v=float(rng.uniform(-2e-3, 2e-3)),
        skew_s=float(rng.uniform(-50e-12, 50e-12)),
    )
    frequency_hz = coherent_frequency(wanted_hz, RATE_HZ, COUNT)
    records = converter.records(rng, frequency_hz, 4)
    # when both measure the same records
    ours = sine_quality(HarmonicPlan(frequency_hz, RATE_HZ, COUNT, True).fit(records), SPAN_V, RATE_HZ)
    theirs = by_bins(records, round(frequency_hz / RATE_HZ * COUNT))
    # then they differ by less than a standard uncertainty; of distortion the plain bins know less than we do
    assert ours.thd.value is not None
    assert ours.sfdr.value is not None
    for name, one in (
        ("sinad", ours.sinad),
        ("enob", ours.enob),
        ("thd", ours.thd.value),
        ("sfdr", ours.sfdr.value),
        ("noise_rms", ours.noise_rms),
    ):
        allowed = math.hypot(one.standard_uncertainty, 2 * theirs.get(f"{name}_u", 0.0))
        assert abs(one.value - theirs[name]) < allowed, name


@pytest.mark.parametrize("seed", range(4))
def test_a_public_toolbox_agrees_within_the_uncertainty(seed: int) -> None:
    toolbox = pytest.importorskip("adctoolbox")
    rng = np.random.default_rng([8, seed])
    converter = Converter(float(rng.uniform(0.4, 0.9)), 1e-3, square=0.01, cube=float(rng.uniform(0, 0.02)))
    frequency_hz = coherent_frequency(float(rng.uniform(2e6, 25e6)), RATE_HZ, COUNT)
    records = converter.records(rng, frequency_hz, 4)
    ours = sine_quality(HarmonicPlan(frequency_hz, RATE_HZ, COUNT, True).fit(records), SPAN_V, RATE_HZ)
    theirs = toolbox.analyze_spectrum(
        records, fs=RATE_HZ, max_scale_range=(-1, 1), win_type="boxcar", max_harmonic=10, create_plot=False
    )
    assert ours.thd.value is not None
    assert ours.sfdr.value is not None
    for name, one in (("sndr_dbc", ours.sinad), ("thd_dbc", ours.thd.value), ("sfdr_dbc", ours.sfdr.value)):
        assert abs(one.value - theirs[name]) < one.standard_uncertainty, name
    # Its effective bits are those of the ratio alone; ours count the span that the sine does not fill.
    level_db = theirs["sig_pwr_dbfs"]
    assert ours.enob.value == pytest.approx(theirs["enob"] - level_db / 6.02, abs=0.01)


def test_distortion_below_the_noise_is_a_bound_and_no_number() -> None:
    rng = np.random.default_rng(3)
    converter = Converter(0.5, 3e-3)
    found = measured(converter, rng)
    assert (found.thd.value, found.thd.status) == (None, "noise_limited")
    assert (found.sfdr.value, found.sfdr.status) == (None, "noise_limited")
    # given distortion just under the bounds, then they hold
    hidden = measured(Converter(0.5, 3e-3, cube=4 * 10 ** (-90 / 20) / 0.25), rng)
    assert hidden.thd.bound > -90
    assert 60 < hidden.sfdr.bound < 90


def test_a_spur_that_belongs_to_nothing_limits_the_range() -> None:
    # given a line at no harmonic, 60 dB below the sine
    rng = np.random.default_rng(4)
    frequency_hz = coherent_frequency(5e6, RATE_HZ, COUNT)
    records = Converter(0.5, 1e-3).records(rng, frequency_hz, 4)
    records += 0.5e-3 * np.cos(2 * np.pi * 17.123e6 * np.arange(COUNT) / RATE_HZ)
    found = sine_quality(HarmonicPlan(frequency_hz, RATE_HZ, COUNT, True).fit(records), SPAN_V, RATE_HZ)
    assert found.sfdr.value is not None
    assert abs(found.sfdr.value.value - 60) < 4 * found.sfdr.value.standard_uncertainty
    assert found.sfdr.value.standard_uncertainty < 0.5


@settings(max_examples=25, deadline=None)
@given(
    frequency=st.floats(0.003, 0.47),
    count=st.integers(700, 2000),
    amplitude_v=st.floats(1e-3, 10.0),
    third=st.floats(0.0, 0.1),
    interleaved=st.booleans(),
)
def test_without_noise_every_line_comes_back(
    frequency: float, count: int, amplitude_v: float, third: float, interleaved: bool
) -> None:
    # given any frequency, coherent or not
    number = np.arange(count)
    records = np.array(
        [
            amplitude_v * (np.cos(2 * np.pi * frequency * number + phase))
            + amplitude_v * third * np.cos(3 * (2 * np.pi * frequency * number + phase) + 0.4)
            for phase in (0.1, 2.0)
        ]
    )
    plan = HarmonicPlan(frequency, 1.0, count, interleaved)
    found: Harmonics = plan.fit(records)
    sine, harmonic = found.line(1), found.line(3)
    assert sine is not None
    if harmonic is None:  # it falls on another line
        return
    assert sine.amplitude == pytest.approx(amplitude_v, rel=1e-6)
    assert harmonic.amplitude == pytest.approx(amplitude_v * third, abs=1e-6 * amplitude_v)
    assert found.residual_v2 > 0


def test_noise_shows_no_line_and_a_line_comes_back() -> None:
    pulls, alarms = [], 0
    for seed in range(60):
        # given noise as white as it goes, and then a line in it
        rng = np.random.default_rng([9, seed])
        records = rng.normal(0, 1e-3, (int(rng.integers(1, 17)), 4096))
        alarms += bool(find_lines(spectrum(records, RATE_HZ)))
        frequency_hz, rms_v = rng.uniform(1e6, 39e6), 10 ** rng.uniform(-3.6, -2.5)
        phases = rng.uniform(0, 2 * np.pi, (len(records), 1))
        records += (
            rms_v * math.sqrt(2) * np.cos(2 * np.pi * frequency_hz * np.arange(4096) / RATE_HZ + phases)
        )
        # when the spectrum is searched
        (line,) = find_lines(spectrum(records, RATE_HZ))
        pulls.append(
            [
                (line.frequency.value - frequency_hz) / line.frequency.standard_uncertainty,
                (line.rms.value - rms_v) / line.rms.standard_uncertainty,
            ]
        )
    assert alarms <= 1
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(60))
    # the place is known a little better than stated, since neighbouring bins share their noise
    assert np.all(np.std(pulls, axis=0) < 1 + 3.5 / math.sqrt(120))
    assert np.all(np.std(pulls, axis=0) > 0.5)


def test_what_falls_on_another_line_is_left_out() -> None:
    # given f_s / 8: harmonic 4 is half the sample rate, 8 is zero, 3 is the image of the sine
    plan = HarmonicPlan(10e6, RATE_HZ, COUNT, True)
    assert (4, False) not in plan.names
    assert (8, False) not in plan.names
    assert (3, False) not in plan.names
    assert (2, False) in plan.names
    # then the fit is still one
    found = plan.fit(Converter(0.5, 1e-3).records(np.random.default_rng(5), 10e6, 2))
    line = found.line(1)
    assert line is not None
    assert line.amplitude == pytest.approx(0.5, rel=1e-4)
