"""Damaged messages to oscilloscopes: nothing escapes, they go on, and are set to what they can do."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from damaged_messages import HEADER, ITEM, check_answers_on, is_legal, lines_of, mutated, some_bytes
from kept_memory import Kept
from message_counts import counts

from belahil.oscilloscopes import SCOPES, ScopeModel
from belahil.values import RangeWindow, WindowRequest
from sim.devices.oscilloscopes.acquisition import LARGEST_SHOT
from sim.devices.oscilloscopes.families import DEVICES

COMMON = [
    b"*IDN?", b"*RST", b"*CLS;*ESE 255;*SRE 32", b"*ESR?;*STB?;*OPC?", b"*OPC;*WAI", b"*TRG", b"*TST?",
    b"*SAV 1;*RCL 1", b"*RCL 2", b"*LRN?", b"SYST:ERR?", b"STAT:OPER:ENAB 8;COND?;EVEN?", b"#HFF", b"",
]  # fmt: skip
OWN = {
    "keysight-infiniivision": [
        b":STOP", b":SING;:TRIG:FORC", b":RUN;:AER?;:TER?;:OPER:COND?", b":DIG CHAN1", b":TRIG:SWE NORM",
        b":CHAN1:RANG 0.5;OFFS 10 MV;RANG?;OFFS?", b":CHAN2:PROB 10;IMP FIFT;COUP AC;BWL 1",
        b":TIM:RANG 1E-4;POS 5E-5;REF LEFT;RANG?", b":TIM:RANG 20 NS", b":TIM:REF RIGHT;:SING",
        b':CHAN1:LAB "SHOT 7";LAB?', b":CHAN1:LAB 'it''s \"on\"';LAB?", b':CHAN1:LAB "S4294967296";:SING',
        b":WAV:POIN 1000;POIN?;:ACQ:POIN?;SRAT?", b":WAV:POIN 500000", b":WAV:POIN:MODE RAW;:WAV:UNS 0",
        b":WAV:SOUR CHAN1;FORM WORD;BYT LSBF;UNS 1;PRE?", b":WAV:FORM ASC;DATA?", b":WAV:FORM BYTE;DATA?",
        b":WAV:SOUR CHAN2;DATA?", b":WAV:DATA?", b":WAV:XINC?;XOR?;XREF?;YINC?;YOR?;YREF?",
        b":TRIG:EDGE:SOUR EXT;SLOP POS;:EXT:LEV 1;LEV?",
        b":TRIG:EDGE:LEV 1,CHAN2;LEV? CHAN2", b":TIM:MODE MAIN;:ACQ:TYPE NORM",
        b":CHAN1:SCAL 0.1;SCAL?;INV 0;:CHAN2?;:TIM:SCAL 1E-5;SCAL?;:TIM?", b":CHAN1:INV 1;:SING;:CHAN1:INV 0",
        b":ACQ:COUN 8;MODE RTIM;COUN?", b":WAV:POIN 100;POIN?", b":SYST:PRES",
    ],
    "rigol-ds1000z": [
        b":STOP", b":SING;:TRIG:STAT?", b":TFOR;:TRIG:STAT?", b":RUN;:ACQ:MDEP 12000;:STOP;:ACQ:MDEP?",
        b":RUN;:ACQ:MDEP 120000", b":RUN;:ACQ:MDEP 1E400;MDEP 12000000", b":CLE;:TRIG:SWE SING",
        b":SING;:TFOR;:TRIG:STAT?", b":SING;:TFOR",
        b":CHAN1:SCAL 0.1;OFFS -0.2;SCAL?;OFFS?", b":CHAN4:PROB 10;COUP AC;BWL 20M;VERN 1;BWL?",
        b":TIM:MAIN:SCAL 1E-5;OFFS 6E-5;SCAL?", b":TIM:SCAL 5 NS;:ACQ:SRAT?", b":TIM:MAIN:OFFS -500",
        b":TRIG:SPI:WIDT 32;DATA 7;DATA?", b":TRIG:SPI:DATA 4294967295;:SING", b":TRIG:SPI:WIDT 4",
        b":WAV:SOUR CHAN1;MODE RAW;FORM BYTE;STAR 1;STOP 1200;PRE?;DATA?", b":WAV:FORM WORD;DATA?",
        b":WAV:FORM ASC;STAR 5;STOP 100;DATA?", b":WAV:STAR 1000;STOP 10;DATA?;STOP?", b":WAV:PRE?",
        b":TRIG:EDG:SOUR EXT;SLOP POS;LEV 1;LEV?", b":WAV:STOP 250001;DATA?", b":ACQ:TYPE NORM",
        b":WAV:MODE NORM;POIN 1200;DATA?", b":WAV:MODE MAX;POIN?;XINC?;XOR?;XREF?;YINC?;YOR?;YREF?",
    ],
    "siglent-sds": [
        b"STOP", b"TRMD SINGLE;INR?", b"FRTR;INR?;SAST?", b"ARM;FRTR", b"TRMD AUTO;TRMD?", b"CHDR OFF;CHDR?",
        b"C1:VDIV 0.1;C1:OFST 10MV;C1:VDIV?;C1:OFST?", b"C4:ATTN 10;C2:CPL A1M;C3:TRA OFF",
        b"ACQW AVERAGE,16;ACQW?;AVGA 4;AVGA?", b"C1:TRLV 0.1;C1:TRSL NEG;CMR?;EXR?",
        b"TDIV 1E-6;TRDL -7E-6;TDIV?;TRDL?", b"TDIV 1NS;SARA?;SANU? C1", b"MSIZ 14K;MSIZ?", b"MSIZ 140K",
        b"MSIZ 1.4M", b"MSIZ 9999999K", b"WFSU SP,1,NP,0,FP,0;WFSU?", b"WFSU FP,7;TRMD SINGLE",
        b"WFSU SP,4,NP,100,FP,14000", b"C1:WF? DAT2", b"C2:WF? DAT2", b"C1:WF? DESC", b"C1:WF? DAT2;*OPC?",
        b"TRSE EDGE,SR,EX,HT,TI,HV,2US;TRSE?", b"TRSE 'a','\"','\xb5\xff';TRSE?", b"BWL C1,OFF;BWL?",
        b"EX:TRSL NEG;EX:TRLV 1;EX:TRLV?", b"ACQW SAMPLING;ACQW?",
    ],
    "tektronix-mso": [
        b":ACQ:STATE STOP", b":ACQ:STATE RUN;STATE?;NUMAC?;:TRIG:STATE?", b":TRIG FORC;:ACQ:NUMAC?;:BUSY?",
        b":HEAD 0;VERB 0;HEAD?", b":CH1:SCA 0.05;POS -1;OFFS 10MV;SCA?", b":CH4:COUP AC;BAN 20E6;:SEL:CH2 1",
        b":HOR:MOD MAN;MOD:SAMPLER 100E6;RECO 1000;RECO?", b":HOR:MOD:SAMPLER MAX", b":HOR:MOD:RECO 1234.5",
        b":HOR:DEL:MOD 1;TIM 5E-6;:HOR:POS 30", b":HOR:DEL:MOD 0;:HOR:POS 100",
        b":HOR:MOD:SAMPLER 1;RECO 1E5",
        b':CH1:LAB:NAM "SHOT 7";NAM?', b":CH1:LAB:NAM 'it''s \"on\"';NAM?",
        b':CH1:LAB:NAM "SHOT ' + b"9" * 5000,
        b":DAT:SOU CH1;ENC RIB;STAR 1;STOP 1000;:CURV?", b":WFMO:BYT_N 2;:CURV?", b":DAT:ENC RPB;:CURV?",
        b":DAT:STAR 900;STOP 10;:CURV?", b":WFMO:XIN?;XZE?;YMU?;YOF?;YZE?;NR_P?;PT_O?;BYT_O?;BN_F?",
        b":DAT:SOU CH2;:CURV?", b":TRIG:A:MOD NORM;TYP EDGE;EDGE:SOU AUX;SLO RIS;:TRIG:AUXL 1;AUXL?",
        b":TRIG:A:MOD AUTO;:ACQ:STATE 1", b":ACQ:STATE ON;:TRIG FORC",
        b":ACQ:STATE RUN;:TRIG FORC;:CURV?", b":ACQ:MOD SAM;STOPA SEQ",
    ],
}  # fmt: skip


ITEMS = {
    # All settings of a channel, or of time, come behind their headers.
    "keysight-infiniivision": rb"(?::?[A-Z0-9:]+ )?" + ITEM,
    # Rigol's exponents are small letters; Siglent's words and numbers have no form of their own.
    "rigol-ds1000z": rb"(?:[+-]?\d\.\d+e[+-]\d\d|20M|%b)" % ITEM,
    "siglent-sds": rb"(?:[A-Za-z0-9.+-]+|%b)" % ITEM,
    "tektronix-mso": HEADER + ITEM,
}


class Watched:
    """A plant that gives records of all codes, and refuses what no oscilloscope could be set to."""

    def __init__(self, model: ScopeModel) -> None:
        self.model = model
        self.full_scale_v = self.offset_v = self.interval_s = math.nan
        self.records = 0
        self._armed: WindowRequest | None = None
        self._window: RangeWindow | None = None

    def arm(self, request: WindowRequest) -> None:
        request.check()
        model = self.model
        assert request.shot <= LARGEST_SHOT
        assert (request.gain_code, request.products, request.source) == (None, "window", "return")
        assert request.trigger in ("immediate", "generator")
        least = 100 if model.maker.startswith("KEYSIGHT") else model.record_lengths[0]
        assert least <= request.sample_count <= model.record_lengths[-1]
        assert 1e-4 < self.full_scale_v <= 1100
        assert abs(self.offset_v) <= 1000
        # The longest screen of an InfiniiVision is 500 s, also of its shortest record.
        slowest_s = 500 / least if model.maker.startswith("KEYSIGHT") else 1.0
        assert 1 / model.max_rate_hz * (1 - 1e-12) <= self.interval_s <= slowest_s
        self._armed, self._window = request, None
        if request.trigger == "immediate":
            self.fire()

    def prepare(self) -> None:
        pass

    def fire(self) -> None:
        """Let the trigger come."""
        request, self._armed = self._armed, None
        if request is None:
            return
        codes = np.arange(self.model.lowest_code, self.model.top_code + 1, dtype=np.int16)
        phase_s = self.interval_s / 3
        self.records += 1
        self._window = RangeWindow(
            np.resize(codes, request.sample_count),
            self.full_scale_v / self.model.code_count,
            self.model.zero_code - self.offset_v / self.full_scale_v * self.model.code_count,
            self.interval_s,
            round(request.delay_s / self.interval_s) * self.interval_s,
            None,
            shot=request.shot,
            housekeeping={"trigger_phase_s": phase_s},
        )

    def collect(self) -> RangeWindow | None:
        window, self._window = self._window, None
        return window

    def abort(self) -> None:
        self._armed = self._window = None


@pytest.mark.parametrize("count", counts(600))
@pytest.mark.parametrize("driver", sorted(SCOPES))
def test_no_damaged_message_escapes_or_stops_an_oscilloscope(driver: str, count: int) -> None:
    scope_fuzzed(driver, count, f"damage {driver}")


def scope_fuzzed(driver: str, count: int, seed: str) -> None:
    # given an oscilloscope of a family and damaged messages, END after each
    draw = random.Random(seed)
    port = Watched(SCOPES[driver])
    device = DEVICES[driver](port, port)
    identity = device.identity.encode()
    others = COMMON + OWN[driver]
    item = ITEMS.get(driver, ITEM)
    lines = others + 4 * OWN[driver] + lines_of(device, draw) + lines_of(device, draw)
    kept = Kept(count)
    for number in range(count):
        # when they are sent, and triggers come now and then
        data = some_bytes(draw) if number % 20 == 0 else mutated(draw.choice(lines), others, draw)
        if number % 50 == 0:
            data = b"*RST"
        device.write(data, end=True)
        if draw.randrange(3) == 0:
            port.fire()
        # then nothing is raised, each answer is legal, and the device still says who it is
        while (answer := device.read()) is not None:
            if driver == "siglent-sds" and answer.endswith(b"\n\n"):
                answer = answer[:-1]  # its waveforms have a line feed too many
            assert is_legal(answer, identity, item), (data, answer[:200], answer[-50:])
        check_answers_on(device, identity, data)
        kept.look(number)
    # and the damage was no idle one, and the device keeps little of it beside one record
    assert port.records > count // 100
    assert kept.growth_bytes < 1_000_000
