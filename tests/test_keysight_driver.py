"""The generator driver on an emulated instrument: what is sent, what is proved, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.errors import (
    CorruptData,
    InstrumentError,
    InstrumentRefused,
    Interfered,
    LimitExceeded,
    LinkClosed,
    StaleData,
)
from belahil.generators import (
    MODELS,
    ArbBlock,
    GeneratorSetting,
    on_grid,
    setting_for,
    stimulus_of,
)
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from drivers.generators.dialect import Shown, agrees
from drivers.generators.keysight import KeysightDialect
from drivers.generators.verified import VerifiedGenerator
from drivers.scpi import ScpiSession
from drivers.visa_link import VisaLink
from sim.devices.generator import GeneratorDevice
from sim.plant import PlantClock
from sim.transports.visa_library import EmulatedVisa

ADDRESS = "USB0::0x0957::0x2C07::MY1::INSTR"
PULSE = SampledPulse(np.array([0.0, 0.02, 0.1, 0.03, 0.0]), 80e6)


class Port:
    """Where the generator plays into."""

    def __init__(self) -> None:
        self.settings = [GeneratorSetting()]
        self.triggers = 0

    def play(self, setting: GeneratorSetting) -> None:
        self.settings.append(setting)

    def trigger(self) -> bool:
        self.triggers += 1
        return True


class Instrument(GeneratorDevice):
    """A generator that keeps what it was sent, and can be tampered with on the way."""

    def __init__(self, model: str = "33522B") -> None:
        self.port = Port()
        self.sent: list[bytes] = []
        self.tamper = lambda message: message
        super().__init__(MODELS.get(model, replace(MODELS["33522B"], name=model)), self.port)

    def write(self, data: bytes, end: bool = False) -> None:
        self.sent.append(data)
        super().write(self.tamper(data), end)

    def commands(self) -> list[str]:
        """Return what was sent since the last call, without questions."""
        units = b";".join(self.sent).decode("latin-1").replace("\n", "").split(";")
        self.sent.clear()
        return [unit for unit in units if "?" not in unit and not unit.startswith("*ESE")]


def _opened(
    instrument: Instrument, load_ohm: float = 50.0, largest_v: float = 5.0
) -> tuple[VerifiedGenerator, PlantClock]:
    clock = PlantClock()
    link = VisaLink(ADDRESS, EmulatedVisa(clock).plug(ADDRESS, instrument))
    session = ScpiSession(link, clock, ADDRESS)
    return VerifiedGenerator(session, KeysightDialect(), load_ohm, largest_v), clock


def test_opening_resets_switches_off_and_sets_load_and_limits() -> None:
    # given an instrument that is left on, with another load
    instrument = Instrument()
    instrument.write(b"OUTP:LOAD INF;:VOLT 3;:OUTP ON;:FOO\n")
    # when it is opened with a limit of 0.1234 V
    generator, _ = _opened(instrument, largest_v=0.1234)
    # then it is off, silent, limited by itself, and its error queue is empty
    channel = instrument.channels[0]
    assert instrument.port.settings[-1] == GeneratorSetting(function="DC", amplitude_vpp=0.1)
    assert (channel.limits_on, channel.limit_high_v, channel.limit_low_v) == (True, 0.1234, -0.1234)
    assert not instrument.status.errors
    assert generator.identity == "Agilent Technologies,33522B,EMULATED,0.00-emulated"
    assert generator.limits is MODELS["33522B"]


@pytest.mark.parametrize("model", ["33509B", "33622A"])
def test_limits_follow_the_model(model: str) -> None:
    generator, _ = _opened(Instrument(model))
    assert generator.limits is MODELS[model]


def test_an_unknown_model_is_one_clear_line() -> None:
    with pytest.raises(
        InstrumentError, match=r"generator model '33120A' .* is unknown; known: 33509B"
    ) as caught:
        _opened(Instrument("33120A"))
    assert caught.value.exit_status == 3


def test_only_what_has_changed_is_sent() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(Sine(1e6, 0.05), "immediate")
    generator.output(True)
    instrument.commands()
    # when only the frequency changes, only that is sent, and the output stays on
    generator.prepare(Sine(2e6, 0.05), "immediate")
    generator.output(True)
    assert instrument.commands() == [":SOUR1:FREQ 2000000.0"]
    # when nothing changes, nothing is set, but everything is read back
    generator.prepare(Sine(2e6, 0.05), "immediate")
    assert b":SOUR1:VOLT?" in instrument.sent[-1]
    assert instrument.commands() == []
    # when the shape changes, the output is off meanwhile
    generator.prepare(NoSignal(), "immediate")
    assert instrument.commands()[0] == ":OUTP1 0"


def test_the_range_is_found_for_a_pulse_and_then_held() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    # given a sine, for which the instrument finds ranges by itself
    generator.prepare(Sine(1e6, 0.05), "immediate")
    assert instrument.channels[0].autorange == "ON"
    # when a pulse is prepared, the range is found for its amplitude and held
    generator.prepare(PULSE, "generator")
    assert instrument.channels[0].autorange == "OFF"
    instrument.commands()
    # when only its amplitude changes, the range is found once more
    generator.prepare(replace(PULSE, volts=2 * PULSE.volts), "generator")
    held = ":SOUR1:VOLT:RANG:AUTO"
    assert instrument.commands() == [f"{held} ON", ":SOUR1:VOLT 0.4", f"{held} OFF"]
    # and silence or a sine have it on again
    generator.prepare(NoSignal(), "immediate")
    assert instrument.channels[0].autorange == "ON"
    generator.prepare(PULSE, "generator")
    generator.prepare(Sine(1e6, 0.05), "immediate")
    assert instrument.channels[0].autorange == "ON"


def test_a_pulse_is_sent_once_and_only_its_trigger_changes_later() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(PULSE, "generator")
    generator.output(True)
    instrument.commands()
    generator.prepare(replace(PULSE, start_s=1e-6), "digitizer")
    assert instrument.commands() == [":OUTP:TRIG 0", ":TRIG1:SOUR EXT", ":TRIG1:DEL 1e-06"]
    generator.prepare(PULSE, "generator")
    generator.trigger()
    assert instrument.port.triggers == 1
    # another rate needs no other points; other points do, even when all their statistics are the same
    generator.prepare(replace(PULSE, sample_rate_hz=40e6), "generator")
    assert not any("DATA" in command for command in instrument.commands())
    generator.prepare(replace(PULSE, volts=np.roll(PULSE.volts, 1)), "generator")
    assert any("DATA:ARB:DAC" in command for command in instrument.commands())


_VOLTS = st.floats(2.5e-3, 0.4)  # the least at high impedance is 2 mVpp
_SINES = st.builds(Sine, st.floats(1.0, 30e6), _VOLTS, st.floats(-0.05, 0.05))
_PULSES = st.builds(
    SampledPulse,
    st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=40).map(np.array),
    st.floats(1e3, 250e6),
    st.floats(0, 1e-3),
    st.sampled_from(["linear", "hold"]),
)
# One interval later: a pulse may begin with a jump.
_PULSES = _PULSES.map(lambda one: replace(one, start_s=one.start_s + 1 / one.sample_rate_hz))
_STIMULI = st.one_of(_SINES, _PULSES, st.just(NoSignal()), st.just(TransmittedPulse()))


@settings(max_examples=60)
@given(
    plan=st.lists(st.tuples(_STIMULI, st.sampled_from(["generator", "digitizer"])), max_size=5),
    load_ohm=st.sampled_from([50.0, 75.0, math.inf]),
    model=st.sampled_from(["33522B", "33622A"]),
)
def test_what_is_played_is_what_the_setting_says(
    plan: list[tuple[Stimulus, str]], load_ohm: float, model: str
) -> None:
    # given an instrument whose own limits just allow what comes
    instrument = Instrument(model)
    generator, clock = _opened(instrument, load_ohm, largest_v=0.25)
    for stimulus, trigger in plan:
        wanted = setting_for(stimulus, MODELS[model], load_ohm, trigger)
        if wanted.amplitude_vpp / 2 + abs(wanted.offset_v) > 0.25:
            continue
        # when a stimulus is prepared and the output is switched on
        played = generator.prepare(stimulus, trigger)
        generator.output(True)
        # then the instrument plays exactly that, at the first try
        assert stimulus_of(instrument.port.settings[-1]) == stimulus_of(wanted)
        assert played == on_grid(stimulus, MODELS[model], load_ohm, trigger)
        assert clock.now_s() == 0
    generator.close()
    assert not instrument.port.settings[-1].output


def test_what_the_model_cannot_make_is_refused_before_anything_is_sent() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    instrument.sent.clear()
    with pytest.raises(LimitExceeded):
        generator.prepare(Sine(31e6, 0.1), "immediate")
    assert instrument.sent == []


def test_what_the_instrument_refuses_comes_with_its_number_and_the_output_is_off() -> None:
    # given an instrument that shall not exceed 0.1 V
    instrument = Instrument()
    generator, _ = _opened(instrument, largest_v=0.1)
    generator.prepare(Sine(1e6, 0.1), "immediate")
    generator.output(True)
    # when it is asked for more
    with pytest.raises(InstrumentRefused, match='33522B refused: -222 "Data out of range') as caught:
        generator.prepare(Sine(1e6, 0.3), "immediate")
    # then it says why, and is off; and it serves again
    assert caught.value.reason == -222
    assert not instrument.port.settings[-1].output
    assert generator.prepare(Sine(1e6, 0.1), "immediate") == Sine(1e6, 0.1)


def test_a_command_that_was_damaged_once_is_repeated() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)

    def once(message: bytes) -> bytes:
        instrument.tamper = lambda intact: intact
        return message.replace(b"FREQ 1", b"FREQ 3")

    instrument.tamper = once
    generator.prepare(Sine(1e6, 0.05), "immediate")
    generator.output(True)
    assert instrument.port.settings[-1].frequency_hz == 1e6


def test_a_command_that_is_always_damaged_is_never_relied_on() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(Sine(2e6, 0.05), "immediate")
    generator.output(True)
    instrument.tamper = lambda message: message.replace(b"FREQ 1", b"FREQ 3")
    with pytest.raises(CorruptData, match=r"FREQ 1000000\.0 was to give 1000000\.0.*answers \+3"):
        generator.prepare(Sine(1e6, 0.05), "immediate")
    assert not instrument.port.settings[-1].output


@pytest.mark.parametrize("place", range(0, 40, 3))
def test_a_damaged_block_is_found(place: int) -> None:
    # given a line that flips one bit of each block
    instrument = Instrument()
    generator, _ = _opened(instrument)

    def flipped(message: bytes) -> bytes:
        if b"DATA:ARB:DAC" not in message:
            return message
        at = len(message) - 2 - place
        return message[:at] + bytes([message[at] ^ 1 << place % 8]) + message[at + 1 :]

    instrument.tamper = flipped
    # when a pulse is prepared, then it is not relied on
    with pytest.raises((CorruptData, InstrumentRefused)):
        generator.prepare(replace(PULSE, volts=np.linspace(-0.1, 0.1, 20), start_s=1e-6), "generator")
    assert not instrument.port.settings[-1].output


def test_an_instrument_that_lacks_a_command_says_so() -> None:
    # given an older firmware without the trigger output
    instrument = Instrument()
    generator, _ = _opened(instrument)
    instrument.tamper = lambda message: message.replace(b":OUTP:TRIG", b":OUTP:TRAG")
    # when a pulse needs it, then the instrument's own words come, not a time-out
    with pytest.raises(InstrumentRefused, match='-113 "Undefined header') as caught:
        generator.prepare(PULSE, "generator")
    assert caught.value.reason == -113


def test_settings_that_someone_changed_are_found_and_restored() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(Sine(1e6, 0.05), "immediate")
    generator.output(True)
    # when someone changes the frequency, and then only the amplitude is to change
    instrument.write(b"FREQ 5E6\n")
    with pytest.raises(Interfered, match=r"FREQ\? answers \+5.*, and 1000000\.0 was set: another program"):
        generator.prepare(Sine(1e6, 0.06), "immediate")
    # then it is told, and preparing it again sets everything
    generator.prepare(Sine(1e6, 0.06), "immediate")
    assert instrument.port.settings[-1].frequency_hz == 1e6


@pytest.mark.parametrize("deed", [b"*ESE 99\n", b"OUTP OFF\n"])
def test_who_spoke_to_the_instrument_meanwhile_is_found_by_one_short_question(deed: bytes) -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(Sine(1e6, 0.05), "immediate")
    generator.output(True)
    # given nobody else, it is confirmed as often as one likes
    generator.confirm()
    generator.confirm()
    generator.confirm(whole=True)
    # when somebody asks as our drivers do, or switches the output off
    instrument.write(deed)
    with pytest.raises(Interfered, match="another program"):
        generator.confirm()
    # then nothing is relied on until everything was set again
    with pytest.raises(StaleData):
        generator.confirm()
    instrument.commands()
    generator.prepare(Sine(1e6, 0.05), "immediate")
    generator.output(True)
    assert "*RST" in instrument.commands()
    generator.confirm(whole=True)
    assert instrument.port.settings[-1].output
    assert instrument.port.settings[-1].frequency_hz == 1e6


def test_a_hand_at_the_panel_is_found_by_reading_everything_back() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(PULSE, "generator")
    generator.output(True)
    instrument.write(b":VOLT:LIM:STAT OFF\n")
    with pytest.raises(Interfered, match=r"LIM:STAT\? answers 0, and 1 was set"):
        generator.confirm(whole=True)


def test_closing_never_raises_and_switches_off() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    generator.prepare(Sine(1e6, 0.05), "immediate")
    generator.output(True)
    instrument.tamper = lambda message: b"" if b"OUTP1 0" in message else message
    assert not generator.close()
    assert instrument.port.settings[-1].output
    generator, _ = _opened(instrument := Instrument())
    generator.output(True)
    assert generator.close()
    # and says the same when it is closed again, and nothing else
    assert generator.close()
    sent = len(instrument.port.settings)
    for verb in (lambda: generator.output(True), generator.trigger):
        with pytest.raises(LinkClosed, match="the driver was closed"):
            verb()
    assert len(instrument.port.settings) == sent
    assert not instrument.port.settings[-1].output


@pytest.mark.parametrize(
    ("answer", "expected", "same"),
    [
        ("+1.000000000000000E+06", 1e6, True),
        ("+1.000000000000001E+06", 1e6, False),
        ("+9.9E+37", 9.9e37, True),
        ('"B0A1"', "B0A1", True),
        ("B0A2", "B0A1", False),
        ("+1.234E-01", Shown(0.12341), True),
        ("+1.234E-01", Shown(0.12352), False),
        ("+1.234100000000000E-01", Shown(0.1234), False),
        ("+5", Shown(5), True),
        ("", 1.0, False),
        ("one", Shown(1.0), False),
    ],
)
def test_answers_are_compared_to_the_digits_that_they_show(
    answer: str, expected: str | float | Shown, same: bool
) -> None:
    assert agrees(answer, expected) == same


def test_the_block_that_arrives_has_the_codes_that_were_sent() -> None:
    instrument = Instrument()
    generator, _ = _opened(instrument)
    pulse = SampledPulse(np.sin(np.arange(5000) / 7) * 0.1, 80e6)
    generator.prepare(pulse, "generator")
    wanted = setting_for(pulse, MODELS["33522B"], 50.0, "generator")
    assert isinstance(wanted.arb, ArbBlock)
    assert instrument.port.settings[-1].arb == wanted.arb
