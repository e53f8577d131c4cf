"""Words that our drivers of oscilloscopes do not use, and others do: other names, numbers of a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scope_bench import config, device_of

from sim.build import endpoints

if TYPE_CHECKING:
    from sim.devices.oscilloscopes.acquisition import ScopeDevice


def scope(driver: str) -> ScopeDevice:
    device = device_of(endpoints(config(driver)))
    device.own.exchange = "stream"
    return device


def ask(device: ScopeDevice, text: str) -> str:
    """Send a message; return the last answer."""
    device.write(text.encode("latin-1") + b"\n", end=True)
    answer = b""
    while (one := device.read()) is not None:
        answer = one
    return answer.decode("latin-1").removesuffix("\n")


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.replace(";", ",").split(",")]


@pytest.mark.parametrize(
    ("driver", "message", "expected"),
    [
        # by the division, or over the whole screen
        ("keysight-infiniivision", ":CHAN1:SCAL 0.05;RANG?;SCAL?", [0.4, 0.05]),
        ("keysight-infiniivision", ":CHAN1:RANG 0.8;SCAL?;RANG?", [0.1, 0.8]),
        ("keysight-infiniivision", ":TIM:SCAL 2E-6;RANG?;SCAL?", [2e-5, 2e-6]),
        ("keysight-infiniivision", ":ACQ:COUN?;COUN 64;COUN?", [8, 64]),
        ("keysight-infiniivision", ":WAV:POIN 100;POIN?;:SING;:WAV:POIN?", [100, 100]),
        ("rigol-ds1000z", ":WAV:POIN?;STAR 5;POIN 100;POIN?;STOP?", [1200, 100, 104]),
        ("rigol-ds1000z", ":ACQ:AVER?;AVER 64;AVER?", [2, 64]),
        ("siglent-sds", "AVGA?;AVGA 32;AVGA?;C1:TRLV 0.1;C1:TRLV?", [16, 32, 0.1]),
        ("tektronix-mso", ":HEAD 0;:HOR:SCA 1E-6;SCA?;SAMPLER?;RECO?", [1e-6, 1e9, 1e4]),
        ("tektronix-mso", ":HEAD 0;:HOR:SCA 1E-9;SAMPLER?;RECO?", [3.125e9, 1e4]),
        ("tektronix-mso", ":HEAD 0;:ACQ:NUMAV?;NUMAV 4;NUMAV?;:CH1:PROBEF:EXTA 10;EXTA?", [16, 4, 10]),
        ("tektronix-mso", ":HEAD 0;:TRIG:A:LEV:CH2 0.2;CH1?;CH2?", [0, 0.2]),
    ],
)
def test_a_setting_is_told_as_it_was_set(driver: str, message: str, expected: list[float]) -> None:
    device = scope(driver)
    assert numbers(ask(device, message)) == pytest.approx(expected)
    assert ask(device, "SYST:ERR?").endswith('0,"No error"')


@pytest.mark.parametrize(
    ("driver", "take"),
    [
        ("keysight-infiniivision", ":TIM:RANG 1E-5;:SING;:TRIG:FORC"),
        ("rigol-ds1000z", ":TIM:SCAL 1E-6;:SING;:TFOR;:WAV:MODE RAW;STOP 12000"),
        ("rigol-ds1000z", ":TIM:SCAL 1E-6;:SING;:TFOR;:WAV:MODE MAX;POIN 7"),
        ("rigol-ds1000z", ":TIM:SCAL 1E-6;:SING;:TFOR"),
    ],
)
def test_each_number_of_a_record_is_that_of_the_preamble(driver: str, take: str) -> None:
    device = scope(driver)
    ask(device, take)
    record = device.record()
    assert record is not None
    preamble = ask(device, ":WAV:PRE?").split(",")
    assert ask(device, ":WAV:XINC?;XOR?;XREF?;YINC?;YOR?;YREF?").split(";") == preamble[4:]
    # and the times of the first and the last point are those of the record
    points, interval_s, start_s = int(preamble[2]), float(preamble[4]), float(preamble[5])
    step = round(interval_s / record.sample_interval_s)
    assert interval_s == pytest.approx(step * record.sample_interval_s, rel=1e-6)
    assert start_s == pytest.approx(record.start_s, abs=record.sample_interval_s)
    assert (points - 1) * step < record.counts.size


def test_a_screen_of_a_rigol_is_its_record_at_equal_steps() -> None:
    device = scope("rigol-ds1000z")
    ask(device, ":CHAN1:SCAL 0.01;:TIM:SCAL 1E-6;:SING;:TFOR;:WAV:FORM WORD")
    record = device.record()
    assert record is not None
    head, _, data = ask(device, ":WAV:DATA?").partition("2400")
    assert head == "#900000"
    assert np.frombuffer(data.encode("latin-1"), "<u2") == pytest.approx(record.counts[::10])


@pytest.mark.parametrize(
    ("driver", "setting", "force"),
    [
        ("keysight-infiniivision", ":CHAN1:INV 1", ":TRIG:FORC"),
        ("keysight-infiniivision", ":ACQ:MODE SEGM", ":TRIG:FORC"),
        ("rigol-ds1000z", ":CHAN1:INV 1", ":TFOR"),
        ("siglent-sds", "C1:INVS ON", "FRTR"),
    ],
)
def test_what_would_give_other_volts_takes_no_record(driver: str, setting: str, force: str) -> None:
    device = scope(driver)
    single = "TRMD SINGLE" if driver == "siglent-sds" else ":SING"
    ask(device, f"{setting};{single};{force}")
    assert ask(device, "SYST:ERR?").startswith("-221,")
    assert device.record() is None
    ask(device, f"*RST;{single};{force}")
    assert device.record() is not None


def test_a_siglent_remembers_what_lecroy_calls_its_own_too() -> None:
    # as PyMeasure sets a T3DSO1204
    device = scope("siglent-sds")
    words = "C1:UNIT?;C1:INVS?;C1:TRCP?;C1:SKEW?"
    assert ask(device, words) == "V;OFF;DC;0.00E+00"
    assert ask(device, f"C1:UNIT A;C1:INVS ON;C1:TRCP HFREJ;C1:SKEW 50NS;{words}") == "A;ON;HFREJ;5.00E-08"
    assert ask(device, "SYST:ERR?").endswith('0,"No error"')


def test_a_tektronix_tells_counts_as_whole_numbers() -> None:
    device = scope("tektronix-mso")
    assert ask(device, ":HEAD 0;:HOR:MOD:RECO?;:ACQ:NUMAV?;:DAT:STAR?") == "10000;16;1"


def test_all_settings_of_a_channel_and_of_time_come_at_once() -> None:
    device = scope("keysight-infiniivision")
    assert ask(device, ":CHAN2:COUP AC;:CHAN2?").split(":CHAN2:")[1].split(";")[2:8] == [
        "COUP AC", "IMP ONEM", "DISP 1", "BWL 0", "INV 0", 'LAB "1"',
    ]  # fmt: skip
    assert ask(device, ":TIM:RANG 2E-5;REF LEFT;:TIM?").startswith(":TIM:MODE MAIN;REF LEFT;MAIN:RANG +2.0")


@pytest.mark.parametrize(
    ("message", "codes"),
    [
        ("C1:VDIV 1", "0;0"),
        ("NONE?", "1;0"),
        ("AVGA", "4;0"),
        ("AVGA 5", "0;25"),
        ("ACQW AVERAGE,3", "0;25"),
        ("ACQW SAMPLING,4", "7;0"),
        ("AVGA 5;*CLS", "0;0"),
    ],
)
def test_registers_of_a_siglent_tell_the_last_error_once(message: str, codes: str) -> None:
    device = scope("siglent-sds")
    ask(device, message)
    assert ask(device, "CMR?;EXR?") == codes
    assert ask(device, "CMR?;EXR?") == "0;0"
    assert ask(device, "ACQW AVERAGE,64;ACQW?;ACQW SAMPLING;ACQW?") == "AVERAGE,64;SAMPLING"


def test_a_tektronix_tells_all_events_at_once() -> None:
    device = scope("tektronix-mso")
    ask(device, ":HEAD 0;:NONE?")
    ask(device, ":CURVE?")
    assert ask(device, "ALLE?") == '-113,"Undefined header; NONE",+2244,"Waveform requested is not active"'
    assert ask(device, "ALLE?") == '0,"No events to report; queue empty"'
