"""The bench: one generator, one receiver, and the cut between them.

`Bench.measure` is the only way across the cut: arming order, triggers, time-outs, repeats and the
interlock live here and nowhere else.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from belahil import config as configuration
from belahil.clock import SystemClock
from belahil.errors import (
    InstrumentError,
    Interfered,
    InterlockRefused,
    LinkClosed,
    LinkError,
    RefusedInput,
    StaleData,
)
from belahil.generators import SOURCE_OHM, behind_output, open_circuit
from belahil.interfaces import Confirming
from belahil.link_source import DirectLinks
from belahil.request_checks import check_window_request
from belahil.stimuli import NoSignal, SampledPulse, Stimulus, TransmittedPulse, largest_volts, scaled
from belahil.values import Shot, Trigger, WindowRequest

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from belahil.config import BenchConfig
    from belahil.generators import GeneratorModel
    from belahil.interfaces import Clock, Digitizer, FunctionGenerator, LinkCounts
    from belahil.link_source import LinkSource
    from belahil.receiver import DigitizerSpec

ATTEMPTS = 3
READ_TIMEOUT_S = 2.0


@dataclass(frozen=True)
class Endpoints:
    """What a vendor library needs to reach an emulated device; empty for hardware.

    Parameters
    ----------
    visa_library : object or None
        A PyVISA library instance; None lets PyVISA choose by the bench file.
    visa_address : str
        Resource name of the generator in that library; empty: the bench file's.
    visa_scope_address : str
        Resource name of an oscilloscope in that library; empty: the bench file's.
    serial_url : str
        What pyserial opens; empty: the bench file's.
    usb_backend : object or None
        A pyusb backend; None lets pyusb choose.
    usb_id : tuple of int
        Vendor and product number on that backend.
    clock : Clock
        Time of this bench.
    links : LinkSource
        Opens the links, records or replays them.
    """

    visa_library: Any = None
    visa_address: str = ""
    visa_scope_address: str = ""
    serial_url: str = ""
    usb_backend: Any = None
    usb_id: tuple[int, int] = (0, 0)
    clock: Clock = field(default_factory=SystemClock)
    links: LinkSource = field(default_factory=DirectLinks)


class Bench:
    """A generator and a digitizer that meet at the cut.

    Parameters
    ----------
    generator : FunctionGenerator
        Its output is switched off before anything else.
    digitizer : Digitizer
        The receiver under test.
    config : BenchConfig
        Attenuation, load, interlock, triggering; `[emulation]` is not read here.
    clock : Clock
        For settling.
    links : LinkSource or None
        Where the instruments' links come from; None: straight from the libraries, or there are none.

    Notes
    -----
    Use it as a context manager: the output is off on every way out, or the error says that it may not be.
    """

    def __init__(
        self,
        generator: FunctionGenerator,
        digitizer: Digitizer,
        config: BenchConfig,
        clock: Clock,
        links: LinkSource | None = None,
    ) -> None:
        self._generator = generator
        self._digitizer = digitizer
        self._clock = clock
        self._prepared: tuple[Stimulus, Trigger] | None = None
        self._played: Stimulus | None = None
        self._gain_code: int | None = None
        self.config = config
        self.links = links or DirectLinks()
        self.repeated_because = ""
        """Why the last shot that was repeated had to be, in one line."""
        generator.output(False)

    @property
    def source(self) -> str:
        """``simulated``, ``emulated``, ``hardware`` or ``replay``: for labels only, never to branch on."""
        return self.config.source

    @property
    def spec(self) -> DigitizerSpec:
        """What the receiver reports of its converters."""
        return self._digitizer.spec

    @property
    def link_counts(self) -> LinkCounts:
        """What the receiver's link dropped since it was opened, damaged or stale."""
        return self._digitizer.dropped

    @property
    def generator(self) -> FunctionGenerator:
        """The generator's driver, for those who try drivers: the interlock does not stand before it."""
        return self._generator

    @property
    def digitizer(self) -> Digitizer:
        """The digitizer's driver, for those who try drivers."""
        return self._digitizer

    @property
    def clock(self) -> Clock:
        """Time of this bench, by which it settles."""
        return self._clock

    @property
    def generator_model(self) -> GeneratorModel:
        """Limits of the generator that answered."""
        return self._generator.limits

    @property
    def identities(self) -> dict[str, str]:
        """Who answered."""
        return {"generator": self._generator.identity, "digitizer": self._digitizer.identity}

    @property
    def setting_per_cut_volt(self) -> float:
        """Generator setting, V into its load setting, that gives 1 V at the cut."""
        return setting_per_cut_volt(self.config)

    def check(self, stimulus: Stimulus, request: WindowRequest) -> None:
        """Refuse what the interlock, the generator or the receiver would refuse, before anything is sent.

        Raises
        ------
        RefusedInput
            One line with what was asked and what is allowed; `InterlockRefused`, `LimitExceeded`.
        """
        # What is being played has been checked before.
        if self._prepared is None or self._prepared[0] != stimulus:
            self._check_stimulus(stimulus)
        check_window_request(stimulus, request, self._trigger_for(stimulus, request), self.spec)

    def _check_stimulus(self, stimulus: Stimulus) -> None:
        from belahil.generators import on_grid

        self._interlock(stimulus)
        part, factor = self.config.generator, self.setting_per_cut_volt
        played = on_grid(scaled(stimulus, factor), self.generator_model, part.load_ohm)
        # Rounding may go up.
        self._interlock(scaled(played, 1 / factor))

    def _interlock(self, stimulus: Stimulus) -> None:
        limit, peak = self.config.generator.max_vpp, largest_volts(stimulus)
        # Turned round, so that what is not a number does not pass.
        if not 2 * peak <= limit * (1 + 1e-9):
            raise InterlockRefused(
                f"a stimulus of up to {peak:.6g} V at the cut, offset included ({2 * peak:.6g} Vpp): "
                f"[generator] max_vpp = {limit:g} allows {limit / 2:.6g} V"
            )

    def measure(self, stimulus: Stimulus, request: WindowRequest) -> Shot:
        """Play a stimulus and return the window it gave.

        Parameters
        ----------
        stimulus : Stimulus
            In volts at the cut.
        request : WindowRequest
            Its `trigger` is filled in here; only silence may ask for "digitizer", to see the laser fire.

        Raises
        ------
        InterlockRefused, LimitExceeded
            Refused; nothing was sent.
        InstrumentError
            The instruments failed three times, or one refused or is gone.
        """
        self.check(stimulus, request)
        trigger = self._trigger_for(stimulus, request)
        request = replace(request, trigger=trigger)
        attempt = 1
        while True:
            try:
                return self._try(stimulus, request, attempt)
            except LinkClosed:
                self._prepared = None
                raise
            except LinkError as error:
                self._prepared = self._gain_code = None
                self.repeated_because = str(error)
                if attempt >= ATTEMPTS:
                    raise
                attempt += 1

    def _trigger_for(self, stimulus: Stimulus, request: WindowRequest) -> Trigger:
        if isinstance(stimulus, TransmittedPulse):
            return "digitizer"
        if isinstance(stimulus, NoSignal) and request.trigger == "digitizer":
            return "digitizer"
        return self.config.bench.trigger if isinstance(stimulus, SampledPulse) else "immediate"

    def _try(self, stimulus: Stimulus, request: WindowRequest, attempt: int) -> Shot:
        is_new = self._prepared != (stimulus, request.trigger)
        if is_new:
            self._prepare(stimulus, request.trigger)
        assert self._played is not None
        if is_new or request.gain_code != self._gain_code:
            self._settle(request)
        self._digitizer.arm(request)
        if request.trigger == "generator":
            self._generator.trigger()
        window = self._digitizer.read(READ_TIMEOUT_S + request.delay_s)
        if window.shot != request.shot:
            raise StaleData(
                f"asked for shot {request.shot}, the window that came belongs to shot {window.shot}"
            )
        self._confirm()
        return Shot(self._played, window, datetime.now(UTC).isoformat(timespec="milliseconds"), attempt)

    def _confirm(self, whole: bool = False) -> None:
        """Make sure that what is believed to be played is, where the generator can tell."""
        if isinstance(self._generator, Confirming):
            self._generator.confirm(whole)

    def _prepare(self, stimulus: Stimulus, trigger: Trigger) -> None:
        factor = self.setting_per_cut_volt
        self._prepared = None
        prepared = self._generator.prepare(scaled(stimulus, factor), trigger)
        played = scaled(behind_output(prepared, self.config.generator.bandwidth_hz), 1 / factor)
        self._interlock(played)
        self._generator.output(True)
        self._played, self._prepared = played, (stimulus, trigger)

    def _settle(self, request: WindowRequest) -> None:
        """Wait until a new stimulus or a new gain code has settled.

        Only arming sets a gain code. So the receiver is armed here, and once more for the window that counts;
        one that starts by itself is read and thrown away.
        """
        settle_s = self.config.bench.settle_s
        if settle_s and request.gain_code != self._gain_code:
            self._digitizer.arm(request)
            if request.trigger != "generator":
                self._digitizer.read(READ_TIMEOUT_S + request.delay_s)
        self._gain_code = request.gain_code
        self._clock.sleep_s(settle_s)

    def close(self) -> bool:
        """Switch the output off and let go of both instruments; return whether it is confirmed to be off."""
        self.links.leaving()
        try:
            return self._generator.close()
        finally:
            self._digitizer.close()
            self.links.close()

    def _interfered_at_last(self) -> Interfered | None:
        """Return what somebody else has done to the last stimulus, which no later one has found out."""
        if self._prepared is None:
            return None
        try:
            self._confirm(whole=True)
        except Interfered as error:
            return Interfered(f"{error}; windows since the last change of the stimulus may be wrong")
        except InstrumentError:
            return None  # closing tells whether the output is off
        return None

    def __enter__(self) -> Bench:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        interfered = self._interfered_at_last() if error is None else None
        left_on = "" if self.close() else self.links.left_on
        if error is None and left_on:
            raise InstrumentError(left_on)
        if error is None:
            self.links.check()
            if interfered is not None:
                raise interfered
        elif left_on:
            error.add_note(left_on)


def setting_per_cut_volt(config: BenchConfig) -> float:
    """Generator setting, V into its load setting, that gives 1 V at the cut.

    The attenuator is a matched 50-ohm pad: cut voltage = V_open 10**(-dB/20) R_in / (50 + R_in).
    """
    part = config.generator
    input_ohm = config.digitizer.input_ohm
    divider = 1.0 if input_ohm == float("inf") else input_ohm / (SOURCE_OHM + input_ohm)
    return 10 ** (part.attenuation_db / 20) / (divider * open_circuit(part.load_ohm))


def open_bench(
    bench: str | BenchConfig = "emulated", *, seed: int | None = None, record: str | Path | None = None
) -> Bench:
    """Open a bench by name, by file or by its configuration.

    Parameters
    ----------
    bench : str or BenchConfig
        ``"emulated"``, ``"simulated"``, ``"replay:FILE"``, the path of a bench file, or a configuration.
    seed : int or None
        Replaces ``[emulation] seed``; a recording keeps its own.
    record : str, Path or None
        File that takes every byte of the links; it must not be there yet.

    Returns
    -------
    Bench
        With its output off.

    Raises
    ------
    ConfigError
        The file or the combination is not allowed.
    RefusedInput
        The recording is there already, or there is nothing to record.
    InstrumentError
        Nobody answers, or somebody unknown does.
    """
    config = bench if isinstance(bench, configuration.BenchConfig) else configuration.load_bench(bench)
    configuration.check_bench(config)
    if seed is not None:
        config = configuration.seeded(config, seed)
    if record is not None and config.source in ("simulated", "replay"):
        raise RefusedInput(f"--record {record}: the bench is {config.source} and has no links to record")
    # By name: belahil imports neither drivers nor sim, and a bench loads only what it needs.
    if config.source == "simulated":
        made: Bench = importlib.import_module("sim.build").bench(config)
        return made
    endpoints = _endpoints(config, record)
    try:
        opened: Bench = importlib.import_module("drivers.build").bench(config, endpoints)
    except BaseException:
        endpoints.links.close()
        raise
    endpoints.links.note("instruments", opened.identities)
    return opened


def _endpoints(config: BenchConfig, record: str | Path | None) -> Endpoints:
    """Return what the drivers reach their instruments by, or recorded ones."""
    if config.source == "replay":
        from belahil.recording import read_session
        from belahil.replay import Replay

        path = config.generator.address.removeprefix(configuration.REPLAY)
        read_session(path).check_replayable()
        replay = Replay(path)
        return Endpoints(clock=replay.clock, links=replay)
    emulated = config.source == "emulated"
    found: Endpoints = importlib.import_module("sim.build").endpoints(config) if emulated else Endpoints()
    if record is None:
        return found
    from belahil.recording import Recorder

    recorder = Recorder(record, config, found.clock)
    return replace(found, clock=recorder.clock, links=recorder)
