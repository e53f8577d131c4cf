"""A shot as bytes and back: every float, every count, every word as it was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np
from msgspec import Struct

from belahil.stimuli import Interpolation, NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from belahil.values import Candidate, RangeWindow, Shot, WindowRequest

if TYPE_CHECKING:
    from collections.abc import Callable


class _NoSignal(Struct, tag="no_signal", array_like=True, frozen=True):
    pass


class _Transmitted(Struct, tag="transmitted_pulse", array_like=True, frozen=True):
    pass


class _Sine(Struct, tag="sine", array_like=True, frozen=True):
    frequency_hz: float
    amplitude_vpp: float
    offset_v: float


class _Pulse(Struct, tag="sampled_pulse", array_like=True, frozen=True):
    volts: bytes
    sample_rate_hz: float
    start_s: float
    interpolation: Interpolation
    poles: tuple[tuple[float, float], ...]


class SamePulse(Struct, tag="same", array_like=True, frozen=True):
    """Stands for a pulse that an earlier record holds in full; `place` says which."""

    place: int


class _Record(Struct, array_like=True, frozen=True):
    request: WindowRequest
    played: _NoSignal | _Transmitted | _Sine | _Pulse | SamePulse
    counts: memoryview  # into the record: a window is the most of it, and need not be copied
    volts_per_count: float
    zero_count: float
    sample_interval_s: float
    start_s: float
    gain_code: int | None
    shot: int
    saturated: int
    candidates: tuple[Candidate, ...]
    housekeeping: dict[str, float]
    date: str
    attempt: int


class _Key(Struct, array_like=True, frozen=True):
    request: WindowRequest


_ENCODER = msgspec.msgpack.Encoder()
_RECORD = msgspec.msgpack.Decoder(_Record)
_KEY = msgspec.msgpack.Decoder(_Key)


def to_bytes(request: WindowRequest, shot: Shot, same: SamePulse | None = None) -> bytes:
    """Encode a shot and the request it answers.

    Parameters
    ----------
    request : WindowRequest
        As the procedure asked.
    shot : Shot
        Its counts must be int16, shape (n,).
    same : SamePulse or None
        Written in place of the stimulus.
    """
    window = shot.window
    if window.counts.dtype != np.int16 or window.counts.ndim != 1:
        raise TypeError(
            f"counts of type {window.counts.dtype}, shape {window.counts.shape}: must be one row of int16"
        )
    return _ENCODER.encode(
        _Record(
            request=request,
            played=same or _packed(shot.played),
            counts=np.ascontiguousarray(window.counts, "<i2").data,
            volts_per_count=float(window.volts_per_count),
            zero_count=float(window.zero_count),
            sample_interval_s=float(window.sample_interval_s),
            start_s=float(window.start_s),
            gain_code=None if window.gain_code is None else int(window.gain_code),
            shot=int(window.shot),
            saturated=int(window.saturated),
            candidates=window.candidates,
            housekeeping={name: float(value) for name, value in window.housekeeping.items()},
            date=shot.date,
            attempt=int(shot.attempt),
        )
    )


def request_in(record: bytes) -> WindowRequest:
    """Decode only the request of a record.

    Raises
    ------
    ValueError
        The bytes are no record.
    """
    return _KEY.decode(record).request


def from_bytes(record: bytes, pulse_at: Callable[[int], Stimulus]) -> tuple[WindowRequest, Shot]:
    """Decode a record; `pulse_at` finds the pulse that a `SamePulse` stands for.

    Raises
    ------
    ValueError
        The bytes are no record.
    """
    held = _RECORD.decode(record)
    window = RangeWindow(
        counts=np.frombuffer(held.counts, "<i2").astype(np.int16, copy=False),
        volts_per_count=held.volts_per_count,
        zero_count=held.zero_count,
        sample_interval_s=held.sample_interval_s,
        start_s=held.start_s,
        gain_code=held.gain_code,
        shot=held.shot,
        saturated=held.saturated,
        candidates=held.candidates,
        housekeeping=held.housekeeping,
    )
    played = pulse_at(held.played.place) if isinstance(held.played, SamePulse) else _unpacked(held.played)
    return held.request, Shot(played, window, held.date, held.attempt)


def _packed(stimulus: Stimulus) -> _NoSignal | _Transmitted | _Sine | _Pulse:
    if isinstance(stimulus, Sine):
        return _Sine(float(stimulus.frequency_hz), float(stimulus.amplitude_vpp), float(stimulus.offset_v))
    if isinstance(stimulus, SampledPulse):
        return _Pulse(
            volts=stimulus.volts.astype("<f8", copy=False).tobytes(),
            sample_rate_hz=float(stimulus.sample_rate_hz),
            start_s=float(stimulus.start_s),
            interpolation=stimulus.interpolation,
            poles=tuple((float(pole.real), float(pole.imag)) for pole in stimulus.poles),
        )
    return _Transmitted() if isinstance(stimulus, TransmittedPulse) else _NoSignal()


def _unpacked(held: _NoSignal | _Transmitted | _Sine | _Pulse) -> Stimulus:
    if isinstance(held, _Sine):
        return Sine(held.frequency_hz, held.amplitude_vpp, held.offset_v)
    if isinstance(held, _Pulse):
        return SampledPulse(
            volts=np.frombuffer(held.volts, "<f8"),
            sample_rate_hz=held.sample_rate_hz,
            start_s=held.start_s,
            interpolation=held.interpolation,
            poles=tuple(complex(*pole) for pole in held.poles),
        )
    return TransmittedPulse() if isinstance(held, _Transmitted) else NoSignal()
