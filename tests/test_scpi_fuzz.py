"""Damaged messages: nothing escapes, the device goes on answering, and never plays beyond its limits."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest
from damaged_messages import check_answers_on, is_legal, lines_of, mutated, some_bytes
from kept_memory import Kept
from message_counts import counts

from belahil.generators import FAMILIES, MODELS, GeneratorModel, GeneratorSetting, per_50_ohm
from sim.devices.generator import GeneratorDevice
from sim.devices.generator_families import generator_device
from sim.devices.scpi import ScpiDevice

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
OTHER_LINES = [
    b"FUNC USER", b"FUNC:USER VOLATILE", b"FUNC:USER SINC;USER?", b"DATA VOLATILE,0,.5,-1,2",
    b"DATA:DAC VOLATILE,0,100,-8191,8191,1,2,3,4", b"DATA:DAC VOLATILE,#216" + bytes(range(16)),
    b"DATA:COPY A1,VOLATILE;CAT?", b"DATA:DEL A1", b"DATA:NVOL:CAT?;FREE?", b"DATA:ATTR:PTP? VOLATILE;CFAC?",
    b"TRIG:SOUR BUS;SLOP NEG", b"OUTP:TRIG ON", b"UNIT:ANGL RAD", b"SYST:COMM:RLST LOC", b"PULS:PER 1E-6",
    b"BURS:TRIG:SOUR MAN;TRIGO POS", b"BURS:TDEL 1E-6;:BURS ON", b"FUNC:ARB:MODE SRAT;SRAT 60E6",
    b"DATA:DAC16 VOLATILE,CON,#216" + bytes(range(16)), b"DATA:DAC16 VOLATILE,END,#216" + bytes(16),
    b"DATA:LOAD? VOLATILE;LOAD? 1", b"DATA:VAL? VOLATILE,3;POIN? VOLATILE", b"APPL:USER 1E6,2,0.1,30;:APPL?",
    b"SOUR2:APPL:ARB 1E6,2", b"BURS:TRIG", b"TRIG1:IMM", b"OUTP1:IMP 75;LOAD?",
    b"FUNC:USER A1;:FUNC USER;*SAV 2",
    b"FUNC:USER SINC;:DATA:DEL A1;*RCL 2", b"SOUR2:FREQ 40E6;VOLT 9",
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
SIGLENT_LINES = [
    b"C1:OUTP ON,LOAD,50", b"C1:OUTP ON", b"C1:OUTP OFF;OUTP?", b"C1:OUTP LOAD,HZ", b"C1:BSWV FRQ,2E6;BSWV?",
    b"C1:BSWV WVTP,SINE,FRQ,1000000HZ,AMP,0.5V", b"C1:BSWV OFST,0.1,AMP,0.02", b"C2:BSWV WVTP,SQUARE",
    b"C1:BTWV STATE,ON,TRSR,MAN,TIME,1", b"C1:BTWV STATE,OFF", b"C1:BTWV MTRIG", b"C1:BTWV?",
    b"C1:WVDT WVNM,a1,WAVEDATA," + bytes(range(32)), b"C1:ARWV NAME,a1", b"C1:ARWV?", b"STL? USER",
    b"C1:SRATE MODE,TARB,VALUE,75000000", b"C1:BSWV WVTP,ARB", b"C1:BSWV PHSE,90", b"C1:BSWV AMP,1E9",
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
            # Siglent's smallest number is the same at every load. A change of the load rescales what is set,
            # as owners have measured; that 2 mVpp into no load become 1 mVpp into 50 ohm is assumed.
            least = self.model.min_amplitude_vpp * unit / (2 if "Siglent" in self.model.manufacturer else 1)
            assert amplitude == 0 or amplitude >= least * (1 - 1e-6)
        assert self.model.min_sine_hz <= setting.frequency_hz <= self.model.max_sine_hz
        assert 1 <= setting.load_ohm <= self.model.load_span_ohm[1] or setting.load_ohm == float("inf")
        assert 0 <= setting.trigger_delay_s <= self.model.max_delay_s
        if setting.arb is not None:
            # By the frequency of the whole, points may follow each other as fast as they like.
            by_rate = self.model.arb_played_by == "rate" and self.model.max_points > 65_536
            by_rate &= "Siglent" not in self.model.manufacturer
            fastest = self.model.max_arb_rate_hz if by_rate else float("inf")
            assert 0 < setting.arb.sample_rate_hz <= fastest
            assert setting.arb.codes.size >= self.model.min_points

    def trigger(self) -> bool:
        return True


def spoken(device: ScpiDevice, draw: random.Random) -> list[bytes]:
    own = {"Siglent": SIGLENT_LINES + SDG_LINES, "TEKTRONIX": AFG_LINES}
    return (
        4 * own.get(re.split("[ ,]", device.identity)[0], [])
        + LINES
        + OTHER_LINES
        + lines_of(device, draw)
        + lines_of(device, draw)
    )


@pytest.mark.parametrize("count", counts(6_000))
@pytest.mark.parametrize("family", FAMILIES)
def test_no_damaged_message_escapes_or_stops_the_device(family: str, count: int) -> None:
    # given a generator of a family and damaged messages, END after each
    draw = random.Random(f"damage {family}")
    model = MODELS[sorted(FAMILIES[family])[-1]]
    port = Watched(model)
    device = generator_device(model, port)
    identity = device.identity.encode()
    lines, kept = spoken(device, draw), Kept(count)
    for number in range(count):
        # when they are sent
        data = some_bytes(draw) if number % 20 == 0 else mutated(draw.choice(lines), LINES, draw)
        device.write(data, end=True)
        # then nothing is raised, each answer is legal, and the device still says who it is
        while (answer := device.read()) is not None:
            assert is_legal(answer, identity), (data, answer)
        check_answers_on(device, identity, data)
        kept.look(number)
    # and the damage was no idle one, and the device keeps little of it: short waveforms, cached forms
    assert port.changes > count // 200
    assert kept.growth_bytes < 1_000_000


def test_without_end_a_device_clear_is_enough_to_be_in_step_again() -> None:
    draw = random.Random("no END")
    device = GeneratorDevice(MODELS["33522B"], Watched(MODELS["33522B"]))
    for _ in range(3000):
        data = mutated(draw.choice(LINES), LINES, draw)
        cut = draw.randint(0, len(data))
        device.write(data[:cut])
        device.write(data[cut:])
        device.clear()
        device.write(b"*OPC?\n")
        assert device.read() == b"1\n", data
