"""Each rule of the conformance suite can fail: drivers that break exactly one promise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from belahil.config import parse_bench
from belahil.conformance import DIGITIZER_RULES, GENERATOR_RULES, check_digitizer, check_generator
from belahil.conformance.digitizer import CLOSING_RULES as CLOSING_DIGITIZER
from belahil.conformance.generator import CLOSING_RULES as CLOSING_GENERATOR
from belahil.conformance.generator import GeneratorTried
from belahil.conformance.rules import RuleResult, judged
from belahil.conformance.stand import GuardedGenerator, Receiving
from belahil.errors import (
    BelahilError,
    ConformanceFailed,
    InstrumentError,
    InstrumentRefused,
    LimitExceeded,
    LinkClosed,
    LinkTimeout,
    RefusedInput,
    ReplayDiffers,
)
from belahil.generators import MODELS, stimulus_of
from belahil.interfaces import LinkCounts
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, largest_volts
from belahil.values import RangeWindow, WindowRequest
from sim.build import scope_receiver
from sim.instruments import SimulatedDigitizer, SimulatedGenerator
from sim.plant import Plant
from sim.simulated_scope import SimulatedScope

MAX_VPP = 0.5
MODEL = MODELS["33522B"]
OWN_ERRORS = {"", "InstrumentError", "InstrumentRefused", "LimitExceeded", "LinkTimeout", "RuntimeError"}


class Wrapped:
    """Something that behaves as what is in it, but for what a mutant changes."""

    def __init__(self, inside: Any) -> None:
        self.inside = inside
        self.calls = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inside, name)


@dataclass
class Stand:
    """A plant with simulated instruments, either of which may be a mutant."""

    plant: Plant
    generator: Any
    digitizer: Any

    @property
    def player(self) -> GuardedGenerator:
        return GuardedGenerator(self.generator, MAX_VPP)


def stand(scope: bool = False) -> Stand:
    told = '[digitizer]\ndriver = "siglent-sds"\nlink = "simulated"\nreceiver = "analog"\n' if scope else ""
    config = parse_bench(told + '[generator]\naddress = "simulated"\n' if scope else "")
    receiver = scope_receiver(config)
    plant = Plant(config, receiver)
    digitizer = SimulatedDigitizer(plant) if receiver is None else SimulatedScope(plant, receiver)
    return Stand(plant, SimulatedGenerator(plant, MODEL, 50.0), digitizer)


def seen_of_generator(rule: str, there: Stand) -> RuleResult:
    eye = Receiving(there.digitizer, None, None, there.plant.clock)
    (chosen,) = (one for one in (*GENERATOR_RULES, *CLOSING_GENERATOR) if one.name == rule)
    (result,) = judged([chosen], GeneratorTried(there.player, eye))
    return result


def seen_of_digitizer(rule: str, there: Stand) -> RuleResult:
    tried = Receiving(there.digitizer, there.player, None, there.plant.clock)
    (chosen,) = (one for one in (*DIGITIZER_RULES, *CLOSING_DIGITIZER) if one.name == rule)
    (result,) = judged([chosen], tried)
    return result


# ---- generators that break one promise


class OnAtOpening(Wrapped):
    def __init__(self, inside: Any) -> None:
        super().__init__(inside)
        inside.prepare(Sine(1e6, 0.2), "immediate")
        inside.output(True)


class Renamed(Wrapped):
    @property
    def identity(self) -> str:
        self.calls += 1
        return f"instrument {self.calls}"


class TwoLines(Wrapped):
    identity = "Maker,Model\n,1"


def with_limits(**changed: Any) -> type[Wrapped]:
    class Limits(Wrapped):
        limits = replace(MODEL, **changed)

    return Limits


def played_as(change: Callable[[Any, int], Any]) -> type[Wrapped]:
    """Say that something else is played."""

    class Played(Wrapped):
        def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
            self.calls += 1
            played: Stimulus = change(self.inside.prepare(stimulus, trigger), self.calls)
            return played

    return Played


def on_sines(change: Callable[[Sine, int], Stimulus]) -> type[Wrapped]:
    return played_as(lambda one, calls: change(one, calls) if isinstance(one, Sine) else one)


def on_pulses(change: Callable[[SampledPulse, int], Stimulus]) -> type[Wrapped]:
    return played_as(lambda one, calls: change(one, calls) if isinstance(one, SampledPulse) else one)


def accepting(is_so: Callable[[Any], bool]) -> type[Wrapped]:
    """Accept what should be refused, where it is so."""

    class Accepting(Wrapped):
        def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
            try:
                played: Stimulus = self.inside.prepare(stimulus, trigger)
            except LimitExceeded:
                if not is_so(stimulus):
                    raise
                return stimulus
            return played

    return Accepting


def raising(kind: type[Exception], text: str = "no") -> type[Wrapped]:
    """Refuse with another error."""

    class Raising(Wrapped):
        def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
            try:
                played: Stimulus = self.inside.prepare(stimulus, trigger)
            except LimitExceeded:
                raise kind(text) from None
            return played

    return Raising


def pulse_where(is_so: Callable[[SampledPulse], bool]) -> type[Wrapped]:
    return accepting(lambda one: isinstance(one, SampledPulse) and is_so(one))


def sine_where(is_so: Callable[[Sine], bool]) -> type[Wrapped]:
    return accepting(lambda one: isinstance(one, Sine) and is_so(one))


class ChangedByRefusal(Wrapped):
    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        try:
            played: Stimulus = self.inside.prepare(stimulus, trigger)
        except LimitExceeded:
            self.inside.prepare(NoSignal(), "immediate")
            raise
        return played


class DeadAfterRefusal(Wrapped):
    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        if self.calls:
            raise InstrumentError("stuck")
        try:
            played: Stimulus = self.inside.prepare(stimulus, trigger)
        except LimitExceeded:
            self.calls += 1
            raise
        return played


class OneTrigger(Wrapped):
    def trigger(self) -> None:
        self.calls += 1
        if self.calls > 1:
            raise InstrumentRefused("only one")
        self.inside.trigger()


class NoTrigger(Wrapped):
    def trigger(self) -> None:
        return


class TriggersRegardless(Wrapped):
    def trigger(self) -> None:
        try:
            self.inside.trigger()
        except InstrumentRefused:
            return


class RefusesRepeat(Wrapped):
    last: bool | None = None

    def output(self, on: bool) -> None:
        if on == self.last:
            raise InstrumentRefused("it is so already")
        self.last = on
        self.inside.output(on)


def output_only(to: bool) -> type[Wrapped]:
    class Stuck(Wrapped):
        def output(self, on: bool) -> None:
            if on == to:
                self.inside.output(on)

    return Stuck


class PrepareSwitchesOn(Wrapped):
    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        played: Stimulus = self.inside.prepare(stimulus, trigger)
        self.inside.output(True)
        return played


def closing(first: object, later: object, acts: bool = True) -> type[Wrapped]:
    class Closing(Wrapped):
        def close(self) -> object:
            self.calls += 1
            if acts:
                self.inside.close()
            return first if self.calls == 1 else later

    return Closing


class OpenForEver(Wrapped):
    def close(self) -> bool:
        self.inside.output(False)
        return True


class ClosedButForTrigger(Wrapped):
    def trigger(self) -> None:
        raise InstrumentRefused("nothing waits")


BAD_GENERATORS: dict[str, tuple[type[Wrapped], ...]] = {
    "output_off_at_opening": (OnAtOpening,),
    "identity": (Renamed, TwoLines),
    "limits": (
        with_limits(min_sine_hz=1e9),
        with_limits(min_points=2_000_000),
        with_limits(min_amplitude_vpp=11.0),
        with_limits(interpolations=()),
    ),
    "prepares_silence": (played_as(lambda one, calls: Sine(1e6, 0.01) if one == NoSignal() else one),),
    "prepares_sines": (
        on_sines(lambda one, calls: replace(one, amplitude_vpp=1.01 * one.amplitude_vpp)),
        on_sines(lambda one, calls: replace(one, frequency_hz=1.01 * one.frequency_hz)),
        on_sines(lambda one, calls: replace(one, offset_v=0.0)),
        on_sines(lambda one, calls: NoSignal()),
        on_sines(lambda one, calls: replace(one, amplitude_vpp=0.6)),
    ),
    "prepares_pulses": (
        on_pulses(lambda one, calls: replace(one, start_s=one.start_s + 5e-9)),
        on_pulses(lambda one, calls: replace(one, volts=0.99 * one.volts)),
        on_pulses(lambda one, calls: NoSignal()),
        on_pulses(lambda one, calls: replace(one, volts=2 * one.volts)),
    ),
    "stays_on_its_grid": (
        on_sines(lambda one, calls: replace(one, frequency_hz=one.frequency_hz + 1e-6 * calls)),
        on_pulses(lambda one, calls: replace(one, volts=one.volts * (1 - 1e-6 * calls))),
    ),
    "refuses_frequency": (
        sine_where(lambda one: one.frequency_hz > MODEL.max_sine_hz),
        sine_where(lambda one: one.frequency_hz < MODEL.min_sine_hz),
        raising(ValueError),
        raising(LimitExceeded, "two\nlines"),
    ),
    "refuses_amplitude": (
        sine_where(lambda one: one.amplitude_vpp < MODEL.min_amplitude_vpp),
        sine_where(lambda one: one.amplitude_vpp > 10),
        sine_where(lambda one: one.offset_v > 1),
        pulse_where(lambda one: float(np.max(one.volts)) > 5),
    ),
    "refuses_waveform": (
        pulse_where(lambda one: one.volts.size > MODEL.max_points),
        pulse_where(lambda one: one.sample_rate_hz > MODEL.max_arb_rate_hz),
    ),
    "refuses_start": (
        pulse_where(lambda one: one.start_s < 0),
        pulse_where(lambda one: one.start_s > MODEL.max_delay_s),
    ),
    "refuses_shape": (
        pulse_where(lambda one: bool(one.poles)),
        pulse_where(lambda one: not one.poles),
        raising(InstrumentRefused),
    ),
    "refuses_absurd_numbers": (
        sine_where(lambda one: one.frequency_hz == 1e300),
        sine_where(lambda one: one.offset_v == 1e300),
        pulse_where(lambda one: one.start_s == -1e300),
        raising(OverflowError),
    ),
    "refuses_needless_trigger": (TriggersRegardless,),
    "refusal_changes_nothing": (ChangedByRefusal,),
    "works_after_refusal": (DeadAfterRefusal,),
    "takes_triggers": (OneTrigger,),
    "output_may_be_repeated": (RefusesRepeat,),
    "output_switches": (output_only(True), output_only(False), PrepareSwitchesOn),
    "pulse_arrives": (NoTrigger,),
    "off_when_closed": (closing(None, None), closing(False, False), closing(True, True, acts=False)),
    "closes_twice": (closing(True, False),),
    "closed_stays_closed": (OpenForEver, ClosedButForTrigger),
}


@pytest.mark.parametrize(
    ("rule", "mutant"), [(rule, mutant) for rule, mutants in BAD_GENERATORS.items() for mutant in mutants]
)
def test_a_bad_generator_breaks_its_rule(rule: str, mutant: type[Wrapped]) -> None:
    # given a generator that breaks one promise
    bad = stand()
    bad.generator = mutant(bad.generator)
    # when that rule is tried, then it fails in one line
    result = seen_of_generator(rule, bad)
    assert result.status == "fails", result
    assert "\n" not in str(result)
    # and it is the promise that fails, not the mutant
    assert result.error in OWN_ERRORS


@pytest.mark.parametrize("rule", BAD_GENERATORS)
def test_a_good_generator_keeps_each_rule_alone(rule: str) -> None:
    assert seen_of_generator(rule, stand()).status == "holds"


# ---- digitizers that break one promise


def with_spec(**changed: Any) -> type[Wrapped]:
    class Spec(Wrapped):
        @property
        def spec(self) -> Any:
            return replace(self.inside.spec, **changed)

    return Spec


def read_as(change: Callable[[RangeWindow, int], RangeWindow]) -> type[Wrapped]:
    class Read(Wrapped):
        def read(self, timeout_s: float) -> RangeWindow:
            self.calls += 1
            return change(self.inside.read(timeout_s), self.calls)

    return Read


def fields(**changed: Any) -> type[Wrapped]:
    return read_as(lambda window, calls: replace(window, **changed))


def armed_as(change: Callable[[WindowRequest], WindowRequest]) -> type[Wrapped]:
    class Armed(Wrapped):
        def arm(self, request: WindowRequest) -> None:
            self.inside.arm(change(request))

    return Armed


def refusing(is_so: Callable[[WindowRequest], bool], error: Exception | None = None) -> type[Wrapped]:
    class Refusing(Wrapped):
        def arm(self, request: WindowRequest) -> None:
            if is_so(request):
                raise error or InstrumentRefused("not that")
            self.inside.arm(request)

    return Refusing


def unread_as(verb: Callable[[Any, BelahilError], Any]) -> type[Wrapped]:
    """Do something else than to raise where nothing can be read."""

    class Unread(Wrapped):
        last: Any = None

        def read(self, timeout_s: float) -> Any:
            try:
                self.last = self.inside.read(timeout_s)
            except BelahilError as error:
                return verb(self, error)
            return self.last

    return Unread


def _raise(error: Exception) -> Any:
    raise error


def _late(wrapped: Any, error: BelahilError) -> Any:
    wrapped._plant.clock.sleep_s(10.0)
    raise error


class KeepsOlder(Wrapped):
    """A refused request leaves what was armed before."""

    def arm(self, request: WindowRequest) -> None:
        if request.sample_count < 1:
            raise LimitExceeded("no sample")
        self.inside.arm(request)


class DeadAfterBadArm(Wrapped):
    def arm(self, request: WindowRequest) -> None:
        if self.calls:
            raise InstrumentRefused("stuck")
        try:
            self.inside.arm(request)
        except (RefusedInput, InstrumentRefused):
            self.calls += 1
            raise


class ArmsOnce(Wrapped):
    """A window that was not read stays armed."""

    def arm(self, request: WindowRequest) -> None:
        if self.inside._shot is None:
            self.inside.arm(request)


class EndsAtOnce(Wrapped):
    def read(self, timeout_s: float) -> Any:
        return self.inside.read(0.0)


class Forgetful(Wrapped):
    @property
    def dropped(self) -> LinkCounts:
        self.calls += 1
        return LinkCounts(5 - self.calls, 0)


class RaisesWhenClosedAgain(Wrapped):
    def close(self) -> None:
        self.calls += 1
        if self.calls > 1:
            raise InstrumentError("closed already")
        self.inside.close()


class NeverClosed(Wrapped):
    def close(self) -> None:
        return


def closed_as(error: Exception) -> type[Wrapped]:
    class Closed(Wrapped):
        def read(self, timeout_s: float) -> Any:
            try:
                return self.inside.read(timeout_s)
            except LinkClosed:
                raise error from None

    return Closed


def _found(window: RangeWindow, calls: int) -> RangeWindow:
    return replace(window, candidates=tuple(replace(one, correlation_window=()) for one in window.candidates))


BAD_DIGITIZERS: dict[str, tuple[type[Wrapped], ...]] = {
    "identity": (Renamed, TwoLines),
    "spec": (
        with_spec(sample_rate_hz=0.0),
        with_spec(bits=0),
        with_spec(max_sample_count=0),
        with_spec(triggers=()),
        with_spec(triggers=("immediate", "immediate")),
        with_spec(products=("everything",)),
        with_spec(gain_codes=(1, 1)),
        with_spec(gain_codes=()),
    ),
    "refuses_unarmed_read": (unread_as(lambda _, error: None), unread_as(_late)),
    "takes_a_window": (
        fields(shot=7),
        read_as(lambda window, calls: replace(window, counts=window.counts[:-1])),
        read_as(lambda window, calls: replace(window, counts=window.counts[None])),
        read_as(lambda window, calls: replace(window, counts=window.counts.astype(np.int32))),
        fields(gain_code=5),
        fields(sample_interval_s=1e-8),
        fields(start_s=1e-6),
        fields(volts_per_count=0.0),
        fields(zero_count=math.nan),
        fields(saturated=-1),
        fields(saturated=4001),
    ),
    "counts_fit_the_converter": (
        read_as(lambda window, calls: replace(window, counts=window.counts * np.int16(4))),
        read_as(lambda window, calls: replace(window, volts_per_count=window.volts_per_count * calls)),
        read_as(lambda window, calls: replace(window, zero_count=window.zero_count + calls)),
    ),
    "counts_saturated_samples": (
        fields(saturated=0),
        read_as(lambda window, calls: replace(window, saturated=window.counts.size)),
        fields(saturated=1),
    ),
    "rounds_the_delay": (
        armed_as(lambda one: replace(one, delay_s=math.floor(one.delay_s * 80e6) / 80e6)),
        read_as(lambda window, calls: replace(window, start_s=window.start_s + 0.4 / 80e6)),
    ),
    "takes_any_length": (
        refusing(lambda one: one.sample_count == 1),
        refusing(lambda one: one.sample_count > 16000),
        read_as(lambda window, calls: replace(window, counts=window.counts[:16000])),
    ),
    "takes_every_gain_code": (
        refusing(lambda one: one.gain_code == 15),
        armed_as(lambda one: replace(one, gain_code=4)),
    ),
    "takes_every_trigger": (
        refusing(lambda one: one.trigger == "generator"),
        refusing(lambda one: one.trigger == "digitizer"),
    ),
    "gives_every_product": (
        read_as(_found),
        refusing(lambda one: one.products == "candidates"),
        read_as(lambda window, calls: replace(window, counts=np.zeros(16064, np.int16))),
        read_as(
            lambda window, calls: replace(
                window, candidates=tuple(replace(one, first_sample=16063) for one in window.candidates)
            )
        ),
    ),
    "takes_or_refuses_transmit": (
        refusing(lambda one: one.source == "transmit", RuntimeError("transmit")),
        fields(shot=7),
    ),
    "returns_every_shot": (armed_as(lambda one: replace(one, shot=one.shot & 0xFFFF)),),
    "refuses_gain_code": (
        armed_as(lambda one: replace(one, gain_code=4) if one.gain_code is None else one),
        armed_as(lambda one: replace(one, gain_code=min(15, one.gain_code or 0)) if one.gain_code else one),
    ),
    "refuses_length": (
        armed_as(lambda one: replace(one, sample_count=max(1, one.sample_count))),
        armed_as(lambda one: replace(one, sample_count=min(16064, one.sample_count))),
        refusing(lambda one: one.sample_count == 0, ValueError("no sample")),
    ),
    "refuses_delay": (
        armed_as(lambda one: one if math.isfinite(one.delay_s) else replace(one, delay_s=0.0)),
        armed_as(lambda one: replace(one, delay_s=max(0.0, one.delay_s))),
    ),
    "works_after_refusal": (KeepsOlder, DeadAfterBadArm),
    "reads_once": (unread_as(lambda wrapped, error: wrapped.last),),
    "rearms": (ArmsOnce,),
    "times_out": (
        EndsAtOnce,
        unread_as(_late),
        unread_as(lambda _, error: _raise(InstrumentError("nothing"))),
        unread_as(lambda wrapped, error: wrapped.last),
        armed_as(lambda one: replace(one, trigger="immediate")),
    ),
    "counts_what_it_dropped": (Forgetful,),
    "closes_twice": (RaisesWhenClosedAgain,),
    "closed_stays_closed": (
        NeverClosed,
        closed_as(InstrumentError("nothing armed")),
        closed_as(LinkTimeout("late")),
    ),
}


@pytest.mark.parametrize(
    ("rule", "mutant"), [(rule, mutant) for rule, mutants in BAD_DIGITIZERS.items() for mutant in mutants]
)
def test_a_bad_digitizer_breaks_its_rule(rule: str, mutant: type[Wrapped]) -> None:
    # given a digitizer that breaks one promise
    bad = stand()
    bad.digitizer = mutant(bad.digitizer)
    # when that rule is tried, then it fails in one line
    result = seen_of_digitizer(rule, bad)
    assert result.status == "fails", result
    assert "\n" not in str(result)
    # and it is the promise that fails, not the mutant
    assert result.error in OWN_ERRORS


@pytest.mark.parametrize("rule", BAD_DIGITIZERS)
def test_a_good_digitizer_keeps_each_rule_alone(rule: str) -> None:
    assert seen_of_digitizer(rule, stand()).status == "holds"


@pytest.mark.parametrize(
    "word", [{"trigger": "immediate"}, {"products": "window"}], ids=["trigger", "products"]
)
def test_an_oscilloscope_that_takes_words_it_does_not_have_breaks_its_rule(word: dict[str, Any]) -> None:
    # given an oscilloscope, which has no trigger "digitizer" and no candidates
    assert seen_of_digitizer("refuses_foreign_words", stand(scope=True)).status == "holds"
    bad = stand(scope=True)
    bad.digitizer = armed_as(lambda one: replace(one, **word))(bad.digitizer)
    # then one that takes them for others is found
    assert seen_of_digitizer("refuses_foreign_words", bad).status == "fails"


def test_every_rule_has_a_mutant_that_breaks_it() -> None:
    generators = {one.name for one in (*GENERATOR_RULES, *CLOSING_GENERATOR)}
    digitizers = {one.name for one in (*DIGITIZER_RULES, *CLOSING_DIGITIZER)}
    assert generators == set(BAD_GENERATORS)
    assert digitizers == {*BAD_DIGITIZERS, "refuses_foreign_words"}
    assert all(one.promise for one in (*GENERATOR_RULES, *DIGITIZER_RULES))


# ---- the whole suite


def tried(there: Stand, **asked: Any) -> Any:
    return check_generator(
        there.generator, max_vpp=MAX_VPP, digitizer=there.digitizer, clock=there.plant.clock, **asked
    )


def test_a_rule_that_fails_does_not_stop_the_others() -> None:
    # given a generator whose prepare never works
    class Broken(Wrapped):
        def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
            raise InstrumentError("dead")

    bad = stand()
    bad.generator = Broken(bad.generator)
    report = tried(bad)
    # then every rule has a result, those about other verbs hold, and all that fail are told
    assert [one.rule for one in report.results] == [
        one.name for one in (*GENERATOR_RULES, *CLOSING_GENERATOR)
    ]
    status = {one.rule: one.status for one in report.results}
    assert status["identity"] == status["closes_twice"] == "holds"
    assert status["prepares_sines"] == "fails"
    assert not report.holds
    assert not report.link_lost
    with pytest.raises(ConformanceFailed, match="prepares_sines: fails: InstrumentError: dead") as caught:
        report.require()
    assert caught.value.failures == report.failures
    assert caught.value.exit_status == 1


def test_a_link_that_is_gone_is_told() -> None:
    gone = stand()
    gone.generator.close()
    report = tried(gone)
    assert report.link_lost
    assert report.identity


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ReplayDiffers("another way")])
@pytest.mark.parametrize("at", range(1, 60, 7))
def test_the_output_is_off_on_every_way_out(error: BaseException, at: int) -> None:
    # given a generator that is interrupted at some call while it is tried
    class Interrupted(Wrapped):
        def _count(self) -> None:
            self.calls += 1
            if self.calls == at:
                raise error

        def prepare(self, stimulus: Stimulus, trigger: str) -> Any:
            self._count()
            return self.inside.prepare(stimulus, trigger)

        def output(self, on: bool) -> None:
            if on:
                self._count()
            self.inside.output(on)

        def trigger(self) -> None:
            self._count()
            self.inside.trigger()

    there = stand()
    there.generator = Interrupted(there.generator)
    # then the interruption comes through, and the output is off
    with pytest.raises(type(error)):
        tried(there)
    assert not there.plant._setting.output
    assert there.generator.calls == at


@pytest.mark.parametrize("load_ohm", [50.0, math.inf])
@pytest.mark.parametrize("max_vpp", [3e-3, 0.021, 0.5, 30.0])
def test_nothing_above_max_vpp_is_ever_played(max_vpp: float, load_ohm: float) -> None:
    # given a plant that notes what is played with the output on
    there, played = stand(), []
    play = there.plant.play

    def noted(setting: Any) -> None:
        if setting.output:
            played.append(2 * largest_volts(stimulus_of(setting)))
        play(setting)

    there.plant.play = noted  # type: ignore[method-assign]
    there.generator = SimulatedGenerator(there.plant, MODEL, load_ohm)
    report = check_generator(there.generator, max_vpp=max_vpp, load_ohm=load_ohm)
    # then nothing is above, and it is told what is played
    assert max(played) <= max_vpp
    assert report.holds
    assert report.plays
    assert not there.plant._setting.output


def test_a_generator_that_plays_more_than_it_may_is_not_switched_on() -> None:
    # given a driver that says it will play ten times what was asked for
    class Loud(Wrapped):
        def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
            played: Stimulus = self.inside.prepare(stimulus, trigger)
            return (
                replace(played, amplitude_vpp=10 * played.amplitude_vpp)
                if isinstance(played, Sine)
                else played
            )

        def output(self, on: bool) -> None:
            now = self.inside._setting
            assert not (on and now.function == "SIN")
            self.inside.output(on)

    loud = stand()
    loud.generator = Loud(loud.generator)
    assert "output_switches" in {one.rule for one in tried(loud).failures}


def test_an_output_that_stays_on_is_never_asked_for_more_than_it_may() -> None:
    # given a generator that was left on and cannot be switched off
    asked = []

    class Stuck(Wrapped):
        def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
            asked.append(2 * largest_volts(stimulus))
            played: Stimulus = self.inside.prepare(stimulus, trigger)
            return played

        def output(self, on: bool) -> None:
            if not on:
                raise LinkTimeout("no answer")
            self.inside.output(on)

    stuck = stand()
    stuck.generator = Stuck(OnAtOpening(stuck.generator))
    report = tried(stuck)
    # then nothing beyond max_vpp is asked for, and the rules that would ask say why
    assert max(asked) <= MAX_VPP
    status = {one.rule: one.seen for one in report.failures}
    assert status["refuses_amplitude"] == "LinkTimeout: no answer"


@pytest.mark.parametrize("max_vpp", [0.0, -1.0, math.nan])
def test_a_span_of_nothing_is_refused(max_vpp: float) -> None:
    there = stand()
    with pytest.raises(RefusedInput, match="max_vpp"):
        check_generator(there.generator, max_vpp=max_vpp)
    with pytest.raises(RefusedInput, match="max_vpp"):
        check_digitizer(there.digitizer, generator=there.generator, max_vpp=max_vpp)


def test_a_generator_alone_and_one_too_coarse_are_told_what_does_not_apply() -> None:
    def lacking(report: Any) -> set[str]:
        report.require()
        return {one.rule for one in report.results if one.status == "not_applicable"}

    assert lacking(check_generator(stand().generator, max_vpp=MAX_VPP)) == {
        "output_off_at_opening",
        "output_switches",
        "pulse_arrives",
    }
    # one millivolt is the smallest amplitude: nothing but 0 V can be played
    quiet = check_generator(stand().generator, max_vpp=1e-3)
    assert {"prepares_sines", "prepares_pulses"} <= lacking(quiet)
    assert "nothing but 0 V" in quiet.plays[0]


def test_a_digitizer_is_started_by_whatever_is_given() -> None:
    # given a digitizer alone, and one with something else that triggers it
    alone = stand()
    report = check_digitizer(alone.digitizer, clock=alone.plant.clock).require()
    assert {one.rule for one in report.results if one.status != "holds"} == {"refuses_foreign_words"}
    (without,) = (one for one in report.results if one.rule == "takes_every_trigger")
    assert "not generator" in without.seen
    there, started = stand(), []
    there.generator.prepare(there.player.pulse(), "generator")

    def start() -> None:
        started.append(1)
        there.generator.trigger()

    report = check_digitizer(there.digitizer, start=start, clock=there.plant.clock).require()
    (with_start,) = (one for one in report.results if one.rule == "takes_every_trigger")
    assert with_start.seen == "immediate, generator, digitizer"
    assert started


def test_what_is_left_open_works_afterwards() -> None:
    there = stand()
    tried(there, close=False).require()
    check_digitizer(
        there.digitizer, generator=there.generator, max_vpp=MAX_VPP, clock=there.plant.clock, close=False
    ).require()
    there.generator.prepare(Sine(1e6, 0.1), "immediate")
    there.digitizer.arm(WindowRequest(1, 4, 10))
    assert there.digitizer.read(1.0).shot == 1
