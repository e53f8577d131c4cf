"""Damaged packets of the GRM link: what its checks promise, and that none is taken for a good one."""

from __future__ import annotations

import itertools
import math
import random
from collections import deque
from zlib import crc32

import pytest
from grm_bench import SPEC, FakeReceiver
from grm_cases import a_window
from kept_memory import Kept
from message_counts import counts

from belahil.errors import CorruptData
from belahil.grm_link import (
    Acknowledge,
    Framing,
    HousekeepingReport,
    IdentityReport,
    Refusal,
    SpecReport,
    Telecommand,
    Telemetry,
    Verb,
    crc16,
    framed,
    packet_stream,
    read_answer,
    segments,
    telecommand,
    telemetry,
)
from belahil.values import WindowRequest
from sim.devices.grm import GrmDevice

COUNTS = counts(4_000)
FRAMINGS: tuple[Framing, ...] = ("cobs", "raw")
KINDS = [Telecommand, Telemetry]


def packets(kind: type[Telecommand] | type[Telemetry]) -> list[bytes]:
    """Return packets of every sort, all with their second check."""
    if kind is Telecommand:
        asked = [telecommand(verb, 7 + verb, checked=True) for verb in Verb if verb is not Verb.ARM]
        arms = [WindowRequest(shot, shot % 16, 10 + shot, 1e-6 * shot, "generator") for shot in range(20)]
        commands = asked + [telecommand(Verb.ARM, 50 + arm.shot, arm, checked=True) for arm in arms]
        return [command.pack() for command in commands]
    answers = [
        Acknowledge(0x1864C001),
        Refusal(0x1864C002, 3, "gain code 16; allowed: 0 to 15"),
        IdentityReport(0x1864C003, "Fake receiver, number 1"),
        SpecReport(0x1864C004, SPEC),
        HousekeepingReport(0x1864C005, {"temperature_k": 293.15, "supply_v": 27.9}),
        *segments(a_window(samples=60), 0x1864C006, 90),
    ]
    return [telemetry(answer, number, 0.5, checked=True).pack() for number, answer in enumerate(answers)]


def mutated(data: bytes, other: bytes, draw: random.Random) -> bytes:
    """Damage bytes in one to four places, in each of the ways that lines and programs have."""
    spoiled = bytearray(data)
    for _ in range(draw.randint(1, 4)):
        at, run = draw.randrange(len(spoiled) + 1), draw.choice([1, 1, 1, 2, 3, 5, 9, 30])
        stop = min(len(spoiled), at + run)
        kind = draw.randrange(8)
        if kind == 0 and at < len(spoiled):
            spoiled[at] ^= 1 << draw.randrange(8)
        elif kind == 1:
            spoiled[at:stop] = draw.randbytes(stop - at)
        elif kind == 2:
            spoiled[at:stop] = bytes([draw.choice([0, 255])]) * (stop - at)
        elif kind == 3:
            del spoiled[at:stop]
        elif kind == 4:
            spoiled[at:at] = draw.randbytes(run)
        elif kind == 5:
            spoiled[at:at] = spoiled[at:stop]
        elif kind == 6:
            spoiled[at:] = other[at:]
        else:
            spoiled[at:stop] = reversed(spoiled[at:stop])
    return bytes(spoiled)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("framing", FRAMINGS)
def test_no_damaged_packet_is_taken_for_a_good_one(
    framing: Framing, kind: type[Telecommand] | type[Telemetry], count: int
) -> None:
    # given one stream on which every packet is damaged
    draw = random.Random(f"packets {framing} {kind.__name__}")
    sent = packets(kind)
    known = {kind.unpack(packet) for packet in sent}
    stream = packet_stream(kind, framing)
    kept = Kept(count)
    for number in range(count):
        one, other = draw.choice(sent), draw.choice(sent)
        if number % 2:
            # when the packet is damaged, or what is on the line
            data = framed(mutated(one, other, draw), framing)
        else:
            data = mutated(framed(one, framing), framed(other, framing), draw)
        # then nothing is raised, and whatever comes through is one that was sent
        assert known.issuperset(stream.feed(data)), data.hex()
        assert known.issuperset(stream.end()), data.hex()
        kept.look(number)
    # and the stream keeps nothing of them
    assert kept.growth_bytes < 50_000
    assert stream.damaged > count / 4


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize(("kind", "second_bits"), [(Telecommand, 16), (Telemetry, 32)])
def test_the_second_check_stops_what_the_first_lets_pass(
    kind: type[Telecommand] | type[Telemetry], second_bits: int, count: int
) -> None:
    # given damage that the CRC-16 does not see: changed octets, and the CRC-16 that belongs to them
    draw = random.Random(f"forged {kind.__name__}")
    sent = packets(kind)
    passed = 0
    for _ in range(count // 4):
        packet = draw.choice(sent)
        body = bytearray(packet[:-2])
        # the places of identification, length and PUS version have rules of their own
        for at in draw.sample([3, 7, 8, *range(11, len(body))], 3):
            body[at] = draw.randrange(256)
        forged = bytes(body) + crc16(bytes(body)).to_bytes(2, "big")
        if forged != packet:
            try:
                kind.unpack(forged)
            except CorruptData:
                continue
            passed += 1
    # then the second one does, but for one in 2^16 or 2^32; a Poisson number exceeds this once in 10^6 runs
    mean = count / 4 / 2**second_bits
    assert passed <= mean + 5 * math.sqrt(mean) + 3 * (second_bits == 16)


def syndromes(packet: bytes, second_bytes: int) -> list[list[int]]:
    """Return, for each octet and bit, by how much both checks, computed less sent, then change.

    The checks are linear, so the change of any damage is the exclusive or of those of its bits.
    """

    def checks(octets: bytes) -> int:
        blank = octets[:9] + bytes(second_bytes) + octets[9 + second_bytes : -2]
        found = int.from_bytes(octets[9 : 9 + second_bytes], "big")
        second = crc32(blank) % 256**second_bytes ^ found
        return second << 16 | crc16(octets)

    sound = checks(packet)
    return [
        [sound ^ checks(packet[:at] + bytes([packet[at] ^ 1 << bit]) + packet[at + 1 :]) for bit in range(8)]
        for at in range(len(packet))
    ]


def independent(values: list[int]) -> bool:
    """Whether no exclusive or of some of them is 0: then both checks see any damage made of their bits."""
    basis: list[int] = []
    for value in values:
        for known in basis:
            value = min(value, value ^ known)
        if not value:
            return False
        basis.append(value)
    return True


@pytest.mark.parametrize(
    ("packet", "octets", "second_bytes"),
    [
        (packets(Telecommand)[0], 2, 2),
        (packets(Telecommand)[-1], 2, 2),
        (packets(Telemetry)[0], 3, 4),
        pytest.param(packets(Telemetry)[0], 4, 4, marks=pytest.mark.slow),
    ],
    ids=["IDENTIFY", "ARM", "acknowledge", "acknowledge-4"],
)
def test_damage_to_a_few_octets_anywhere_is_always_seen(
    packet: bytes, octets: int, second_bytes: int
) -> None:
    # Octet 6 says whether there is a second check; what it may not be is refused for itself, see below.
    places = [at for at in range(len(packet)) if at != 6]
    changes = syndromes(packet, second_bytes)
    assert all(
        independent([value for at in chosen for value in changes[at]])
        for chosen in itertools.combinations(places, octets)
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_packet_cannot_lose_its_second_check_by_damage_to_few_octets(
    kind: type[Telecommand] | type[Telemetry],
) -> None:
    second_bytes = 2 if kind is Telecommand else 4
    for packet in packets(kind):
        for version in set(range(256)) - {packet[6]}:
            body = (
                packet[:6] + bytes([version]) + packet[7:9] + bytes(second_bytes) + packet[9 + second_bytes :]
            )
            with pytest.raises(CorruptData):
                kind.unpack(body)


@pytest.mark.parametrize("kind", KINDS)
def test_damage_of_up_to_16_bits_in_a_row_is_always_seen(kind: type[Telecommand] | type[Telemetry]) -> None:
    # Also without a second check: that is what a CRC-16 promises.
    draw = random.Random("bursts")
    for packet in packets(kind):
        number, bits = int.from_bytes(packet, "big"), 8 * len(packet)
        for at in range(bits - 15):
            burst = draw.randrange(1, 1 << 16)
            spoiled = (number ^ burst << at).to_bytes(len(packet), "big")
            assert crc16(spoiled) != 0


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("framing", FRAMINGS)
def test_a_receiver_acts_on_no_damaged_command_and_goes_on_answering(framing: Framing, count: int) -> None:
    # given a receiver whose every command is damaged
    draw = random.Random(f"receiver {framing}")
    sent = packets(Telecommand)
    numbers = {Telecommand.unpack(packet).request_id for packet in sent}
    armed = {arm for arm in map(Telecommand.unpack, sent) if arm.subtype == Verb.ARM}
    receiver = FakeReceiver()
    device, ears = GrmDevice(receiver, framing), packet_stream(Telemetry, framing)
    identify = framed(telecommand(Verb.IDENTIFY, 999, checked=True).pack(), framing)
    receiver.armed = deque(maxlen=1)  # type: ignore[assignment]
    for number in range(count // 10):
        device.write(mutated(framed(draw.choice(sent), framing), framed(draw.choice(sent), framing), draw))
        # then what it says is legal, and answers a command that was sent
        for packet in ears.feed(device.read(1 << 20)):
            answer = read_answer(packet)
            assert answer is not None
            assert answer.request_id in numbers
        if receiver.armed:
            assert receiver.armed[0].shot in range(len(armed))
        # and it answers who it is, behind a zero byte that ends what was left of the damaged one
        if number % 50 == 0:
            device.write(b"\0" + identify if framing == "cobs" else identify)
            # one that had lost no more than its end is whole now, and answered too: a window comes last
            answers = [read_answer(packet) for packet in ears.feed(device.read(1 << 20))]
            answers.remove(IdentityReport(0x1864C000 + 999, receiver.identity))
            assert all(answer is not None and answer.request_id in numbers for answer in answers)
