"""The figures of a roughness campaign: width, skewness, library, residuals, reach and regions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from procedures.range_scenes import REFLECTANCES
from procedures.roughness_chunks import CASES
from procedures.roughness_results import LIMITS, RESIDUALS
from procedures.roughness_shape import BINS_M, CONTOURS, FEWEST, LEVELS_V2, LIMIT_V2, MAP_EDGES_M

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.roughness_results import RoughnessResults

_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_LABEL_PART = 0.042
"""Of the height of a map: from one line of text to the next."""
_DEGREE = 3
"""Of the polynomial through mean slopes; as many means as it has coefficients leave nothing to fit."""
_WORDS = {"free": "without noise", "night": "night", "day": "day"}


def width_figure(found: RoughnessResults) -> Figure:
    """Draw squares of roughness from the width against those of the ground."""
    width = found.width
    figure = Figure(figsize=(10.5, 4.8), layout="constrained")
    figure.set_label(
        "(a) Square of the roughness from the width of the return pulse against that of the ground, a "
        "point for each footprint without noise; red: one to one; blue: means of bins with equally many "
        "footprints, plus and minus one standard deviation. (b) Share of negative squares in these bins, "
        "which no roughness has."
    )
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    ground, observed = 1e18 * width.ground_s2, 1e18 * width.observed_s2
    left.plot(ground, observed, "k.", ms=1.2, alpha=0.3, rasterized=True)
    span = np.array([0, np.quantile(ground, 0.999)])
    left.plot(span, span, color="r", lw=1.5, label="one to one")
    middle, mean, spread = (1e18 * one for one in (width.middle_s2, width.mean_s2, width.spread_s2))
    left.plot(middle, mean, "o-", color=_BLUE, ms=4, lw=2, label="mean")
    for sign in (-1, 1):
        left.plot(middle, mean + sign * spread, color=_BLUE, lw=0.9)
    left.axhline(0, color="0.6", lw=0.7)
    left.set_xlim(0, span[1])
    left.set_ylim(*np.quantile(observed, (0.001, 0.999)))
    left.set_xlabel(r"ground: $\sigma_{rough}^2$, ns$^2$")
    left.set_ylabel(r"width: $\sigma_{rough}^2$, ns$^2$")
    left.set_title(f"(a) {observed.size} footprints, eleven fractals", loc="left", fontsize=10)
    left.legend(fontsize=9, loc="upper left")
    right.semilogx(np.sqrt(width.middle_s2) * 0.1498962e9, 100 * width.negative, "o-", color=_BLUE)
    right.set_ylim(0, 60)
    right.set_xticks((0.02, 0.05, 0.1, 0.2, 0.5), ("0.02", "0.05", "0.1", "0.2", "0.5"))
    right.minorticks_off()
    right.set_xlabel("roughness of the ground, m", loc="left")
    right.set_ylabel("negative squares, %")
    share, u = width.share_negative
    right.set_title(f"(b) negative: {100 * share:.0f}({100 * u:.0f}) % of all", loc="left", fontsize=10)
    return figure


def skewness_figure(found: RoughnessResults) -> Figure:
    """Draw histograms of skewness beside that of white noise."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    figure.set_label(
        "Skewness of the heights in footprints about their planes: fractals, the terrain model where one was "
        "given, and white noise on as many posts."
    )
    axes = figure.subplots()
    edges = np.linspace(-2, 2, 81).tolist()
    for name, colour in (("fractals", _BLUE), ("terrain", _ORANGE)):
        if name in found.skewness:
            one = found.skewness[name]
            label = (
                f"{'terrain model' if name == 'terrain' else name}, {one.values.size}, rms {one.spread:.2f}"
            )
            axes.hist(
                one.values, edges, density=True, histtype="stepfilled", color=colour, alpha=0.45, label=label
            )
    axes.hist(
        found.white,
        edges,
        density=True,
        histtype="step",
        color="k",
        lw=1.6,
        label=f"white noise, rms {found.white.std():.2f}",
    )
    axes.set_xlabel("skewness", loc="left")
    axes.set_ylabel("density")
    axes.legend(fontsize=9)
    return figure


def library_figure(found: RoughnessResults) -> Figure:
    """Draw the footprint with the largest residual, its samples, and slopes against the library's."""
    example = found.example
    figure = Figure(figsize=(12.0, 4.3), layout="constrained")
    figure.set_label(
        "(a) Ground about the footprint with the largest residual; line: where the beam has "
        "1/e\N{SUPERSCRIPT TWO} of its peak. (b) Its samples without noise (black), with bars of the noise "
        "by day (large) and night (small), and the best pulse of the library of flat slopes (red). (c) "
        "Slope of the ground by slope of the best pulse, as a share of each; red: polynomial through the "
        "means."
    )
    left, middle, right = figure.subplots(1, 3)
    heights = example["example_heights_m"]
    reach_m = float(example["example_spacing_m"]) * (heights.shape[0] - 1) / 2
    shown = left.imshow(
        np.ma.masked_invalid(heights - np.nanmean(heights)),
        origin="lower",
        extent=(-reach_m, reach_m) * 2,
        cmap="cividis",
    )
    along_m, across_m = found.sigma_m
    left.add_patch(Ellipse((0, 0), 4 * along_m, 4 * across_m, fill=False, edgecolor="w", lw=2))
    left.set_xlabel("x, m")
    left.set_ylabel("y, m")
    roughness = float(example["example_roughness_m"])
    left.set_title(f"(a) roughness {roughness:.2f} m", loc="left", fontsize=10)
    figure.colorbar(shown, ax=left, label="height, m", shrink=0.8)
    times_ns = 1e9 * example["example_time_s"]
    for case, size in (("day", 5), ("night", 3)):
        middle.errorbar(
            times_ns,
            1e3 * example["example_samples_v"],
            1e3 * found.noise_v[case],
            fmt="none",
            ecolor="0.3",
            capsize=size,
            lw=0.8,
        )
    middle.plot(times_ns, 1e3 * example["example_samples_v"], "ko-", ms=4, lw=0.8, label="samples")
    middle.plot(times_ns, 1e3 * example["example_best_v"], "r--", lw=1.5, label="best pulse")
    middle.set_xlim(-120, 160)
    middle.set_xlabel("time from the arrival, ns")
    middle.set_ylabel("voltage, mV")
    counts = {case: found.beyond_noise(case) for case in CASES[1:]}
    middle.set_title(
        f"(b) beyond 2 sd: {counts['day']} by day, {counts['night']} by night", loc="left", fontsize=10
    )
    middle.legend(fontsize=9)
    _slopes(right, found)
    return figure


def _slopes(axes: Axes, found: RoughnessResults) -> None:
    seen = found.everything
    there = seen.width_s[0, 0] > 0
    edges = np.arange(-0.5, 41.0, 1.0)
    counts, _, _ = np.histogram2d(seen.library_deg[0, 0][there], seen.slope_deg[there], (edges, edges))
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.pcolormesh(edges, edges, np.ma.masked_less_equal(shares.T, 0), cmap="Blues", vmax=0.5)
    slopes = found.slopes
    inner = slopes["library_deg"] < edges[-1] - 1
    best, mean, u = (slopes[name][inner] for name in ("library_deg", "mean_deg", "mean_u_deg"))
    if best.size > _DEGREE + 1:
        curve = np.polynomial.Polynomial.fit(best, mean, _DEGREE, w=1 / np.maximum(u, 0.05))
        axes.plot(best, curve(best), "r", lw=1.8, label="polynomial through means")
    else:
        axes.plot(best, mean, "r.", label="means, too few to fit")
    axes.plot((0, 40), (0, 40), "k:", lw=1, label="one to one")
    axes.set_xlabel("slope of the best pulse, deg", loc="left")
    axes.set_ylabel("slope of the ground, deg")
    bias, bias_u = found.slope_bias_deg
    axes.set_title(f"(c) best pulse less ground: {bias:+.2f}({bias_u:.2f}) deg", loc="left", fontsize=10)
    axes.legend(fontsize=9, loc="upper left")


def shape_figure(found: RoughnessResults) -> Figure:
    """Draw cumulative shares of residuals for three bins, and maps of them, by case."""
    figure = Figure(figsize=(10.5, 10.5), layout="constrained")
    figure.set_label(
        "Mean squared residuals (MSR) of footprints whose best pulse has "
        f"{found.everything.compared_deg:g} degrees, by rows without noise, by night and by day. "
        "Left: cumulative share for three bins of roughness. Right: the same by roughness, each bin for "
        "itself; lines: below them are 50, 70, 90, 95 and 99 %."
    )
    grid = figure.subplots(3, 2, squeeze=False)
    for row, case in zip(grid, CASES, strict=True):
        one = found.shapes[case]
        for curve, bounds, count, colour in zip(
            one.curves, BINS_M, one.counts, (_GREEN, _PURPLE, _ORANGE), strict=True
        ):
            label = f"{bounds[0]:g} to {bounds[1]:g} m, {count}"
            # A bin without footprints has no share, not even 0 %; its name and count stay.
            shown = 100 * curve if count else np.full_like(curve, np.nan)
            row[0].semilogx(1e6 * LEVELS_V2, shown, color=colour, lw=1.8, label=label)
        row[0].axvline(1e6 * LIMIT_V2, color="0.5", ls=":", lw=1)
        low = 1e-4 if case == "free" else 1e-1
        row[0].set_xlim(low, 1e1)
        row[0].set_ylabel("cumulative share, %")
        row[0].set_title(_WORDS[case], loc="left", fontsize=10)
        row[0].legend(fontsize=8, loc="lower right")
        _map(row[1], found, case, low)
    for axes in grid[-1]:
        axes.set_xlabel("MSR, mV$^2$" if axes is grid[-1, 0] else "roughness of the ground, m", loc="left")
    return figure


def _map(axes: Axes, found: RoughnessResults, case: str, low_mv2: float) -> None:
    one = found.shapes[case]
    have = one.cell_counts >= FEWEST
    shares = np.ma.masked_array(100 * one.cells, np.repeat(~have[:, None], LEVELS_V2.size, axis=1))
    shown = axes.pcolormesh(
        MAP_EDGES_M, 1e6 * _edges(LEVELS_V2), shares.T, cmap="viridis", vmin=0, vmax=100, rasterized=True
    )
    axes.set_yscale("log")
    axes.set_ylim(low_mv2, 10)
    axes.set_xlim(0, MAP_EDGES_M[np.flatnonzero(have)[-1] + 1] + 0.15 if have.any() else 1.0)
    middles = (MAP_EDGES_M[:-1] + MAP_EDGES_M[1:]) / 2
    for row in one.contours_v2:
        axes.plot(middles, 1e6 * row, color="k", lw=1.2)
    if have.any():
        _name_contours(axes, float(MAP_EDGES_M[np.flatnonzero(have)[-1] + 1]), 1e6 * one.contours_v2)
    axes.set_ylabel("MSR, mV$^2$")
    axes.figure.colorbar(shown, ax=axes, label="cumulative share, %", pad=0.02)


def _name_contours(axes: Axes, beside_m: float, contours_mv2: np.ndarray) -> None:
    """Write the shares beside the map, each joined to the end of its line and none on another."""
    decades = float(np.diff(np.log10(axes.get_ylim()))[0])
    middles, above = (MAP_EDGES_M[:-1] + MAP_EDGES_M[1:]) / 2, -np.inf
    lines = [
        (share, row) for share, row in zip(CONTOURS, contours_mv2, strict=True) if np.isfinite(row).any()
    ]
    for share, row in sorted(lines, key=lambda line: float(line[1][np.isfinite(line[1])][-1])):
        last = int(np.flatnonzero(np.isfinite(row))[-1])
        end = float(np.log10(row[last]))
        above = max(end, above + _LABEL_PART * decades)
        joined = {"arrowstyle": "-", "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
        axes.annotate(
            f"{100 * share:.0f} %",
            (middles[last], 10.0**end),
            (beside_m + 0.02, 10.0**above),
            fontsize=8,
            va="center",
            arrowprops=joined,
        )


def _edges(levels: np.ndarray) -> np.ndarray:
    """Edges between levels in geometric steps."""
    step = np.sqrt(levels[1] / levels[0])
    return np.append(levels / step, levels[-1] * step)


def reach_figure(found: RoughnessResults) -> Figure:
    """Draw how well the shape tells rough from smooth by altitude, and estimates of regions."""
    figure = Figure(figsize=(13.0, 4.2), layout="constrained")
    figure.set_label(
        "(a) Share of footprints with 0.9 to 1.1 m whose residual is above 99 % of those below 0.1 m, by "
        "night; of the samples of the pulse (solid) and of the whole window (dashed); dotted: 5 %, at which "
        "it is taken to tell, and the 1 % of chance. (b) How many standard deviations the means of 100 rough "
        "and 100 smooth ones are apart; dotted: 3. (c) Roughness of terrains from stacked residuals of their "
        "pulses, judged by terrains of other sets, against the truth; bars: 68 %."
    )
    single, stacked, regions = figure.subplots(1, 3)
    for reflectance, colour in zip(REFLECTANCES, (_PURPLE, _BLUE, _ORANGE), strict=True):
        rows = [one for one in found.reaches if one.reflectance == reflectance]
        for residual in RESIDUALS:
            powers = [(1e-3 * one.altitude_m, one.powers[residual]) for one in rows]
            there = [(altitude_km, power) for altitude_km, power in powers if power is not None]
            altitudes_km = [one for one, _ in there]
            shares, apart = [100 * one.share for _, one in there], [one.separation for _, one in there]
            if residual == "window":
                single.plot(altitudes_km, shares, "--", color=colour, lw=0.8)
                stacked.plot(altitudes_km, apart, "--", color=colour, lw=0.8)
                continue
            look = {"fmt": "o-", "ms": 4, "color": colour, "label": f"reflectance {reflectance:g}"}
            single.errorbar(altitudes_km, shares, [100 * one.share_u for _, one in there], **look)
            stacked.errorbar(altitudes_km, apart, [one.separation_u for _, one in there], **look)
    for axes, levels in ((single, (100 * LIMITS["single"], 1.0)), (stacked, (LIMITS["stacked"], 0.0))):
        for level in levels:
            axes.axhline(level, color="0.4", ls=":", lw=1)
        axes.set_xlabel("altitude, km")
        axes.plot([], [], "o-", ms=4, color="0.3", label="samples of the pulse")
        axes.plot([], [], "--", lw=0.8, color="0.3", label="whole window")
    if found.reaches:
        single.legend(fontsize=8)
    else:
        _missing(single, "altitudes were not computed")
        _missing(stacked, "altitudes were not computed")
    single.set_ylabel("rough beyond smooth, %")
    single.set_title("(a) single footprints, night", loc="left", fontsize=10)
    stacked.set_ylabel("separation, standard deviations")
    stacked.set_title("(b) 100 stacked, night", loc="left", fontsize=10)
    _regions(regions, found)
    return figure


def _regions(axes: Axes, found: RoughnessResults) -> None:
    for case, colour, offset in (("night", _BLUE, 0.98), ("day", _ORANGE, 1.02)):
        one = found.trials["pulse"][case]
        if not one.found:
            continue
        best = np.array([region.roughness_m for region in one.found])
        spans = np.array([region.inside_68_m for region in one.found])
        label = f"{case}: {100 * one.inside('inside_68_m').mean():.0f} % inside"
        axes.errorbar(
            offset * one.truth_m,
            best,
            np.abs(spans.T - best),
            fmt="o",
            ms=3,
            lw=0.8,
            color=colour,
            label=label,
        )
    axes.plot((0.01, 2), (0.01, 2), "k:", lw=1)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("roughness of the terrain, m", loc="left")
    axes.set_ylabel("estimate, m")
    axes.set_title("(c) regions", loc="left", fontsize=10)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, loc="upper left")
    else:
        _missing(axes, "too few footprints for a region")


def _missing(axes: Axes, reason: str) -> None:
    """Say in the middle of axes why they are empty, in place of guides for what is not there."""
    for guide in list(axes.lines):
        guide.remove()
    axes.text(0.5, 0.5, reason, transform=axes.transAxes, ha="center", va="center", color="0.35")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.minorticks_off()
