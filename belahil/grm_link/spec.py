"""What a receiver says of its converters: its octets, and what they may say."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, TypeVar

from belahil.errors import CorruptData
from belahil.grm_link.commands import NO_GAIN_CODE
from belahil.grm_link.octets import Octets
from belahil.receiver import DigitizerSpec
from belahil.values import PRODUCTS, TRIGGERS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

SLOWEST_HZ, FASTEST_HZ = 1.0, 1e12
MOST_BITS = 16
MOST_SAMPLES = 1 << 24

_SPEC = struct.Struct(">dIBBBBB")

T = TypeVar("T", bound=str)


def pack_spec(spec: DigitizerSpec) -> bytes:
    """Return the octets of a spec."""
    codes = spec.gain_codes or ()
    head = _SPEC.pack(
        spec.sample_rate_hz,
        spec.max_sample_count,
        spec.bits,
        spec.converters,
        sum(1 << TRIGGERS.index(name) for name in spec.triggers),
        sum(1 << PRODUCTS.index(name) for name in spec.products),
        len(codes),
    )
    return head + bytes(codes)


def read_spec(octets: Octets) -> DigitizerSpec:
    """Read a spec that is the rest of a block.

    Raises
    ------
    CorruptData
        Its length is not that of its gain codes, or a field holds what the link's page does not allow.
    """
    rate_hz, sample_count, bits, converters, triggers, products, count = octets.take(_SPEC, "its last field")
    codes = tuple(octets.take_bytes(count, f"the list of {count} gain codes"))
    octets.end()
    spec = DigitizerSpec(
        sample_rate_hz=rate_hz,
        bits=bits,
        converters=converters,
        max_sample_count=sample_count,
        gain_codes=codes or None,
        triggers=_flagged(TRIGGERS, triggers),
        products=_flagged(PRODUCTS, products),
    )
    for rule in _broken(spec):
        raise CorruptData(f"spec: {rule}")
    return spec


def _broken(spec: DigitizerSpec) -> Iterator[str]:
    """Say of each field that is not allowed what it holds, and what it may hold."""
    if not SLOWEST_HZ <= spec.sample_rate_hz <= FASTEST_HZ:
        yield f"sample rate {spec.sample_rate_hz} Hz; allowed: {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz"
    if not 1 <= spec.max_sample_count <= MOST_SAMPLES:
        yield f"largest sample count {spec.max_sample_count}; allowed: 1 to {MOST_SAMPLES}"
    if not 1 <= spec.bits <= MOST_BITS:
        yield f"bits {spec.bits}; allowed: 1 to {MOST_BITS}"
    if not spec.converters:
        yield "converters 0; allowed: 1 or more"
    if not spec.triggers:
        yield f"the mask of triggers names none; allowed: at least one of {', '.join(TRIGGERS)}"
    if not spec.products:
        yield f"the mask of products names none; allowed: at least one of {', '.join(PRODUCTS)}"
    codes = spec.gain_codes or ()
    if NO_GAIN_CODE in codes:
        yield f"gain code {NO_GAIN_CODE}; allowed: 0 to {NO_GAIN_CODE - 1}"
    if len(set(codes)) < len(codes):
        yield f"gain codes {', '.join(map(str, codes))}; allowed: each once"


def _flagged(names: Sequence[T], mask: int) -> tuple[T, ...]:
    return tuple(name for bit, name in enumerate(names) if mask >> bit & 1)
