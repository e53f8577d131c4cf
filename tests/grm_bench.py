"""A receiver, a clock and a faulty line in memory, for the tests of the GRM device and its driver."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from grm_cases import a_window

from belahil.errors import InstrumentRefused
from belahil.receiver import DigitizerSpec
from belahil.values import WITH_SAMPLES, RangeWindow, WindowRequest
from sim.devices.grm import GrmDevice

SPEC = DigitizerSpec(80e6, 12, 2, 16064, tuple(range(16)), products=("window", "candidates"))


class FakeReceiver:
    """Captures at once, or when `captured` is set; the window follows from the request alone."""

    identity = "Fake receiver, number 1"

    def __init__(self, spec: DigitizerSpec = SPEC) -> None:
        self.spec = spec
        self.captured = True
        self.request: WindowRequest | None = None
        self.armed: list[WindowRequest] = []
        self.aborts = 0
        self.refusing: Exception | None = None
        self.failing: Exception | None = None

    def arm(self, request: WindowRequest) -> None:
        if self.refusing is not None:
            raise self.refusing
        self.request = request
        self.armed.append(request)

    def collect(self) -> RangeWindow | None:
        if self.failing is not None:
            raise self.failing
        if not self.captured or self.request is None:
            return None
        request, self.request = self.request, None
        return window_for(request)

    def abort(self) -> None:
        self.request = None
        self.aborts += 1

    def housekeeping(self) -> dict[str, float]:
        return {"temperature_k": 293.15, "windows": float(len(self.armed))}


def window_for(request: WindowRequest) -> RangeWindow:
    counts = a_window(request.shot, request.sample_count).counts
    if request.gain_code is not None:
        counts = (counts // 64 + 64 * request.gain_code).astype(np.int16)
    (found,) = a_window(request.shot, 1).candidates
    return replace(
        a_window(request.shot, 1),
        candidates=(replace(found, correlation_window=()) if request.products == "candidates" else found,),
        counts=counts if request.products in WITH_SAMPLES else counts[:0],
        start_s=round(request.delay_s * SPEC.sample_rate_hz) / SPEC.sample_rate_hz,
        gain_code=request.gain_code,
        saturated=0,
    )


class FakeClock:
    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def sleep_s(self, duration_s: float) -> None:
        self.time_s += duration_s


class FakeLink:
    """Joins a driver to a device; an empty read is the expired time-out.

    `there` and `back` may change the bytes of each write and each read.
    """

    def __init__(self, device: GrmDevice, clock: FakeClock) -> None:
        self.device = device
        self.clock = clock
        self.there: Callable[[bytes], bytes] = bytes
        self.back: Callable[[bytes], bytes] = bytes
        self.pending: deque[bytes] = deque()
        self.error: Exception | None = None
        self.closed = False
        self.clears = 0

    def write(self, data: bytes) -> None:
        if self.error is not None:
            raise self.error
        self.device.write(self.there(data))

    def read(self, count: int, timeout_s: float) -> bytes:
        if self.error is not None:
            raise self.error
        if self.pending:
            return self.pending.popleft()
        ready = self.device.read(count)
        data = self.back(ready) if ready else b""
        if not data:
            self.clock.sleep_s(timeout_s)
        return data

    def clear(self) -> None:
        if self.error is not None:
            raise self.error
        self.clears += 1
        self.pending.clear()
        self.device.clear()

    def close(self) -> None:
        self.closed = True


def refused(text: str, reason: int) -> InstrumentRefused:
    return InstrumentRefused(text, reason)
