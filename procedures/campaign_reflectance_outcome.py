"""The outcome of the reflectance campaign: results, tables, figures, budget, and the definitions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from procedures.range_cells_told import estimate_columns, json_or_none
from procedures.reflectance_kinds import KINDS
from procedures.reflectance_reach import ageing, mixing, reach, shot_budget, statements
from procedures.reflectance_results import (
    ContrastCell,
    KindCell,
    MixtureCell,
    ReflectanceCells,
    reflectance_cells,
)

if TYPE_CHECKING:
    from belahil.outcome import Column
    from procedures.echo_energy import Conversion
    from procedures.range_points import Collected

NOTES = (
    "Measured reflectance: energy of a detected pulse by E_G, calibrated as in the energy campaign, over "
    "that of white ground from the same altitude. The laser's energy from shot to shot, 1.4 %, is not known "
    "and in it. It is relative: all shots of a pass share the errors of laser, photodiode and receiver.",
    "Separate (assumed): at the threshold where false alarms and misses are equally likely, both are 5 % at "
    "most. Distributions are the weighted draws themselves, no normal ones; means of several shots are their "
    "convolutions, from 64 shots on normal. That dark ground is also detected less often is not used.",
    "Pairs of kinds are compared until nine detections of the fainter in ten are false. Beyond, the energies "
    "are those of noise.",
    "Shots are detected ones over one kind of ground; pulses are those to be fired for them, over the kind "
    "that is seen less often.",
    "Apart: difference of the means over the standard deviation of one shot over the first kind. It is the "
    "meaning of 'measurable' that the text's numbers suggest, and a weaker one than 'separate'.",
    "Kinds: dark 0.08 and regolith 0.17 from the paper; ice 0.30 assumed; an intimate mixture with 75 % ice "
    "is 15 % brighter than regolith, fresh ground 30 %. Reflectances of ice beside regolith add by area "
    "(assumed); of an intimate mixture they follow a straight line through that one point (assumed).",
    "Cross-overs: two footprints of the same night-time altitude, whose ground differs by 5 % (assumed).",
    "Uncertainties: a jackknife of ten groups of echoes; that of the law of noise peaks is far smaller.",
    "Ground, dark noise and sunlight: as in the range campaign, slopes of 10 degrees. Not modelled: "
    "photometry (shade, phase, tilt of the ground towards the beam), speckle, clipping.",
)


def outcome(found: Collected, convert: Conversion) -> Outcome:
    """Make the outcome of the campaign."""
    from procedures.campaign_reflectance_figures import contrast_figure, mixture_figure

    cells = reflectance_cells(found.points, found.laws(), convert)
    results = {
        "kinds": dict(KINDS),
        "reach": reach(cells),
        "mixing": mixing(cells),
        "measured": [_kind_told(one) for one in cells.kinds],
        "contrasts": [_contrast_told(one) for one in cells.contrasts],
        "mixtures": [_mixture_told(one) for one in cells.mixtures],
        "ageing": ageing(cells),
        "statements": statements(cells),
    }
    return Outcome(
        results=results,
        tables={"contrast_cell": _table(cells)},
        figures={
            "reflectance-contrasts": lambda: contrast_figure(cells),
            "reflectance-mixtures": lambda: mixture_figure(cells),
        },
        notes=NOTES,
        budget=shot_budget(cells),
    )


def _kind_told(one: KindCell) -> dict[str, Any]:
    return {
        "kind": one.kind,
        "altitude_m": one.altitude_m,
        "light": one.light,
        "pfd": one.pfd.as_json(),
        "mean": one.mean,
        "spread": one.spread,
    }


def _contrast_told(one: ContrastCell) -> dict[str, Any]:
    return {
        "contrast": one.contrast.name,
        "altitude_m": one.altitude_m,
        "light": one.light,
        "wrong": one.wrong.as_json(),
        "shots": json_or_none(one.shots),
        "pulses": json_or_none(one.pulses),
        "apart": one.apart,
    }


def _mixture_told(one: MixtureCell) -> dict[str, Any]:
    return {
        "mixture": one.mixture,
        "altitude_m": one.altitude_m,
        "light": one.light,
        "share_u": one.share_u.as_json(),
        "shots": one.shots.as_json(),
    }


def _table(cells: ReflectanceCells) -> Table:
    rows = cells.contrasts
    columns: dict[str, Column] = {
        "contrast_cell": (np.arange(len(rows)), "1", "number of the cell"),
        "altitude": (np.array([one.altitude_m for one in rows]), "m", "altitude"),
        "day": (np.array([int(one.light == "day") for one in rows]), "1", "1 at noon, 0 at night"),
        "reflectance_low": (np.array([KINDS[one.contrast.low] for one in rows]), "1", "of the darker kind"),
        "reflectance_high": (
            np.array([KINDS[one.contrast.high] for one in rows]),
            "1",
            "of the brighter kind",
        ),
    }
    columns |= estimate_columns(
        "wrong_share", [one.wrong for one in rows], "1", "false alarms, and misses, with one shot"
    )
    columns |= estimate_columns(
        "shots_needed", [one.shots for one in rows], "1", "detected shots to separate"
    )
    columns |= estimate_columns("pulses_needed", [one.pulses for one in rows], "1", "pulses fired for them")
    return Table(columns, "contrast_cell")
