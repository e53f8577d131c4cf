"""Emulated oscilloscopes: what messages make of them, without a driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from scope_bench import config, device_of

from belahil.errors import RefusedInput
from belahil.oscilloscopes import SCOPES
from sim.build import endpoints
from sim.devices.oscilloscopes.acquisition import LARGEST_SHOT

if TYPE_CHECKING:
    from sim.devices.oscilloscopes.acquisition import ScopeDevice

DRIVERS = sorted(SCOPES)
LABEL = {
    "keysight-infiniivision": (":CHAN1:LAB", ":SING;:TRIG:FORC"),
    "tektronix-mso": (":CH1:LAB:NAM", ":ACQ:STATE RUN;:TRIG FORC"),
}


def ask(device: ScopeDevice, text: str) -> str:
    """Send a message; return the last answer."""
    device.write(text.encode("latin-1") + b"\n", end=True)
    answer = b""
    while (one := device.read()) is not None:
        answer = one
    return answer.decode("latin-1").removesuffix("\n")


def scope(driver: str) -> ScopeDevice:
    device = device_of(endpoints(config(driver)))
    device.own.exchange = "stream"  # so that reading until there is no more is no error
    return device


@pytest.mark.parametrize(
    ("driver", "shortest", "rate"),
    [
        ("keysight-infiniivision", ":TIM:RANG MIN;:SING;:TRIG:FORC", ":ACQ:SRAT?"),
        ("rigol-ds1000z", ":TIM:SCAL 5 NS;:SING;:TFOR", ":ACQ:SRAT?"),
        ("siglent-sds", "TDIV 1NS;TRMD SINGLE;FRTR", "SARA?"),
    ],
)
def test_no_screen_is_so_short_that_samples_come_faster_than_they_can(
    driver: str, shortest: str, rate: str
) -> None:
    device = scope(driver)
    ask(device, shortest)
    record, most_hz = device.record(), SCOPES[driver].max_rate_hz
    assert record is not None
    assert record.sample_interval_s == 1 / most_hz
    assert float(ask(device, rate)) == most_hz
    # and the record is about the trigger all the same
    half_s = record.counts.size / most_hz / 2
    assert record.start_s == pytest.approx(-half_s, abs=2 / most_hz)


@pytest.mark.parametrize(
    ("driver", "label", "shot"),
    [
        # a label of this one has ten characters
        ("keysight-infiniivision", "S7", 7),
        ("keysight-infiniivision", f"S{'9' * 5000}", 999_999_999),
        ("keysight-infiniivision", "SHOT 12345", 12345),
        ("keysight-infiniivision", "4294967295", LARGEST_SHOT),
        ("keysight-infiniivision", "7", None),
        ("tektronix-mso", "SHOT 4294967295", LARGEST_SHOT),
        ("tektronix-mso", "SHOT 4294967296", None),
        ("tektronix-mso", f"SHOT {'9' * 5000}", None),
    ],
)
def test_only_a_number_that_a_plan_may_have_is_a_shot(driver: str, label: str, shot: int | None) -> None:
    device, (header, start) = scope(driver), LABEL[driver]
    ask(device, f'{header} "{label}";{start}')
    assert device.shot() == shot
    record = device.record()
    assert record is not None
    assert record.shot == (shot or 0)


@pytest.mark.parametrize("driver", sorted(LABEL))
def test_a_label_is_answered_as_a_string(driver: str) -> None:
    device, header = scope(driver), LABEL[driver][0]
    device.headers = False  # type: ignore[attr-defined]
    assert ask(device, f"{header} 'a\"b';{header}?") == '"a""b"'


@pytest.mark.parametrize(
    ("setting", "answers"),
    [
        ("*RST", [":TRIGGER:A:EDGE:SLOPE RISE", ":ACQUIRE:STOPAFTER RUNSTOP", ":SELECT:CH2 1", ":HEADER 1"]),
        (":VERB 0", [":TRIG:A:EDGE:SLO RIS", ":ACQ:STOPA RUNST", ":SEL:CH2 1", ":HEAD 1"]),
        (":HEAD 0", ["RISE", "RUNSTOP", "1", "0"]),
        (":HEAD 0;VERB 0", ["RIS", "RUNST", "1", "0"]),
        (":HEAD 0;VERB 0;*RST", [":TRIGGER:A:EDGE:SLOPE RISE", ":ACQUIRE:STOPAFTER RUNSTOP"]),
    ],
)
def test_a_tektronix_answers_with_headers_and_long_words_until_it_is_told_otherwise(
    setting: str, answers: list[str]
) -> None:
    device = scope("tektronix-mso")
    ask(device, setting)
    said = ask(device, ":TRIG:A:EDGE:SLO?;:ACQ:STOPA?;:SEL:CH2?;:HEAD?")
    assert said.split(";")[: len(answers)] == answers
    # but common headers have no answers with headers
    assert ask(device, "*ESE 7;*ESE?") == "+7"


@pytest.mark.parametrize(
    ("driver", "refused", "question", "answer"),
    [
        ("rigol-ds1000z", ":RUN;:ACQ:MDEP 1E400", ":ACQ:MDEP?", "12000"),
        ("rigol-ds1000z", ":CHAN1:BWL 20M;BWL ON", ":CHAN1:BWL?", "20M"),
        ("siglent-sds", f"MSIZ {'9' * 400}M", "MSIZ?", "14K"),
        ("siglent-sds", "BWL C1,'\xb5'", "BWL?", "C1,OFF,C2,OFF,C3,OFF,C4,OFF"),
        ("siglent-sds", "BWL C1,OFF,C9,ON", "BWL?", "C1,OFF,C2,OFF,C3,OFF,C4,OFF"),
        ("siglent-sds", "STOP;MSIZ 140K", "MSIZ?", "14K"),
        ("siglent-sds", "TRSE EDGE,SR,'\"',HT,OFF", "TRSE?", "EDGE,SR,C1,HT,OFF"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(
    driver: str, refused: str, question: str, answer: str
) -> None:
    device = scope(driver)
    ask(device, refused)
    assert ask(device, question) == answer
    assert ask(device, "SYST:ERR?").startswith("-2")


def test_a_positive_trigger_delay_of_a_siglent_is_later() -> None:
    # given a screen of 14 us about the trigger, as a user measured it on an instrument
    device = scope("siglent-sds")
    for delay_s in (0.0, 20e-6, -2e-6):
        ask(device, f"TDIV 1E-6;TRDL {delay_s};TRMD SINGLE;FRTR")
        record = device.record()
        assert record is not None
        # then its middle is as much after the trigger as the delay says
        assert record.start_s == pytest.approx(delay_s - 7e-6, abs=1e-15)


def test_no_answer_follows_a_waveform_with_a_line_feed_too_many() -> None:
    device = scope("siglent-sds")
    ask(device, "TRMD SINGLE;FRTR;WFSU FP,0,NP,4")
    answer = ask(device, "C1:WF? DAT2;*OPC?")
    assert answer.startswith("DAT2,#9000000004")
    assert len(answer) == len("DAT2,#9000000004") + 4 + 1
    assert ask(device, "SYST:ERR?").startswith("-440")


def test_of_many_sample_rates_few_receivers_are_kept() -> None:
    device = scope("keysight-infiniivision")
    ask(device, ":TRIG:SWE AUTO")
    for number in range(20):
        ask(device, f":TIM:RANG {1e-5 * (1 + number)};:SING")
    front = device._front
    assert len(front._models) <= 8  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("driver", "changes", "questions"),
    [
        (
            "keysight-infiniivision",
            ':CHAN1:RANG 0.5;LAB "S7";:TIM:RANG 1E-5;REF LEFT;:WAV:POIN 2000',
            ":CHAN1:RANG?;LAB?;:TIM:RANG?;REF?;:WAV:POIN?",
        ),
        (
            "rigol-ds1000z",
            ":RUN;:ACQ:MDEP 120000;:STOP;:CHAN1:SCAL 0.1;:TRIG:SPI:WIDT 32;DATA 7;:WAV:STOP 99",
            ":ACQ:MDEP?;:CHAN1:SCAL?;:TRIG:SPI:WIDT?;DATA?;:WAV:STOP?",
        ),
        (
            "siglent-sds",
            "MSIZ 140K;C1:VDIV 0.1;WFSU SP,1,NP,5,FP,7;TRSE EDGE,SR,EX,HT,OFF;TRMD SINGLE",
            "MSIZ?;C1:VDIV?;WFSU?;TRSE?",
        ),
        (
            "tektronix-mso",
            ':CH1:SCA 0.05;LAB:NAM "SHOT 7";:HOR:MOD:RECO 2000;:DAT:STOP 9;:ACQ:STATE RUN',
            ":CH1:SCA?;LAB:NAM?;:HOR:MOD:RECO?;:DAT:STOP?",
        ),
    ],
)
def test_settings_come_back_from_their_place_and_nothing_waits(
    driver: str, changes: str, questions: str
) -> None:
    # given settings that are kept
    device = scope(driver)
    first = ask(device, questions)
    ask(device, f"{changes};*SAV 1")
    kept = ask(device, questions)
    assert kept != first
    # when the instrument is reset, and they are recalled
    ask(device, "*RST")
    assert ask(device, questions) == first
    ask(device, "*RCL 1")
    ask(device, "WFSU FP,9")  # a word of one of them, which what is kept must not follow
    ask(device, "*RCL 1")
    # then they are as before, and it is stopped
    assert ask(device, questions) == kept
    assert not device.is_armed
    # and none of them answers all settings at once
    ask(device, "*CLS;*LRN?")
    assert ask(device, "SYST:ERR?").startswith("-113")


def test_a_rate_at_which_no_noise_can_be_computed_is_a_conflict(monkeypatch: pytest.MonkeyPatch) -> None:
    # given an oscilloscope that holds a record
    device = scope("keysight-infiniivision")
    ask(device, ":SING")
    assert device.record() is not None

    def refuse() -> None:
        raise RefusedInput("beyond double precision")

    # when a record is to be taken for which there is no receiver
    monkeypatch.setattr(device._front, "prepare", refuse)
    ask(device, ":TRIG:SWE NORM;:SING")
    # then it says so, stops, and does not wait
    assert ask(device, "SYST:ERR?") == '-221,"Settings conflict; not emulated: beyond double precision"'
    assert ask(device, ":OPER:COND?") == "+0"
    assert not device.is_armed


def test_a_rigol_writes_numbers_as_rigol_does() -> None:
    talk = scope("rigol-ds1000z")
    assert ask(talk, ":CHAN1:SCAL?;:ACQ:AVER?;:SYST:ERR?") == '1.000000e+00;2;0,"No error"'
