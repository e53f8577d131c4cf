"""Test the digitizer of a receiver with sines, after IEEE Std 1057-2017, by gain code.

Each gain code sees sines of a few levels and frequencies, several records of each. They give signal to noise
and distortion (SINAD), effective bits (ENOB), spurious-free range (SFDR), harmonic distortion (THD), noise
floor and offset, and how the two converters differ in gain, offset and sampling time.

The levels are reached as far as interlock and generator let them; what was reached is told with each point.

Not modelled: distortion and noise of the generator, which count as the receiver's; the nonlinearity of single
codes (INL, DNL), which needs a histogram of millions of samples; aperture jitter apart from other noise.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.generators import per_50_ohm
from belahil.stimuli import Sine
from belahil.uncertainty import sized
from belahil.values import Shot, WindowRequest
from procedures.coherent import coherent_frequency
from procedures.dark_noise import LEAST_SAMPLES
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.noise import gain_codes, window_length
from procedures.plans import Journal, PlannedShot, check_all, measure_all
from procedures.sine_fit import SinePlan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.outcome import Outcome
    from belahil.recorded import RecordedWindows

LEVELS_DBFS = (-1.0, -7.0)
"""Default peaks of the sines, dB of half the converter's span."""
RECORDS = 4
PLACES = (1 / 80, 1 / 16, 1 / 6, 0.36)
"""Default frequencies as parts of the sample rate: 1, 5, 13.3 and 28.8 MHz at 80 MHz."""
_ROUNDING = 1.1e-3
"""The amplitude is rounded to four digits here and in the generator, perhaps upwards."""


@dataclass(frozen=True, slots=True)
class DigitizerOptions:
    """What the user may choose.

    Parameters
    ----------
    codes : tuple of int or None
        Gain codes; None takes all that the receiver reports.
    levels_dbfs : tuple of float
        Peaks of the sines at the converter, dB of half its span; at most 0.
    frequencies_hz : tuple of float or None
        None takes four coherent ones up to 0.36 of the sample rate, or to the generator's limit.
    records : int
        Windows of each sine, at least two.
    receiver : KnownReceiver or None
        Whose gains set the amplitudes; None: the preset.
    """

    codes: tuple[int, ...] | None = None
    levels_dbfs: tuple[float, ...] = LEVELS_DBFS
    frequencies_hz: tuple[float, ...] | None = None
    records: int = RECORDS
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        if self.codes == () or not self.levels_dbfs or self.frequencies_hz == ():
            raise RefusedInput("gain codes, levels and frequencies: each list needs at least one value")
        if any(not -120 <= level <= 0 for level in self.levels_dbfs):
            told = ", ".join(f"{level:g}" for level in self.levels_dbfs)
            raise RefusedInput(f"levels {told} dBFS: allowed: -120 to 0")
        if self.records < 2:
            raise RefusedInput(f"{self.records} records of a sine: at least 2 are needed")


@dataclass(frozen=True, slots=True)
class DigitizerPlan:
    """Every shot of a digitizer test.

    Parameters
    ----------
    codes : tuple of (int or None)
        Gain codes; a single None for a receiver without them.
    sines : tuple of (frequency_hz, tuple of (amplitude_vpp, tuple of int))
        For each frequency each amplitude at the cut, V, with the places in `codes` that see it.
    records, sample_count, converters, bits : int
        Windows of each sine, samples a window, interleaved converters and their resolution.
    """

    codes: tuple[int | None, ...]
    sines: tuple[tuple[float, tuple[tuple[float, tuple[int, ...]], ...]], ...]
    records: int
    sample_count: int
    converters: int
    bits: int

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """All that see one sine follow each other."""
        wanted = [
            (Sine(frequency_hz, amplitude_vpp), self.codes[place])
            for frequency_hz, amplitudes in self.sines
            for amplitude_vpp, places in amplitudes
            for place in places
            for _ in range(self.records)
        ]
        return tuple(
            PlannedShot(WindowRequest(shot, code, self.sample_count), sine)
            for shot, (sine, code) in enumerate(wanted)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        return asdict(self)


def plan(bench: Bench, options: DigitizerOptions) -> DigitizerPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code or frequency that receiver or generator does not have, or too short windows.
    RefusedInput
        A frequency at which no sine can be measured, or a known receiver that is another one.
    """
    spec = bench.spec
    refuse_other(options.receiver, spec, "the receiver on the bench")
    count = window_length(spec)
    codes = gain_codes(spec.gain_codes, options.codes)
    frequencies = options.frequencies_hz
    if frequencies is None:
        most = bench.generator_model.max_sine_hz
        frequencies = tuple(
            coherent_frequency(part * spec.sample_rate_hz, spec.sample_rate_hz, count)
            for part in PLACES
            if part * spec.sample_rate_hz <= most
        )
    for frequency_hz in frequencies:
        _refuse_unmeasurable(frequency_hz, spec.sample_rate_hz, count, spec.converters == 2)
    known = options.receiver or preset_receiver(bench.config)
    made = DigitizerPlan(
        codes=codes,
        sines=tuple(
            (frequency_hz, _amplitudes(bench, known, codes, frequency_hz, options.levels_dbfs))
            for frequency_hz in dict.fromkeys(frequencies)
        ),
        records=options.records,
        sample_count=count,
        converters=spec.converters,
        bits=spec.bits,
    )
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: DigitizerOptions) -> DigitizerPlan:
    """Take the sines of a data file, at the wanted gain codes and frequencies or at all that it has.

    Raises
    ------
    RefusedInput
        It has none of those, or its windows have different lengths or are too short.
    """
    found: dict[float, dict[float, set[int]]] = {}
    lengths = set()
    for row in range(len(recorded)):
        sine, request = recorded.played(row), recorded.request(row)
        if (
            isinstance(sine, Sine)
            and (options.codes is None or request.gain_code in options.codes)
            and (options.frequencies_hz is None or sine.frequency_hz in options.frequencies_hz)
        ):
            code = -1 if request.gain_code is None else request.gain_code
            found.setdefault(sine.frequency_hz, {}).setdefault(sine.amplitude_vpp, set()).add(code)
            lengths.add(request.sample_count)
    if not found:
        raise RefusedInput(f"{recorded.path}: has no window with a sine of those that are wanted")
    if len(lengths) > 1 or min(lengths) < LEAST_SAMPLES:
        raise RefusedInput(
            f"{recorded.path}: windows of {min(lengths)} to {max(lengths)} samples: they must be of one "
            f"length, at least {LEAST_SAMPLES}"
        )
    codes = sorted(set().union(*(ones for amplitudes in found.values() for ones in amplitudes.values())))
    sines = tuple(
        (hz, tuple((vpp, tuple(map(codes.index, sorted(ones)))) for vpp, ones in sorted(amplitudes.items())))
        for hz, amplitudes in sorted(found.items())
    )
    spec, told = recorded.spec, tuple(None if code < 0 else code for code in codes)
    return DigitizerPlan(told, sines, options.records, lengths.pop(), spec.converters, spec.bits)


def _amplitudes(
    bench: Bench,
    known: KnownReceiver,
    codes: tuple[int | None, ...],
    frequency_hz: float,
    levels_dbfs: tuple[float, ...],
) -> tuple[tuple[float, tuple[int, ...]], ...]:
    """Return the amplitudes at the cut, V peak to peak, and which places in `codes` see each."""
    passed = float(butterworth.magnitude(frequency_hz, known.cutoff.value, known.order, known.highpass_hz))
    least, most = _reach_vpp(bench)
    found: dict[float, list[int]] = {}
    for place, code in enumerate(codes):
        gain = known.at(code).gain.value * passed
        wanted = (known.adc_full_scale_v * 10 ** (level / 20) / gain for level in levels_dbfs)
        for amplitude in dict.fromkeys(float(f"{min(max(one, least), most):.4g}") for one in wanted):
            found.setdefault(amplitude, []).append(place)
    return tuple((amplitude, tuple(places)) for amplitude, places in sorted(found.items()))


def _reach_vpp(bench: Bench) -> tuple[float, float]:
    """Return the least and the largest amplitude at the cut that generator and interlock let through, V."""
    model, part = bench.generator_model, bench.config.generator
    unit = per_50_ohm(part.load_ohm) / bench.setting_per_cut_volt
    most = min(part.max_vpp, 2 * model.max_peak_v * unit) * (1 - _ROUNDING)
    return min(model.min_amplitude_vpp * unit * (1 + _ROUNDING), most), most


def _refuse_unmeasurable(frequency_hz: float, rate_hz: float, count: int, interleaved: bool) -> None:
    if SinePlan(frequency_hz, rate_hz, count, interleaved).foreseen != "ok":
        step = 4 if interleaved else 2
        raise RefusedInput(
            f"frequency {frequency_hz / 1e6:g} MHz: no sine can be measured there; allowed: at least "
            f"{sized(rate_hz / count / 2, 'Hz', 3)} away from 0 and not a multiple of fs/{step} = "
            f"{rate_hz / step / 1e6:g} MHz"
        )


def measure(
    bench: Bench, run: Journal, plan: DigitizerPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: DigitizerPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into results.

    Parameters
    ----------
    plan : DigitizerPlan
        What was measured.
    shots : iterable of Shot
        Gone through more than once; an iterator is turned into a list first.
    config : BenchConfig
        Attenuation, load and declared uncertainties; ``[emulation]`` is not read.
    """
    from procedures.digitizer_outcome import outcome
    from procedures.digitizer_points import read_points

    return outcome(plan, read_points(plan, shots, config), config)
