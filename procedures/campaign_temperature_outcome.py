"""The outcome of a temperature campaign: differences, range bias, amplitudes, and the wrong library."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline

from belahil.outcome import BudgetLine, Outcome, Table
from belahil.uncertainty import budget
from belahil.values import Estimate
from procedures.campaign_temperature import AZIMUTHS_DEG, PARTS, SETS, STEPS, STRENGTHS
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.presets import THERMAL_SOURCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan

PUBLISHED_V = 2e-3
"""The text: shapes vary by up to 2 mV."""
_WIDE = (STRENGTHS[0], STRENGTHS[1])
"""The strength is taken to lie between these with any value as likely."""


@dataclass(frozen=True, slots=True, eq=False)
class Sets:
    """What the chunks gave, by name of the set or variation.

    Parameters
    ----------
    found : dict
        The pulses.
    matched : dict
        ``msr_v2``, ``slope_deg``, ``factor`` with the ambient library, by name.
    between_v2 : ndarray of float64
        MSR of the ambient set over a plane midway between two slopes of the library, V^2.
    """

    found: dict[str, dict[str, NDArray[Any]]]
    matched: dict[str, dict[str, NDArray[Any]]]
    between_v2: NDArray[np.float64]

    @property
    def assumed(self) -> bool:
        """Whether the sets are the assumed ones."""
        return f"hot, times {STRENGTHS[0]:g}" in self.found


@dataclass(frozen=True, slots=True)
class Change:
    """What one set does against another.

    Parameters
    ----------
    difference_v : float
        Largest difference of the digitized pulses when their peaks coincide, V.
    range_bias_m : float
        How much farther the ground seems, m: from the fitted arrivals of return and transmitted pulse.
    pointing_m : float
        What of it the light's place on the ground makes, m.
    amplitude, peak : float
        Relative change of the fitted amplitude and of the peak.
    fwhm_s : float
        Change of the fitted width, s.
    """

    difference_v: float
    range_bias_m: float
    pointing_m: float
    amplitude: float
    peak: float
    fwhm_s: float


def gathered(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Sets:
    """Give the results their names."""
    names = [chunk.name for chunk in plan.chunks[:-1]]
    last = results[-1]
    matched = {name: {key: last[key][at] for key in last} for at, name in enumerate(names)}
    return Sets(dict(zip(names, results[:-1], strict=True)), matched, last["msr_v2"][-1])


def peak_of(one: dict[str, NDArray[Any]]) -> tuple[float, float]:
    """Time and height of the peak of a pulse, s and V."""
    curve = CubicSpline(one["time_s"], one["volts"])
    middle = int(np.argmax(one["volts"]))
    near = curve.derivative().roots(extrapolate=False)
    step_s = one["time_s"][1] - one["time_s"][0]
    near = near[np.abs(near - one["time_s"][middle]) <= step_s]
    place_s = float(near[np.argmax(curve(near))]) if near.size else float(one["time_s"][middle])
    return place_s, float(curve(place_s))


def aligned(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    """Return the pulse of `one`, moved so that its peak comes with the other's, at the other's times, V."""
    late_s = peak_of(one)[0] - peak_of(other)[0]
    return np.asarray(CubicSpline(one["time_s"], one["volts"])(other["time_s"] + late_s))


def change(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> Change:
    """Compare a set with another."""
    whole_s = (one["fit"][0] - one["transmitted_fit"][0]) - (other["fit"][0] - other["transmitted_fit"][0])
    peaks_v = peak_of(one)[1], peak_of(other)[1]
    # Where a moved pulse would be read beyond what is stored, nothing is left of either.
    inner = slice(STEPS, -STEPS)
    return Change(
        float(np.abs(aligned(one, other) - other["volts"])[inner].max()),
        float(SPEED_OF_LIGHT_M_PER_S / 2 * whole_s),
        float(SPEED_OF_LIGHT_M_PER_S / 2 * (one["ground_s"][0] - other["ground_s"][0])),
        float(one["fit"][2] / other["fit"][2] - 1),
        peaks_v[0] / peaks_v[1] - 1,
        float(one["fit"][1] - other["fit"][1]),
    )


def outcome(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Bring everything into the form that a run keeps."""
    sets = gathered(plan, results)
    return Outcome(
        results=_results(sets),
        tables=_tables(sets),
        figures={"temperature": lambda: _figure(sets)},
        budget=_budget(sets),
        notes=[*_DEFINITIONS.values(), *_notes(sets)],
    )


_DEFINITIONS = {
    "difference": "Difference: the largest, at any time, of the filtered and amplified pulses without noise "
    "when the peaks of both are made to coincide.",
    "range_bias": "Range bias: c/2 times the change of the time between the fitted Gaussians of the "
    "transmitted pulse behind the fibre and of the return pulse. The true range is that at nominal pointing, "
    "so a beam that points elsewhere on a slope is in it.",
    "msr": "MSR: mean squared residual of a correlation window about the best pulse of the library of flat "
    "slopes of the ambient set, scaled and moved; mean and largest over azimuths of the slope and over "
    "places between two samples.",
    "uncertainty": "Standard uncertainties: of the assumed changes, which are taken to be 0.5 to 1.5 times "
    "as large with any value as likely. Zero where lasers were given; theirs is not known here.",
}


def _notes(sets: Sets) -> list[str]:
    if not sets.assumed:
        return ["The lasers are those of scenes; photons and wavelength are those of the campaign's scene."]
    return [f"Assumed: the sets hot and cold; {THERMAL_SOURCE.text}."]


def _results(sets: Sets) -> dict[str, Any]:
    ambient = sets.found["ambient"]
    against = {name: _change(sets, name, "ambient") for name in ("cold", "hot")}
    night_v, day_v = ambient["day_night_v"].tolist()
    return {
        "assumed": sets.assumed,
        "names": list(sets.found),
        "photons": {"sent": float(ambient["photons"][0]), "received": float(ambient["photons"][1])},
        "noise_v": {"night": night_v, "day": day_v},
        "sets": {name: _set(sets, name) for name in SETS},
        "against_ambient": against,
        "hot_against_cold": _change(sets, "hot", "cold"),
        "published_difference_v": PUBLISHED_V,
        "msr_between_library_slopes_v2": float(sets.between_v2.mean()),
        "strength_of_published_difference": _strength(sets),
        "range_bias_by_azimuth": _by_azimuth(sets),
        "parts": _parts(sets),
        "definitions": _DEFINITIONS,
    }


def _measured(value: float, uncertainty: float, unit: str) -> dict[str, Any]:
    return Estimate(float(value), float(uncertainty), unit).as_json()


def _set(sets: Sets, name: str) -> dict[str, Any]:
    one, match = sets.found[name], sets.matched[name]

    def number(key: str, read: Any, unit: str) -> dict[str, Any]:
        return _measured(read(name), _uncertain(sets, name, read), unit)

    return {
        "photons_received": float(one["photons"][1]),
        "peak": number("peak", lambda at: peak_of(sets.found[at])[1], "V"),
        "fwhm": number("fwhm", lambda at: float(sets.found[at]["fit"][1]), "s"),
        "amplitude": number("amplitude", lambda at: float(sets.found[at]["fit"][2]), "V"),
        "msr_ambient_library": number("msr", lambda at: float(sets.matched[at]["msr_v2"].mean()), "V2"),
        "msr_ambient_library_largest_v2": float(match["msr_v2"].max()),
        "library_slope_deg": float(match["slope_deg"].mean()),
    }


def _uncertain(sets: Sets, name: str, read: Any) -> float:
    """Standard deviation over assumed strengths, any between the two limits as likely."""
    if not sets.assumed or name == "ambient":
        return 0.0
    low, high = (read(f"{name}, times {strength:g}") for strength in _WIDE)
    return float(abs(high - low) / math.sqrt(12))


def _change(sets: Sets, name: str, other: str) -> dict[str, Any]:
    here = change(sets.found[name], sets.found[other])
    units = {"difference_v": "V", "range_bias_m": "m", "pointing_m": "m", "fwhm_s": "s"}
    found = {}
    for key in Change.__slots__:
        u = 0.0
        if sets.assumed:
            low, high = (
                getattr(
                    change(
                        sets.found[f"{name}, times {strength:g}"],
                        sets.found[other if other == "ambient" else f"{other}, times {strength:g}"],
                    ),
                    key,
                )
                for strength in _WIDE
            )
            u = abs(high - low) / math.sqrt(12)
        found[key.removesuffix("_v").removesuffix("_m").removesuffix("_s")] = _measured(
            getattr(here, key), u, units.get(key, "1")
        )
    return found


def _strength(sets: Sets) -> dict[str, float | None] | None:
    """How many times the assumed changes make the published difference, against ambient and each other."""
    if not sets.assumed:
        return None
    strengths = sorted((*STRENGTHS, 1.0))
    found: dict[str, float | None] = {}
    for name, other in (("cold", "ambient"), ("hot", "ambient"), ("hot", "cold")):
        differences_v = [0.0]
        for strength in strengths:
            ending = "" if strength == 1.0 else f", times {strength:g}"
            against = other if other == "ambient" else other + ending
            differences_v.append(change(sets.found[name + ending], sets.found[against]).difference_v)
        reached = differences_v[-1] >= PUBLISHED_V
        at = float(np.interp(PUBLISHED_V, differences_v, [0.0, *strengths])) if reached else None
        found[f"{name}_{other}"] = at
    return found


def _by_azimuth(sets: Sets) -> list[dict[str, float]]:
    """What pointing does to the range when the slope rises in other directions, m."""
    ambient_s = sets.found["ambient"]["ground_s"]
    return [
        {"azimuth_deg": turn}
        | {
            f"{name}_m": float(
                SPEED_OF_LIGHT_M_PER_S / 2 * (sets.found[name]["ground_s"][at] - ambient_s[at])
            )
            for name in ("cold", "hot")
        }
        for at, turn in enumerate(AZIMUTHS_DEG)
    ]


def _parts(sets: Sets) -> dict[str, Any] | None:
    """Each change of a set alone."""
    if not sets.assumed:
        return None
    ambient = sets.found["ambient"]
    found: dict[str, Any] = {}
    for name in ("cold", "hot"):
        found[name] = {}
        for part in PARTS:
            one = change(sets.found[f"{name}, {part} alone"], ambient)
            found[name][part] = {key: getattr(one, key) for key in Change.__slots__}
    return found


def _budget(sets: Sets) -> list[BudgetLine]:
    """What each change alone contributes to difference and bias, as if they were independent."""
    lines: list[BudgetLine] = []
    parts = _parts(sets)
    for name, by_part in (parts or {}).items():
        for key, unit in (("difference_v", "V"), ("range_bias_m", "m")):
            sizes = {f"{part} alone": abs(one[key]) for part, one in by_part.items()}
            lines += budget(f"{key.rpartition('_')[0].replace('_', ' ')} of {name}", unit, sizes)
    return lines


def _tables(sets: Sets) -> dict[str, Table]:
    first = sets.found["ambient"]
    columns: dict[str, Any] = {
        "time": (first["time_s"], "s", "from the laser's Gaussian, way to the gate out")
    }
    for name in SETS:
        one = sets.found[name]
        columns[f"emitted_{name}"] = (one["emitted_rate"], "s-1", f"photons sent, {name}")
        columns[f"received_{name}"] = (one["received_rate"], "s-1", f"photons on the photodiode, {name}")
        columns[f"volts_{name}"] = (one["volts"], "V", f"at the converter without noise, {name}")
        columns[f"aligned_{name}"] = (
            aligned(one, first),
            "V",
            f"the same, peak where the ambient one's is, {name}",
        )
    names = list(sets.found)
    rows = [change(sets.found[name], first) for name in names]
    changes: dict[str, Any] = {
        f"change_{key}": (np.array([getattr(one, key) for one in rows]), unit, text)
        for key, unit, text in (
            ("difference_v", "V", "largest difference of aligned pulses to ambient"),
            ("range_bias_m", "m", "range bias against ambient"),
            ("pointing_m", "m", "of it, from where the light falls"),
            ("amplitude", "1", "relative change of the fitted amplitude"),
            ("peak", "1", "relative change of the peak"),
            ("fwhm_s", "s", "change of the fitted width"),
        )
    }
    changes["set_msr"] = (
        np.array([sets.matched[name]["msr_v2"].mean() for name in names]),
        "V2",
        "MSR with the ambient library, mean",
    )
    return {"curve": Table(columns, "time"), "change": Table(changes, "set")}


def _figure(sets: Sets) -> Figure:
    from procedures.campaign_temperature_figure import temperature_figure

    return temperature_figure(sets)
