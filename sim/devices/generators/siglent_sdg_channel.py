"""The settings of a channel of an SDG2000X, and the waveforms that were uploaded."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from belahil.generators import Function, TriggerSource
from sim.devices.generator_levels import Levels
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel
    from belahil.stimuli import Interpolation

LEAST_VPP = 2e-3
"""At every load setting, as measured by owners. A change of the load rescales what is set, as they measured
too; that it goes below this, where the output stays as it is, is assumed."""
_SHAPES: dict[str, Function] = {"SINE": "SIN", "ARB": "ARB", "DC": "DC"}
_SOURCES: dict[str, TriggerSource] = {"INT": "TIM", "EXT": "EXT", "MAN": "BUS"}
# Highest frequencies beside a sine's, as measured by owners.
_MOST_HZ = {"SQUARE": 25e6, "PULSE": 25e6, "RAMP": 1e6, "ARB": 20e6}
BUILT_IN = "StairUp"


class UserWaves:
    """Uploaded waveforms by name, and one that is built in (its points are assumed)."""

    def __init__(self, model: GeneratorModel) -> None:
        self._model = model
        self._built_in = np.repeat(np.linspace(-32767, 32767, 8), 4).astype(np.int16)
        self._held: dict[str, NDArray[np.int16]] = {}

    def codes(self, name: str) -> NDArray[np.int16]:
        """Return a waveform.

        Raises
        ------
        ScpiError
            -224 when there is none of that name.
        """
        if name == BUILT_IN:
            return self._built_in
        if name not in self._held:
            raise ScpiError(-224, f"no waveform {name}")
        return self._held[name]

    def store(self, name: str, data: bytes) -> None:
        """Keep 16-bit points, low byte first, in place of those of the same name."""
        if not name:
            raise ScpiError(-109, "WVNM")
        if len(data) % 2:
            raise ScpiError(-161, "a point is two bytes")
        points = np.frombuffer(data, "<i2")
        if not self._model.min_points <= points.size <= self._model.max_points:
            raise ScpiError(-222, f"{self._model.min_points} to {self._model.max_points} points")
        self._held[name] = np.maximum(points, -self._model.full_code).astype(np.int16)

    def listed(self) -> str:
        """Names of the uploaded ones."""
        return ",".join(("WVNM", *self._held))


@dataclass(slots=True)
class SdgChannel(Levels):
    """One channel; volts are volts into `load_ohm`."""

    waves: UserWaves = field(kw_only=True)
    function: str = "SINE"
    arb_name: str = BUILT_IN
    rate_mode: str = "DDS"
    inter: str = "LINE"
    gate: str = "NCYC"
    trigger_source: str = "INT"
    trigger_output: str = "OFF"
    edge: str = "RISE"
    sync: bool = False
    sync_type: str = "CH1"

    @property
    def least_vpp(self) -> float:
        """Smallest amplitude, at every load."""
        return LEAST_VPP

    @property
    def is_sine(self) -> bool:
        """Whether the shape is a sine."""
        return self.function == "SINE"

    @property
    def most_hz(self) -> float:
        """Highest frequency of the present shape."""
        return _MOST_HZ.get(self.function, self.model.max_sine_hz)

    @property
    def plays_by_rate(self) -> bool:
        """Whether the sample rate says how fast a waveform is, and not the frequency."""
        return self.rate_mode == "TARB"

    @property
    def shape(self) -> Function:
        """Shape as the plant knows it."""
        return _SHAPES.get(self.function, "OTHER")

    @property
    def source(self) -> TriggerSource:
        """What starts a burst."""
        return _SOURCES[self.trigger_source]

    @property
    def is_plain_burst(self) -> bool:
        """Whether a burst is one whole waveform per trigger."""
        return self.gate == "NCYC" and super(SdgChannel, self).is_plain_burst

    @property
    def arb_codes(self) -> NDArray[np.int16]:
        """Points of the selected waveform."""
        return self.waves.codes(self.arb_name)

    @property
    def interpolation(self) -> Interpolation:
        """What is between points: straight lines for LINE (assumed)."""
        return "hold" if self.inter == "HOLD" else "linear"
