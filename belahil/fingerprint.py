"""What a run is, as plain values: a resume must find all of it unchanged."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import msgspec

from belahil.provenance import belahil_version

if TYPE_CHECKING:
    from collections.abc import Mapping

    from belahil.config import BenchConfig

# Where an instrument is plugged in may change between two days; results do not depend on it.
PLACES = (("generator", "address"), ("generator", "visa_library"), ("digitizer", "link"))


def plain(value: Any) -> Any:
    """Turn tuples, dataclasses and structs into the lists and dicts that a file gives back."""
    return msgspec.msgpack.decode(msgspec.msgpack.encode(value))


def facts(
    procedure: str, plan: Mapping[str, Any] | None, config: BenchConfig, seed: int | None
) -> dict[str, Any]:
    """Collect what the shots of a run depend on.

    Parameters
    ----------
    procedure : str
        Its name.
    plan : mapping or None
        As plain values; None leaves it out.
    config : BenchConfig
        Without the places of the instruments, and without ``[limits]``, which only judge. ``[emulation]``
        belongs to the facts where it is read.
    seed : int or None
        Of the run.
    """
    bench = plain(config)
    for table, key in PLACES:
        del bench[table][key]
    del bench["limits"]
    if config.source in ("hardware", "replay"):
        del bench["emulation"]
    found = {
        "belahil": belahil_version(),
        "procedure": procedure,
        "seed": seed,
        "source": config.source,
        "bench": bench,
    }
    return found if plan is None else found | {"plan": plain(plan)}


def fingerprint(found: Mapping[str, Any]) -> str:
    """SHA-256 of facts, in hexadecimal."""
    return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()


def difference(begun: Any, now: Any, where: str = "") -> str | None:
    """Name the first place where facts are not as they were begun; what only `begun` has is let be.

    Examples
    --------
    >>> difference({"seed": 1, "bench": {"a": 2.0}}, {"seed": 1, "bench": {"a": 3.0}})
    'bench.a was 2.0 and is 3.0'
    """
    if isinstance(begun, dict) and isinstance(now, dict):
        for key in now:
            place = f"{where}.{key}" if where else str(key)
            found = difference(begun.get(key), now[key], place)
            if found is not None:
                return found
        return None
    return None if begun == now else f"{where} was {begun!r} and is {now!r}"
