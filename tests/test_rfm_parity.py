"""The receiver's range finder against ours: an honest receiver passes, a changed one does not."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scope_bench
import xarray
from msgspec import structs
from scipy import signal

from belahil.bench import Bench, open_bench
from belahil.cli.main import main
from belahil.config import BenchConfig, EmulatedReceiver, Interleave, parse_bench
from belahil.errors import LimitExceeded, LinkTimeout, RefusedInput
from belahil.outcome import Outcome
from belahil.receiver import BELA_GRM, GALA_LIKE
from belahil.stimuli import NoSignal, SampledPulse
from belahil.values import Candidate, Estimate, Products, RangeWindow, Shot, WindowRequest
from procedures.detection_model import Prediction, Sightings, predict
from procedures.echo_agreement import FALSE_ALARMS, EchoAgreement, agreements
from procedures.echo_sighting import expectation, pulse_places, sighting
from procedures.gaussian_pulses import TrainPulse, gaussian_pulse, gaussian_train
from procedures.known_receiver import KnownCode, KnownReceiver, preset_receiver
from procedures.rfm_parity import ParityOptions, ParityPlan, analyse, measure, plan
from sim.rfm import RangeFinder
from sim.template_bank import TemplateBank

Report = Callable[[RangeWindow, Products], RangeWindow]


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.shots: dict[int, Shot] = {}

    def shot(self, request: WindowRequest, measure: Callable[[], Shot], why: Callable[[], str] = str) -> Shot:
        return self.shots.setdefault(request.shot, measure())


def bench_file(seed: int = 1, link: str = "simulated", **receiver: Any) -> BenchConfig:
    """A bench with a hidden receiver."""
    config = parse_bench(
        f"[generator]\naddress = '{link.partition(':')[0]}'\n[digitizer]\nlink = '{link}'\n"
        f"[emulation]\nseed = {seed}\n"
    )
    hidden = EmulatedReceiver(**receiver)
    return structs.replace(config, emulation=structs.replace(config.emulation, receiver=hidden))


def exactly(config: BenchConfig, **known: Any) -> KnownReceiver:
    """The preset, known without any uncertainty, but for what is told."""
    preset = preset_receiver(config)
    codes = tuple(
        KnownCode(one.code, Estimate(one.gain.value, 0.0), Estimate(one.noise_rms.value, 0.0, "V"))
        for one in preset.codes
        if one.noise_rms is not None
    )
    return replace(preset, **{"cutoff": Estimate(preset.cutoff.value, 0.0, "Hz"), "codes": codes} | known)


def chosen(config: BenchConfig, **words: Any) -> ParityOptions:
    few = {"snrs": (3.0, 8.0), "widths_s": (40e-9,), "shots": 80, "samples": 3000, "model_windows": 300}
    return ParityOptions(**({"receiver": exactly(config)} | few | words))


def compared(
    config: BenchConfig,
    options: ParityOptions | None = None,
    report: Callable[[RangeFinder], Report] | None = None,
    seen: Callable[[Shot], Shot] = lambda shot: shot,
    products: Products | None = None,
) -> Outcome:
    """Measure and analyse; the device may report otherwise than its range finder would."""
    with open_bench(config) as bench:
        if report is not None:
            device = bench._digitizer._plant  # type: ignore[attr-defined]
            device.__dict__["_range_finder"] = _Reporting(report(RangeFinder.of(BELA_GRM)))
        made = plan(bench, options or chosen(config))
        if products is not None:
            made = replace(made, products=products)
        kept = Kept()
        measure(bench, kept, made)
    return analyse(made, [seen(shot) for shot in kept.shots.values()], config)


class _Reporting:
    def __init__(self, report: Report) -> None:
        self.report = report


def decisions(outcome: Outcome) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for check in outcome.checks:
        found.setdefault(check.limit, set()).add(check.decision)
    return found


def decided(told: EchoAgreement) -> list[str]:
    parts = (told.probability, told.spread, told.apart)
    return [one.decision for one in parts if one is not None]


# ---- an honest receiver


@pytest.mark.parametrize(
    "seed", [1, pytest.param(7, marks=pytest.mark.slow), pytest.param(20, marks=pytest.mark.slow)]
)
def test_an_honest_receiver_passes(seed: int) -> None:
    outcome = compared(bench_file(seed))
    assert decisions(outcome) == {
        "windows_agreeing": {"pass"},
        "detection_probability_difference": {"pass"},
        "arrival_spread_ratio": {"pass"},
        "echo_after_marker_difference_s": {"pass"},
    }
    parity = outcome.results["parity"]
    assert (parity["windows"], parity["agreeing"]) == (160, 160)
    assert parity["largest_difference"] == {"arrival_s": 0, "fwhm_s": 0, "amplitude_v": 0, "first_sample": 0}
    # and the weak echo is seen sometimes, the strong one always
    weak, strong = (row["detected"] for row in outcome.results["echoes"])
    assert 10 < weak < 80
    assert strong == 80


@pytest.mark.slow
def test_an_odd_receiver_that_is_known_passes() -> None:
    # Given a receiver unlike the preset in filter, clock, converters and noise, and all that known
    gains, noise = (1.2,) * 16, (0.4e-3,) * 16
    config = bench_file(
        3,
        cutoff_hz=12e6,
        order=4,
        highpass_hz=30e3,
        clock_ppm=60.0,
        interleave=Interleave(0.02, 1e-3, 0.2e-9),
        gain_by_code=gains,
        noise_rms_v_by_code=noise,
    )
    known = exactly(
        config,
        cutoff=Estimate(12e6, 0.0, "Hz"),
        order=4,
        highpass=Estimate(30e3, 0.0, "Hz"),
        clock_ppm=Estimate(60.0, 0.0),
        interleave_gain=Estimate(0.02, 0.0),
        interleave_offset=Estimate(1e-3, 0.0, "V"),
        interleave_skew=Estimate(0.2e-9, 0.0, "s"),
        codes=(KnownCode(9, Estimate(1.2, 0.0), Estimate(0.4e-3, 0.0, "V")),),
    )
    outcome = compared(config, chosen(config, receiver=known))
    assert set.union(*decisions(outcome).values()) == {"pass"}
    # and with the preset's filter it is not the receiver that the model is of
    taken = replace(known, cutoff=Estimate(19e6, 0.0, "Hz"), order=3, highpass=None)
    found = decisions(compared(config, chosen(config, receiver=taken)))
    assert found.pop("windows_agreeing") == {"pass"}
    assert "fail" in set.union(*found.values())


def test_an_honest_receiver_fails_no_oftener_than_said() -> None:
    # Given 300 runs of 8 echoes whose windows and model are draws of the same kind
    rng, echoes, failed = np.random.default_rng(4), 8, 0
    for _ in range(300):
        pairs = []
        for chance in np.linspace(0.2, 1.0, echoes):
            measured, model = (
                Sightings(n, 3e-6 + 2e-9 * rng.standard_normal(rng.binomial(n, chance))) for n in (100, 1000)
            )
            pairs.append((measured, Prediction(model, None)))
        single, together = agreements(pairs)
        failed += any("fail" in decided(one) for one in (*single, together))
    # Then so many fail as chance allows: 1 % of 300, and three standard deviations more
    assert failed <= 300 * FALSE_ALARMS + 3 * math.sqrt(300 * FALSE_ALARMS)


def test_what_all_echoes_miss_a_little_is_found_in_all_together() -> None:
    # Given 12 echoes of 200 windows, each seen 6 % of windows less often than the model says, many times
    rng, found = np.random.default_rng(5), {"one": 0, "all": 0}
    for _ in range(40):
        pairs = []
        for chance in np.linspace(0.3, 0.9, 12):
            measured, model = (
                Sightings(n, 3e-6 + 2e-9 * rng.standard_normal(rng.binomial(n, at)))
                for n, at in ((200, chance - 0.06), (1000, chance))
            )
            pairs.append((measured, Prediction(model, None)))
        single, together = agreements(pairs)
        found["one"] += any("fail" in decided(one) for one in single)
        assert together.probability is not None
        found["all"] += together.probability.decision == "fail"
        # and the mean over echoes is the mean of what each shows
        means = [one.probability.between.value for one in single if one.probability is not None]
        assert together.probability.between.value == pytest.approx(np.mean(means))
    assert found["all"] >= 36
    assert found["one"] <= 20


# ---- a receiver that is not as it says


def test_another_bank_of_templates_is_found_in_the_windows() -> None:
    other = replace(RangeFinder.of(BELA_GRM), bank=TemplateBank(12.5e-9, 5, 25e-9, 200e-9))
    outcome = compared(bench_file(), report=lambda _: other.report)
    assert decisions(outcome)["windows_agreeing"] == {"fail"}
    assert outcome.results["parity"]["candidates"]["missing"] > 0
    assert outcome.results["parity"]["samples_differing"] == 0


@pytest.mark.parametrize(("least_s", "status"), [(120e-9, "ok"), (250e-9, "marker_lost")])
@pytest.mark.slow
def test_a_bank_without_narrow_templates_misses_echoes_whether_samples_come_or_not(
    least_s: float, status: str
) -> None:
    wide = replace(RangeFinder.of(BELA_GRM), bank=TemplateBank(12.5e-9, 3, least_s, 600e-9))
    for products in ("window_and_candidates", "candidates", "correlation_windows"):
        outcome = compared(bench_file(), report=lambda _: wide.report, products=products)
        assert echoes_of(outcome) == {status}
        assert "fail" in decisions(outcome)["detection_probability_difference"]
        assert ("windows_agreeing" in decisions(outcome)) == (products == "window_and_candidates")
        assert (outcome.results["status"] == "no_samples") == (products != "window_and_candidates")
    drawn(outcome)


def moved(by_s: float, every: bool = True) -> Callable[[RangeFinder], Report]:
    """A device that adds to the arrivals: of all candidates, or of all but the best."""

    def report(finder: RangeFinder) -> Report:
        def told(window: RangeWindow, products: Products) -> RangeWindow:
            honest = finder.report(window, products)
            return replace(
                honest,
                candidates=tuple(
                    replace(one, arrival_s=one.arrival_s + by_s * (every or place > 0))
                    for place, one in enumerate(honest.candidates)
                ),
            )

        return told

    return report


@pytest.mark.parametrize(
    "by_s", [pytest.param(-3e-9, marks=pytest.mark.slow), 20e-12, pytest.param(9e-12, marks=pytest.mark.slow)]
)
def test_shifted_arrivals_are_found_down_to_the_tolerance(by_s: float) -> None:
    outcome = compared(bench_file(), report=moved(by_s))
    assert decisions(outcome)["windows_agreeing"] == {"pass" if abs(by_s) < 10e-12 else "fail"}
    largest = outcome.results["parity"]["largest_difference"]
    assert largest["arrival_s"] == pytest.approx(abs(by_s), rel=1e-4)
    assert largest["fwhm_s"] == 0
    # which marker and echo have in common, so that the time between them cannot tell
    assert decisions(outcome)["echo_after_marker_difference_s"] == {"pass"}


@pytest.mark.slow
def test_an_echo_that_comes_late_after_its_marker_is_found_without_samples() -> None:
    outcome = compared(bench_file(), report=moved(3e-9, every=False), products="candidates")
    assert "fail" in decisions(outcome)["echo_after_marker_difference_s"]
    assert decisions(outcome)["arrival_spread_ratio"] == {"pass"}


@pytest.mark.parametrize(
    "products", [pytest.param("window_and_candidates", marks=pytest.mark.slow), "candidates"]
)
def test_more_noise_than_stated_is_found_in_the_echoes_alone(products: Products) -> None:
    noise = tuple(1.3 * one for one in BELA_GRM.noise_rms_v_by_code)
    config = bench_file(noise_rms_v_by_code=noise)
    outcome = compared(config, chosen(config), products=products)
    found = decisions(outcome)
    assert "fail" in found["detection_probability_difference"] | found["arrival_spread_ratio"]
    assert found.get("windows_agreeing", {"pass"}) == {"pass"}


@pytest.mark.slow
def test_what_is_uncertain_of_the_noise_makes_the_prediction_uncertain() -> None:
    # Given the same receiver with more noise, of which the noise is known to 20 % only
    noise = tuple(1.3 * one for one in BELA_GRM.noise_rms_v_by_code)
    config = bench_file(noise_rms_v_by_code=noise)
    sure = exactly(config)
    unsure = replace(
        sure,
        codes=tuple(
            replace(one, noise_rms=Estimate(one.noise_rms.value, 0.2 * one.noise_rms.value, "V"))
            for one in sure.codes
            if one.noise_rms is not None
        ),
    )
    wide, narrow = (
        compared(config, chosen(config, receiver=one)).results["echoes"][0]["detection_probability"]
        for one in (unsure, sure)
    )
    # Then its prediction holds what was measured, and the exact one does not
    assert wide["decision"] == "pass"
    assert wide["model_interval"][0] <= wide["measured"]["value"] <= wide["model_interval"][1]
    assert not narrow["model_interval"][0] <= narrow["measured"]["value"] <= narrow["model_interval"][1]


@pytest.mark.slow
def test_lost_samples_of_correlation_windows_are_counted() -> None:
    def report(finder: RangeFinder) -> Report:
        def told(window: RangeWindow, products: Products) -> RangeWindow:
            honest = finder.report(window, products)
            first, *more = honest.candidates
            counts = (first.correlation_window[0] ^ 1, *first.correlation_window[1:])
            return replace(honest, candidates=(replace(first, correlation_window=counts), *more))

        return told

    outcome = compared(bench_file(), report=report)
    assert outcome.results["parity"]["samples_differing"] == 160
    assert decisions(outcome)["windows_agreeing"] == {"fail"}


@pytest.mark.slow
def test_a_marker_that_is_lost_now_and_then_is_a_lost_echo() -> None:
    def report(finder: RangeFinder) -> Report:
        def told(window: RangeWindow, products: Products) -> RangeWindow:
            honest = finder.report(window, products)
            return replace(honest, candidates=honest.candidates[window.shot % 3 == 0 :])

        return told

    outcome = compared(bench_file(), report=report, products="candidates")
    assert [row["unmarked"] for row in outcome.results["echoes"]] == [27, 27]
    assert decisions(outcome)["detection_probability_difference"] >= {"fail"}


# ---- what cannot be compared


def drawn(outcome: Outcome) -> None:
    """Draw and write the figure, in which nothing may go wrong."""
    outcome.figures["rfm-parity"]().savefig(BytesIO(), format="png")


def echoes_of(outcome: Outcome) -> set[str]:
    return {row["status"] for row in outcome.results["echoes"]}


def test_a_receiver_that_reports_nothing_has_a_status() -> None:
    def silent(shot: Shot) -> Shot:
        return replace(shot, window=replace(shot.window, candidates=()))

    # Asked for windows alone it need not report any; asked for both it must
    for products, status in (("window", "no_candidates"), ("window_and_candidates", "ok")):
        outcome = compared(bench_file(), seen=silent, products=products)  # type: ignore[arg-type]
        assert outcome.results["status"] == status
        assert echoes_of(outcome) == {"no_candidates"}
        drawn(outcome)
        assert decisions(outcome) == {
            "windows_agreeing": {"undecided" if products == "window" else "fail"},
            "detection_probability_difference": {"undecided"},
        }


def test_clipped_windows_are_left_out_of_the_echoes() -> None:
    config = bench_file(adc_full_scale_v=10e-3)
    outcome = compared(config)
    assert echoes_of(outcome) == {"saturated"}
    assert decisions(outcome) == {
        "windows_agreeing": {"pass"},
        "detection_probability_difference": {"undecided"},
    }


@pytest.mark.parametrize(
    ("stimulus", "status"),
    [
        (lambda bench: gaussian_pulse(40e-9, 5e-3, bench.generator_model, 1e-6), "no_marker"),
        (
            lambda bench: SampledPulse(
                -gaussian_pulse(40e-9, 5e-3, bench.generator_model, 1e-6).volts, 250e6
            ),
            "no_pulse",
        ),
        (lambda bench: NoSignal(), None),
    ],
    ids=["a pulse alone", "a pulse downwards", "no signal"],
)
def test_other_windows_are_compared_for_their_candidates_alone(
    stimulus: Callable[[Bench], Any], status: str | None
) -> None:
    config = bench_file()
    with open_bench(config) as bench:
        request = WindowRequest(0, 4, 2000, products="window_and_candidates")
        shots = [bench.measure(stimulus(bench), replace(request, shot=shot)) for shot in range(12)]
    outcome = analyse(recorded_as(config), shots, config)
    assert outcome.results["parity"]["agreeing"] == 12
    assert echoes_of(outcome) == ({status} if status else set())
    assert decisions(outcome) == {"windows_agreeing": {"pass"}}
    drawn(outcome)


def recorded_as(config: BenchConfig, **changes: Any) -> ParityPlan:
    """The plan of recorded windows."""
    options = chosen(config)
    return replace(
        ParityPlan(
            options.receiver, None, (), 0, 2000, 100, "window", options.tolerances, BELA_GRM.digitizer
        ),
        **changes,
    )


def test_candidates_alone_of_too_few_echoes_decide_nothing() -> None:
    # Given recorded candidates without samples, of fewer windows of an echo than tell anything
    config = bench_file()
    with open_bench(config) as bench:
        made = replace(plan(bench, chosen(config)), products="candidates")
        asked = [(one.stimulus, one.request) for one in made.shots[:3]]
        shots = [bench.measure(stimulus, request) for stimulus, request in asked]
    for ones in (shots, []):
        assert decisions(analyse(recorded_as(config), ones, config)) == {"windows_agreeing": {"undecided"}}


def test_windows_of_another_receiver_are_not_compared() -> None:
    gala = parse_bench(
        "[generator]\naddress = 'simulated'\n[digitizer]\nlink = 'simulated'\nreceiver = 'gala-like'\n"
    )
    with open_bench(gala) as bench:
        request = WindowRequest(0, 4, 1000, products="window_and_candidates")
        shots = [bench.measure(NoSignal(), replace(request, shot=shot)) for shot in range(3)]
    for spec in (GALA_LIKE.digitizer, replace(BELA_GRM.digitizer, bits=14)):
        outcome = analyse(recorded_as(bench_file(), spec=spec), shots, bench_file())
        assert outcome.results["status"] == "another_receiver"
        drawn(outcome)
        assert decisions(outcome) == {"windows_agreeing": {"undecided"}}
    # and by their own bench file they are
    own = replace(recorded_as(gala), receiver=None, spec=GALA_LIKE.digitizer)
    assert analyse(own, shots, gala).results["parity"]["agreeing"] == 3


def test_too_few_windows_and_an_unknown_gain_code_have_a_status() -> None:
    config = bench_file()
    with open_bench(config) as bench:
        made = plan(bench, chosen(config, shots=9))
        kept = Kept()
        measure(bench, kept, made)
    assert echoes_of(analyse(made, kept.shots.values(), config)) == {"too_few_points"}
    assert made.receiver is not None
    known = replace(made.receiver, codes=tuple(one for one in made.receiver.codes if one.code != made.code))
    outcome = analyse(replace(made, receiver=known), kept.shots.values(), config)
    assert echoes_of(outcome) == {"not_known"}
    assert outcome.results["parity"]["agreeing"] == 18


@pytest.mark.slow
def test_windows_of_two_gain_codes_are_kept_apart() -> None:
    # Given the same pulses at two gain codes, one window after the other
    config = bench_file()
    with open_bench(config) as bench:
        made = plan(bench, chosen(config, snrs=(6.0,)))
        shots = [
            bench.measure(one.stimulus, replace(one.request, shot=2 * place + late, gain_code=code))
            for place, one in enumerate(made.shots)
            for late, code in enumerate((4, 8))
        ]
    outcome = analyse(replace(made, echoes=(), products="window"), shots, config)
    # Then each code is compared with a model of its own gain and noise
    assert [(row["code"], row["windows"], row["status"]) for row in outcome.results["echoes"]] == [
        (4, 80, "ok"),
        (8, 80, "ok"),
    ]
    assert set.union(*decisions(outcome).values()) == {"pass"}


def test_a_candidate_beyond_every_number_stops_nothing() -> None:
    def absurd(shot: Shot) -> Shot:
        bad = Candidate(1e300, -1e300, 0.0, (), 2**31)
        return replace(shot, window=replace(shot.window, candidates=(bad,) * 4))

    outcome = compared(bench_file(), seen=absurd)
    assert outcome.results["parity"]["candidates"] == {"matched": 0, "missing": 640, "extra": 640}
    json.dumps(outcome.results, allow_nan=False)
    drawn(outcome)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"snrs": ()}, "at least one value"),
        ({"snrs": (3.0, math.nan)}, "above zero"),
        ({"snrs": (30.0,)}, "at least twice"),
        ({"shots": 1}, "at least 2"),
        ({"model_windows": 5}, "100"),
        ({"code": 16}, "gain code 16"),
        ({"samples": 200}, "marker and echo"),
        ({"widths_s": (1e-9,)}, "least width"),
    ],
)
def test_what_cannot_be_played_is_refused(words: dict[str, Any], said: str) -> None:
    config = bench_file()
    with pytest.raises((RefusedInput, LimitExceeded), match=said), open_bench(config) as bench:
        plan(bench, chosen(config, **words))


def test_an_oscilloscope_is_refused_before_anything_is_played() -> None:
    config = scope_bench.config("rigol-ds1000z", "simulated")
    with open_bench(config) as bench, pytest.raises(LimitExceeded, match="reports no candidates"):
        plan(bench, chosen(config))


@pytest.mark.parametrize("trigger", ["generator", pytest.param("digitizer", marks=pytest.mark.slow)])
def test_pulses_lie_in_the_window_whoever_triggers(trigger: str) -> None:
    text = f"[bench]\ntrigger = '{trigger}'\ntrigger_delay_s = 5e-6\n"
    config = structs.replace(bench_file(), bench=parse_bench(text).bench)
    outcome = compared(config, chosen(config, shots=30))
    assert echoes_of(outcome) == {"ok"}
    assert "fail" not in set.union(*decisions(outcome).values())


# ---- the command


SHORT = ("--shots", "30", "--samples", "3000", "--snrs", "3,8", "--widths-ns", "40", "--model-windows", "300")


def test_the_command_measures_and_reads_its_own_windows_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    assert main(["rfm-parity", *SHORT, "--bench", "simulated", "--out", str(first), "--seed", "5"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(
        "60 of 60 windows have the candidates that we find: 240 matched, 0 missing, 0 extra\n"
    )
    assert said.splitlines()[-2] == "verdict: pass"
    assert (
        main(
            ["rfm-parity", "--windows", str(first / "data.nc"), "--model-windows", "300", "--out", str(again)]
        )
        == 0
    )
    told, read = (json.loads((folder / "summary.json").read_text())["results"] for folder in (first, again))
    assert read["parity"] == told["parity"]
    # and the echoes are the same, but that the file does not tell what was planned
    planned = {"fwhm_s": None, "snr": None}
    assert read["echoes"] == [row | planned for row in told["echoes"]]
    assert "as recorded" not in capsys.readouterr().out
    with xarray.open_dataset(first / "data.nc") as data:
        assert np.all(data["parity_matched"] == 4)
        assert data["echo_detected"].values.tolist() == [row["detected"] for row in told["echoes"]]


@pytest.mark.slow
def test_an_interrupted_run_ends_as_if_it_had_not_been(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Given what is known from a characterization, tolerances of one's own, and a link that fails at shot 25
    known = tmp_path / "known"
    few = ["--codes", "4", "--amplitudes-mvpp", "30", "--frequencies-mhz", "1,3,6,10,15,20,25,29"]
    assert main(["characterize", *few, "--bench", "simulated", "--out", str(known), "--quiet"]) == 0
    words = [
        "rfm-parity",
        *SHORT,
        "--receiver",
        str(known),
        "--arrival-tolerance-ps",
        "5",
        "--quiet",
        "--out",
    ]
    measure_one = Bench.measure

    def failing(bench: Bench, stimulus: Any, request: WindowRequest) -> Shot:
        if request.shot == 25:
            raise LinkTimeout("nothing came")
        return measure_one(bench, stimulus, request)

    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert main([*words, str(whole), "--bench", "simulated"]) == 0
    with monkeypatch.context() as patched:
        patched.setattr(Bench, "measure", failing)
        assert main([*words, str(broken), "--bench", "simulated"]) == 3
    assert main(["rfm-parity", "--resume", str(broken), "--quiet"]) == 0
    # Then the resumed run, and one over the links of an emulated bench, give the same results
    linked = tmp_path / "linked"
    assert main([*words, str(linked), "--bench", "emulated"]) == 0
    told = [json.loads((one / "summary.json").read_text())["results"] for one in (whole, broken, linked)]
    assert told[0] == told[1] == told[2]
    assert told[0]["parity"]["tolerances"]["arrival_s"] == pytest.approx(5e-12)


def test_a_receiver_that_differs_ends_with_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Given a run whose data file was changed: one arrival of one candidate by 1 ns
    folder = tmp_path / "run"
    assert main(["rfm-parity", *SHORT, "--bench", "simulated", "--out", str(folder), "--quiet"]) == 0
    with xarray.open_dataset(folder / "data.nc", decode_times=False, mask_and_scale=False) as opened:
        data = opened.load()
    data["candidate_arrival_s"][7, 2] += 1e-9
    data.to_netcdf(tmp_path / "changed.nc", engine="h5netcdf")
    command = ["rfm-parity", "--windows", str(tmp_path / "changed.nc"), "--bench", str(folder / "bench.toml")]
    assert main([*command, "--model-windows", "100", "--out", str(tmp_path / "changed")]) == 1
    said = capsys.readouterr().out
    assert "fail: windows_agreeing (all)\nverdict: fail" in said
    summary = json.loads((tmp_path / "changed" / "summary.json").read_text())
    assert summary["results"]["parity"]["agreeing"] == 59
    assert summary["results"]["parity"]["largest_difference"]["arrival_s"] == pytest.approx(1e-9)


@pytest.mark.slow
def test_windows_of_a_scene_are_searched_again(tmp_path: Path) -> None:
    scene, folder = tmp_path / "scene", tmp_path / "run"
    words = ["--shots", "3", "--products", "window_and_candidates", "--tolerance", "1e-2", "--quiet"]
    assert main(["simulate", "plane", *words, "--out", str(scene)]) == 0
    (tmp_path / "bench.toml").write_text("")
    told = ["--windows", str(scene / "data.nc"), "--bench", str(tmp_path / "bench.toml"), "--quiet"]
    assert main(["rfm-parity", *told, "--out", str(folder)]) == 0
    results = json.loads((folder / "summary.json").read_text())["results"]
    assert results["parity"]["agreeing"] == 3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--snrs", "0"), "must be above zero"),
        (("--code", "77", "--bench", "simulated"), "gain code 77"),
        (("--gain-code", "78", "--bench", "simulated"), "gain code 78"),
        (("--arrival-tolerance-ps", "-1"), "arrival_s"),
        (("--windows", "there-is-none.nc"), "there-is-none.nc"),
        (("--receiver", "there-is-none"), "belahil characterize"),
    ],
)
def test_wrong_words_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert main(["rfm-parity", *words, "--out", str(tmp_path / "run")]) == 2
    answer = capsys.readouterr().err
    assert answer.count("\n") == 1
    assert said in answer


# ---- the model, against a slow and obvious one


FINER = 16
"""Steps in a sample interval of the slow model."""


@pytest.mark.parametrize(("snr", "cutoff_hz", "order"), [(3.0, 19e6, 3), (5.0, 11e6, 2)])
@pytest.mark.slow
def test_the_model_predicts_what_a_fine_time_grid_gives(snr: float, cutoff_hz: float, order: int) -> None:
    # Given marker and echo of 45 ns, in exact form and as a run of 16 steps a sample through SciPy's filter
    config = bench_file()
    noise_v, gain, samples = 1e-3, 2.0, 1500
    known = replace(
        exactly(config),
        cutoff=Estimate(cutoff_hz, 0.0, "Hz"),
        order=order,
        codes=(KnownCode(None, Estimate(gain, 0.0), Estimate(noise_v, 0.0, "V")),),
    )
    finder = RangeFinder.of(BELA_GRM)
    pulses = [TrainPulse(45e-9, 40 * noise_v / gain, 3e-6), TrainPulse(45e-9, snr * noise_v / gain, 6.1e-6)]
    with open_bench(config) as bench:
        stimulus = gaussian_train(pulses, bench.generator_model)
    _, places_s = pulse_places(stimulus)
    expected = expectation(stimulus, places_s, known, gain, finder)
    counts = np.zeros(samples, np.int16)
    example = RangeWindow(counts, 0.5e-3, 2048.0, 12.5e-9, 0.0, None, 0)
    model = predict(stimulus, example, expected.marker_s, known, finder, expected, 1500, 0.0).sightings

    fine_hz = FINER * 80e6
    filtered = signal.butter(order, cutoff_hz, fs=fine_hz)
    pulse = gain * signal.lfilter(*filtered, stimulus.at(np.arange(FINER * samples) / fine_hz))
    rng, ones = np.random.default_rng(8), []
    slow = replace(finder, compiled=False)
    for _ in range(500):
        noise = signal.lfilter(*filtered, rng.standard_normal(FINER * (samples + 100)))[FINER * 100 :]
        volts = (pulse + noise_v * noise / noise_rms(filtered))[rng.integers(FINER) :: FINER]
        rows = slow.search(0.5e-3 * np.round(volts / 0.5e-3))
        ones.append(sighting([(row[0], row[2]) for row in rows], expected))
    # Then both agree as two sets of draws do
    (told,), _ = agreements([(Sightings.of(ones), Prediction(model, None))])
    assert decided(told) == ["pass"] * 3
    assert 0.2 < model.detected / model.used <= 1.0


def noise_rms(filtered: tuple[np.ndarray, np.ndarray]) -> float:
    """Of white noise of unit rms behind a digital filter."""
    return float(np.sqrt(np.sum(signal.lfilter(*filtered, np.eye(1, 4000)[0]) ** 2)))
