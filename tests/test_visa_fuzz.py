"""The emulated VISA library, called in any order: errors are VISA's own, answers whole, nothing is kept."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from damaged_messages import HEADER, ITEM, is_legal, mutated
from kept_memory import Kept
from message_counts import counts
from pyvisa.constants import BufferOperation, ResourceAttribute, StatusCode, TriggerProtocol
from pyvisa.errors import VisaIOError
from scope_bench import config

from belahil.oscilloscopes import SCOPES
from sim.build import SCOPE_ADDRESS, VISA_ADDRESS, endpoints

GENERATOR = [
    b"*RST;:OUTP ON", b"FREQ 3E6;:VOLT 0.05;:OUTP ON", b"FUNC SIN;FREQ?;:VOLT?", b"*ESR?;*STB?",
    b"*CLS;*SRE 48",
    b"DATA:ARB a1,0,.5,1,.5,0,0,0,0", b"FUNC:ARB A1;:FUNC ARB;:BURS:STAT 1;:TRIG:SOUR BUS;:OUTP ON", b"*TRG",
    b"DATA:VOL:CAT?", b"*IDN?",
]  # fmt: skip
SCOPE = {
    "keysight-infiniivision": [
        b":CHAN1:RANG 0.5;:TIM:RANG 1E-5;POS 5E-6;:TRIG:SWE NORM", b":SING", b":SING;:TRIG:FORC;:AER?;:TER?",
        b":WAV:POIN 1000;SOUR CHAN1;FORM WORD", b":WAV:PRE?", b":WAV:DATA?", b':CHAN1:LAB "S7";LAB?',
        b"*IDN?",
    ],
    "rigol-ds1000z": [
        b":RUN;:ACQ:MDEP 12000", b":CHAN1:SCAL 0.05;:TIM:SCAL 1E-5", b":SING", b":SING;:TFOR;:TRIG:STAT?",
        b":WAV:SOUR CHAN1;MODE RAW;STAR 1;STOP 1200", b":WAV:DATA?", b":WAV:PRE?", b"*IDN?",
    ],
    "siglent-sds": [
        b"C1:VDIV 0.05;TDIV 1E-6;MSIZ 14K", b"TRMD SINGLE", b"TRMD SINGLE;FRTR;INR?", b"C1:WF? DAT2",
        b"WFSU NP,1000,FP,0", b"WFSU FP,7;WFSU?", b"*IDN?",
    ],
    "tektronix-mso": [
        b":CH1:SCA 0.05;:HOR:MOD:SAMPLER 1E8;RECO 1000", b":TRIG:A:MOD NORM;:ACQ:STATE RUN",
        b":ACQ:STATE RUN;:TRIG FORC;:ACQ:NUMAC?", b":DAT:STOP 1000;:CURV?", b":WFMO:XZE?;YMU?", b"*IDN?",
    ],
}  # fmt: skip
# The words of either are sent to both, so those of all families are allowed.
ANY_ITEM = rb"(?:[A-Za-z0-9.+-]+|%b%b|:?[A-Z0-9:]+ %b)" % (HEADER, ITEM, ITEM)


class Caller:
    """Sessions to both instruments of a bench, and what was read of an answer that has not ended."""

    def __init__(self, driver: str, draw: random.Random) -> None:
        ends = endpoints(config(driver))
        self.draw, self.visa = draw, ends.visa_library
        self.clock_s = ends.clock.now_s
        self.manager, _ = self.visa.open_default_resource_manager()
        self.lines = {VISA_ADDRESS: GENERATOR, SCOPE_ADDRESS: SCOPE[driver]}
        self.names: dict[int, str] = {}
        self.begun: dict[int, bytes] = {}
        self.read_whole = 0
        self.open()

    def open(self) -> None:
        for name in (VISA_ADDRESS, SCOPE_ADDRESS):
            session, _ = self.visa.open(self.manager, name)
            self.visa.ignore_warning(session, StatusCode.success_max_count_read).__enter__()
            self.names[session], self.begun[session] = name, b""

    def close(self) -> None:
        for session in self.names:
            self.visa.close(session)
        # a session that was closed is none
        with pytest.raises(VisaIOError) as caught:
            self.visa.read_stb(session)
        assert caught.value.error_code == StatusCode.error_invalid_object
        self.names, self.begun = {}, {}
        self.open()

    def write(self, session: int) -> None:
        line = self.draw.choice(self.lines[self.names[session]])
        if self.draw.randrange(3) == 0:
            line = mutated(line, self.lines[self.names[session]], self.draw)
        stop = self.draw.choice([len(line), len(line), self.draw.randint(0, len(line))])
        for part in (line[:stop], line[stop:]):
            assert self.visa.write(session, part)[0] == len(part)
        self._forget(session)

    def _forget(self, session: int) -> None:
        """All sessions to an instrument share what was not read."""
        for other, name in self.names.items():
            if name == self.names[session]:
                self.begun[other] = b""

    def read(self, session: int) -> None:
        count = self.draw.choice([1, 7, 1000, 1 << 20])
        before_s = self.clock_s()
        try:
            data, status = self.visa.read(session, count)
        except VisaIOError as error:
            data, status = b"", error.error_code
        if status == StatusCode.error_timeout:
            # nothing to say is a time-out, for which time passes
            assert self.clock_s() - before_s == pytest.approx(2.0)
            return
        assert status >= 0
        assert 0 < len(data) <= count
        self.begun[session] += data
        if status == StatusCode.success:
            answer, self.begun[session] = self.begun[session], b""
            if b"DAT2,#" in answer:
                answer = answer[:-1]  # Siglent's waveforms have a line feed too many
            assert is_legal(answer, self.identity(session), ANY_ITEM), (answer[:200], answer[-50:])
            self.read_whole += 1

    def identity(self, session: int) -> bytes:
        device = self.visa._sessions[session].device
        text: str = device.identity
        return text.encode()

    def clear(self, session: int) -> None:
        self.visa.clear(session)
        self._forget(session)

    def flush(self, session: int) -> None:
        self.visa.flush(session, BufferOperation.discard_read_buffer)
        self.begun[session] = b""

    def poll(self, session: int) -> None:
        assert 0 <= self.visa.read_stb(session)[0] <= 255

    def trigger(self, session: int) -> None:
        self.visa.assert_trigger(session, TriggerProtocol.default)
        self._forget(session)

    def switch(self, session: int) -> None:
        attribute = self.draw.choice([ResourceAttribute.send_end_enabled, ResourceAttribute.termchar_enabled])
        self.visa.set_attribute(session, attribute, self.draw.random() < 0.8)
        assert self.visa.get_attribute(session, attribute)[0] in (True, False)


@pytest.mark.parametrize("count", counts(250))
@pytest.mark.parametrize("driver", sorted(SCOPES))
def test_calls_in_any_order_end_as_visa_has_it(driver: str, count: int) -> None:
    calls_in_any_order(driver, count, f"calls {driver}")


def calls_in_any_order(driver: str, count: int, seed: str) -> None:
    # given sessions to a generator and an oscilloscope on one plant
    draw = random.Random(seed)
    caller, kept = Caller(driver, draw), Kept(count)
    verbs: list[Callable[[int], None]] = [
        *4 * [caller.write], *6 * [caller.read], caller.clear, caller.flush, caller.poll, caller.trigger,
        caller.switch,
    ]  # fmt: skip
    session = -1
    for number in range(count):
        # when anything is called, some calls long on one session
        if number % 100 == 0:
            caller.close()
        if number % 4 == 0:
            session = draw.choice(list(caller.names))
        draw.choice(verbs)(session)
        # then after a clear each instrument says who it is
        if number % 20 == 19:
            for each in caller.names:
                caller.clear(each)
                caller.visa.set_attribute(each, ResourceAttribute.send_end_enabled, True)
                caller.visa.write(each, b"*CLS;*IDN?")
                assert caller.visa.read(each, 1000)[0] == caller.identity(each) + b"\n"
        kept.look(number)
    # and many answers came, and little is kept
    assert caller.read_whole > count // 100
    assert kept.growth_bytes < 1_000_000
