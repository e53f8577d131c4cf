"""The bench: one way across the cut, with its interlock, repeats and proof of identity."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from belahil.bench import Bench
from belahil.config import BenchConfig, BenchTable, DigitizerTable, GeneratorTable
from belahil.errors import (
    InstrumentError,
    InterlockRefused,
    LimitExceeded,
    LinkClosed,
    LinkTimeout,
    RefusedInput,
    StaleData,
)
from belahil.generators import MODELS, GeneratorModel, on_grid
from belahil.interfaces import LinkCounts
from belahil.link_source import LEFT_ON
from belahil.receiver import BELA_GRM, DigitizerSpec
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus
from belahil.values import RangeWindow, WindowRequest


class Recorder:
    """A generator and a digitizer that write down what they are asked."""

    identity = "recorder"

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.failures: list[Exception] = []
        self.shot_offset = 0
        self.confirms = True
        self._request: WindowRequest | None = None

    limits: GeneratorModel = MODELS["33522B"]
    spec: DigitizerSpec = BELA_GRM.digitizer
    dropped = LinkCounts()

    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        self.calls.append(f"prepare {type(stimulus).__name__} {trigger}")
        return on_grid(stimulus, self.limits)

    def output(self, on: bool) -> None:
        self.calls.append(f"output {on}")

    def trigger(self) -> None:
        self.calls.append("trigger")

    def arm(self, request: WindowRequest) -> None:
        self.calls.append(f"arm {request.shot} {request.trigger}")
        self._request = request

    def read(self, timeout_s: float) -> RangeWindow:
        self.calls.append("read")
        if self.failures:
            raise self.failures.pop(0)
        assert self._request is not None
        counts = np.zeros(self._request.sample_count, np.int16)
        return RangeWindow(counts, 1e-3, 0, 12.5e-9, 0.0, 4, self._request.shot + self.shot_offset)

    def close(self) -> bool:
        self.calls.append("close")
        return self.confirms

    def now_s(self) -> float:
        return 0.0

    def sleep_s(self, duration_s: float) -> None:
        self.calls.append(f"sleep {duration_s}")


def _bench(**generator: float) -> tuple[Bench, Recorder]:
    recorder = Recorder()
    config = BenchConfig(bench=BenchTable(settle_s=0.5), generator=GeneratorTable(**generator))
    return Bench(recorder, recorder, config, recorder), recorder


def test_the_order_of_a_pulse_is_arm_then_trigger() -> None:
    # given a bench
    bench, recorder = _bench()
    # when a pulse is measured twice
    pulse = SampledPulse(np.array([0.0, 0.01, 0.0]), 80e6)
    bench.measure(pulse, WindowRequest(shot=0))
    bench.measure(pulse, WindowRequest(shot=1))
    # then the output was off at first, the digitizer is armed before the trigger, and nothing is sent twice
    assert recorder.calls == [
        "output False",
        "prepare SampledPulse generator",
        "output True",
        "sleep 0.5",
        "arm 0 generator",
        "trigger",
        "read",
        "arm 1 generator",
        "trigger",
        "read",
    ]


@pytest.mark.parametrize("trigger", ["generator", "immediate"])
def test_a_new_gain_code_settles_before_its_window(trigger: str) -> None:
    # given a bench that lets its instruments settle
    bench, recorder = _bench()
    pulse = SampledPulse(np.array([0.0, 0.01, 0.0]), 80e6)
    stimulus: Stimulus = pulse if trigger == "generator" else Sine(1e6, 0.05)
    # when the gain code changes while the stimulus stays
    for shot, code in enumerate((4, 4, 5)):
        bench.measure(stimulus, WindowRequest(shot, code))
    # then arming sets the new code, all settles, and the receiver is armed again
    window = ["trigger", "read"] if trigger == "generator" else ["read"]
    thrown_away = [] if trigger == "generator" else ["read"]

    def settling(shot: int) -> list[str]:
        return [f"arm {shot} {trigger}", *thrown_away, "sleep 0.5"]

    assert recorder.calls[3:] == [
        *settling(0),
        *(f"arm 0 {trigger}", *window),
        *(f"arm 1 {trigger}", *window),
        *settling(2),
        *(f"arm 2 {trigger}", *window),
    ]


def test_after_a_failure_the_gain_code_settles_again_and_without_a_settling_time_never() -> None:
    bench, recorder = _bench()
    bench.measure(NoSignal(), WindowRequest(0, 4))
    recorder.calls.clear()
    recorder.failures = [LinkTimeout("late")]
    bench.measure(NoSignal(), WindowRequest(1, 4))
    assert recorder.calls.count("sleep 0.5") == 1
    assert recorder.calls.count("arm 1 immediate") == 3
    bench.config = msgspec.structs.replace(bench.config, bench=BenchTable())
    recorder.calls.clear()
    bench.measure(NoSignal(), WindowRequest(2, 5))
    assert recorder.calls.count("arm 2 immediate") == recorder.calls.count("read") == 1


def test_a_lost_window_is_asked_again_and_counted() -> None:
    bench, recorder = _bench()
    recorder.failures = [LinkTimeout("late"), StaleData("old")]
    assert bench.measure(NoSignal(), WindowRequest(shot=3)).attempt == 3
    recorder.failures = [LinkTimeout("1"), LinkTimeout("2"), LinkTimeout("3")]
    with pytest.raises(LinkTimeout, match="3"):
        bench.measure(NoSignal(), WindowRequest(shot=4))


def test_a_closed_link_is_not_tried_again() -> None:
    bench, recorder = _bench()
    recorder.failures = [LinkClosed("gone")]
    with pytest.raises(LinkClosed):
        bench.measure(NoSignal(), WindowRequest(shot=0))
    assert recorder.calls.count("read") == 1


def test_a_window_of_another_shot_is_never_returned() -> None:
    bench, recorder = _bench()
    recorder.shot_offset = 1
    with pytest.raises(StaleData, match="asked for shot 5, the window that came belongs to shot 6"):
        bench.measure(NoSignal(), WindowRequest(shot=5))


@pytest.mark.parametrize(
    ("stimulus", "request_", "error", "said"),
    [
        (Sine(1e6, 0.4, 0.1), WindowRequest(0), InterlockRefused, "max_vpp = 0.5 allows 0.25 V"),
        (Sine(1e6, 0.6), WindowRequest(0), InterlockRefused, "(0.6 Vpp): [generator] max_vpp = 0.5"),
        (Sine(40e6, 0.1), WindowRequest(0), LimitExceeded, "33522B makes"),
        (
            NoSignal(),
            WindowRequest(0, gain_code=16),
            LimitExceeded,
            "gain code 16: the receiver has gain codes 0 to 15",
        ),
        (NoSignal(), WindowRequest(0, sample_count=20000), LimitExceeded, "takes 1 to 16064"),
        (NoSignal(), WindowRequest(0, sample_count=0), RefusedInput, "sample_count = 0: must be"),
        (NoSignal(), WindowRequest(0, sample_count=41.5), RefusedInput, "sample_count = 41.5: must"),  # type: ignore[arg-type]
        (NoSignal(), WindowRequest(-1), RefusedInput, "shot = -1: must be a whole number of 0 or more"),
        (NoSignal(), WindowRequest(0, delay_s=math.nan), RefusedInput, "delay_s = nan: must be a finite"),
        (NoSignal(), WindowRequest(0, delay_s=-math.inf), RefusedInput, "delay_s = -inf: must be a finite"),
    ],
)
def test_what_is_not_allowed_is_refused_before_anything_is_sent(
    stimulus: Stimulus, request_: WindowRequest, error: type[Exception], said: str
) -> None:
    bench, recorder = _bench()
    with pytest.raises(error) as caught:
        bench.measure(stimulus, request_)
    assert said in str(caught.value)
    assert recorder.calls == ["output False"]


def test_what_rounding_would_lift_over_the_interlock_is_not_sent() -> None:
    # given an attenuator that puts the limit between two settings of the generator
    bench, recorder = _bench(attenuation_db=3.3333)
    # when the limit itself is asked for, then the setting above it is refused before it is sent
    with pytest.raises(InterlockRefused, match=r"0\.250001 V .* max_vpp = 0\.5 allows 0\.25 V"):
        bench.measure(Sine(1e6, 0.5), WindowRequest(0))
    assert recorder.calls == ["output False"]
    bench.measure(Sine(1e6, 0.4999), WindowRequest(0))
    assert "output True" in recorder.calls


@pytest.mark.parametrize("offset_v", [float("nan"), float("inf"), float("-inf")])
def test_no_sine_has_an_offset_that_is_no_number(offset_v: float) -> None:
    with pytest.raises(RefusedInput, match=f"offset of {offset_v!r} V: must be finite"):
        Sine(1e6, 0.05, offset_v)


@pytest.mark.parametrize(
    ("load_ohm", "input_ohm", "attenuation_db", "expected"),
    [
        (50.0, 50.0, 0.0, 1.0),
        (float("inf"), 50.0, 0.0, 2.0),
        (50.0, float("inf"), 0.0, 0.5),
        (50.0, 50.0, 20.0, 10.0),
    ],
)
def test_volts_at_the_cut_become_a_setting(
    load_ohm: float, input_ohm: float, attenuation_db: float, expected: float
) -> None:
    bench, _ = _bench(load_ohm=load_ohm, attenuation_db=attenuation_db)
    bench.config = msgspec.structs.replace(bench.config, digitizer=DigitizerTable(input_ohm=input_ohm))
    assert bench.setting_per_cut_volt == pytest.approx(expected, rel=1e-12)
    # and what comes back is in volts at the cut again
    shot = bench.measure(Sine(1e6, 0.05), WindowRequest(0))
    assert isinstance(shot.played, Sine)
    assert shot.played.amplitude_vpp == pytest.approx(0.05, rel=1e-3)


def test_the_output_is_off_on_every_way_out() -> None:
    bench, recorder = _bench()
    with pytest.raises(ZeroDivisionError), bench:
        raise ZeroDivisionError
    assert recorder.calls[-2:] == ["close", "close"]


def test_a_generator_that_does_not_confirm_its_silence_is_told_of() -> None:
    # given a generator that cannot be reached any more
    bench, recorder = _bench()
    recorder.confirms = False
    # when the bench is left, then that is an error, or a note on the one that is on its way
    with pytest.raises(InstrumentError, match="did not confirm that its output is off"), bench:
        pass
    with pytest.raises(ZeroDivisionError) as caught, bench:
        raise ZeroDivisionError
    assert caught.value.__notes__ == [LEFT_ON]


def test_a_request_is_not_changed_by_being_measured() -> None:
    bench, _ = _bench()
    request = WindowRequest(shot=0)
    bench.measure(NoSignal(), request)
    assert request == replace(request)
