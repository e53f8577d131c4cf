"""Damaged messages: nothing escapes, the device goes on answering, and never plays beyond its limits."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest

from belahil.generators import MODELS, GeneratorModel, GeneratorSetting, per_50_ohm
from sim.devices.generator import GeneratorDevice
from sim.devices.generator_families import generator_device

LINES = [
    b"*IDN?", b"*RST", b"*CLS;*ESE 255;*SRE 32", b"*ESR?;*STB?;*OPC?", b"*TRG;*WAI", b"*OPC", b"*TST?",
    b"SYST:ERR?", b":SYSTem:ERRor:NEXT?;:SYST:VERS?", b"STAT:QUES:ENAB 4096;COND?;EVEN?",
    b"SOUR1:FUNC SIN", b"FUNCtion:SHAPe ARB", b"FUNC RAMP", b"SOUR2:FUNC PULS", b"FUNC DC",
    b"FREQ 1.5 MHZ;FREQ?", b"SOURce1:FREQuency:CW 1E6", b"FREQ MAX", b"FREQ? MIN",
    b"VOLT 50 MVPP;VOLT?;VOLT? MAX", b"VOLT 0.1 VRMS", b"VOLT -10 DBM", b"VOLT:UNIT DBM", b"VOLT:UNIT VPP",
    b"VOLT:OFFS 10 MV;OFFS?", b"VOLT:HIGH 0.3;LOW -0.1;HIGH?;LOW?", b"VOLT:LIM:HIGH 2;LOW -2;STAT ON",
    b"VOLT:LIM:STAT OFF", b"VOLT:RANG:AUTO ONCE", b"OUTP:LOAD INF", b"OUTP:LOAD 75 OHM;LOAD?",
    b"OUTP1 ON", b"OUTP2:STAT 0", b"OUTP:SYNC:SOUR CH2", b"OUTP:POL INV", b"PHAS 90 DEG;PHAS?",
    b"FUNC:PULS:PER 1e-6;WIDT 2e-8;TRAN:BOTH 1e-8", b"FUNC:SQU:DCYC 20 PCT",
    b"FUNC:ARB:SRAT 80 MSA/S;FILT STEP",
    b"BURS:STAT 1;NCYC 1;MODE TRIG;PHAS 0;INT:PER 1 MS", b"BURS:NCYC INF;NCYC?",
    b"TRIG:SOUR BUS;DEL 1E-6;SLOP NEG", b"TRIG1:SOUR IMM", b"APPL:SIN 1 MHZ,0.05 VPP,0 V;:APPL?",
    b"APPL:ARB 1e6,1,DEF", b"DATA:VOL:CLE", b"DATA:VOL:CAT?;FREE?", b"FORM:BORD SWAP",
    b"DATA:ARB a1,0,.1,.2,.3,.4,.5,.6,.7", b"SOUR1:DATA:ARB:DAC b_2, 1,2,3,4,-5,6,7,32767",
    b"DATA:ARB:DAC c,#216" + bytes(range(16)), b"DATA:ARB d,#232" + np.arange(8, dtype=">f4").tobytes(),
    b"DATA:ARB e,#0" + bytes(32), b"FUNC:ARB A1", b'FUNC:ARB "INT:\\BUILTIN\\EXP_RISE.ARB"',
    b"DATA:ATTR:AVER?;PTP? A1;CFAC?;POIN?", b"DISP:TEXT 'it''s \"on\"';TEXT?", b"SYST:BEEP", b"#HFF", b"",
]  # fmt: skip
PIECES = [
    b";", b":", b",", b" ", b"?", b"*", b"#", b"#0", b"#3", b"#9999999999", b"'", b'"', b"\n", b"\r",
    b"\0", b"\xff", b"\t", b"1e400", b"-1E-400", b"9.9E37", b"#HFFFFFFFFFFFFFFFF", b"1" * 50, b"A" * 20,
    b"MIN", b"MAX", b"INF", b"NAN", b"DEF", b" MHZ", b"e", b"-", b".", b"SOUR2:", b"SOUR9:", b";:", b"(1)",
]  # fmt: skip


class Watched:
    """A plant that plays nothing and refuses what no instrument could play."""

    def __init__(self, model: GeneratorModel) -> None:
        self.model = model
        self.changes = 0

    def play(self, setting: GeneratorSetting) -> None:
        self.changes += 1
        unit = per_50_ohm(setting.load_ohm)
        amplitude = 0.0 if setting.function == "DC" else setting.amplitude_vpp
        if setting.function != "OTHER":
            assert abs(setting.offset_v) + amplitude / 2 <= self.model.max_peak_v * unit * (1 + 1e-9)
            assert amplitude == 0 or amplitude >= self.model.min_amplitude_vpp * unit * (1 - 1e-6)
        assert self.model.min_sine_hz <= setting.frequency_hz <= self.model.max_sine_hz
        assert 1 <= setting.load_ohm <= self.model.load_span_ohm[1] or setting.load_ohm == float("inf")
        assert 0 <= setting.trigger_delay_s <= self.model.max_delay_s
        if setting.arb is not None:
            # By the frequency of the whole, points may follow each other as fast as they like.
            by_rate = self.model.arb_played_by == "rate" and self.model.max_points > 65_536
            fastest = self.model.max_arb_rate_hz if by_rate else float("inf")
            assert 0 < setting.arb.sample_rate_hz <= fastest
            assert setting.arb.codes.size >= self.model.min_points

    def trigger(self) -> bool:
        return True


def mutated(line: bytes, draw: random.Random) -> bytes:
    """Damage a line in one to three places."""
    data = bytearray(line)
    for _ in range(draw.randint(1, 3)):
        place = draw.randint(0, len(data))
        kind = draw.randrange(6)
        if kind == 0:
            del data[place : place + draw.randint(1, 4)]
        elif kind == 1:
            data[place:place] = draw.choice(PIECES)
        elif kind == 2 and place < len(data):
            data[place] = draw.randrange(256)
        elif kind == 3:
            other = draw.choice(LINES)
            data[place:] = other[draw.randint(0, len(other)) :]
        elif kind == 4:
            data[place:place] = data[draw.randint(0, len(data)) :]
        else:
            data += b";" + draw.choice(LINES)
    return bytes(data[:2000])


@pytest.mark.parametrize("name", ["33522B", "33611A"])
def test_no_damaged_message_escapes_or_stops_the_device(name: str) -> None:
    # given a generator and 50 000 damaged messages for each of two models, END after each
    draw = random.Random(f"damage {name}")
    port = Watched(MODELS[name])
    device = GeneratorDevice(MODELS[name], port)
    identity = device.identity.encode() + b"\n"
    for _ in range(50_000):
        # when they are sent
        data = mutated(draw.choice(LINES), draw)
        device.write(data, end=True)
        # then nothing is raised, each answer is one line, and the device still says who it is
        while (answer := device.read()) is not None:
            assert answer.endswith(b"\n")
            assert b"\n" not in answer[:-1]
        device.write(b"*IDN?\n")
        assert device.read() == identity, data
        device.write(b"SYST:ERR?\n")
        error = device.read()
        assert error is not None
        assert re.fullmatch(rb'[+-]\d+,"[ !#-~]*"\n', error)
    # and the damage was no idle one
    assert port.changes > 500


OTHER_LINES = [
    b"FUNC USER", b"FUNC:USER VOLATILE", b"FUNC:USER SINC;USER?", b"DATA VOLATILE,0,.5,-1,2",
    b"DATA:DAC VOLATILE,0,100,-8191,8191,1,2,3,4", b"DATA:DAC VOLATILE,#216" + bytes(range(16)),
    b"DATA:COPY A1,VOLATILE;CAT?", b"DATA:DEL A1", b"DATA:NVOL:CAT?;FREE?", b"DATA:ATTR:PTP? VOLATILE;CFAC?",
    b"TRIG:SOUR BUS;SLOP NEG", b"OUTP:TRIG ON", b"UNIT:ANGL RAD", b"SYST:COMM:RLST LOC", b"PULS:PER 1E-6",
    b"BURS:TRIG:SOUR MAN;TRIGO POS", b"BURS:TDEL 1E-6;:BURS ON", b"FUNC:ARB:MODE SRAT;SRAT 60E6",
    b"DATA:DAC16 VOLATILE,CON,#216" + bytes(range(16)), b"DATA:DAC16 VOLATILE,END,#216" + bytes(16),
    b"DATA:LOAD? VOLATILE;LOAD? 1", b"DATA:VAL? VOLATILE,3;POIN? VOLATILE", b"APPL:USER 1E6,2,0.1,30;:APPL?",
    b"SOUR2:APPL:ARB 1E6,2", b"BURS:TRIG", b"TRIG1:IMM", b"OUTP1:IMP 75;LOAD?", b"SOUR2:FREQ 40E6;VOLT 9",
]  # fmt: skip


AFG_LINES = [
    b"DATA:DATA EMEM,#210" + bytes(range(10)), b"DATA:DATA:VAL? EMEM,3;:DATA? EMEM", b"DATA:COPY USER2,EMEM",
    b"SOUR1:FUNC EMEM;:SOUR1:FREQ:FIX 1E6", b"SOUR1:FUNC USER2;:DATA:DEL USER2;:*SAV 1;*RCL 1",
    b"SOUR1:BURS:TDEL 1US;NCYC 1;STAT ON;:*TRG", b"SOUR1:VOLT:LEV:IMM:AMPL 0.5VPP;:OUTP1:STAT ON;IMP INF",
    b"TRIG:SEQ:SOUR EXT", b"DATA:DEF EMEM2,20;POIN EMEM,30", b"*RST;:SOUR1:FUNC:SHAP SIN;:OUTP1 ON",
]  # fmt: skip
SDG_LINES = [
    b"C1:BSWV WVTP,ARB,FRQ,1e6,AMP,0.5V,OFST,10mV;C1:BSWV?", b"C1:OUTP ON,LOAD,50,PLRT,INVT;C1:OUTP?",
    b"C1:WVDT WVNM,W,LENGTH,16B,WAVEDATA," + bytes(range(16)), b"C1:ARWV NAME,W;C1:ARWV?;STL? USER",
    b"C1:WVDT WVNM,W,WAVEDATA," + bytes(range(1, 21)), b"C1:BTWV STATE,ON,TRSR,MAN,TIME,1;C1:BTWV MTRIG",
    b"C1:SRATE MODE,TARB,VALUE,75e6,INTER,HOLD;C1:SRATE?", b"C2:BSWV PERI,1e-9,HLEV,2,LLEV,3;C2:BSWV?",
    b"C1:BTWV STATE,OFF;C1:BSWV WVTP,SINE", b"WVDT? USER,W",
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "own"),
    [("33220A", OTHER_LINES), ("DG1062Z", OTHER_LINES), ("AFG3152C", AFG_LINES), ("SDG2042X", SDG_LINES)],
)
def test_no_damaged_message_escapes_from_the_other_families(name: str, own: list[bytes]) -> None:
    # given 5000 damaged messages of these families and of Keysight's
    draw = random.Random(f"damage {name}")
    port = Watched(MODELS[name])
    device = generator_device(MODELS[name], port)
    for _ in range(5000):
        data = mutated(draw.choice(own if draw.random() < 0.6 else LINES), draw)
        device.write(data, end=True)
        # then nothing is raised, and the device still says who it is and what was wrong
        while device.read() is not None:
            pass
        device.write(b"*IDN?\n")
        assert device.read() == device.identity.encode() + b"\n", data
        device.write(b"SYST:ERR?\n")
        error = device.read()
        assert error is not None
        assert re.fullmatch(rb'[+-]?\d+,"[ !#-~]*"\n', error)
    assert port.changes > 100


def test_without_end_a_device_clear_is_enough_to_be_in_step_again() -> None:
    draw = random.Random("no END")
    device = GeneratorDevice(MODELS["33522B"], Watched(MODELS["33522B"]))
    for _ in range(3000):
        data = mutated(draw.choice(LINES), draw)
        cut = draw.randint(0, len(data))
        device.write(data[:cut])
        device.write(data[cut:])
        device.clear()
        device.write(b"*OPC?\n")
        assert device.read() == b"1\n", data
