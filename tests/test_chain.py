"""Chains from end to end: against independent forms, against the link budget, against a bench."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from scenes import BARE, DAY, NIGHT, with_

from belahil import butterworth
from belahil.bench import open_bench
from belahil.config import Interleave, parse_bench
from belahil.errors import RefusedInput
from belahil.pole_response import response
from belahil.stimuli import NoSignal, SampledPulse
from belahil.values import WindowRequest
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.detector import volts_per_photon_rate
from sim.draws import Draws
from sim.footprint import DelayGaussian
from sim.link_budget import link_budget
from sim.presets import laser_preset
from sim.receiver_model import ReceiverModel
from sim.scene import Scene, load_scene
from sim.terrain_grid import OffTerrain

INTERVAL_S = 12.5e-9


def steady(name: str) -> Scene:
    return with_(load_scene(name), laser={"jitter_rad": (0.0, 0.0), "energy_jitter": 0.0})


# ---- the mean echo


def test_the_echo_carries_the_photons_of_the_link_budget() -> None:
    chain, budget = Chain(BARE, Accuracy(1e-6)), link_budget(BARE)

    echo = chain.echo()

    assert echo.status == "ok"
    assert echo.photons == pytest.approx(budget.photons, rel=1e-6)
    assert echo.energy_j == pytest.approx(budget.energy_j, rel=1e-6)
    begin_s, end_s = echo.span_s
    step_s = 1e-10
    count = math.ceil((end_s - begin_s) / step_s)
    assert echo.photon_rate_hz(begin_s, step_s, count).sum() * step_s == pytest.approx(
        budget.photons, rel=1e-6
    )
    assert echo.power_w(begin_s, step_s, count).sum() * step_s == pytest.approx(budget.energy_j, rel=1e-6)


def test_the_area_of_the_samples_is_that_of_the_link_budget() -> None:
    chain = Chain(BARE, Accuracy(1e-6))

    volts = chain.samples(request=chain.correlation_window(sample_count=200)).volts

    assert volts.sum() * INTERVAL_S == pytest.approx(link_budget(BARE).area_at_converter_v_s, rel=1e-5)


def test_samples_are_the_stimulus_behind_the_filter() -> None:
    # Given a stimulus on a fine grid, filtered by another module
    chain = Chain(BARE, Accuracy(1e-5))
    pulse, samples = chain.stimulus(), chain.samples()
    assert isinstance(pulse, SampledPulse)
    times_s = samples.start_s + np.arange(samples.volts.size) * INTERVAL_S

    volts = 5.19 * response(
        pulse.volts, pulse.sample_rate_hz, pulse.start_s, "linear", butterworth.poles(19e6, 3), times_s
    )

    # Then both are the same within the tolerance, met twice
    np.testing.assert_allclose(samples.volts, volts, rtol=0, atol=2e-5 * volts.max())


BENDS = "0 0\n1e-9 0.2\n3e-9 1\n6e-9 0.5\n12e-9 0\n"
JUMPS = "0 1\n8e-9 1\n"


@pytest.mark.parametrize(("rows", "tolerance"), [(BENDS, 1e-2), (BENDS, 1e-4), (JUMPS, 1e-2)])
def test_a_coarse_pulse_table_is_as_good_behind_the_receiver(
    tmp_path: Path, rows: str, tolerance: float
) -> None:
    # Given a pulse of a few rows, in whose light no time bins keep the tolerance
    (tmp_path / "pulse.txt").write_text(rows)
    table = {"pulse": "table", "table": str(tmp_path / "pulse.txt")}
    chain = Chain(with_(BARE, laser=table), Accuracy(tolerance))
    # When stimulus and samples are made where a far finer computation has its samples
    finer = Chain(with_(BARE, laser=table), Accuracy(1e-6))
    request = finer.correlation_window()
    pulse, samples = chain.stimulus(), chain.samples(request=request)
    assert isinstance(pulse, SampledPulse)
    times_s = samples.start_s + np.arange(samples.volts.size) * INTERVAL_S
    volts = 5.19 * response(
        pulse.volts, pulse.sample_rate_hz, pulse.start_s, "linear", butterworth.poles(19e6, 3), times_s
    )
    # Then both are what that gives
    true = finer.samples(request=request).volts
    np.testing.assert_allclose(samples.volts, true, rtol=0, atol=tolerance * true.max())
    np.testing.assert_allclose(volts, true, rtol=0, atol=2 * tolerance * true.max())
    assert chain.echo().photons == pytest.approx(Chain(BARE).echo().photons, rel=2 * tolerance)


@pytest.mark.parametrize(
    ("rows", "tolerance", "step", "slope_deg"),
    [(BENDS, 1e-4, 0.003, 10.0), (BENDS, 1e-4, 0.003, 40.0), (JUMPS, 1e-2, 0.02, 10.0)],
)
def test_the_light_of_a_coarse_pulse_table_rises_and_falls_once_on_a_plane(
    tmp_path: Path, rows: str, tolerance: float, step: float, slope_deg: float
) -> None:
    (tmp_path / "pulse.txt").write_text(rows)
    table = {"pulse": "table", "table": str(tmp_path / "pulse.txt")}
    scene = with_(BARE, laser=table, surface={"slope_deg": slope_deg})

    rate = Chain(scene, Accuracy(tolerance)).echo().photon_rate_hz(-300e-9, 0.5e-9, 1201)

    top = int(rate.argmax())
    against = [np.diff(rate[: top + 1]).clip(max=0), np.diff(rate[top:]).clip(min=0)]
    assert max(float(np.abs(one).max()) for one in against) < step * rate.max()


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-4])
def test_all_light_of_a_pulse_table_is_there_on_level_ground(tmp_path: Path, tolerance: float) -> None:
    # Given a pulse whose spectrum reaches thousands of times further than that of the receiver
    (tmp_path / "pulse.txt").write_text(BENDS)
    table = {"pulse": "table", "table": str(tmp_path / "pulse.txt")}
    chain = Chain(with_(BARE, laser=table, surface={"slope_deg": 0.0}), Accuracy(tolerance))

    photons = chain.echo().photons

    assert photons == pytest.approx(link_budget(chain.scene).photons, rel=tolerance)


def test_a_jump_in_a_pulse_table_is_refused_where_no_stimulus_is_fine_enough(tmp_path: Path) -> None:
    (tmp_path / "box.txt").write_text(JUMPS)
    chain = Chain(with_(BARE, laser={"pulse": "table", "table": str(tmp_path / "box.txt")}))

    with pytest.raises(RefusedInput, match="begin and end the table of the pulse with no power"):
        chain.stimulus()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_a_fine_stimulus_has_its_points_on_the_time_bins(tolerance: float) -> None:
    # Given a tolerance whose stimulus has up to 2e5 points over thousands of time bins
    chain = Chain(with_(load_scene("plane"), noise={"shot": False}), Accuracy(tolerance))
    # When it is made
    pulse = chain.stimulus()
    # Then its points lie on the bins, so that no table of all lags is built, and all the light is there
    assert isinstance(pulse, SampledPulse)
    ratio = pulse.sample_rate_hz * chain.light_bin_s
    assert min(abs(ratio - round(ratio)), abs(1 / ratio - round(1 / ratio))) < 1e-9
    area = float(np.sum(pulse.volts)) / pulse.sample_rate_hz
    assert area == pytest.approx(chain.echo().photons * volts_per_photon_rate(chain.scene.detector), rel=1e-5)


def test_the_amplifiers_pole_is_left_to_the_stimulus_and_is_in_the_samples() -> None:
    chain = Chain(with_(BARE, detector={"tia_pole_hz": 20e6}), Accuracy(1e-5))
    pulse, samples = chain.stimulus(), chain.samples()
    assert isinstance(pulse, SampledPulse)
    assert pulse.poles == (complex(-2 * math.pi * 20e6),)
    times_s = samples.start_s + np.arange(samples.volts.size) * INTERVAL_S
    poles = (*pulse.poles, *butterworth.poles(19e6, 3))

    volts = 5.19 * response(pulse.volts, pulse.sample_rate_hz, pulse.start_s, "linear", poles, times_s)

    np.testing.assert_allclose(samples.volts, volts, rtol=0, atol=2e-5 * volts.max())


def test_the_three_idealized_surfaces_return_equal_light() -> None:
    areas = []
    for name in ("plane", "crater", "boulder"):
        chain = Chain(steady(name))
        request = chain.correlation_window(sample_count=200)
        areas.append(chain.samples(request=request).volts.sum() * INTERVAL_S)

    assert areas == pytest.approx([link_budget(steady("plane")).area_at_converter_v_s] * 3, rel=1e-4)


def test_echoes_of_crater_and_boulder_are_mirrored() -> None:
    # Given a pulse that is its own mirror
    step_s, count = 0.5e-9, 801
    rates = []
    for name in ("crater", "boulder"):
        scene = with_(steady(name), laser={"pulse": "gaussian"})
        rates.append(Chain(scene).echo().photon_rate_hz(-200e-9, step_s, count))

    # Then one is the other backwards, but for the wavefront's curve of 1 ps
    np.testing.assert_allclose(rates[0], rates[1][::-1], rtol=0, atol=2e-3 * rates[0].max())
    assert np.abs(rates[0] - rates[1]).max() > 0.1 * rates[0].max()


def test_a_gaussian_fitted_to_the_boulder_is_narrower_than_one_fitted_to_the_plane() -> None:
    from scipy.optimize import curve_fit

    widths = {}
    for name in ("plane", "boulder"):
        samples = Chain(steady(name)).samples()
        places = np.arange(42.0)
        start = (samples.volts.max(), float(samples.volts.argmax()), 2.0)
        found, _ = curve_fit(
            lambda t, a, t0, s: a * np.exp(-0.5 * ((t - t0) / s) ** 2), places, samples.volts, start
        )
        widths[name] = abs(found[2])

    assert widths["boulder"] < 0.97 * widths["plane"]


# ---- shots


def test_a_shot_is_the_same_alone_and_in_a_row() -> None:
    row = Chain(DAY)
    for shot in range(5):
        row.window(shot)

    assert row.window(5).equals(Chain(DAY).window(5))
    assert not row.window(5).equals(row.window(4))


def test_windows_of_one_shot_share_their_echo_and_its_shot_noise() -> None:
    chain = Chain(structs.replace(BARE, noise=structs.replace(BARE.noise, shot=True)))
    short = chain.samples(7)
    whole = chain.samples(7, chain.whole_window(7))

    first = round((short.start_s - whole.start_s) / INTERVAL_S)
    np.testing.assert_allclose(
        whole.volts[first : first + 42], short.volts, rtol=0, atol=1e-6 * short.volts.max()
    )


def test_the_mean_of_noisy_shots_is_the_noise_free_one() -> None:
    # Given the noise of many shots, each at its own sampling phase
    noisy, quiet, shots = Chain(DAY), Chain(BARE), 1500
    noise = np.array([noisy.samples(k).volts - quiet.samples(k).volts for k in range(shots)])

    # Then no sample's mean is further off than 4.5 standard errors (42 samples: 3e-4 by chance)
    assert np.abs(noise.mean(axis=0) / (noise.std(axis=0) / math.sqrt(shots))).max() < 4.5


def test_jitter_moves_the_echo_of_sloping_ground_as_far_as_the_beam() -> None:
    jitter_rad, shots = 2e-6, 400
    chain = Chain(with_(BARE, laser={"jitter_rad": (jitter_rad, 0.0)}))

    found = [chain.lit(shot).delays for shot in range(shots)]
    means = [light.mean_s for light in found if isinstance(light, DelayGaussian)]

    moved_s = 2 / 299792458.0 * jitter_rad * 500e3 * math.tan(math.radians(10))
    assert np.std(means) == pytest.approx(moved_s, rel=4.5 / math.sqrt(2 * shots))


def test_energy_jitter_scales_light_and_samples() -> None:
    chain, still = Chain(with_(BARE, laser={"energy_jitter": 0.05})), Chain(BARE)

    ratio = chain.echo(4).photons / still.echo(4).photons

    assert ratio != 1
    np.testing.assert_allclose(chain.samples(4).volts, still.samples(4).volts * ratio, rtol=1e-12, atol=1e-18)


def test_skewed_converters_sample_the_echo_at_their_own_times() -> None:
    skew_s = 400e-12
    skewed = Chain(with_(BARE, electronics={"interleave": Interleave(skew_s=skew_s)}))
    straight = Chain(BARE)
    request = straight.correlation_window()
    times_s = request.delay_s - straight.gate_s + np.arange(42) * INTERVAL_S
    late_s = np.where(np.arange(42) % 2 == 0, skew_s / 2, -skew_s / 2)
    light = straight.lit().delays
    assert isinstance(light, DelayGaussian)
    kernel = straight.kernel.widened(light.std_s)
    expected = light.total * kernel.exact(times_s + late_s - light.mean_s)

    np.testing.assert_allclose(skewed.samples().volts, 5.19 * expected, rtol=0, atol=1e-12)
    assert np.abs(skewed.samples().volts - straight.samples().volts).max() > 1e-4


# ---- noise against its density


class _Ones:
    """Draws that are all 1: what is drawn is the rms."""

    def stream(self, effect: str) -> _Ones:
        return self

    def standard_normal(self, count: int) -> np.ndarray:
        return np.ones(count)


def test_the_variance_of_shot_noise_is_the_analytic_one() -> None:
    from scipy.signal import butter, residue

    from sim.chain_noise import ShotNoise
    from sim.light_noise import shot_noise_density

    # Given a filter in partial fractions by another library, and a fine quadrature
    chain = Chain(structs.replace(BARE, noise=structs.replace(BARE.noise, shot=True)))
    (noise,) = chain.light_noise
    assert isinstance(noise, ShotNoise)
    first_s, step_s = -160e-9, INTERVAL_S / 400
    light = chain.echo()
    begin_s, end_s = light.span_s
    places_s = np.arange(begin_s, end_s, step_s)
    density = shot_noise_density(BARE.detector, light.photon_rate_hz(begin_s, step_s, places_s.size))
    weights, poles, _ = residue(*butter(3, 2 * math.pi * 19e6, analog=True))
    lags = first_s + INTERVAL_S * np.arange(42)[:, None] - places_s - step_s / 2
    after = np.maximum(lags, 0)
    h = sum((w * np.exp(p * after)).real for w, p in zip(weights, poles, strict=True)) * (lags > 0)
    expected = (0.5 * density**2 * h**2).sum(axis=1) * step_s

    # When every draw is its rms, and the taps are squared
    begin, rms_v = noise.before_filter(light, first_s, _Ones())  # type: ignore[arg-type]
    first, taps = noise.taps
    variance = np.convolve(rms_v**2, taps**2)
    index = noise.steps * np.arange(42) - begin - first
    found = np.where(
        (index >= 0) & (index < variance.size), variance[np.clip(index, 0, variance.size - 1)], 0.0
    )

    # Then the variances agree to 0.2 % of the largest
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-3 * expected.max())
    # The peak rate, were it to last, would make more.
    lasting_v2 = density.max() ** 2 * butterworth.noise_bandwidth(19e6, 3)
    assert 0.6 * lasting_v2 < expected.max() < lasting_v2

    # And the samples are drawn with that variance
    drawn = np.zeros((4000, 42))
    for shot, row in enumerate(drawn):
        noise.add(row, first_s, light, Draws(1, shot))
    loud = expected > 1e-3 * expected.max()
    assert np.abs(drawn[:, loud].var(axis=0) / expected[loud] - 1).max() < 5 * math.sqrt(2 / 4000)


def test_sunlight_makes_dark_noise_1_8_times_as_large() -> None:
    # Given no echo, so that a window holds stationary noise alone
    day, night = (with_(scene, surface={"slope_deg": 0.0}, noise={"shot": False}) for scene in (DAY, NIGHT))
    rms = []
    for scene in (night, day):
        chain = Chain(scene)
        volts = np.concatenate([chain.samples(k, chain.whole_window(k)).volts[:7900] for k in range(8)])
        rms.append(float(volts.std()))

    # Then noon raises it by 80 %; one sample in two is independent
    assert rms[0] == pytest.approx(0.83e-3, rel=0.02)
    assert rms[1] / rms[0] == pytest.approx(1.80, rel=0.02)


# ---- one receiver: a played pulse and an echo


@pytest.mark.parametrize("name", ["plane", "boulder", "boulder-example"])
def test_a_played_echo_gives_the_window_of_the_chain(name: str) -> None:
    # Given a scene, and a bench whose receiver is the same and without noise
    scene = structs.replace(steady(name), noise=type(BARE.noise)(), sun=None, seed=11)
    chain = Chain(scene)
    bench_file = parse_bench(
        "[generator]\ndriver = 'keysight-33600'\naddress = 'simulated'\nattenuation_db = 20.0\n"
        "[digitizer]\nlink = 'simulated'\n[emulation]\nseed = 11\n[emulation.receiver]\n"
        f"noise_rms_v_by_code = {[0.0] * 16}\n"
    )
    pulse = chain.stimulus(sample_rate_hz=1e9)

    # When the generator plays its echo
    with open_bench(bench_file) as bench:
        shot = bench.measure(pulse, WindowRequest(3, 4, 16064))
    played = shot.window.counts.astype(int)

    # Then counts differ by one count and one step of the generator, at most
    assert isinstance(shot.played, SampledPulse)
    step_v = np.abs(shot.played.volts).max() / 2**13 * chain.scene.gain
    allowed = 1 + step_v / shot.window.volts_per_count
    assert np.abs(played - chain.window(3).counts).max() <= allowed
    assert np.ptp(played) > 4


def test_a_played_shot_carries_its_shot_noise() -> None:
    scene = structs.replace(BARE, noise=structs.replace(BARE.noise, shot=True))
    chain, quiet = Chain(scene), Chain(BARE)
    pulse = chain.stimulus(6)
    assert isinstance(pulse, SampledPulse)

    window = chain.receiver.window(pulse, chain.correlation_window(6), Draws(scene.seed, 6))

    noise = chain.samples(6).volts - quiet.samples(6).volts
    differs = window.volts - chain.window(6, chain.correlation_window(6)).volts
    # Straight lines between the draws take 0.2 % of the amplitude away at 20 MHz.
    assert np.abs(differs).max() <= window.volts_per_count + 0.01 * np.abs(noise).max()


# ---- what cannot be


def test_black_ground_returns_no_light_and_no_signal() -> None:
    chain = Chain(with_(NIGHT, surface={"reflectance": 0.0}))

    assert chain.echo().status.startswith("the ground")
    assert chain.echo().photons == 0
    assert isinstance(chain.stimulus(), NoSignal)
    assert np.abs(chain.window(1).volts).max() < 8 * 0.83e-3


def test_a_beam_off_the_terrain_is_told(tmp_path: Path) -> None:
    np.save(tmp_path / "ground.npy", np.zeros((40, 40)))
    scene = with_(BARE, surface={"kind": "dtm", "slope_deg": 0.0, "file": str(tmp_path / "ground.npy")})
    scene = with_(scene, laser={"pointing_rad": (2e-3, 0.0)})

    with pytest.raises(OffTerrain, match="no ground"):
        Chain(scene)


def test_a_bias_above_breakdown_is_refused() -> None:
    with pytest.raises(RefusedInput, match="breakdown"):
        Chain(with_(BARE, detector={"bias_v": 400.0}))


def test_an_amplifier_slower_than_the_high_pass_is_refused() -> None:
    scene = with_(BARE, detector={"tia_pole_hz": 1e3}, electronics={"highpass_hz": 1e4})

    with pytest.raises(RefusedInput, match="tia_pole_hz"):
        Chain(scene)


@pytest.mark.parametrize(
    "tables", [{"detector": {"tia_pole_hz": 20e6}}, {"electronics": {"highpass_hz": 1e4}}], ids=str
)
def test_poles_beside_the_filter_of_earlier_models_are_refused(tables: dict[str, dict[str, float]]) -> None:
    # Given the Gaussian filter, and a pole that neither noise nor signal would go through alike
    scene = structs.replace(with_(BARE, **tables), filter="gaussian")

    (key,) = (key for table in tables.values() for key in table)
    with pytest.raises(RefusedInput, match=f'{key} = .*: must be 0 with filter = "gaussian"'):
        Chain(scene)


def test_another_instrument_runs_through_the_same_chain() -> None:
    scene = with_(load_scene("gala-like"), laser={"jitter_rad": (0.0, 0.0), "energy_jitter": 0.0})
    chain = Chain(scene)

    assert chain.samples().volts.size == 64
    assert chain.samples().sample_rate_hz == 200e6
    assert laser_preset("gala-like").divergence_rad == scene.laser.divergence_rad


# ---- detection


def test_the_range_finder_of_the_receiver_finds_the_echo() -> None:
    chain = Chain(NIGHT)

    best, *others = chain.candidates(2, with_samples=True)

    noise_free = chain.samples()
    peak_s = noise_free.start_s + noise_free.volts.argmax() * INTERVAL_S
    assert abs(best.arrival_s - peak_s) < 2 * INTERVAL_S
    assert best.amplitude_v > 5 * max(other.amplitude_v for other in others)
    assert (len(best.correlation_window), len(others)) == (42, 3)


def test_the_whole_window_is_computed_only_where_somebody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = []
    true = ReceiverModel.at_converter
    monkeypatch.setattr(
        ReceiverModel,
        "at_converter",
        lambda self, volts, *rest: (sizes.append(volts.size), true(self, volts, *rest))[1],
    )
    chain = Chain(DAY)

    chain.samples(1)
    chain.window(1, chain.correlation_window(1))
    assert set(sizes) == {42}
    chain.candidates(1)

    assert sizes[-1] == 16064


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, math.nan, math.inf, 1e15])
def test_a_stimulus_at_an_impossible_rate_is_refused(rate_hz: float) -> None:
    with pytest.raises(RefusedInput, match=r"a stimulus (at|of)"):
        Chain(BARE).stimulus(None, rate_hz)


@pytest.mark.parametrize("shot", [-1, 1.5, "a", math.nan, [2]])
def test_a_shot_that_is_no_number_of_one_is_refused_in_a_line(shot: object) -> None:
    chain = Chain(DAY)
    asked: list[Callable[[Any], object]] = [
        chain.window, chain.shot, chain.samples, chain.stimulus, chain.echo, chain.lit, chain.candidates,
    ]  # fmt: skip
    for what in asked:
        with pytest.raises(RefusedInput, match=r"^shot = .*: must be a whole number of 0 or more$"):
            what(shot)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"delay_s": math.nan}, "delay_s = nan"),
        ({"delay_s": math.inf}, "delay_s = inf"),
        ({"sample_count": 0}, "sample_count = 0"),
        ({"sample_count": 2.5}, "sample_count = 2.5"),
        ({"gain_code": 16}, "gain code 16: 0 to 15 is allowed"),
        ({"gain_code": None}, "gain code None: 0 to 15 is allowed"),
    ],
)
def test_a_window_that_no_receiver_could_take_is_refused_in_a_line(changes: Any, said: str) -> None:
    chain = Chain(BARE)
    request = replace(chain.whole_window(), **changes)
    for ask in (chain.window, chain.samples):
        with pytest.raises(RefusedInput) as caught:
            ask(None, request)
        assert said in str(caught.value)


@pytest.mark.parametrize("count", [0, -3, 1.5, "a"])
def test_a_correlation_window_of_no_samples_is_refused(count: Any) -> None:
    with pytest.raises(RefusedInput, match=r"sample_count = .*: must be a whole number of 1 or more"):
        Chain(BARE).correlation_window(0, count)


@pytest.mark.parametrize(("fwhm_s", "sigma"), [(1e-12, "4.2e-13"), (1e-11, "4.2e-12"), (1e-10, "4.2e-11")])
@pytest.mark.parametrize("pulse", ["gaussian", "tailed"])
def test_light_too_short_for_time_bins_is_refused_as_short_and_its_samples_are_served(
    pulse: str, fwhm_s: float, sigma: str
) -> None:
    # Given a smooth pulse far shorter than a sample interval
    scene = with_(BARE, laser={"pulse": pulse, "fwhm_s": fwhm_s}, surface={"kind": "boulder"})
    chain = Chain(scene, Accuracy(1e-4))
    # When its light without any filter is asked for, and its samples behind the receiver
    if fwhm_s < 1e-10:
        with pytest.raises(RefusedInput) as caught:
            chain.stimulus()
        # Then the words name its speed, not an edge that it has not
        assert f"the pulse behind no filter changes within {sigma} s, which is too fast" in str(caught.value)
        assert "bends" not in str(caught.value)
    volts = chain.samples().volts
    # And these have the area of the light
    whole = chain.samples(None, chain.whole_window()).volts.sum() * chain.receiver.grid.interval_s
    due = chain.kernel.gain * chain.scene.gain * chain.lit().delays.total
    assert whole == pytest.approx(due, rel=2e-4)
    assert volts.max() > 0
