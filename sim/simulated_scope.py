"""The oscilloscope of a simulated bench: the same requests and windows as over a link, without the link."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import InstrumentError, LinkClosed, LinkTimeout
from belahil.interfaces import LinkCounts
from belahil.oscilloscopes import ScopeRecord, check_request, setting_for, told, window_of

if TYPE_CHECKING:
    from belahil.oscilloscopes import ScopeSetting
    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest
    from sim.oscilloscope import ScopeReceiver
    from sim.plant import Plant


class SimulatedScope:
    """An oscilloscope that is asked without any link.

    Parameters
    ----------
    plant : Plant
        What it digitizes.
    receiver : ScopeReceiver
        The receiver of that plant.
    """

    def __init__(self, plant: Plant, receiver: ScopeReceiver) -> None:
        self._plant = plant
        self._receiver = receiver
        self._full_scale_v = receiver.full_scale_v
        self._armed: tuple[WindowRequest, ScopeSetting] | None = None
        self._is_open = True
        self.identity = f"{receiver.model.maker},{receiver.model.name},EMULATED,0.00-emulated"

    @property
    def spec(self) -> DigitizerSpec:
        """What the oscilloscope is as a digitizer."""
        return self._receiver.spec

    @property
    def dropped(self) -> LinkCounts:
        """Nothing: there is no link."""
        return LinkCounts()

    def arm(self, request: WindowRequest) -> None:
        """Ask for one window.

        Raises
        ------
        LimitExceeded
            As the driver of an oscilloscope.
        """
        self._check_open()
        self._armed = None
        check_request(request, self.spec)
        setting = setting_for(request, self.spec, self._receiver.model, self._full_scale_v)
        self._plant.arm(replace(request, sample_count=setting.points, delay_s=setting.start_s))
        self._armed = request, setting

    def read(self, timeout_s: float) -> RangeWindow:
        """Return the window of the last `arm`.

        Raises
        ------
        LinkTimeout
            Its trigger has not come; the plant's clock has moved by `timeout_s`.
        InstrumentError
            Nothing is armed.
        """
        self._check_open()
        if self._armed is None:
            raise InstrumentError("the oscilloscope was asked for a window before it was armed")
        (request, setting), self._armed = self._armed, None
        taken = self._plant.collect()
        if taken is None:
            self._plant.clock.sleep_s(timeout_s)
            raise LinkTimeout(f"window of shot {request.shot}: no trigger came within {timeout_s:g} s")
        model = self._receiver.model
        first_s = setting.start_s
        if model.tells_phase:
            first_s = told(taken.start_s + taken.housekeeping["trigger_phase_s"], model.time_digits)
        record = ScopeRecord(
            taken.counts.astype(np.uint16),
            model.volts_per_count(setting.full_scale_v),
            self._receiver.zero_code,
            setting.interval_s,
            first_s,
        )
        return window_of(record, request, setting, model)

    def close(self) -> None:
        """Disarm the oscilloscope."""
        if self._is_open:
            self._plant.abort()
        self._is_open = False

    def _check_open(self) -> None:
        if not self._is_open:
            raise LinkClosed("the simulated oscilloscope was closed")
