"""What an analysis may assume about the receiver under test: from a characterization, or from its preset.

Not modelled: a cut-off that differs between gain codes; what differs enters the uncertainty. A receiver
that is not linear: what it does to a pulse beside its linear part shows as a difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.receiver import receiver_preset
from belahil.uncertainty import sized
from belahil.values import Estimate

if TYPE_CHECKING:
    from belahil.config import BenchConfig
    from belahil.receiver import DigitizerSpec

PRESET_RELATIVE = 0.01
"""Assumed standard uncertainty of gain and cut-off of a receiver that nobody measured: 1 %."""


@dataclass(frozen=True, slots=True)
class KnownCode:
    """A receiver at one gain code.

    Parameters
    ----------
    code : int or None
        None for a receiver without gain codes.
    gain : Estimate
        Pass band, V/V from the cut to the converter.
    noise_rms : Estimate or None
        Analog noise at the converter, V; None where it was not measured.
    """

    code: int | None
    gain: Estimate
    noise_rms: Estimate | None = None


@dataclass(frozen=True, slots=True)
class KnownReceiver:
    """A receiver as far as it is known.

    Parameters
    ----------
    origin : str
        Where the numbers are from, in a few words.
    sample_interval_s : float
        Nominal, of all interleaved converters together, s.
    converters, bits : int
        Interleaved converters and their resolution.
    adc_full_scale_v : float
        Whole span of the converters, V.
    order : int
        Of the Butterworth low-pass.
    cutoff : Estimate
        Its -3 dB frequency, Hz.
    codes : tuple of KnownCode
        At least one.
    highpass : Estimate or None
        Corner of the high-pass, Hz; None where there is none, or none could be seen.
    clock_ppm, interleave_gain, interleave_offset, interleave_skew : Estimate or None
        As in ``summary.json`` of ``characterize``.

    Raises
    ------
    RefusedInput
        No gain code.
    """

    origin: str
    sample_interval_s: float
    converters: int
    bits: int
    adc_full_scale_v: float
    order: int
    cutoff: Estimate
    codes: tuple[KnownCode, ...]
    highpass: Estimate | None = None
    clock_ppm: Estimate | None = None
    interleave_gain: Estimate | None = None
    interleave_offset: Estimate | None = None
    interleave_skew: Estimate | None = None

    def __post_init__(self) -> None:
        if not self.codes:
            raise RefusedInput(f"{self.origin}: no gain code has a gain; at least one is needed")

    @property
    def highpass_hz(self) -> float:
        """Corner of the high-pass, Hz; 0 for none."""
        return 0.0 if self.highpass is None else self.highpass.value

    @property
    def poles(self) -> tuple[complex, ...]:
        """Poles of the filter, rad/s."""
        return butterworth.poles(self.cutoff.value, self.order, self.highpass_hz)

    @property
    def zeros(self) -> int:
        """Zeros of the filter at 0 Hz."""
        return int(self.highpass_hz > 0)

    @property
    def true_interval_s(self) -> float:
        """Time between samples by the measured clock, s; the nominal one where the clock is not known."""
        ppm = 0.0 if self.clock_ppm is None else self.clock_ppm.value
        return self.sample_interval_s / (1 + 1e-6 * ppm)

    def samples_every(self, interval_s: float) -> bool:
        """Tell whether a nominal interval, s, is that of this receiver; clocks err beside it."""
        return math.isclose(interval_s, self.sample_interval_s, rel_tol=1e-6)

    def at(self, code: int | None) -> KnownCode:
        """Return what is known at a gain code.

        Raises
        ------
        RefusedInput
            Nothing is.
        """
        for one in self.codes:
            if one.code == code:
                return one
        known = ", ".join(str(one.code) for one in self.codes)
        raise RefusedInput(f"gain code {code}: {self.origin} knows the gain of {known}")


def refuse_other(known: KnownReceiver | None, spec: DigitizerSpec, where: str) -> None:
    """Refuse what is known of a receiver where windows come from another one.

    Parameters
    ----------
    known : KnownReceiver or None
        None: nothing to compare.
    spec : DigitizerSpec
        Of the receiver that digitizes or digitized.
    where : str
        Of the windows, for the message.

    Raises
    ------
    RefusedInput
        Sample intervals, converters or bits differ.
    """
    if known is None:
        return
    told = [(one.converters, one.bits, sized(one.sample_interval_s, "s", 4)) for one in (spec, known)]
    if not known.samples_every(spec.sample_interval_s) or told[0][:2] != told[1][:2]:
        words = "{} converters with {} bit and a sample every {}"
        raise RefusedInput(f"{where}: {words.format(*told[0])}; {known.origin}: {words.format(*told[1])}")


def preset_receiver(config: BenchConfig) -> KnownReceiver:
    """Return the preset that ``[digitizer] receiver`` names; its gain and cut-off are assumed to 1 %."""
    spec = receiver_preset(config.digitizer.receiver)
    codes = spec.digitizer.gain_codes or (None,)
    rows = zip(codes, spec.gain_by_code, spec.noise_rms_v_by_code, strict=True)
    return KnownReceiver(
        origin=f"preset {spec.name}",
        sample_interval_s=spec.digitizer.sample_interval_s,
        converters=spec.digitizer.converters,
        bits=spec.digitizer.bits,
        adc_full_scale_v=spec.adc_full_scale_v,
        order=spec.order,
        cutoff=Estimate(spec.cutoff_hz, PRESET_RELATIVE * spec.cutoff_hz, "Hz"),
        codes=tuple(
            KnownCode(code, Estimate(gain, PRESET_RELATIVE * gain), Estimate(noise_v, 0.1 * noise_v, "V"))
            for code, gain, noise_v in rows
        ),
    )


def characterized_receiver(folder: str | Path) -> KnownReceiver:
    """Read what ``belahil characterize`` measured.

    Parameters
    ----------
    folder : str or Path
        A finished run folder.

    Raises
    ------
    RefusedInput
        No finished run of ``characterize``, or one in which no gain code has gain, cut-off and whole order.

    Notes
    -----
    The cut-off is the weighted mean over gain codes. Its uncertainty is that of the best code, not less,
    since declared errors are common to all; it grows by Birge's ratio where the codes disagree.

    Gain, cut-off and high-pass of a code are those of its small-signal fit wherever that describes its gains,
    also where dead zone and cubic term are not significant: to leave them out only then would be a choice by
    the same data, and what is just too small to be significant moves the pooled gain by seven of its
    standard uncertainties. Elsewhere they are those of the pooled fit.
    """
    from belahil.recorded import read_windows
    from belahil.run_folder import read_bench, read_json

    folder = Path(folder)
    if not (folder / "summary.json").is_file():
        raise RefusedInput(
            f"--receiver {folder}: there is no finished run; needed is one of belahil characterize"
        )
    summary = read_json(folder / "summary.json")
    if summary.get("procedure") != "characterize":
        raise RefusedInput(
            f"--receiver {folder}: holds a run of {summary.get('procedure')}; "
            "needed is one of belahil characterize"
        )
    results = summary["results"]
    whole = [
        row for row in results["gain_codes"] if row["gain"] and row["cutoff"] and row["order"]["integer"]
    ]
    if not whole:
        raise RefusedInput(f"--receiver {folder}: no gain code has a gain, a cut-off and a whole order")
    spec, preset = (
        read_windows(folder / "data.nc").spec,
        receiver_preset(read_bench(folder).digitizer.receiver),
    )
    linear = [_linear_part(row) for row in whole]
    corners = [one for fit in linear if (one := _estimate(fit["highpass"])) is not None]
    interleave = results["interleave"] or {}
    return KnownReceiver(
        origin=f"characterization begun {summary['started']}",
        sample_interval_s=spec.sample_interval_s,
        converters=spec.converters,
        bits=spec.bits,
        adc_full_scale_v=preset.adc_full_scale_v,
        order=int(np.bincount([row["order"]["integer"] for row in whole]).argmax()),
        cutoff=_mean([Estimate(**fit["cutoff"]) for fit in linear]),
        highpass=_mean(corners) if corners else None,
        codes=tuple(
            KnownCode(row["code"], Estimate(**fit["gain"]), _estimate(row["noise_rms"]))
            for row, fit in zip(whole, linear, strict=True)
        ),
        clock_ppm=_estimate(results["clock_ppm"]),
        interleave_gain=_estimate(interleave.get("gain")),
        interleave_offset=_estimate(interleave.get("offset_v")),
        interleave_skew=_estimate(interleave.get("skew_s")),
    )


def _linear_part(row: dict[str, Any]) -> dict[str, Any]:
    """Return which fit of a gain code tells gain, cut-off and high-pass of its linear part."""
    fit = row.get("small_signal", {})
    # Runs of earlier versions do not tell the filter of this fit.
    described = fit.get("status") in ("ok", "not_significant") and fit.get("gain") and fit.get("cutoff")
    return fit if described else row


def _estimate(told: dict[str, Any] | None) -> Estimate | None:
    return None if told is None else Estimate(**told)


def _mean(ones: list[Estimate]) -> Estimate:
    values, spreads = (
        np.array([getattr(one, name) for one in ones]) for name in ("value", "standard_uncertainty")
    )
    weights = spreads.min() ** 2 / spreads**2
    mean = float(weights @ values / weights.sum())
    chi_square = float(np.sum(((values - mean) / spreads) ** 2))
    ratio = math.sqrt(max(1.0, chi_square / max(1, len(ones) - 1)))
    return Estimate(mean, ratio * float(spreads.min()), ones[0].unit)
