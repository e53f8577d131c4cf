"""The plant as Python objects: the instruments of a simulated bench, without any link."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from belahil.errors import InstrumentError, InstrumentRefused, LinkClosed, LinkTimeout
from belahil.generators import GeneratorModel, GeneratorSetting, model_of, on_grid, setting_for
from belahil.grm_link import Verb, read_command, telecommand
from belahil.interfaces import LinkCounts
from sim.devices.grm import check

if TYPE_CHECKING:
    from belahil.receiver import DigitizerSpec
    from belahil.stimuli import Stimulus
    from belahil.values import RangeWindow, WindowRequest
    from sim.plant import Plant

_TRIGGER_IGNORED, _DATA_OUT_OF_RANGE = -211, -222


class SimulatedGenerator:
    """A function generator that plays straight into a plant.

    Parameters
    ----------
    plant : Plant
        What it plays into.
    model : GeneratorModel
        The emulated model with its true sample rate; `limits` are those that its name promises.
    load_ohm : float
        Its load setting.
    """

    def __init__(self, plant: Plant, model: GeneratorModel, load_ohm: float) -> None:
        self.identity = f"{model.manufacturer},{model.name},EMULATED,0.00-emulated"
        self.limits = model_of(self.identity)
        self._plant = plant
        self._model = model
        self._load_ohm = load_ohm
        self._is_open = True
        self._play(GeneratorSetting(load_ohm=load_ohm))

    def prepare(self, stimulus: Stimulus, trigger: str) -> Stimulus:
        """Load a stimulus and return what its settings say will be played, volts into the load setting.

        Raises
        ------
        LimitExceeded
            The model cannot make it; nothing was changed.
        InstrumentRefused
            The emulated generator cannot, though its model could.
        """
        self._check_open()
        setting = setting_for(stimulus, self.limits, self._load_ohm, trigger)
        if setting.arb is not None and setting.arb.sample_rate_hz > self._model.max_arb_rate_hz:
            raise InstrumentRefused(
                f"an arbitrary waveform at {setting.arb.sample_rate_hz:.10g} Sa/s; allowed: at most "
                f"{self._model.max_arb_rate_hz:g} Sa/s",
                _DATA_OUT_OF_RANGE,
            )
        self._play(replace(setting, output=self._setting.output))
        return on_grid(stimulus, self.limits, self._load_ohm, trigger)

    def output(self, on: bool) -> None:
        """Connect or disconnect the output."""
        self._check_open()
        self._play(replace(self._setting, output=on))

    def trigger(self) -> None:
        """Start a pulse that waits for it.

        Raises
        ------
        InstrumentRefused
            None does.
        """
        self._check_open()
        if not self._plant.trigger():
            raise InstrumentRefused("trigger ignored: no stimulus waits for one", _TRIGGER_IGNORED)

    def close(self) -> bool:
        """Switch the output off, which is always confirmed."""
        if self._is_open:
            self.output(False)
        self._is_open = False
        return True

    def _check_open(self) -> None:
        if not self._is_open:
            raise LinkClosed("the simulated generator was closed")

    def _play(self, setting: GeneratorSetting) -> None:
        self._setting = setting
        self._plant.play(setting)


class SimulatedDigitizer:
    """A receiver that is asked without any link.

    Parameters
    ----------
    plant : Plant
        What it digitizes.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._shot: int | None = None
        self._is_open = True

    @property
    def identity(self) -> str:
        """What the receiver calls itself."""
        return self._plant.identity

    @property
    def spec(self) -> DigitizerSpec:
        """What the receiver reports of its converters."""
        return self._plant.spec

    @property
    def dropped(self) -> LinkCounts:
        """Nothing: there is no link."""
        return LinkCounts()

    def arm(self, request: WindowRequest) -> None:
        """Ask for one window.

        Raises
        ------
        LimitExceeded, InstrumentRefused
            Exactly when a receiver on the GRM link would: the request takes the form that it has there.
        """
        self._check_open()
        self._shot = None
        _, sent = read_command(telecommand(Verb.ARM, 0, request))
        assert sent is not None
        check(sent, self.spec)
        self._plant.arm(sent)
        self._shot = sent.shot

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
        if self._shot is None:
            raise InstrumentError("the receiver was asked for a window before it was armed")
        shot, self._shot = self._shot, None
        window = self._plant.collect()
        if window is None:
            self._plant.clock.sleep_s(timeout_s)
            raise LinkTimeout(f"window of shot {shot}: no trigger came within {timeout_s:g} s")
        return window

    def close(self) -> None:
        """Disarm the receiver."""
        if self._is_open:
            self._plant.abort()
        self._is_open = False

    def _check_open(self) -> None:
        if not self._is_open:
            raise LinkClosed("the simulated receiver was closed")
