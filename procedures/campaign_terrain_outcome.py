"""The outcome of a terrain campaign: deviations, slopes, quantiles of models, and how they compare."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from procedures.arrival_ground import EXTENT_M, ROUGHNESS_M
from procedures.campaign_terrain import BASELINES_M, QUANTILES
from procedures.study_ground import BASELINE_M, HURST, LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan

BANDS = (0.01, 0.25, 0.5, 0.75, 0.99)
_BOOTSTRAPS = 400


@dataclass(frozen=True, slots=True, eq=False)
class Terrains:
    """Deviations of everything, rows by terrain, columns by baseline; zero where a terrain has none.

    Parameters
    ----------
    names : tuple of str
        The analog whole, its areas, the fractals, the pieces of the models.
    kinds : tuple of str
        "analog", "area", "fractal" or "model".
    baseline_m, rms_m, u_m, pairs : ndarray, shape (n, baselines)
        As in `procedures.relief_profile.Profile`.
    hurst : ndarray of float64, shape (n, 2)
        Exponents and their standard uncertainties.
    analog : dict of ndarray
        What else its chunk gave.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    baseline_m: NDArray[np.float64]
    rms_m: NDArray[np.float64]
    u_m: NDArray[np.float64]
    pairs: NDArray[np.int64]
    hurst: NDArray[np.float64]
    analog: dict[str, NDArray[Any]]

    def rows(self, kind: str) -> list[int]:
        """Numbers of the rows of a kind."""
        return [at for at, one in enumerate(self.kinds) if one == kind]


def gathered(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Terrains:
    """Put the results of all chunks into one table."""
    names = [str(one) for one in results[0]["names"]]
    kinds = ["analog", *["area"] * (len(names) - 1)]
    for chunk, result in zip(plan.chunks[1:], results[1:], strict=True):
        count = len(result["rms_m"])
        names += [chunk.name] if count == 1 else [f"{chunk.name}, piece {at}" for at in range(count)]
        kinds += [chunk.name.split(" ")[0]] * count
    columns = ("baseline_m", "rms_m", "u_m", "pairs", "hurst")
    joined = {key: np.concatenate([one[key] for one in results]) for key in columns}
    return Terrains(tuple(names), tuple(kinds), analog=results[0], **joined)


def outcome(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Bring everything into the form that a run keeps."""
    found = gathered(plan, results)
    bands = bands_of(found, plan.seed)
    return Outcome(
        results={
            "analog": _analog(found, plan.instruments["ground"]),
            "fractals": [_terrain(found, at) for at in found.rows("fractal")],
            "models": _models(found, bands),
            "definitions": _DEFINITIONS,
        },
        tables=_tables(found, bands),
        figures={"terrain": lambda: _figure(found, bands, plan.instruments["ground"])},
        notes=[*_DEFINITIONS.values(), *_NOTES],
    )


_DEFINITIONS = {
    "rms_deviation": "RMS deviation at a baseline: root mean square of the differences of all heights that "
    "are so far apart along either axis of the grid; the mean slope stays in.",
    "slope": "Slope: the steepest, from differences over the baseline along both axes about one place.",
    "uncertainty": "Standard uncertainties are of the ground's own deviation: a jackknife over 4 x 4 blocks, "
    "times what it misses on self-affine ground of this exponent; of slopes, from the scatter of the blocks.",
}
_NOTES = (
    f"The fractals have a Hurst exponent of {HURST} (paper) and RMS deviations of {ROUGHNESS_M[0]:g} to "
    f"{ROUGHNESS_M[-1]:g} m at {BASELINE_M:g} m in geometric steps, which are assumed; each is "
    f"{EXTENT_M:g} m wide, and scaled to its level, so that its deviation there is exact. Beyond that "
    "their law is taken.",
    "A terrain model lacks relief below the resolution of its images, which is several posts: at its "
    "shortest baselines its deviation is too small.",
)


def _measured(value: float, uncertainty: float, unit: str = "m") -> dict[str, Any]:
    return Estimate(float(value), float(uncertainty), unit).as_json()


def _terrain(found: Terrains, at: int) -> dict[str, Any]:
    exponent, u = (float(one) for one in found.hurst[at])
    return {
        "name": found.names[at],
        "hurst": _measured(exponent, u, "1") if np.isfinite(exponent) else None,
        "deviations": [
            {
                "baseline_m": float(found.baseline_m[at, k]),
                "rms": _measured(found.rms_m[at, k], found.u_m[at, k]),
                "pairs": int(found.pairs[at, k]),
            }
            for k in np.flatnonzero(found.pairs[at])
        ],
    }


def _analog(found: Terrains, source: str) -> dict[str, Any]:
    own = found.analog
    slopes = {
        f"p{round(100 * share):02d}": _measured(value, u, "rad")
        for share, value, u in zip(
            QUANTILES, own["slope_quantiles_rad"], own["slope_quantiles_u_rad"], strict=True
        )
    }
    areas = [
        _terrain(found, at) | dict(zip(("x_m", "y_m", "side_m"), own["boxes_m"][at].tolist(), strict=True))
        for at in found.rows("area")
    ]
    return _terrain(found, 0) | {
        "made": source == "made terrain",
        "spacing_m": float(own["spacing_m"]),
        "extent_m": own["extent_m"].tolist(),
        "known": float(own["known"]),
        "slopes": {"baseline_m": float(own["slope_baseline_m"])} | slopes,
        "areas": areas,
    }


# ---- quantiles of terrain models


def bands_of(found: Terrains, seed: int) -> dict[str, NDArray[Any]] | None:
    """Quantiles of the models' deviations by baseline, and the bootstrap uncertainty of each; None without.

    A deviation is brought from its own whole number of spacings to the baseline with H = 0.8. The bootstrap
    draws pieces, as if each were independent.
    """
    rows = found.rows("model")
    if not rows:
        return None
    nominal = np.array(BASELINES_M)
    have = found.pairs[rows] > 0
    own = np.where(have, found.baseline_m[rows], nominal)
    rms = found.rms_m[rows] * (nominal / own) ** HURST
    stream = np.random.Generator(np.random.Philox(key=seed))
    quantiles, u = np.zeros((2, nominal.size, len(BANDS)))
    for k in range(nominal.size):
        values = rms[have[:, k], k]
        if values.size:
            quantiles[k] = np.quantile(values, BANDS)
            drawn = values[stream.integers(values.size, size=(_BOOTSTRAPS, values.size))]
            u[k] = np.quantile(drawn, BANDS, axis=1).std(axis=1)
    return {"pieces": have.sum(axis=0), "quantiles_m": quantiles, "u_m": u}


def _models(found: Terrains, bands: dict[str, NDArray[Any]] | None) -> dict[str, Any] | None:
    if bands is None:
        return None
    rows = found.rows("model")
    have = found.pairs[rows] > 0
    baseline_m, rms_m = found.baseline_m[rows][have], found.rms_m[rows][have]
    lowest, highest = (law_m(level, baseline_m) for level in (0, LEVELS - 1))
    return {
        "pieces": len(rows),
        "bands": [
            {"baseline_m": BASELINES_M[k], "pieces": int(bands["pieces"][k])}
            | {
                f"p{round(100 * share):02d}": _measured(value, u)
                for share, value, u in zip(BANDS, bands["quantiles_m"][k], bands["u_m"][k], strict=True)
            }
            for k in np.flatnonzero(bands["pieces"])
        ],
        "below_analog": _share_below(found, baseline_m, rms_m),
        "within_fractals": float(np.mean((rms_m >= lowest) & (rms_m <= highest))),
    }


def law_m(level: int, baseline_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """RMS deviation of a fractal by its law, m."""
    return ROUGHNESS_M[level] * (baseline_m / BASELINE_M) ** HURST


def _share_below(
    found: Terrains, baseline_m: NDArray[np.float64], rms_m: NDArray[np.float64]
) -> float | None:
    """Share of deviations below that of the whole analog, at baselines that it has; None without any."""
    have = found.pairs[0] > 0
    across = np.log(found.baseline_m[0, have])
    shared = (np.log(baseline_m) >= across[0]) & (np.log(baseline_m) <= across[-1])
    if not shared.any():
        return None
    analog_m = np.exp(np.interp(np.log(baseline_m[shared]), across, np.log(found.rms_m[0, have])))
    return float(np.mean(rms_m[shared] < analog_m))


# ---- tables


def _tables(found: Terrains, bands: dict[str, NDArray[Any]] | None) -> dict[str, Table]:
    gaps = found.pairs == 0
    values = {
        "own_baseline": (found.baseline_m, "m", "baseline, a whole number of spacings"),
        "rms_deviation": (found.rms_m, "m", "RMS deviation of heights so far apart"),
        "rms_deviation_u": (found.u_m, "m", "standard uncertainty of rms_deviation"),
    }
    columns: dict[str, Any] = {
        key: (np.ma.masked_array(column, gaps), unit, text) for key, (column, unit, text) in values.items()
    }
    columns["pairs"] = (found.pairs, "1", "pairs of heights")
    columns["kind"] = (
        np.array([("analog", "area", "fractal", "model").index(one) for one in found.kinds]),
        "1",
        "0 the analog, 1 an area of it, 2 a fractal, 3 a piece of a terrain model",
    )
    columns["hurst"] = (np.ma.masked_invalid(found.hurst[:, 0]), "1", "slope of log deviation, log baseline")
    columns["hurst_u"] = (np.ma.masked_invalid(found.hurst[:, 1]), "1", "standard uncertainty of hurst")
    own = found.analog
    slopes = np.ma.masked_array(own["slope_rad"], ~own["slope_known"])
    tables = {
        "terrain": Table(columns, "terrain", "baseline"),
        "baseline": Table({"baseline": (np.array(BASELINES_M), "m", "asked for")}, "baseline"),
        "slope": Table({"slope": (slopes, "rad", "slope of the analog, means of blocks")}, "row", "column"),
    }
    if bands is not None:
        empty = np.repeat(bands["pieces"][:, None] == 0, len(BANDS), axis=1)
        tables["models"] = Table(
            {
                "model_pieces": (bands["pieces"], "1", "pieces of terrain models"),
                "model_quantile": (
                    np.ma.masked_array(bands["quantiles_m"], empty),
                    "m",
                    f"quantiles {', '.join(map(str, BANDS))} of their RMS deviations",
                ),
                "model_quantile_u": (np.ma.masked_array(bands["u_m"], empty), "m", "their uncertainty"),
            },
            "baseline",
            "quantile",
        )
    return tables


def _figure(found: Terrains, bands: dict[str, NDArray[Any]] | None, source: str) -> Figure:
    from procedures.campaign_terrain_figure import terrain_figure

    return terrain_figure(found, bands, source)
