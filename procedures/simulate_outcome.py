"""The results, tables and figure of a simulated scene."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from procedures.simulate import Fitted, Simulation
    from sim.chain import Chain

_BESIDE = 0.01
"""Of the beam, beyond what the plan cuts off its edge at any sensible tolerance."""


def analyse(simulation: Simulation) -> Outcome:
    """Turn a simulation into results, tables and the figure."""
    return Outcome(
        results=_results(simulation),
        tables=_tables(simulation),
        figures={"simulation": lambda: _figure(simulation)},
        notes=[
            "night and day: the scene's own noise, without and with sunlight; what it does not name is the "
            "receiver's dark noise, the shot noise of the echo, and the Sun of the ready scene `day`.",
            "detected: shots with a candidate of the range finder within 10 m of the echo; fitted: shots "
            "with a Gaussian in the samples round the place where the echo is expected.",
            "arrivals count from the gate, the time of flight to the plane z = 0 at nadir, and have the "
            "delay of the receiver's filter; they and the widths are in true time, whatever error the "
            "receiver's clock has.",
            *remarks(simulation),
        ],
    )


def remarks(simulation: Simulation) -> list[str]:
    """Say what a user may not have meant: darkness, a beam beside the terrain, clipped samples."""
    chain, shots = simulation.chain, simulation.shots
    said = []
    if simulation.dark:
        said.append(f"no light comes back: {chain.echo().status}")
    beside = 1 - chain.lit().delays.lit
    if not simulation.dark and beside > _BESIDE:
        said.append(f"{100 * beside:.2g} % of the beam meets no known ground; its light is lost")
    clipped = sum(shot.window.saturated > 0 for shot in shots)
    if clipped:
        peak_v = float(simulation.curves["amplified"].max())
        said.append(
            f"{clipped} of {len(shots)} windows have samples beyond the converter's span of "
            f"{sized(chain.receiver.quantizer.full_scale_v, 'V')}: "
            f"noise {sized(chain.noise_rms_v, 'V', 3)} rms, echo {sized(peak_v, 'V', 3)}"
        )
    return said


def _results(simulation: Simulation) -> dict[str, Any]:
    chain, curves = simulation.chain, simulation.curves
    light = chain.echo()
    return {
        "status": "no_light" if simulation.dark else "ok",
        "tolerance": chain.accuracy.tolerance,
        "predicted_error": chain.plan.predicted_error,
        "terrain_posts_error": chain.posts_error,
        "method": chain.plan.method.replace(" ", "_"),
        "pixels": chain.plan.pixels,
        "echo": {
            "photons": light.photons,
            "energy_j": light.energy_j,
            "peak_rate_hz": float(curves["received_rate"].max()),
            "peak_at_converter_v": float(curves["amplified"].max()),
        },
        "cases": [
            {"case": case.name, "noise_rms_v": case.noise_rms_v, **_of_fit(chain, case.fit, case.times_s[0])}
            for case in simulation.cases
        ],
        "shots": _of_shots(simulation),
        "stages": [
            {"stage": stage.name, "place": stage.place, "draws": stage.draw, "because": stage.reason}
            for stage in chain.stages
        ],
    }


def _of_fit(chain: Chain, fit: Fitted, first_s: float) -> dict[str, Any]:
    pulse, receiver = fit.pulse, chain.receiver
    # A fit counts in nominal intervals, as the receiver does.
    true = receiver.grid.interval_s / receiver.spec.sample_interval_s
    return {
        "arrival_s": None if pulse is None else float(first_s) + true * pulse.arrival_s,
        "fwhm_s": None if pulse is None else true * pulse.fwhm_s,
        "amplitude_v": None if pulse is None else pulse.amplitude_v,
        "status": fit.status,
    }


def _arrivals(simulation: Simulation) -> list[dict[str, Any]]:
    chain = simulation.chain
    return [
        _of_fit(chain, fit, chain.first_sample_s(index, chain.correlation_window(index)))
        for index, fit in enumerate(simulation.fits)
    ]


def _of_shots(simulation: Simulation) -> dict[str, Any]:
    """Mean and spread over the shots whose fit holds; what needs two shots is null with one."""
    rows = [row for row in _arrivals(simulation) if row["status"] == "ok"]
    found: dict[str, Any] = {
        "count": len(simulation.shots),
        "detected": simulation.detected,
        "fitted": len(rows),
    }
    for key, unit in (("arrival_s", "s"), ("fwhm_s", "s"), ("amplitude_v", "V")):
        name = key.rpartition("_")[0]
        values = np.array([row[key] for row in rows])
        found[name] = found[f"{name}_spread"] = None
        if values.size > 1:
            spread = float(values.std(ddof=1))
            found[name] = _measured(float(values.mean()), spread / math.sqrt(values.size), unit)
            found[f"{name}_spread"] = _measured(spread, spread / math.sqrt(2 * (values.size - 1)), unit)
    return found


def _measured(value: float, uncertainty: float, unit: str) -> dict[str, Any]:
    return {"value": value, "standard_uncertainty": uncertainty, "unit": unit}


def _tables(simulation: Simulation) -> dict[str, Table]:
    ground, curves = simulation.ground, simulation.curves
    texts = {
        "transmitted_rate": ("s-1", "photons sent; the laser fires at time 0"),
        "received_rate": ("s-1", "photons on the photodiode"),
        "received_power": ("W", "optical power on the photodiode"),
        "before_amplifier": ("V", "at the cut, with shot noise of the echo"),
        "amplified": ("V", "at the converter, without noise"),
    }
    samples: dict[str, Any] = {
        "sample_time": (simulation.cases[0].times_s, "s", "true time of the sample from the gate")
    }
    samples |= {
        case.name.replace("-", "_"): (case.volts, "V", f"samples, {case.name}") for case in simulation.cases
    }
    rows = _arrivals(simulation)
    fits: dict[str, Any] = {
        key: (np.array([np.nan if row[key] is None else row[key] for row in rows]), unit, text)
        for key, unit, text in (
            ("arrival_s", "s", "centre of the Gaussian from the gate"),
            ("fwhm_s", "s", "its full width at half maximum"),
            ("amplitude_v", "V", "its height at the converter"),
        )
    }
    fits["status"] = (np.array([row["status"] for row in rows]), "1", "ok, or what is missing")
    tables = {
        "curve": Table(
            {"time": (simulation.times_s, "s", "from the gate")}
            | {name: (curves[name], unit, text) for name, (unit, text) in texts.items()},
            "time",
        ),
        "samples": Table(samples, "sample_time"),
        "fit": Table(fits, "shot"),
        "ground": Table(
            {
                "ground_y": (ground.y_m, "m", "from nadir"),
                "height": (ground.height_m, "m", "above z = 0"),
            },
            "ground_y",
            "ground_x",
        ),
        "ground_x": Table({"ground_x": (ground.x_m, "m", "from nadir")}, "ground_x"),
    }
    return {
        name: Table(
            {
                column if column == table.dimension or column.startswith(name) else f"{name}_{column}": values
                for column, values in table.columns.items()
            },
            table.dimension,
            table.across,
        )
        for name, table in tables.items()
    }


def _figure(simulation: Simulation) -> Figure:
    from procedures.simulate_figure import simulation_figure

    return simulation_figure(simulation)
