"""The page on the GRM link is true: its examples are what the code sends, its Python does what it says."""

from __future__ import annotations

import re
import zlib
from binascii import crc_hqx
from dataclasses import replace

import numpy as np
import pytest
from cobs import cobs
from grm_bench import FakeClock
from hypothesis import example, given
from hypothesis import strategies as st
from page_receiver import PAGE, PageReceiver, cobs_decode, cobs_encode, crc16, crc32

from belahil.bench import READ_TIMEOUT_S
from belahil.errors import InstrumentRefused
from belahil.grm_link import (
    MAX_PACKET_BYTES,
    MAX_SEGMENT_BYTES,
    Acknowledge,
    HousekeepingReport,
    IdentityReport,
    Reason,
    Refusal,
    SpecReport,
    Telecommand,
    Telemetry,
    Verb,
    WindowAssembler,
    framed,
    pack_window,
    read_answer,
    segments,
    telecommand,
    telemetry,
)
from belahil.grm_link.answers import MAX_TEXT_BYTES
from belahil.grm_link.spec import FASTEST_HZ, MOST_BITS, MOST_SAMPLES, SLOWEST_HZ
from belahil.receiver import DigitizerSpec
from belahil.values import Candidate, RangeWindow, WindowRequest
from drivers.grm import GrmDigitizer
from drivers.grm_rules import (
    INTERVAL_TOLERANCE,
    LARGEST_SPAN_V,
    LARGEST_ZERO_COUNT,
    SMALLEST_SPAN_V,
    check_window,
    spans_of,
)
from drivers.grm_session import ANSWER_TIMEOUT_S, READ_BYTES
from drivers.serial_link import DEFAULT_BAUD
from procedures.dark_noise import LEAST_SAMPLES
from sim.devices.grm import LONGEST_DELAY_S


def examples() -> dict[str, bytes]:
    found = re.findall(r"```hex (.+?)\n(.*?)```", PAGE, re.DOTALL)
    return {
        name: bytes.fromhex("".join(re.split(r"\s{2,}", line)[0] for line in block.splitlines()))
        for name, block in found
    }


REQUEST = WindowRequest(shot=7, gain_code=4, sample_count=5, delay_s=1e-6, trigger="generator")
SPEC = DigitizerSpec(80e6, 12, 2, 16064, (0, 1, 4))
WINDOW = RangeWindow(
    counts=np.array([-2048, -1, 0, 1, 2047], np.int16),
    volts_per_count=2 / 4096,
    zero_count=0.0,
    sample_interval_s=12.5e-9,
    start_s=1e-6,
    gain_code=4,
    shot=7,
    saturated=2,
    candidates=(Candidate(25e-9, 21e-9, 0.11, (0, 1), 2),),
    housekeeping={"temperature_k": 293.15},
)


def session() -> dict[str, bytes]:
    abort, identify, spec = (telecommand(v, n) for n, v in enumerate([Verb.ABORT, Verb.IDENTIFY, Verb.SPEC]))
    arm = telecommand(Verb.ARM, 3, REQUEST)
    refused = telecommand(Verb.ARM, 4, replace(REQUEST, gain_code=16))
    housekeeping = telecommand(Verb.HOUSEKEEPING, 5)
    first, last = segments(WINDOW, arm.request_id, 64)
    packets = {
        "abort": abort,
        "acknowledge of abort": telemetry(Acknowledge(abort.request_id), 0),
        "identify": identify,
        "identity": telemetry(IdentityReport(identify.request_id, "Example receiver, 17"), 1),
        "spec command": spec,
        "spec": telemetry(SpecReport(spec.request_id, SPEC), 2),
        "arm": arm,
        "acknowledge of arm": telemetry(Acknowledge(arm.request_id), 3, 1.5),
        "first segment": telemetry(first, 4, 2.25),
        "last segment": telemetry(last, 5, 2.25),
        "refusal": telemetry(Refusal(refused.request_id, 3, "gain code 16; allowed: 0, 1, 4"), 6),
        "housekeeping command": housekeeping,
        "housekeeping": telemetry(HousekeepingReport(housekeeping.request_id, {"temperature_k": 293.15}), 7),
        "checked abort": replace(abort, checked=True),
        "checked acknowledge": telemetry(Acknowledge(abort.request_id), 0, checked=True),
    }
    made = {name: packet.pack() for name, packet in packets.items()}
    for name in ("abort", "acknowledge of abort"):
        made[f"{name} on a serial line"] = framed(made[name], "cobs")
    return made


def test_every_example_is_what_the_code_sends() -> None:
    assert examples() == session()


def test_the_window_of_the_examples_keeps_the_rules_of_the_page() -> None:
    answers = [
        read_answer(Telemetry.unpack(examples()[name])) for name in ("spec", "first segment", "last segment")
    ]
    assembler = WindowAssembler(answers[1].request_id, 7)
    *_, window = [assembler.add(segment) for segment in answers[1:]]

    assert window.equals(WINDOW)
    check_window(window, REQUEST, answers[0].spec)


some_bytes = st.binary(max_size=700) | st.integers(0, 800).map(lambda size: b"\x01" * size)


@given(some_bytes)
@example(b"\x01" * 254)
@example(b"\x01" * 254 + b"\0")
@example(b"\x01" * 508)
def test_the_cobs_of_the_page_is_that_of_the_package(data: bytes) -> None:
    stuffed = cobs_encode(data)

    assert stuffed == cobs.encode(data)
    assert cobs_decode(stuffed) == data
    assert cobs.decode(stuffed) == data


@given(st.binary(max_size=300))
def test_the_cobs_of_the_page_refuses_what_the_package_refuses(data: bytes) -> None:
    outcomes = []
    for decode, error in ((cobs.decode, cobs.DecodeError), (cobs_decode, ValueError)):
        try:
            outcomes.append(decode(data))
        except error:
            outcomes.append(None)

    assert outcomes[0] == outcomes[1]


def test_the_page_says_right_what_a_final_code_means() -> None:
    full = b"\xff" + b"\x01" * 254

    assert cobs.decode(full) == cobs.decode(full + b"\x01") == b"\x01" * 254


@given(st.binary(max_size=200))
def test_the_checksums_of_the_page_are_those_of_the_code(data: bytes) -> None:
    assert crc16(data) == crc_hqx(data, 0xFFFF)
    assert crc32(data) == zlib.crc32(data)


def test_the_check_values_of_the_page() -> None:
    assert f"0x{crc_hqx(b'123456789', 0xFFFF):X}" in PAGE
    assert f"0x{zlib.crc32(b'123456789'):X}" in PAGE


def test_the_reasons_and_commands_of_the_page_are_those_of_the_code() -> None:
    rows = re.findall(r"^\| (\d+) \| ([A-Z_]+) \|", PAGE, re.MULTILINE)

    listed = [(verb.value, verb.name) for verb in Verb] + [(reason.value, reason.name) for reason in Reason]
    assert [(int(number), name) for number, name in rows] == listed


@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        (MAX_PACKET_BYTES, "packet of at most {} octets"),
        (MAX_SEGMENT_BYTES, "part of the payload | at most {} octets"),
        (READ_BYTES, "reads with a buffer of {} octets"),
        (DEFAULT_BAUD, "no flow control; {} baud"),
        (len(Telecommand(200, 1, 0).pack()), "from {} octets (telecommand)"),
        (len(Telemetry(1, 1, 0).pack()), "{} octets (telemetry) to 16 384 octets"),
        (MOST_SAMPLES, "u32 largest sample count | 1 to {} |"),
        (MOST_BITS, "of a converter, 1 to {} |"),
        (LEAST_SAMPLES, "which must be at least {}."),
        (LARGEST_ZERO_COUNT, "the count of 0 V, -65 536 to {};"),
    ],
)
def test_the_limits_of_the_page_are_those_of_the_code(number: int, sentence: str) -> None:
    assert sentence.format(f"{number:,}".replace(",", " ")) in PAGE


def test_the_ranges_of_the_page_are_those_of_the_code() -> None:
    assert f"must have at most {MAX_TEXT_BYTES} octets" in PAGE
    assert f"must hold 1 to {MAX_TEXT_BYTES} octets of UTF-8" in PAGE
    assert (SLOWEST_HZ, FASTEST_HZ) == (1, 1e12)
    assert "nominal; 1 to 10^12 |" in PAGE
    assert (SMALLEST_SPAN_V, LARGEST_SPAN_V) == (1e-3, 1e3)
    assert "times 2^bits, it is 1 mV to 1 kV" in PAGE
    assert INTERVAL_TOLERANCE == 1e-12
    assert "but for rounding (1 part in 10^12)" in PAGE
    assert LONGEST_DELAY_S >= 0.01
    assert "must accept delays from 0 to 0.01 s" in PAGE


def test_the_counts_of_the_page_are_those_of_the_code() -> None:
    spans = re.search(r"with 12 bits\s+from (-\d+) to (\d+) or from (\d+) to (\d+)", PAGE)
    assert spans is not None
    low, high, lowest, highest = map(int, spans.groups())
    assert spans_of(12) == ((low, high), (lowest, highest))
    assert [len(spans_of(bits)) for bits in (15, 16)] == [2, 1]

    sent = re.search(r"count (-1) is 0x(\w{4}), (0) is 0x(\w{4}), (4095) is 0x(\w{4})", PAGE)
    assert sent is not None
    counts, octets = sent.groups()[::2], bytes.fromhex("".join(sent.groups()[1::2]))
    window = replace(WINDOW, counts=np.array([*map(int, counts)], np.int16))
    assert pack_window(window)[48:54] == octets


def test_the_times_of_the_page_are_those_of_the_code() -> None:
    assert ANSWER_TIMEOUT_S == READ_TIMEOUT_S == 2.0
    assert "waits 2 s for each answer, and for the whole window 2 s + delay" in PAGE


# --- a receiver that was written from the page alone


def counts_of(shot: int, code: int, count: int) -> np.ndarray:
    return np.random.default_rng([shot, code]).integers(-2048, 2048, count).astype(np.int16)


@pytest.mark.parametrize("usb", [False, True], ids=["serial", "usb"])
def test_a_receiver_written_from_the_page_is_measured(usb: bool) -> None:
    receiver = PageReceiver(counts_of, usb)
    digitizer = GrmDigitizer(receiver, FakeClock(), "raw" if usb else "cobs")

    assert digitizer.identity == "Receiver from the page"
    assert digitizer.spec == DigitizerSpec(
        80e6,
        12,
        2,
        16064,
        tuple(range(16)),
        ("immediate",),
        ("window", "correlation_windows", "window_and_candidates"),
    )
    assert digitizer.housekeeping() == {"supply_v": 28.0}
    for shot in range(20):
        request = WindowRequest(shot, gain_code=shot % 16, sample_count=400 + shot)
        digitizer.arm(request)
        window = digitizer.read(1.0)
        assert np.array_equal(window.counts, counts_of(shot, shot % 16, 400 + shot))
        assert (window.shot, window.gain_code, window.volts_per_count) == (shot, shot % 16, 2 / 4096)
        # and the same with its candidate
        digitizer.arm(replace(request, products="window_and_candidates"))
        both = digitizer.read(1.0)
        assert np.array_equal(both.counts, window.counts)
        # and its candidate, without the samples
        digitizer.arm(replace(request, products="correlation_windows"))
        found = digitizer.read(1.0)
        assert both.candidates == found.candidates
        largest = int(window.counts.argmax())
        (candidate,) = found.candidates
        assert found.counts.size == 0
        assert candidate.arrival_s == largest * 12.5e-9
        assert candidate.amplitude_v == window.volts[largest]
        stretch = window.counts[candidate.first_sample : candidate.first_sample + 5]
        assert candidate.correlation_window == tuple(stretch.tolist())
        assert candidate.first_sample <= largest < candidate.first_sample + 5
    assert digitizer.dropped.stale == digitizer.dropped.damaged == 0
    for change, reason in [
        ({"gain_code": 16}, Reason.GAIN_CODE),
        ({"sample_count": 0}, Reason.SAMPLE_COUNT),
        ({"trigger": "generator"}, Reason.TRIGGER),
        ({"source": "transmit"}, Reason.SOURCE),
        ({"products": "candidates"}, Reason.PRODUCTS),
    ]:
        with pytest.raises(InstrumentRefused) as refusal:
            digitizer.arm(replace(WindowRequest(1, gain_code=1), **change))
        assert refusal.value.reason == reason
    digitizer.close()
