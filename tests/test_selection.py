from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from scenes import BARE, DAY, NIGHT, with_

import sim.chain
import sim.chain_light
import sim.chain_noise
import sim.chain_response
import sim.receiver_model
from belahil.config import Interleave, SmallSignal
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.chain_light import Illumination
from sim.chain_noise import GaussianNoise, ShotNoise, StationaryNoise
from sim.scene import Scene, load_scene, ready_scenes
from sim.scene_tables import Noise, Sun
from sim.selection import select

# What runs when an effect is there, by the name of its stage.
WORKERS: dict[str, tuple[Any, str]] = {
    "pointing jitter": (sim.chain_light, "pointing_jitter"),
    "energy jitter": (sim.chain_light, "energy_factor"),
    "radiation factor": (Illumination, "_cosine"),
    "field of view": (sim.chain_light, "in_field_of_view"),
    "shot noise": (ShotNoise, "add"),
    "sunlight": (StationaryNoise, "add"),
    "dark current": (StationaryNoise, "add"),
    "Gaussian low-pass": (sim.chain_response, "gaussian_filter_sigma_s"),
    "dead zone": (sim.receiver_model, "dead_zone"),
    "cubic": (sim.receiver_model, "cubic"),
    "gain": (sim.receiver_model, "amplify"),
    "dark noise": (sim.receiver_model, "add_noise"),
    "gain mismatch": (sim.receiver_model, "mismatch_gain"),
    "offset mismatch": (sim.receiver_model, "mismatch_offset"),
    "recorded dark noise": (sim.chain, "read_dark_windows"),
}
BARER = with_(BARE, electronics={"gain_by_code": (1.0,) * 16})
EFFECTS: dict[str, Scene] = {
    "pointing jitter": with_(BARER, laser={"jitter_rad": (1e-6, 1e-6)}),
    "energy jitter": with_(BARER, laser={"energy_jitter": 0.014}),
    "radiation factor": with_(BARER, surface={"kind": "crater", "photometry": "lambert"}),
    "field of view": with_(BARER, detector={"field_of_view_rad": 20e-6}),
    "shot noise": structs.replace(BARER, noise=Noise(shot=True)),
    "sunlight": structs.replace(BARER, sun=Sun()),
    "dark current": with_(BARER, detector={"bulk_dark_a": 1e-12}),
    "Gaussian low-pass": structs.replace(BARER, filter="gaussian"),
    "dead zone": with_(BARER, electronics={"small_signal": SmallSignal(deadband_v=1e-5)}),
    "cubic": with_(BARER, electronics={"small_signal": SmallSignal(cubic_per_v2=-1.0)}),
    "gain": BARE,
    "dark noise": structs.replace(BARER, noise=Noise(dark_rms_v=1e-3)),
    "gain mismatch": with_(BARER, electronics={"interleave": Interleave(gain=0.01)}),
    "offset mismatch": with_(BARER, electronics={"interleave": Interleave(offset_v=1e-3)}),
}


def names(scene: Scene) -> set[str]:
    return {stage.name for stage in select(scene, Accuracy())}


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    counts = dict.fromkeys(WORKERS, 0)

    def spied(true: Callable[..., Any], effects: list[str]) -> Callable[..., Any]:
        def counting(*given: Any, **named: Any) -> Any:
            for effect in effects:
                counts[effect] += 1
            return true(*given, **named)

        return counting

    for place in set(WORKERS.values()):
        effects = [effect for effect, worker in WORKERS.items() if worker == place]
        monkeypatch.setattr(*place, spied(getattr(*place), effects))
    return counts


def run(scene: Scene) -> Chain:
    chain = Chain(scene)
    chain.window(3, chain.correlation_window(3))
    chain.samples()
    chain.stimulus(3)
    return chain


def test_what_is_absent_is_never_called(called: dict[str, int]) -> None:
    run(BARER)

    assert called == dict.fromkeys(WORKERS, 0)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_calls_its_own_worker_and_no_other(effect: str, called: dict[str, int]) -> None:
    run(EFFECTS[effect])

    alike = {name for name, worker in WORKERS.items() if worker == WORKERS[effect]}
    assert {name for name, count in called.items() if count} == alike


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_is_a_stage_with_a_reason_and_changes_the_samples(effect: str) -> None:
    added = names(EFFECTS[effect]) - names(BARER)

    assert added == {effect}
    assert all(stage.reason for stage in select(EFFECTS[effect], Accuracy()))
    plain, changed = (Chain(scene).samples(3).volts for scene in (BARER, EFFECTS[effect]))
    assert not np.array_equal(plain, changed)


def test_recorded_dark_noise_is_read_only_where_it_is_named(tmp_path: Path, called: dict[str, int]) -> None:
    file = tmp_path / "dark.npy"
    np.save(file, np.random.default_rng(1).normal(0, 1e-3, (3, 100)))

    chain = run(structs.replace(BARER, noise=Noise(dark_windows=str(file))))

    assert {name for name, count in called.items() if count} == {"recorded dark noise"}
    added = chain.samples(3).volts - Chain(BARER).samples(3).volts
    assert added.std() == pytest.approx(1e-3, rel=0.4)


NEUTRAL: dict[str, Scene] = {
    "a Sun on the horizon": structs.replace(NIGHT, sun=Sun(incidence_deg=90.0)),
    "a Sun without light": structs.replace(NIGHT, sun=Sun(irradiance_1au_w_per_m3=0.0)),
    "a radiation factor of 1": with_(NIGHT, surface={"photometry": "factor"}),
    "no skew": with_(NIGHT, electronics={"interleave": Interleave()}),
    "no high-pass": with_(NIGHT, electronics={"highpass_hz": 0.0}),
    "no pole": with_(NIGHT, detector={"tia_pole_hz": 0.0}),
}


@pytest.mark.parametrize("what", NEUTRAL)
def test_neutral_is_absent_bit_for_bit(what: str) -> None:
    neutral, absent = Chain(NEUTRAL[what]), Chain(NIGHT)

    assert neutral.stages == absent.stages
    assert neutral.window(5).equals(absent.window(5))
    assert np.array_equal(neutral.samples(5).volts, absent.samples(5).volts)


def test_noise_of_no_volts_is_no_noise() -> None:
    silent = structs.replace(BARE, noise=Noise(dark_rms_v=0.0))

    assert np.array_equal(Chain(silent).samples(5).volts, Chain(BARE).samples(5).volts)


def test_lamberts_law_on_level_ground_is_absent() -> None:
    level = with_(NIGHT, surface={"slope_deg": 0.0})

    assert Chain(with_(level, surface={"photometry": "lambert"})).stages == Chain(level).stages


@pytest.mark.parametrize("effect", ["dark", "shot", "sun"])
def test_removing_an_effect_leaves_the_draws_of_the_others(effect: str) -> None:
    # Given a scene with every noise, the same without one, and the one alone
    noise = {"dark": {"dark_rms_v": None}, "shot": {"shot": False}, "sun": {}}[effect]
    less = with_(DAY, noise=noise)
    alone = structs.replace(
        BARE,
        noise=Noise(dark_rms_v=0.83e-3 if effect == "dark" else None, shot=effect == "shot"),
        sun=Sun() if effect == "sun" else None,
    )
    if effect == "sun":
        less = structs.replace(less, sun=None)
    every, fewer, one, none = (Chain(scene).samples(9).volts for scene in (DAY, less, alone, BARE))

    # Then what it adds is what it is alone
    np.testing.assert_allclose(every - fewer, one - none, rtol=0, atol=1e-16)
    assert np.abs(one - none).max() > 1e-4


def test_gaussian_noise_has_the_spectrum_of_its_filter() -> None:
    noise = GaussianNoise(9.97e-9, 12.5e-9).draw(np.random.default_rng(2), 400_000)

    for lag, share in enumerate(np.exp(-0.25 * (np.arange(5) * 12.5 / 9.97) ** 2)):
        assert np.mean(noise[lag:] * noise[: noise.size - lag]) == pytest.approx(share, abs=5 * 1.6 / 632)


@pytest.mark.parametrize("name", ready_scenes())
def test_every_ready_scene_runs_and_explains_itself(name: str) -> None:
    chain = Chain(load_scene(name), Accuracy(1e-3))

    told = chain.explain()

    assert all(stage.name in told and stage.reason in told for stage in chain.stages)
    assert "predicted error of a sample" in told
    assert chain.window(1).counts.size == chain.receiver.spec.max_sample_count
