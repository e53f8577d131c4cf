"""No wrong value: whatever happens to one message of a link, a shot is right or a typed error."""

from __future__ import annotations

import random
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from faulty_bench import SCRIPT, FaultyBench, config

from belahil.errors import InstrumentError, LinkClosed, RefusedInput
from belahil.generators import FAMILIES
from belahil.grm_link import Framing, Telemetry, WindowSegment, framed, read_answer, segments, telemetry
from belahil.grm_link.framing import packet_stream
from belahil.values import RangeWindow
from sim.faults import DIRECTIONS, KINDS, Fault, FaultPlan, NeverFired
from sim.faulty_devices import FaultyLine, FaultyMessages

if TYPE_CHECKING:
    from belahil.values import Shot
    from sim.faults import Direction, Kind, LinkName

# Every kind on every link that can do it.
CASES = [
    (link, kind)
    for link in ("visa", "serial", "usb")
    for kind in KINDS
    if not (link == "visa" and kind == "old_shot")
]


@cache
def _sound(line: str, trigger: str, driver: str) -> tuple[list[Shot], dict[tuple[LinkName, Direction], int]]:
    """Return the shots of a bench without faults, and how many messages they took."""
    plan = FaultPlan([])
    shots = FaultyBench(config(line, trigger, driver), plan).measured()
    assert len(shots) == len(SCRIPT)
    return shots, dict(plan.messages)  # type: ignore[return-value]


def _one_fault(link: LinkName, kind: Kind, seed: int, driver: str = "keysight-33500") -> None:
    """Measure with one fault at a random place, and compare with the bench without."""
    chance = random.Random(f"{link} {kind} {seed}")
    line = chance.choice(("serial", "usb")) if link == "visa" else link
    trigger = chance.choice(("generator", "digitizer"))
    sound, messages = _sound(line, trigger, driver)
    direction: Direction = "from_device" if kind == "old_shot" else chance.choice(DIRECTIONS)
    # The last window has an older one; after it come no more than its own and two other messages.
    places = messages[link, direction] - (3 if kind == "old_shot" else 0)
    plan = FaultPlan([Fault(link, direction, kind, chance.randrange(places), seed)])
    bench = FaultyBench(config(line, trigger, driver), plan)
    found = bench.measured()
    plan.require_fired()
    for shot, reference in zip(found, sound, strict=False):
        if not isinstance(shot, InstrumentError):
            assert shot.window.equals(reference.window)
            assert shot.played == reference.played
    shots = [shot for shot in found if not isinstance(shot, InstrumentError)]
    if kind == "close":
        # A link that closes while the bench is being closed is nobody's loss.
        assert isinstance(found[-1], LinkClosed) or len(shots) == len(SCRIPT)
        return
    # One fault costs at most the opening, which is not repeated; once open, every shot is had.
    assert len(shots) == len(SCRIPT) or not shots
    assert not bench.generator.channels[0].output


@pytest.mark.parametrize(("link", "kind"), CASES)
def test_a_fault_gives_the_right_window_or_a_typed_error(link: LinkName, kind: Kind) -> None:
    for seed in range(12):
        _one_fault(link, kind, seed)


OTHER_DRIVERS = [driver for driver in FAMILIES if not driver.startswith("keysight")]
VISA_KINDS = [kind for link, kind in CASES if link == "visa"]


@pytest.mark.parametrize("driver", OTHER_DRIVERS)
def test_a_fault_between_any_generator_and_its_driver_is_found(driver: str) -> None:
    for seed, kind in enumerate(VISA_KINDS):
        _one_fault("visa", kind, seed, driver)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("driver", OTHER_DRIVERS)
@pytest.mark.parametrize("kind", VISA_KINDS)
def test_a_fault_at_40_places_between_any_generator_and_its_driver_is_found(kind: Kind, driver: str) -> None:
    for seed in range(40):
        _one_fault("visa", kind, seed, driver)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("link", "kind"), CASES)
def test_a_fault_at_200_places_gives_the_right_window_or_a_typed_error(link: LinkName, kind: Kind) -> None:
    for seed in range(200):
        _one_fault(link, kind, seed)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (("visa", "from_device", "old_shot", 3), "only serial and usb carry windows"),
        (("serial", "to_device", "old_shot", 3), "only serial and usb carry windows"),
        (("lan", "to_device", "drop", 3), "allowed are visa, serial, usb"),
        (("usb", "sideways", "drop", 3), "allowed are to_device, from_device"),
        (("usb", "to_device", "burn", 3), "allowed are late, drop"),
        (("usb", "to_device", "drop", -1), "the first one is 0"),
    ],
)
def test_a_fault_that_a_link_cannot_have_is_refused(fault: tuple[object, ...], said: str) -> None:
    with pytest.raises(RefusedInput, match=said):
        Fault(*fault)  # type: ignore[arg-type]


def test_two_faults_of_one_message_are_refused() -> None:
    with pytest.raises(RefusedInput, match="one fault for each message"):
        FaultPlan([Fault("usb", "to_device", "drop", 2), Fault("usb", "to_device", "flip", 2)])


def test_a_fault_that_never_fired_is_an_error() -> None:
    plan = FaultPlan([Fault("visa", "to_device", "drop", 10_000), Fault("visa", "to_device", "double", 0)])
    FaultyBench(config("usb"), plan).measured()
    assert plan.fired[Fault("visa", "to_device", "double", 0)] == 1
    with pytest.raises(NeverFired, match=r"1 of 2 faults did not happen: .*at=10000"):
        plan.require_fired()


class Echo:
    """Answers each message with itself."""

    def __init__(self) -> None:
        self.ready: list[bytes] = []
        self.ends: list[bool] = []

    def write(self, data: bytes, end: bool = True) -> None:
        self.ready.append(data)
        self.ends.append(end)

    def read(self, *_: int) -> bytes | None:
        return self.ready.pop(0) if self.ready else None

    def clear(self) -> None:
        self.ready.clear()

    def read_stb(self) -> int:
        return len(self.ready)


def _exchange(*faults: Fault) -> tuple[FaultyMessages, FaultPlan]:
    plan = FaultPlan(faults)
    return FaultyMessages(Echo(), plan), plan


def test_a_dropped_message_is_gone_and_a_doubled_one_comes_twice() -> None:
    device, plan = _exchange(Fault("visa", "to_device", "drop", 0), Fault("visa", "from_device", "double", 0))
    device.write(b"a")
    assert device.read() is None
    device.write(b"b")
    assert [device.read(), device.read(), device.read()] == [b"b", b"b", None]
    plan.require_fired()


def test_a_flipped_message_differs_in_one_bit_and_a_cut_one_in_its_end() -> None:
    for seed in range(50):
        device, _ = _exchange(
            Fault("visa", "to_device", "flip", 0, seed), Fault("visa", "to_device", "cut", 1, seed)
        )
        device.write(b"abcdef")
        flipped = np.frombuffer(device.read() or b"", np.uint8) ^ np.frombuffer(b"abcdef", np.uint8)
        assert np.unpackbits(flipped).sum() == 1
        device.write(b"abcdef")
        cut = device.read()
        assert cut != b"abcdef"
        assert b"abcdef".startswith(cut or b"")


def test_a_late_question_arrives_before_the_next_one() -> None:
    device, _ = _exchange(Fault("visa", "to_device", "late", 0))
    device.write(b"a")
    assert device.read() is None
    device.write(b"b")
    assert [device.read(), device.read()] == [b"a", b"b"]


def test_a_late_answer_outlives_a_clear_and_arrives_with_the_next_answer() -> None:
    device, _ = _exchange(Fault("visa", "from_device", "late", 0))
    device.write(b"a")
    assert device.read() is None
    device.clear()
    assert device.read() is None
    device.write(b"b")
    assert [device.read(), device.read(), device.read()] == [b"a", b"b", None]


def test_a_closed_link_stays_closed() -> None:
    device, _ = _exchange(Fault("visa", "from_device", "close", 0))
    device.write(b"a")
    for verb in (device.read, device.clear, device.read_stb, lambda: device.write(b"b")):
        with pytest.raises(ConnectionResetError):
            verb()


@pytest.mark.parametrize("framing", ["cobs", "raw"])
def test_an_old_shot_is_forged_in_three_ways_and_every_forgery_is_intact(framing: Framing) -> None:
    def answer(shot: int) -> bytes:
        window = RangeWindow(np.full(9, shot, np.int16), 1e-3, 0.0, 12.5e-9, 0.0, 4, shot)
        packets = [telemetry(segment, shot, 0.0) for segment in segments(window, 100 + shot)]
        return b"".join(framed(packet.pack(), framing) for packet in packets)

    seen = set()
    for seed in range(20):
        # given a device that sends two windows in a row, the second of which shall be an old one
        link: LinkName = "serial" if framing == "cobs" else "usb"
        plan = FaultPlan([Fault(link, "from_device", "old_shot", 0, seed)])
        device = Echo()
        line = FaultyLine(_as_line(device), framing, plan)
        device.ready = [answer(1) + answer(2)]
        # when they are read
        packets = packet_stream(Telemetry, framing).feed(line.read(1 << 16))
        plan.require_fired()
        first, second = (read_answer(packet) for packet in packets)
        assert isinstance(first, WindowSegment)
        assert isinstance(second, WindowSegment)
        # then both hold the first window; the second may claim more
        assert second.payload == first.payload
        seen.add((second.request_id - 100, second.shot))
    assert seen == {(1, 1), (2, 1), (2, 2)}


def _as_line(device: Echo) -> FaultyLine:
    device.read = lambda *_: device.ready.pop(0) if device.ready else b""  # type: ignore[method-assign]
    return device  # type: ignore[return-value]
