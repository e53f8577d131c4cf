"""Measure the noise of a silent receiver at each gain code.

The generator plays 0 V with its output on, so the receiver sees its source resistance. Without gains, which
`procedures.characterize` measures, there is no best code here.

Not modelled: noise that is not stationary, and lines other than the interleave line; the spectrum shows them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.errors import LimitExceeded, RefusedInput
from belahil.outcome import Outcome, Table
from belahil.stimuli import NoSignal
from belahil.values import Estimate, RangeWindow, Shot, WindowRequest
from procedures.clipping import with_clipping
from procedures.dark_noise import LEAST_SAMPLES, DarkNoise, dark_noise
from procedures.plans import Journal, PlannedShot, check_all, measure_all

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from matplotlib.figure import Figure

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.receiver import DigitizerSpec
    from belahil.recorded import RecordedWindows

DARK_WINDOWS = 16


@dataclass(frozen=True, slots=True)
class NoiseOptions:
    """What the user may choose.

    Parameters
    ----------
    codes : tuple of int or None
        Gain codes; None takes all that the receiver reports.
    dark_windows : int
        Silent windows for each gain code, at least one.
    """

    codes: tuple[int, ...] | None = None
    dark_windows: int = DARK_WINDOWS

    def __post_init__(self) -> None:
        if self.codes == ():
            raise RefusedInput("gain codes: at least one is needed")
        if self.dark_windows < 1:
            raise RefusedInput(f"{self.dark_windows} dark windows a code: at least 1 is needed")


@dataclass(frozen=True, slots=True)
class NoisePlan:
    """Every shot of a noise measurement.

    Parameters
    ----------
    codes : tuple of (int or None)
        Gain codes; a single None for a receiver without them.
    dark_windows, sample_count, converters, bits : int
        Windows a code, samples a window, interleaved converters and their resolution.
    """

    codes: tuple[int | None, ...]
    dark_windows: int
    sample_count: int
    converters: int
    bits: int

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """All windows of a code, then those of the next."""
        codes = [code for code in self.codes for _ in range(self.dark_windows)]
        return tuple(
            PlannedShot(WindowRequest(shot, code, self.sample_count), NoSignal())
            for shot, code in enumerate(codes)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        return asdict(self)


def plan(bench: Bench, options: NoiseOptions) -> NoisePlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code that the receiver does not have, or a receiver whose windows are too short.
    """
    spec = bench.spec
    made = NoisePlan(
        codes=gain_codes(spec.gain_codes, options.codes),
        dark_windows=options.dark_windows,
        sample_count=window_length(spec),
        converters=spec.converters,
        bits=spec.bits,
    )
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: NoiseOptions) -> NoisePlan:
    """Take the silent windows of a data file, at the wanted gain codes or at all that it has.

    Raises
    ------
    RefusedInput
        It has none at a code that is wanted.
    LimitExceeded
        They are too short.
    """
    silent = [row for row in range(len(recorded)) if isinstance(recorded.played(row), NoSignal)]
    there = [recorded.request(row) for row in silent]
    codes = tuple(dict.fromkeys(one.gain_code for one in there))
    wanted = codes if options.codes is None else options.codes
    missing = [code for code in wanted if code not in codes]
    if missing or not codes:
        raise RefusedInput(f"{recorded.path}: no window without a signal at gain code {missing or 'any'}")
    spec = recorded.spec
    least = min(one.sample_count for one in there)
    if least < LEAST_SAMPLES:
        raise LimitExceeded(
            f"{recorded.path}: windows of {least} samples: at least {LEAST_SAMPLES} are needed"
        )
    return NoisePlan(wanted, len(there) // len(codes), least, spec.converters, spec.bits)


def gain_codes(known: tuple[int, ...] | None, wanted: tuple[int, ...] | None) -> tuple[int | None, ...]:
    """Return the gain codes to measure: the wanted ones, all known ones, or a single None.

    Raises
    ------
    LimitExceeded
        Codes were asked of a receiver without them.
    """
    if known is None:
        if wanted is not None:
            raise LimitExceeded(f"gain codes {', '.join(map(str, wanted))}: this receiver has no gain codes")
        return (None,)
    return tuple(dict.fromkeys(known if wanted is None else wanted))


def window_length(spec: DigitizerSpec) -> int:
    """Return how many samples to ask for: the receiver's longest window.

    Raises
    ------
    LimitExceeded
        That is too short for a noise spectrum.
    """
    if spec.max_sample_count < LEAST_SAMPLES:
        raise LimitExceeded(
            f"the receiver's longest window has {spec.max_sample_count} samples: "
            f"at least {LEAST_SAMPLES} are needed"
        )
    return spec.max_sample_count


def measure(
    bench: Bench, run: Journal, plan: NoisePlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: NoisePlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into results.

    Parameters
    ----------
    plan : NoisePlan
        What was measured.
    shots : iterable of Shot
        In any order.
    config : BenchConfig
        Not needed here; the same for all procedures.
    """
    windows: dict[int | None, list[RangeWindow]] = {code: [] for code in plan.codes}
    for shot in shots:
        if isinstance(shot.played, NoSignal) and shot.window.gain_code in windows:
            windows[shot.window.gain_code].append(with_clipping(shot, plan.bits).window)
    found = {code: dark_noise(ones, plan.converters) for code, ones in windows.items()}
    return Outcome(
        results={
            "gain_codes": [
                {
                    "code": code,
                    "noise_rms": _json(one.rms),
                    "noise_rms_total": _json(one.rms_total),
                    "offset_difference": _json(one.offset_difference),
                    "windows": one.window_count,
                    "status": one.status,
                }
                for code, one in found.items()
            ]
        },
        tables=_tables(found),
        figures={"noise": lambda: _figure(found)},
        notes=[
            noise_note(plan.converters),
            "Not modelled: noise that is not stationary, and lines other than the interleave line; the "
            "spectrum shows them.",
        ],
        verdict_values={
            "noise_rms_v": [
                ("all" if code is None else f"code {code}", one.rms) for code, one in found.items()
            ]
        },
    )


def noise_note(converters: int) -> str:
    """Say what the two noises of a receiver with so many converters are."""
    taken_out = (
        "quantization and the converter's offset are"
        if converters == 1
        else "quantization, the converters' offsets and the interleave line are"
    )
    return (
        f"noise_rms is the analog noise at the converter; {taken_out} taken out. "
        "noise_rms_total is the raw value."
    )


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.as_json()


def _tables(found: dict[int | None, DarkNoise]) -> dict[str, Table]:
    ones = list(found.values())
    known = np.array([one.rms is not None for one in ones])
    rms = np.array([one.rms.value if one.rms else 0.0 for one in ones])
    rms_u = np.array([one.rms.standard_uncertainty if one.rms else 0.0 for one in ones])
    codes = {
        "code": (np.array([-1 if code is None else code for code in found]), "1", "gain code"),
        "code_noise": (np.ma.masked_array(rms, ~known), "V", "analog noise at the converter, rms"),
        "code_noise_u": (np.ma.masked_array(rms_u, ~known), "V", "its standard uncertainty"),
        "code_noise_total": (np.array([one.rms_total.value for one in ones]), "V", "raw noise, rms"),
        "code_noise_status": (np.array([one.status for one in ones]), "1", "ok, or what is missing"),
    }
    return {"codes": Table(codes, "code"), **spectrum_tables(found)}


def spectrum_tables(found: dict[int | None, DarkNoise]) -> dict[str, Table]:
    """Return frequencies and noise densities by code as tables for the data file."""
    frequency_hz = next(iter(found.values())).frequency_hz
    density = np.stack([one.density_v2_per_hz for one in found.values()])
    words = "one-sided noise density at the converter"
    return {
        "noise_frequency": Table(
            {"noise_frequency": (frequency_hz, "Hz", "frequency of noise_density")}, "noise_frequency"
        ),
        "noise_density": Table({"noise_density": (density, "V2 Hz-1", words)}, "code", "noise_frequency"),
    }


def _figure(found: dict[int | None, DarkNoise]) -> Figure:
    from procedures.noise_figure import noise_figure

    return noise_figure(found)
