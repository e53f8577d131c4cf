"""The outcome of a roughness campaign: results for JSON, tables and notes."""

from __future__ import annotations

import itertools
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from procedures.campaign_roughness import FACTORS
from procedures.range_scenes import REFLECTANCES
from procedures.range_truth import Definitions
from procedures.roughness_chunks import CASES
from procedures.roughness_region import FEWEST_OF_REGION, Region, Trial
from procedures.roughness_results import LIMITS, RoughnessResults
from procedures.roughness_shape import (
    BINS_M,
    CONTOURS,
    LEVELS_V2,
    LIMIT_V2,
    MAP_EDGES_M,
    READINGS,
    Power,
    Shape,
)
from procedures.roughness_statistics import COLUMNS, WITHIN_DEG, mean_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan
    from procedures.library_azimuths import Azimuths
    from procedures.roughness_statistics import Residual


def outcome(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Bring everything into the form that a run keeps."""
    found = RoughnessResults(plan, results)
    planes = Definitions(by_beam=bool(plan.chunks[0].given["by_beam"])).told()["slope_and_roughness"]
    slope_deg = found.everything.compared_deg
    low_deg, high_deg = slope_deg - WITHIN_DEG, slope_deg + WITHIN_DEG
    near = f" Of footprints whose best pulse has {low_deg:g} to {high_deg:g} degrees."
    definitions = {"slope_and_roughness": planes, **_DEFINITIONS, "msr": _DEFINITIONS["msr"] + near}
    return Outcome(
        results={
            "footprints": {
                "fractals": found.fractals.size,
                "all": found.everything.size,
                "terrain": None if found.terrain is None else found.terrain.size,
            },
            "noise_v": found.noise_v,
            "width": _width(found),
            "skewness": _skewness(found),
            "library": _library(found),
            "shape": {case: _shape(found.shapes[case], found.powers[case]) for case in CASES},
            "reach": _reach(found),
            "region": _trials(found.trials),
            "region_by_curve": _trials(found.curve_trials),
            "definitions": definitions,
        },
        tables=_tables(found),
        figures={
            "width": lambda: _figure("width_figure", found),
            "skewness": lambda: _figure("skewness_figure", found),
            "library": lambda: _figure("library_figure", found),
            "shape": lambda: _figure("shape_figure", found),
            **({"reach": lambda: _figure("reach_figure", found)} if found.reaches or _regions(found) else {}),
        },
        notes=[*definitions.values(), *_notes(slope_deg), *_unseen(found), *_uncomputed(found)],
    )


_DEFINITIONS = {
    "true_range": "True range: c/2 times the beam-weighted mean of the two-way time at nominal pointing.",
    "false_detection": "False detection: more than 10 m off with the candidate nearest to the truth. "
    "Footprints that were not detected are left out; larger peaks elsewhere in the window are not there.",
    "width_roughness": "Roughness from width: sigma_obs = W_G / (2 sqrt(2 ln 2)) of the fitted Gaussian, "
    "less in squares that of a flat slope of the same tilt; that of the ground: 2/c Std of the heights about "
    "the plane.",
    "skewness": "Skewness: third standardized moment of the heights about the plane.",
    "msr": "MSR: mean squared residual of the samples of the correlation window about the best pulse of the "
    "library of flat slopes, scaled and moved; of the pulse: of samples where that pulse is above a tenth "
    "of its peak alone.",
    "readings": "Other readings of the residual, for comparison: largest, the largest squared one; timed, "
    "mean over the window about the best pulse that is scaled but not moved, its plane through the ground in "
    "the middle of the footprint, as where the range is known.",
    "uncertainty": "Standard uncertainties: from the scatter between terrains; footprints share relief.",
    "reach": "The shape tells roughness of single footprints where at least 5 % of those with 0.9 to 1.1 m "
    "leave more than 99 % of those below 0.1 m (by chance 1 % would), and of 100 stacked ones where the mean "
    "logarithms of residuals of both are 3 standard deviations apart. Linear between altitudes.",
}


def _notes(slope_deg: float) -> tuple[str, ...]:
    return (
        "The eleven fractals have a Hurst exponent of 0.8 (paper) and 0.3 to 8 m RMS deviation at 65 m "
        f"(assumed), level and tilted by {slope_deg:g} degrees. The roughest is also taken with "
        f"{FACTORS[0]:g}, {FACTORS[1]:g} and {FACTORS[2]:g} times its heights: those count for residuals and "
        "regions, not for width and skewness.",
        "The laser's beam is the scene's; a round one makes all azimuths of the library one.",
    )


_PREFIX: dict[Residual, str] = {"window": "", "pulse": "pulse_", "largest": "largest_", "timed": "timed_"}


def _measured(value: float, uncertainty: float, unit: str) -> dict[str, Any]:
    return Estimate(float(value), float(uncertainty), unit).as_json()


def _unseen(found: RoughnessResults) -> list[str]:
    """A terrain model that told nothing must not pass in silence."""
    path = found.plan.instruments.get("terrain")
    if not path or found.terrain is not None:
        return []
    return [f"The terrain model {path} has no footprint with data everywhere: nothing is shown of it."]


def _regions(found: RoughnessResults) -> bool:
    return any(one.found for one in found.trials["pulse"].values())


def _uncomputed(found: RoughnessResults) -> list[str]:
    """Say which questions of the reach have no answer, and why."""
    lines = [] if found.reaches else ["No other altitudes were computed: to which ones shapes tell is open."]
    if not _regions(found):
        lines.append(f"No terrain has the {FEWEST_OF_REGION} comparable footprints that a region needs.")
    return lines


def _width(found: RoughnessResults) -> dict[str, Any]:
    width = found.width
    columns = (width.middle_s2, width.mean_s2, width.mean_u_s2, width.spread_s2, width.negative)
    return {
        "terms_s": {f"{slope:g}": terms for slope, terms in found.terms.items()},
        "footprints": int(width.observed_s2.size),
        "share_negative": _measured(*width.share_negative, "1"),
        "correlation": width.correlation,
        "bins": [
            {
                "ground_s2": float(middle),
                "observed": _measured(mean, u, "s2"),
                "spread_s2": float(spread),
                "negative": float(negative),
            }
            for middle, mean, u, spread, negative in zip(*columns, strict=True)
        ],
    }


def _skewness(found: RoughnessResults) -> dict[str, Any]:
    kinds = {
        name: {
            "footprints": int(one.values.size),
            "spread": one.spread,
            "beyond_white_noise": _measured(one.beyond, one.beyond_u, "1"),
            "white_noise_spread": one.white,
        }
        for name, one in found.skewness.items()
    }
    return {"white_noise_spread": float(found.white.std())} | kinds


def _library(found: RoughnessResults) -> dict[str, Any]:
    example = found.example
    slopes = {name: values.tolist() for name, values in found.slopes.items()}
    return {
        "pulses": int(found.library.slope_deg.size),
        "slope_bias_deg": _measured(*found.slope_bias_deg, "deg"),
        "share_lower": _measured(*found.slope_lower, "1"),
        "timed_slope_bias_deg": _measured(*found.timed_slope_bias_deg, "deg"),
        "azimuths": None if found.azimuths is None else _azimuths(found.azimuths),
        "slopes": [dict(zip(slopes, row, strict=True)) for row in zip(*slopes.values(), strict=True)],
        "example": {
            "roughness_m": float(example["example_roughness_m"]),
            "msr_v2": float(example["example_msr_v2"]),
            "slope_deg": float(example["example_slopes_deg"][0]),
            "library_deg": float(example["example_slopes_deg"][1]),
            "samples_beyond_noise": {case: found.beyond_noise(case) for case in CASES[1:]},
        },
    }


def _azimuths(one: Azimuths) -> dict[str, Any]:
    return {
        "slopes": [asdict(row) for row in one.slopes],
        "error_deg": {
            case: _measured(*error, "deg") for case, error in zip(CASES, one.error_deg, strict=True)
        },
        "chance_deg": one.chance_deg,
    }


def _shape(one: Shape, powers: dict[Residual, Power | None]) -> dict[str, Any]:
    rows = []
    for number, bounds in enumerate(BINS_M):
        row: dict[str, Any] = {
            "roughness_m": list(bounds),
            "footprints": one.counted["window"][number],
            "timed_footprints": one.counted["timed"][number],
        }
        for residual, prefix in _PREFIX.items():
            above = one.above[residual][number]
            row[f"{prefix}above"] = None if above is None else _measured(*above, "1")
        rows.append(row)
    return {"above_v2": LIMIT_V2, "bins": rows} | _powers(powers)


def _powers(powers: Mapping[Residual, Power | None]) -> dict[str, Any]:
    return {f"{prefix}power": _power(powers[residual]) for residual, prefix in _PREFIX.items()}


def _power(one: Power | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "smooth": one.smooth,
        "rough": one.rough,
        "limit_v2": one.limit_v2,
        "share": _measured(one.share, one.share_u, "1"),
        "stacked_separation": _measured(one.separation, one.separation_u, "1"),
    }


def _reach(found: RoughnessResults) -> dict[str, Any] | None:
    if not found.altitudes_m:
        return None
    highest: dict[str, Any] = {}
    for residual, how, reflectance in itertools.product(READINGS, LIMITS, REFLECTANCES):
        altitude_m, status = found.highest_m(reflectance, how, residual)
        by_how = highest.setdefault(residual, {}).setdefault(how, {})
        by_how[f"{reflectance:g}"] = {"altitude_m": altitude_m, "status": status}
    rows = [
        {"altitude_m": one.altitude_m, "reflectance": one.reflectance} | _powers(one.powers)
        for one in found.reaches
    ]
    return {"tells_from": LIMITS, "highest": highest, "altitudes": rows}


def _trials(trials: Mapping[Residual, Mapping[str, Trial]]) -> dict[str, Any]:
    return {
        residual: {case: _trial(one) for case, one in by_case.items()} for residual, by_case in trials.items()
    }


def _trial(one: Trial) -> dict[str, Any]:
    terrains = np.arange(one.truth_m.size)
    return {
        "regions": [
            {"truth_m": float(truth)} | _region(region)
            for truth, region in zip(one.truth_m, one.found, strict=True)
        ],
        "coverage_68": _coverage(one.inside("inside_68_m"), terrains),
        "coverage_95": _coverage(one.inside("inside_95_m"), terrains),
        "dispersion": list(one.dispersion),
        "width_68": one.width_68,
    }


def _region(one: Region) -> dict[str, Any]:
    return {
        "roughness_m": one.roughness_m,
        "inside_68_m": list(one.inside_68_m),
        "inside_95_m": list(one.inside_95_m),
        "footprints": one.footprints,
    }


def _coverage(inside: NDArray[np.bool_], terrains: NDArray[np.int64]) -> dict[str, Any] | None:
    return _measured(*mean_of(inside.astype(np.float64), terrains), "1") if inside.size else None


# ---- tables


def _tables(found: RoughnessResults) -> dict[str, Table]:
    seen = found.everything
    units = dict.fromkeys(COLUMNS, "1") | {"slope_deg": "deg", "azimuth_deg": "deg", "roughness_m": "m"}
    texts = {
        "slope_deg": "tilt of the plane",
        "azimuth_deg": "direction of its steepest ascent, from +x towards +y",
        "roughness_m": "standard deviation about it",
        "skewness": "of the heights about it",
        "raw_skewness": "of the heights with their slope",
    }
    columns: dict[str, Any] = {name: (getattr(seen, name), units[name], texts[name]) for name in COLUMNS}
    columns["chunk"] = (seen.chunk, "1", "number of the chunk")
    columns["ground"] = (seen.ground, "1", "seed of the relief; below zero: block of the terrain model")
    for number, case in enumerate(CASES):
        missing = seen.width_s[0, number] == 0
        for name, unit, text in (
            ("width_s", "s", "fitted full width"),
            ("msr_v2", "V2", "mean squared residual"),
            ("pulse_msr_v2", "V2", "the same of the samples of the pulse alone"),
            ("largest_v2", "V2", "the largest squared residual"),
            ("timed_msr_v2", "V2", "mean squared residual of the best pulse that is not moved"),
            ("timed_deg", "deg", "slope of that one"),
            ("library_deg", "deg", "slope of the best pulse"),
            ("library_azimuth_deg", "deg", "azimuth of the best pulse, the first of those alike"),
        ):
            values = np.ma.masked_array(getattr(seen, name)[0, number], missing)
            columns[f"{name}_{case}"] = (values, unit, f"{text}, {case}")
    curves: dict[str, Any] = {"msr_level": (LEVELS_V2, "V2", "of the cumulative shares")}
    maps: dict[str, Any] = {"roughness_bin": (MAP_EDGES_M[:-1], "m", "lower edge of the bin")}
    for case, one in found.shapes.items():
        curves[f"cumulative_{case}"] = (one.curves.T, "1", "share at or below, by three bins of roughness")
        maps[f"map_{case}"] = (one.cells, "1", "share at or below each level")
        maps[f"map_count_{case}"] = (one.cell_counts, "1", "footprints")
    contours: dict[str, Any] = {"contour": (np.array(CONTOURS), "1", "share")}
    for case, one in found.shapes.items():
        values = np.ma.masked_invalid(one.contours_v2)
        contours[f"contour_{case}"] = (values, "V2", "MSR below which the share lies")
    return {
        "footprint": Table(columns, "footprint"),
        "curves": Table(curves, "msr_level", "bin"),
        "maps": Table(maps, "roughness_bin", "msr_level"),
        "contours": Table(contours, "contour", "roughness_bin"),
        "white": Table({"white_skewness": (found.white, "1", "skewness of white noise")}, "white"),
    }


def _figure(name: str, found: RoughnessResults) -> Figure:
    from procedures import roughness_figures

    drawn: Figure = getattr(roughness_figures, name)(found)
    return drawn
