"""Figures that can be read: nothing lies on anything else, and what is drawn has a meaning."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from belahil.report.figures import save_figures
from belahil.values import Estimate
from procedures.range_budget import BudgetCell, Shift
from procedures.range_constants import Constant
from procedures.range_variant_figures import tornado_figure
from procedures.roughness_figures import _name_contours


def boxes(figure: Figure, texts: list) -> list[Bbox]:  # type: ignore[type-arg]
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    # Of the words alone: an annotation counts its line as well.
    return [Text.get_window_extent(one, renderer) for one in texts]


@pytest.mark.parametrize("size", [(4.0, 2.5), (5.0, 15.0)])
def test_the_stamp_of_simulated_data_is_below_the_axes(size: tuple[float, float], tmp_path: Path) -> None:
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel("a label as long as the axis that it belongs to, gyp")

    save_figures(tmp_path, {"one": lambda: figure}, "simulated")

    stamp = next(one for one in figure.texts if one.get_text() == "SIMULATED DATA")
    label, below, whole = boxes(figure, [axes.xaxis.label, stamp, axes.yaxis.get_ticklabels()[0]])
    assert below.y1 < label.y0
    assert below.y0 >= 0
    # and labels of the axis do not touch the edge
    assert whole.x0 > 4


@pytest.mark.parametrize("apart", [1.0, 1.01, 3.0])
def test_names_of_contours_do_not_lie_on_each_other(apart: float) -> None:
    # given five lines, each so many times above the next
    figure = Figure(figsize=(5.0, 3.5), layout="constrained")
    axes = figure.subplots()
    axes.set_yscale("log")
    axes.set_ylim(1e-1, 1e1)
    axes.set_xlim(0.0, 1.6)
    rows = np.full((5, 15), 0.3) * apart ** np.arange(5)[:, None]
    rows[:, 12:] = np.nan

    _name_contours(axes, 1.3, rows)

    names = sorted(boxes(figure, list(axes.texts)), key=lambda box: box.y0)
    assert [one.get_text() for one in axes.texts] == ["50 %", "70 %", "90 %", "95 %", "99 %"]
    assert all(low.y1 <= high.y0 + 1 for low, high in itertools.pairwise(names))
    # and each begins at its line
    assert [one.xy[1] for one in axes.texts] == pytest.approx(rows[:, 0].tolist())


def budget_cell(altitude_m: float, light: str, pfd_change: float) -> BudgetCell:
    """A cell whose constant "a" changes the error by a tenth and the PFD as told, and "b" nothing."""
    condition = SimpleNamespace(reflectance=0.17, light=light)
    none = Estimate(0.0, 0.0, "1")
    shifts = tuple(
        Shift(
            Constant(name, "m", 1.0, 1.0, 2.0, ""),
            (none, none),
            (Estimate(error, 0.0, "1"), Estimate(pfd, 0.0, "1")),
        )
        for name, error, pfd in (("a", 0.1, pfd_change), ("b", 0.02, 0.0))
    )
    return BudgetCell(SimpleNamespace(altitude_m=altitude_m, condition=condition), shifts)  # type: ignore[arg-type]


def test_a_tornado_explains_its_colours_and_has_no_empty_panel() -> None:
    # given an altitude at which no false detection changes
    budget = [
        budget_cell(altitude_m, light, 0.3 * (altitude_m > 500e3))
        for altitude_m in (500e3, 800e3)
        for light in ("day", "night")
    ]

    figure = tornado_figure(budget)

    (legend,) = figure.legends
    assert [one.get_text() for one in legend.get_texts()] == [
        f"{light}, {end} end of the range" for light in ("day", "night") for end in ("low", "high")
    ]
    drawn = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_xlabel() for axes in drawn] == ["change of the error, %"] * 2 + [
        "change of the PFD, points"
    ]
    assert all(axes.patches for axes in drawn)
    # and the names of the constants are at the first of them
    assert [one.get_text().partition("\n")[0] for one in drawn[-1].texts] == ["b", "a"]
