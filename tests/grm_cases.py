"""Windows, streams and damage for the tests of the GRM link."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as stnp

from belahil.grm_link import framed, segments, telemetry
from belahil.receiver import DigitizerSpec
from belahil.values import PRODUCTS, Candidate, RangeWindow, WindowRequest

numbers = st.floats(allow_nan=False, allow_infinity=False)
scales = st.floats(min_value=1e-300, allow_infinity=False, exclude_min=False)
counts16 = st.integers(-(2**15), 2**15 - 1)
u32 = st.integers(0, 2**32 - 1)
gain_codes = st.none() | st.integers(0, 254)
names = st.text(st.characters(codec="utf-8"), min_size=0, max_size=40)

candidates = st.builds(
    Candidate,
    arrival_s=numbers,
    fwhm_s=numbers,
    amplitude_v=numbers,
    correlation_window=st.lists(counts16, max_size=60).map(tuple),
    first_sample=u32,
)


@st.composite
def windows(draw: st.DrawFn, most_samples: int = 400) -> RangeWindow:
    counts = draw(stnp.arrays(np.int16, st.integers(0, most_samples), elements=counts16))
    return RangeWindow(
        counts=counts,
        volts_per_count=draw(scales),
        zero_count=draw(numbers),
        sample_interval_s=draw(scales),
        start_s=draw(numbers),
        gain_code=draw(gain_codes),
        shot=draw(u32),
        saturated=draw(st.integers(0, len(counts))),
        candidates=tuple(draw(st.lists(candidates, max_size=4))),
        housekeeping=draw(st.dictionaries(names, numbers, max_size=6)),
    )


requests = st.builds(
    WindowRequest,
    shot=u32,
    gain_code=gain_codes,
    sample_count=u32,
    delay_s=numbers,
    trigger=st.sampled_from(["immediate", "generator", "digitizer"]),
    source=st.sampled_from(["return", "transmit"]),
    products=st.sampled_from(PRODUCTS),
)

specs = st.builds(
    DigitizerSpec,
    sample_rate_hz=st.floats(1.0, 1e12),
    bits=st.integers(1, 16),
    converters=st.integers(1, 8),
    max_sample_count=st.integers(1, 2**24),
    gain_codes=st.none() | st.lists(st.integers(0, 254), min_size=1, unique=True).map(tuple),
    triggers=st.just(("immediate", "digitizer")),
    products=st.just(("window", "candidates")),
)


def same(a: RangeWindow, b: RangeWindow) -> bool:
    """Everything alike, housekeeping included, floats bit for bit."""
    return a.equals(b) and repr(dict(a.housekeeping)) == repr(dict(b.housekeeping))


def a_window(shot: int = 7, samples: int = 900, seed: int = 1) -> RangeWindow:
    rng = np.random.default_rng([seed, shot])
    return RangeWindow(
        counts=rng.integers(-2048, 2048, samples).astype(np.int16),
        volts_per_count=2.0 / 4096,
        zero_count=0.5,
        sample_interval_s=12.5e-9,
        start_s=1e-6,
        gain_code=4,
        shot=shot,
        saturated=3,
        candidates=(Candidate(3e-6, 21e-9, 0.11, (1, -2, 300), 1),),
        housekeeping={"temperature_k": 293.15, "supply_v": 27.9},
    )


def packets_of(window: RangeWindow, request_id: int = 0x1864C003, segment_bytes: int = 200) -> list[bytes]:
    parts = segments(window, request_id, segment_bytes)
    return [telemetry(part, number).pack() for number, part in enumerate(parts)]


def stream_of(packets: list[bytes], framing: str) -> bytes:
    return b"".join(framed(packet, framing) for packet in packets)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three faults: bytes flipped, dropped, doubled, cut off, swapped, or strange ones put in."""
    spoiled = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(0, max(1, len(spoiled))))
        run = int(rng.choice([1, 1, 2, 9, 120, 700]))
        match rng.integers(0, 6):
            case 0:
                for place in range(at, min(len(spoiled), at + run)):
                    spoiled[place] ^= int(rng.integers(1, 256))
            case 1:
                del spoiled[at : at + run]
            case 2:
                spoiled[at:at] = spoiled[at : at + run]
            case 3:
                del spoiled[at:]
            case 4:
                first, second = spoiled[at : at + run], spoiled[at + run : at + 2 * run]
                spoiled[at : at + 2 * run] = second + first
            case 5:
                spoiled[at:at] = rng.bytes(run)
    return bytes(spoiled)
