"""The page of the study's statements: its form, its commands, and what is cheap enough to find again."""

from __future__ import annotations

import math
import re
import shlex
from pathlib import Path

import click
import numpy as np
import pytest
from msgspec import structs

from belahil import butterworth
from belahil.cli.main import belahil as command_line
from belahil.delay_curve import published_curve
from procedures.range_reduction import FIXED_OFFSETS
from procedures.range_scenes import base_scene, conditions
from sim.chain import Chain
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.detector import miller_gain
from sim.filter_delay import filter_delay_curve
from sim.presets import detector_preset, laser_preset
from sim.scene import Scene, load_scene
from sim.scene_tables import SurfaceTable

DOCS = Path(__file__).resolve().parent.parent / "docs"
TEXT = (DOCS / "paper-statements.md").read_text(encoding="utf-8")
SOURCES = {
    "Calibration of ranges": ("arrival-time", "tx-delay", "campaign-temperature"),
    "Pulses and receiver": ("campaign-temperature",),
    "Energy": ("energy-calibration", "campaign-energy", "campaign-reflectance"),
    "Roughness": ("campaign-roughness",),
    "Orbit": ("campaign-orbit",),
}
"""Pages with the runs behind a part of this one."""
VERDICTS = ("agrees", "open", "partly", "differs", "put in", "not comparable")


def rows_of(text: str) -> dict[str, list[str]]:
    """Return the cells behind each key."""
    lines = [line for line in text.splitlines() if re.match(r"\| [A-Z]\d", line)]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {key: rest for key, *rest in cells}


ROWS = rows_of(TEXT)


def found(key: str) -> str:
    """Return what the page says that we find."""
    return ROWS[key][1]


def numbers(text: str) -> list[float]:
    """Return the plain numbers of a cell, without uncertainties in brackets."""
    return [float(one) for one in re.findall(r"-?\d+(?:\.\d+)?", re.sub(r"\(\d[\d.]*\)", "", text))]


# ---- form


def test_every_statement_has_a_verdict_of_the_legend() -> None:
    legend = re.findall(r"^\| ([a-z ]+) \| ", TEXT, re.MULTILINE)

    assert [one for one in legend if one != "verdict"] == list(VERDICTS)
    assert {key: cells[2] for key, cells in ROWS.items() if cells[2] not in VERDICTS} == {}


def test_statements_are_counted_without_a_gap() -> None:
    keys = re.findall(r"^\| ([A-Z])(\d+) \|", TEXT, re.MULTILINE)

    for letter in {letter for letter, _ in keys}:
        counted = [int(number) for first, number in keys if first == letter]
        assert counted == list(range(1, len(counted) + 1)), letter


def test_every_difference_has_its_reason() -> None:
    explained = {
        key
        for told in re.findall(r"^- \*\*([A-Z0-9, ]+)\*\* ", TEXT, re.MULTILINE)
        for key in told.split(", ")
    }
    assert explained <= set(ROWS)

    wanted = {key for key, cells in ROWS.items() if cells[2] in ("open", "partly", "differs")}

    assert sorted(wanted - explained) == []


@pytest.mark.parametrize("call", re.findall(r"^\$ (belahil .+)$", TEXT, re.MULTILINE))
def test_a_command_of_the_page_is_understood(call: str) -> None:
    words = shlex.split(call)[1:]
    command: click.Command = command_line
    context = click.Context(command)
    while isinstance(command, click.Group):
        known = command.get_command(context, words.pop(0))
        assert known is not None, call
        command = known

    parsed = command.make_context(command.name, words)  # refuses what it does not know

    assert parsed.args == []


def test_every_part_begins_with_what_to_run() -> None:
    for part in TEXT.split("\n## ")[1:]:
        assert ("\n| | the study says" in part) == ("```console\n$ belahil " in part)


@pytest.mark.parametrize("title", SOURCES)
def test_measured_numbers_are_those_of_the_page_they_come_from(title: str) -> None:
    told = "".join((DOCS / f"{name}.md").read_text(encoding="utf-8") for name in SOURCES[title])
    (part,) = [one for one in TEXT.split("\n## ")[1:] if one.startswith(title)]

    measured = [one for row in rows_of(part).values() for one in re.findall(r"\d[\d.]*\([\d.]+\)", row[1])]

    assert len(measured) > 3
    assert [one for one in measured if one not in told] == []


# ---- what is cheap to find again


def test_fixed_offsets() -> None:
    total_s = math.fsum(one.time.value for one in FIXED_OFFSETS)

    assert found("C1") == f"{1e9 * total_s:.3f} ns"
    path_m = SPEED_OF_LIGHT_M_PER_S * total_s
    assert numbers(found("C2")) == pytest.approx([path_m, path_m / 2], abs=0.0006)


def test_the_published_correction_beside_the_filter() -> None:
    own = filter_delay_curve(butterworth.poles(19e6, 3, 0.0), 12.5e-9)
    widths_s = np.linspace(20e-9, 110e-9, 91)

    def scatter_ns(as_printed: bool) -> float:
        together_s = published_curve(as_printed=as_printed).at(widths_s) + own.at(widths_s)
        return 1e9 * float(np.std(together_s))

    assert f"by {scatter_ns(as_printed=True):.0f} ns rms" in found("C3")
    assert f"by {scatter_ns(as_printed=False):.2f} ns rms" in found("C3")


def test_the_delay_of_the_filter_at_0_hz() -> None:
    delay_s = float(sum(-1 / pole for pole in butterworth.poles(19e6, 3, 0.0)).real)

    assert found("C9").startswith(f"{1e9 * delay_s:.2f} ns ")


def test_the_peak_behind_the_filter() -> None:
    def later_ns(scene: Scene) -> float:
        chain, step_s, count = Chain(scene), 0.05e-9, 6000
        light = chain.echo().photon_rate_hz(-100e-9, step_s, count)
        volts = chain.curve(None, -100e-9, step_s, count)
        return 1e9 * step_s * (int(np.argmax(volts)) - int(np.argmax(light)))

    plane = structs.replace(load_scene("plane"), altitude_m=500e3)
    level = structs.replace(plane, surface=SurfaceTable(kind="plane"))
    boulder = steady(load_scene("boulder-example"))

    told = numbers(found("C7"))
    assert [told[0], told[3]] == pytest.approx([later_ns(plane), later_ns(boulder)], abs=0.06)
    assert later_ns(level) == pytest.approx(told[0], abs=0.3)


def steady(scene: Scene) -> Scene:
    """Return a scene without chance in its light."""
    laser = structs.replace(scene.laser, jitter_rad=(0.0, 0.0), energy_jitter=0.0)
    return structs.replace(scene, laser=laser)


def test_two_peaks_of_a_boulder_and_of_a_crater() -> None:
    def two_peaks(scene: Scene) -> tuple[float, float]:
        step_s = 0.1e-9
        rate = Chain(steady(scene)).echo().photon_rate_hz(-100e-9, step_s, 2000)
        inner = rate[1:-1]
        peaks = 1 + np.flatnonzero((inner > rate[:-2]) & (inner > rate[2:]) & (inner > 0.05 * rate.max()))
        assert peaks.size == 2
        heights = np.sort(rate[peaks])
        return 1e9 * step_s * float(np.diff(peaks)[0]), float(heights[0] / heights[1])

    boulder = two_peaks(load_scene("boulder-example"))
    crater = two_peaks(Scene(surface=SurfaceTable(kind="crater", diameter_m=20.0, depth_m=5.0)))

    assert numbers(found("P2")) == pytest.approx(boulder, rel=0.02)
    _, _, _, apart_ns, ratio = numbers(found("P3"))
    assert (apart_ns, ratio) == pytest.approx(crater, rel=0.02)


def test_the_negative_tail() -> None:
    def tail(scene: Scene) -> float:
        volts = Chain(scene).curve(None, -100e-9, 0.2e-9, 3000)
        return 100 * float(volts.min() / volts.max())

    near, far = numbers(found("P6"))[0], numbers(found("P6"))[2]
    level = Scene(surface=SurfaceTable(kind="plane", reflectance=0.17))

    assert near == round(tail(level))
    assert far == round(tail(load_scene("plane")))


def test_the_instrument_in_closed_form() -> None:
    digitizer = base_scene().receiver_spec.digitizer
    window_s = digitizer.max_sample_count * digitizer.sample_interval_s
    assert found("P7").startswith(f"{window_s * SPEED_OF_LIGHT_M_PER_S / 2e3:.1f} km")
    assert numbers(found("P8")) == pytest.approx([laser_preset().divergence_rad * h for h in (400e3, 1400e3)])

    view_m = 2 * 1400e3 * math.tan(detector_preset().field_of_view_rad)
    assert numbers(found("P19")) == pytest.approx([70, view_m, 1400], abs=0.5)

    nominal = detector_preset()
    both = [miller_gain(v, nominal.breakdown_v, nominal.miller_exponent) for v in (320.0, 370.0)]
    other = [miller_gain(v, 403.14, nominal.miller_exponent) for v in (320.0, 370.0)]
    assert numbers(found("P9")) == pytest.approx([*both, *other], rel=0.004)

    former = detector_preset("previous-model").multiplication
    assert found("P10").startswith(f"{former:g} ")


def test_noon_beside_night() -> None:
    cells = {(one.light, one.reflectance): one.noise_rms_v for one in conditions(base_scene())}
    rises = [round(100 * (cells["day", r] / cells["night", r] - 1)) for r in (0.17, 0.08, 0.30)]

    assert numbers(found("P11"))[::2] == rises


def test_a_wandering_beam_on_a_slope() -> None:
    moved_m = 500e3 * laser_preset().jitter_rad[0] * math.tan(math.radians(10.0))

    assert f" {moved_m:.3f} m " in found("R17")
