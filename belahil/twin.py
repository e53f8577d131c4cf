"""A twin: an emulated bench whose hidden truth is what a characterization measured of a receiver.

A characterization of the twin agrees with that of the original within the uncertainties of both. What was
not measured has the value of the receiver's preset, or none, and a line says so.

Not in a twin, since a characterization does not measure it: interference of the laser, the transmitted pulse,
noise of another colour than the filter's, a filter that is not Butterworth or differs by gain code. What the
generator does wrong, beyond the bandwidth that the bench file tells, is in the gains as measured.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from belahil.config import (
    BenchConfig,
    EmulatedGenerator,
    EmulatedReceiver,
    EmulationTable,
    Interleave,
    SmallSignal,
)
from belahil.errors import RefusedInput
from belahil.oscilloscopes import SCOPES, scope_spec
from belahil.receiver import receiver_preset
from belahil.uncertainty import by_chance, sized

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from belahil.oscilloscopes import SCOPES, scope_spec
from belahil.receiver import DigitizerSpec, ReceiverSpec

_CLOCK_PPM = 250.0  # what `[emulation.receiver] clock_ppm` allows


@dataclass(frozen=True, slots=True)
class Twin:
    """A bench file with a twin of a receiver.

    Parameters
    ----------
    config : BenchConfig
        Emulated, with an ``[emulation]`` table.
    told : tuple of str
        A line for each key: what it is and where it is from.
    """

    config: BenchConfig
    told: tuple[str, ...]


def twin_of(
    summary: Mapping[str, Any],
    config: BenchConfig,
    spec: DigitizerSpec,
    volts_per_count: float,
    seed: int = 1,
) -> Twin:
    """Make a twin of what a characterization measured.

    Parameters
    ----------
    summary : mapping
        ``summary.json`` of ``belahil characterize``.
    config : BenchConfig
        The bench of that run; its ``[emulation]`` is not read.
    spec : DigitizerSpec
        What the receiver reported of its converters.
    volts_per_count : float
        One step of its converters, V.
    seed : int
        Of the twin's own chance.

    Raises
    ------
    RefusedInput
        No run of ``characterize``, no gain code with gain, cut-off and whole order, or converters of another
        kind than those of the preset that the bench file names.
    """
    if summary.get("procedure") != "characterize":
        raise RefusedInput(
            f"a twin of a run of {summary.get('procedure')}: needed is one of belahil characterize"
        )
    preset = receiver_preset(config.digitizer.receiver)
    is_scope = config.digitizer.driver in SCOPES
    _refuse_other(spec, scope_spec(config.digitizer, preset) if is_scope else preset.digitizer, preset.name)
    results = summary["results"]
    whole = [
        row for row in results["gain_codes"] if row["gain"] and row["cutoff"] and row["order"]["integer"]
    ]
    if not whole:
        raise RefusedInput(
            "a twin of a run without any gain code that has a gain, a cut-off and a whole order"
        )
    told: list[str] = []
    small = _small_signal(results["small_signal"], told)
    fits = [_fit(row, small, results.get("gain_by_amplitude", ())) for row in whole]
    receiver = EmulatedReceiver(
        cutoff_hz=_mean([fit["cutoff"] for fit in fits], "cutoff_hz", told),
        order=_order(whole, told),
        highpass_hz=_highpass(fits, told),
        gain_by_code=_by_code(
            {row["code"]: fit["gain"] for row, fit in zip(whole, fits, strict=True)},
            preset,
            preset.gain_by_code,
            "gain_by_code",
            told,
        ),
        noise_rms_v_by_code=_by_code(
            {row["code"]: row["noise_rms"] for row in results["gain_codes"]},
            preset,
            preset.noise_rms_v_by_code,
            "noise_rms_v_by_code",
            told,
        ),
        small_signal=small or SmallSignal(),
        # An oscilloscope's converter is no part of the receiver: its bench file says it.
        adc_full_scale_v=None if is_scope else volts_per_count * 2**spec.bits,
        adc_bits=None if is_scope else spec.bits,
        clock_ppm=_clock_ppm(results["clock_ppm"], told),
        interleave=_interleave(results["interleave"] or {}, told),
        input_ohm=config.digitizer.input_ohm,
    )
    told.append("emc_burst and [emulation.transmitter]: defaults, a characterization does not measure them")
    emulation = EmulationTable(
        seed=seed, generator=EmulatedGenerator(bandwidth_hz=config.generator.bandwidth_hz), receiver=receiver
    )
    bench = replace(
        config,
        bench=replace(config.bench, settle_s=0.0),
        generator=replace(config.generator, address="emulated", visa_library=""),
        digitizer=replace(config.digitizer, link="emulated:visa" if is_scope else "emulated:serial"),
        emulation=emulation,
    )
    return Twin(bench, tuple(told))


def _refuse_other(spec: DigitizerSpec, its: DigitizerSpec, name: str) -> None:
    told = [(one.converters, one.gain_codes, sized(one.sample_rate_hz, "Sa/s", 4)) for one in (spec, its)]
    if told[0] != told[1]:
        words = "{0} converters, gain codes {1}, {2}"
        raise RefusedInput(
            f"the receiver of the run has {words.format(*told[0])}; a twin takes those of preset {name}, "
            f"which has {words.format(*told[1])}; [digitizer] receiver of the run names the preset"
        )


def _small_signal(told_of_all: Mapping[str, Any], told: list[str]) -> SmallSignal | None:
    """Return how the receiver is bent; None where it is not, as far as its uncertainties tell."""
    status = told_of_all["status"]
    # "inconsistent" codes have a mean all the same, with an uncertainty that is widened for it.
    if status not in ("ok", "inconsistent"):
        told.append(f"small_signal: none ({status})")
        return None
    cubic, dead = told_of_all["cubic_per_v2"], told_of_all["deadband_v"]
    said = "" if status == "ok" else f" ({status}: gain codes differ by more than chance)"
    told.append(
        f"small_signal: cubic term {_text(cubic)}, dead zone {_text(dead)}{said}"
        + ("; a negative dead zone cannot be emulated, it is 0" if dead["value"] < 0 else "")
    )
    return SmallSignal(cubic_per_v2=cubic["value"], deadband_v=max(0.0, dead["value"]))


def _fit(
    row: dict[str, Any], small: SmallSignal | None, by_amplitude: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return gain, cut-off and high-pass of a code: of its linear part where the receiver is bent.

    All codes of a twin share one bend. A code whose own fit says a little otherwise keeps its measured gains
    by amplitude, so its gain for small signals moves against the bend.
    """
    fit: dict[str, Any] = row.get("small_signal") or {}
    if small is None or not (fit.get("gain") and fit.get("cutoff")):
        return row
    own = SmallSignal(fit["cubic_per_v2"]["value"], fit["deadband_v"]["value"])
    mine = [one for one in by_amplitude if one["code"] == row["code"] and one["sine_fit"]["value"] > 0]
    weights = [one["sine_fit"]["standard_uncertainty"] ** -2 for one in mine]
    ratios = [_kept(one["amplitude_vpp"] / 2, own) / _kept(one["amplitude_vpp"] / 2, small) for one in mine]
    moved = math.fsum(map(operator.mul, weights, ratios)) / math.fsum(weights) if mine else 1.0
    return fit | {"gain": fit["gain"] | {"value": fit["gain"]["value"] * moved}}


def _kept(peak_v: float, small: SmallSignal) -> float:
    """Part of a sine that is left of it, to first order in dead zone and cubic term."""
    return 1 - 4 / math.pi * small.deadband_v / peak_v + 0.75 * small.cubic_per_v2 * peak_v**2


def _order(whole: Sequence[dict[str, Any]], told: list[str]) -> int:
    counts: dict[int, int] = {}
    for row in whole:
        counts[row["order"]["integer"]] = counts.get(row["order"]["integer"], 0) + 1
    order = max(counts, key=counts.__getitem__)
    told.append(f"order: {order}, of {counts[order]} of {len(whole)} gain codes")
    return order


def _mean(ones: Sequence[dict[str, Any]], key: str, told: list[str]) -> float:
    """Return the weighted mean over gain codes, which share the number in an emulated receiver."""
    weights = [
        (min(one["standard_uncertainty"] for one in ones) / one["standard_uncertainty"]) ** 2 for one in ones
    ]
    mean = math.fsum(w * one["value"] for w, one in zip(weights, ones, strict=True)) / math.fsum(weights)
    chi_square = sum(((one["value"] - mean) / one["standard_uncertainty"]) ** 2 for one in ones)
    said = f"{key}: {sized(mean, 'Hz')}, mean of {len(ones)} gain codes"
    if len(ones) > 1 and not by_chance(chi_square, len(ones) - 1):
        said += f", which differ by more than chance (chi-square {chi_square:.4g} for {len(ones) - 1})"
    told.append(said)
    return mean


def _highpass(fits: Sequence[dict[str, Any]], told: list[str]) -> float:
    corners = [fit["highpass"] for fit in fits if fit["highpass"]]
    if not corners:
        told.append("highpass_hz: none was seen")
        return 0.0
    return _mean(corners, "highpass_hz", told)


def _by_code(
    found: Mapping[int | None, dict[str, Any] | None],
    preset: ReceiverSpec,
    otherwise: Sequence[float],
    key: str,
    told: list[str],
) -> tuple[float, ...]:
    codes = preset.digitizer.gain_codes or (None,)
    measured = {code: one["value"] for code, one in found.items() if one is not None}
    lacking = [code for code in codes if code not in measured]
    told.append(f"{key}: {len(measured)} of {len(codes)} gain codes measured")
    if lacking:
        told.append(f"{key}: preset {preset.name} at gain code {', '.join(map(str, lacking))}, not measured")
    return tuple(measured.get(code, value) for code, value in zip(codes, otherwise, strict=True))


def _clock_ppm(measured: dict[str, Any] | None, told: list[str]) -> float:
    if measured is None:
        told.append("clock_ppm: 0, not measured")
        return 0.0
    ppm = float(measured["value"])
    if abs(ppm) > _CLOCK_PPM:
        raise RefusedInput(
            f"clock error {ppm:.6g} ppm: a twin can have -{_CLOCK_PPM:g} to {_CLOCK_PPM:g} ppm; "
            "do generator and receiver run from what the bench file says?"
        )
    told.append(f"clock_ppm: {_text(measured)}")
    return ppm


def _interleave(measured: Mapping[str, Any], told: list[str]) -> Interleave:
    keys = ("gain", "offset_v", "skew_s")
    parts = {key: measured[key]["value"] for key in keys if measured.get(key)}
    told += [
        f"interleave.{key}: {_text(measured[key])}" if key in parts else f"interleave.{key}: 0, not measured"
        for key in keys
    ]
    return Interleave(**parts)


def _text(measured: dict[str, Any]) -> str:
    from belahil.report.tables import one_text

    return one_text(measured)
