"""Up to which altitudes kinds of ground are told apart; budget, ageing of the laser, and the text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from msgspec import structs

from belahil.uncertainty import budget, combined
from belahil.values import Estimate
from procedures.class_separation import WRONG
from procedures.energy_curves import Crossing, crossing
from procedures.paper_statements import Statement
from procedures.range_scenes import LIGHTS, base_scene
from procedures.reflectance_kinds import AGEING, CONTRASTS, CROSSOVERS, KINDS
from procedures.reflectance_results import (
    MIXTURES,
    SHARE_U,
    ContrastCell,
    MixtureCell,
    allowed_scale_u,
    crossovers_needed,
)
from sim.detector import multiplication

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from belahil.outcome import BudgetLine
    from procedures.reflectance_results import KindCell, ReflectanceCells

    Curve = list[tuple[float, Estimate]]

SHOTS = (1, 10, 100)
"""Of one place, or of one kind of ground: altitudes are told for so many."""
_ONE_SIGMA = 0.15865525393145707
"""Share of confusions where bars of one standard deviation just touch."""
_ALBEDO_U, _ALTITUDE_U_M, _TEMPERATURE_U_K, _BIAS_U_V, _GAIN_U = 0.05, 10.0, 0.1, 0.05, 0.01
"""Assumed: difference of the ground under the footprints of a cross-over; how well altitude, temperature and
bias of the photodiode, and the receiver's gain are known."""
_SCALES_U = (0.01, 0.001)
_BUDGETS_M = (300e3, 500e3, 700e3, 900e3)
_LOW_M = 200e3
"""Periapsis in an extended mission."""


def contrast_curve(cells: ReflectanceCells, name: str, light: str, what: str) -> Curve:
    """Return a number of one contrast, "wrong" or "shots", along the altitude."""
    rows = [one for one in cells.contrasts if (one.contrast.name, one.light) == (name, light)]
    pairs = [(one.altitude_m, getattr(one, what)) for one in sorted(rows, key=lambda one: one.altitude_m)]
    return [(altitude_m, one) for altitude_m, one in pairs if one is not None]


def mixture_curve(cells: ReflectanceCells, name: str, light: str) -> Curve:
    """Return the standard deviation of the share of ice from one shot along the altitude."""
    rows = [one for one in cells.mixtures if (one.mixture, one.light) == (name, light)]
    return [(one.altitude_m, one.share_u) for one in sorted(rows, key=lambda one: one.altitude_m)]


def reach(cells: ReflectanceCells) -> list[dict[str, Any]]:
    """Return for each contrast, by day and by night, up to which altitude it is told."""
    return [
        {
            "contrast": one.name,
            "low": KINDS[one.low],
            "high": KINDS[one.high],
            "light": light,
            **{f"shots_{shots}": highest(cells, one.name, light, shots).as_json() for shots in SHOTS},
            "computed_to_m": max(
                (at for at, _ in contrast_curve(cells, one.name, light, "wrong")), default=0.0
            ),
            "one_sigma": crossing(contrast_curve(cells, one.name, light, "wrong"), _ONE_SIGMA).as_json(),
        }
        for one in CONTRASTS
        for light in LIGHTS
    ]


def highest(cells: ReflectanceCells, name: str, light: str, shots: int) -> Crossing:
    """Return the altitude up to which so many shots separate two kinds."""
    if shots == 1:
        return crossing(contrast_curve(cells, name, light, "wrong"), WRONG)
    # Reaching the next whole number is not enough any more.
    return crossing(contrast_curve(cells, name, light, "shots"), shots + 0.5)


def mixing(cells: ReflectanceCells) -> list[dict[str, Any]]:
    """Return for each mixture up to which altitude so many shots tell the share of ice to 0.1."""
    found = []
    for name, (low, high, share) in MIXTURES.items():
        for light in LIGHTS:
            curve = mixture_curve(cells, name, light)
            reached = {f"shots_{n}": crossing(curve, SHARE_U * math.sqrt(n)).as_json() for n in SHOTS}
            found.append({"mixture": name, "light": light, "ends": [low, high], "share": share, **reached})
    return found


def scale_known() -> dict[str, float]:
    """Return relative standard uncertainties of the scale that all shots of a pass have in common."""
    detector = base_scene().detector
    gain = multiplication(detector)
    warmer = structs.replace(detector, apd_temperature_c=detector.apd_temperature_c + _TEMPERATURE_U_K)
    higher = structs.replace(detector, bias_v=detector.bias_v + _BIAS_U_V)
    return {
        f"gain of the photodiode, temperature to {_TEMPERATURE_U_K:g} K": abs(
            multiplication(warmer) / gain - 1
        ),
        f"gain of the photodiode, bias to {_BIAS_U_V:g} V": abs(multiplication(higher) / gain - 1),
        f"gain of the receiver, {_GAIN_U:g}": _GAIN_U,
    }


def shot_budget(cells: ReflectanceCells) -> list[BudgetLine]:
    """Return what makes the reflectance of one shot over regolith by night uncertain, relative."""
    lines: list[BudgetLine] = []
    jitter = base_scene().laser.energy_jitter
    for one in _regolith(cells):
        if one.altitude_m not in _BUDGETS_M:
            continue
        assert one.mean is not None
        assert one.spread is not None
        whole = one.spread / one.mean
        parts = {
            "energy from the pulse": math.sqrt(max(whole**2 - jitter**2, 0.0)),
            "laser's energy from shot to shot": jitter,
            f"altitude to {_ALTITUDE_U_M:g} m": 2 * _ALTITUDE_U_M / one.altitude_m,
        }
        lines += budget(f"one shot, regolith, night, {one.altitude_m / 1e3:g} km", "1", parts)
    return [*lines, *budget("scale common to a pass", "1", scale_known())]


def _regolith(cells: ReflectanceCells) -> Iterator[KindCell]:
    for one in cells.kinds:
        if (one.kind, one.light) == ("regolith", "night") and one.mean is not None:
            yield one


def ageing(cells: ReflectanceCells) -> dict[str, Any]:
    """Return what ageing does uncorrected, how well it must be known, and the cross-overs for that."""
    kept = {name: 1 + loss for name, loss in AGEING.items()}
    kept["both"] = math.prod(kept.values())
    rows = []
    for one in _regolith(cells):
        assert one.mean is not None
        assert one.spread is not None
        spread = one.spread / one.mean
        whole = math.sqrt(crossovers_needed(spread, _ALBEDO_U, 1.0) / CROSSOVERS[0])
        rows.append(
            {
                "altitude_m": one.altitude_m,
                "spread": spread,
                "needed": {f"{u:g}": crossovers_needed(spread, _ALBEDO_U, u) for u in _SCALES_U},
                "scale_u_from_all": whole,
            }
        )
    return {
        "bias_uncorrected": {name: value - 1 for name, value in kept.items()},
        "regolith_told_as": {name: KINDS["regolith"] * value for name, value in kept.items()},
        "scale_u_allowed": {one.name: allowed_scale_u(one) for one in CONTRASTS},
        "scale_u_known": combined(scale_known().values()),
        "albedo_u": _ALBEDO_U,
        "crossovers_in_mission": list(CROSSOVERS),
        "crossovers": rows,
    }


def statements(cells: ReflectanceCells) -> list[dict[str, Any]]:
    """Return what the text says of reflectance, as `procedures.paper_statements` tells it."""
    rows = [*_kinds_apart(cells), *_mixture_seen(cells), *_share_known(cells)]
    return [one.as_json() for one in rows]


def _kinds_apart(cells: ReflectanceCells) -> Iterator[Statement]:
    """Dark, regolith and ice below 900 km by night: 5 % confusions, one shot; then what is needed there."""
    for one in CONTRASTS[:2]:
        found = [cell for cell in _of(cells.contrasts, 900e3, "night") if cell.contrast == one]
        for cell in found:
            told = f"confusions of {one.name}, one shot, 900 km by night"
            yield Statement("E10", told, "at most", WRONG, 0.005, cell.wrong)
            apart = f"{one.name} apart, in standard deviations, 900 km by night"
            yield Statement("E10", apart, "at least", 1.0, 0.0, _apart(cell))


def _mixture_seen(cells: ReflectanceCells) -> Iterator[Statement]:
    """A rise by 15 %, at 700 km: larger than the error of one shot."""
    for light in LIGHTS:
        for cell in _of(cells.contrasts, 700e3, light):
            if cell.contrast == CONTRASTS[2]:
                told = f"rise by 15 % over the standard deviation of one shot, 700 km by {light}"
                yield Statement("E11", told, "at least", 1.0, 0.0, _apart(cell))


def _apart(cell: ContrastCell) -> Estimate:
    relative = 0.0 if cell.shots is None else cell.shots.standard_uncertainty / cell.shots.value / 2
    return Estimate(cell.apart, cell.apart * relative)


def _share_known(cells: ReflectanceCells) -> Iterator[Statement]:
    for one in _mixed(cells.mixtures, _LOW_M, "night"):
        told = f"share of ice from one shot, {one.mixture} mixture, {one.altitude_m / 1e3:g} km by night"
        yield Statement("E12", told, "at most", SHARE_U, 0.005, one.share_u)


def _of(cells: Sequence[ContrastCell], altitude_m: float, light: str) -> list[ContrastCell]:
    return [one for one in cells if (one.altitude_m, one.light) == (altitude_m, light)]


def _mixed(cells: Sequence[MixtureCell], altitude_m: float, light: str) -> list[MixtureCell]:
    return [one for one in cells if (one.altitude_m, one.light) == (altitude_m, light)]
