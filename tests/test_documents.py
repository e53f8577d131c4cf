"""What the documents and docstrings show is true: examples run, links lead somewhere."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re
import shlex
from pathlib import Path
from typing import Any

import click
import msgspec
import pytest

from belahil import config
from belahil.cli.main import belahil as command_line
from belahil.cli.main import main
from belahil.receiver_truth import receiver_truth
from procedures import characterize, noise, rfm_parity
from procedures.candidate_parity import Tolerances
from sim.scene import parse_scene

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("belahil", "drivers", "sim", "procedures")
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def public_modules() -> list[str]:
    """Return the names of all modules that have no underscore in front."""
    found = list(ROOMS)
    for room in ROOMS:
        for module in pkgutil.walk_packages([str(ROOT / room)], f"{room}."):
            if not any(part.startswith("_") for part in module.name.split(".")):
                found.append(module.name)
    return found


@pytest.mark.parametrize("name", public_modules())
def test_examples_of_a_module(name: str) -> None:
    outcome = doctest.testmod(importlib.import_module(name), verbose=False)

    assert outcome.failed == 0


def test_examples_of_the_readme() -> None:
    outcome = doctest.testfile(str(ROOT / "README.md"), module_relative=False)

    assert outcome.attempted >= 5
    assert outcome.failed == 0


def commands_of_the_readme() -> list[list[str]]:
    """Return the words behind `belahil` of each line in a shell block."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    calls = re.findall(r"(?:^|/)(belahil .*)$", "".join(blocks), re.MULTILINE)
    return [shlex.split(call, comments=True)[1:] for call in calls]


@pytest.mark.parametrize("words", commands_of_the_readme(), ids=" ".join)
def test_a_command_of_the_readme_is_understood(words: list[str]) -> None:
    command: click.Command = command_line
    context = click.Context(command)
    while isinstance(command, click.Group):
        found = command.get_command(context, words.pop(0))
        assert found is not None
        command = found

    if words == ["--help"]:
        return
    parsed = command.make_context(command.name, words)  # refuses what it does not know

    assert parsed.args == []


@pytest.mark.parametrize("name", ["characterize", "noise", "tx-delay", "rfm-parity"])
def test_the_options_of_the_architecture_are_those_of_the_command(name: str) -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `--")]
    own = re.search(rf"^`{name}` also takes (.+)$", text, re.MULTILINE)
    assert own is not None

    told = re.findall(r"--[a-z-]+", " ".join([*rows, own[1]]))

    command = command_line.get_command(click.Context(command_line), name)
    assert command is not None
    assert sorted(told) == sorted(one for parameter in command.params for one in parameter.opts)


def test_the_help_tells_the_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    def told(command: str) -> str:
        assert main([command, "--help"]) == 0
        return " ".join(capsys.readouterr().out.split())

    amplitudes = ",".join(f"{1e3 * volts:g}" for volts in characterize.AMPLITUDES_VPP)
    assert f"peak to peak; {amplitudes} when left out" in told("characterize")
    assert f"{characterize.FREQUENCY_COUNT} up to 38 MHz" in told("characterize")
    assert f"for each code; {characterize.DARK_WINDOWS} when left out" in told("characterize")
    assert f"for each code; {noise.DARK_WINDOWS} when left out" in told("noise")
    widths = ",".join(f"{1e9 * width_s:g}" for width_s in rfm_parity.WIDTHS_S)
    snrs = ",".join(f"{snr:g}" for snr in rfm_parity.SNRS)
    for said in (
        f"ns; {widths} when left out",
        f"filter; {snrs} when left out",
        f"Windows for each echo; {rfm_parity.SHOTS}.",
        f"before each echo; {rfm_parity.MARKER_SNR:g}.",
        f"Simulated windows for each echo; {rfm_parity.MODEL_WINDOWS}.",
        f"equal candidates; {1e12 * Tolerances().arrival_s:g}.",
    ):
        assert said in told("rfm-parity")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")

    targets = [target.split("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]

    assert [target for target in targets if target and not (document.parent / target).exists()] == []


def toml_blocks(document: Path) -> list[str]:
    return re.findall(r"^```toml\n(.*?)^```", document.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def bench_file_of_the_architecture() -> str:
    (text,) = [block for block in toml_blocks(ROOT / "docs/architecture.md") if block.startswith("[bench]")]
    return text


def test_the_bench_file_of_the_architecture_shows_the_defaults() -> None:
    shown, default = config.parse_bench(bench_file_of_the_architecture()), config.emulated()

    assert receiver_truth(shown) == receiver_truth(default)
    same_receiver = msgspec.structs.replace(shown.emulation, receiver=default.emulation.receiver)
    assert msgspec.structs.replace(shown, emulation=same_receiver) == default


def test_the_bench_file_of_the_architecture_names_every_key() -> None:
    def keys(table: msgspec.Struct) -> list[str]:
        values = [(name, getattr(table, name)) for name in table.__struct_fields__]
        return [
            key
            for name, value in values
            for key in [name, *(keys(value) if isinstance(value, msgspec.Struct) else [])]
        ]

    text = bench_file_of_the_architecture()

    assert [key for key in keys(config.emulated()) if key != "limits" and key not in text] == []


def test_the_bench_file_of_the_readme_is_accepted() -> None:
    (text,) = toml_blocks(ROOT / "README.md")

    bench = config.parse_bench(text)

    assert bench.source == "hardware"
    assert bench.limits == config.LimitsTable(cutoff_hz=(18.0e6, 20.0e6))


def test_the_modules_that_the_architecture_names_are_there_or_planned() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    parts = re.split(r"^(?:What is in )?`(\w+)/`", text.split("### Who imports whom")[0], flags=re.MULTILINE)[
        1:
    ]
    rooms = dict(zip(parts[::2], parts[1::2], strict=True))
    assert set(rooms) == set(ROOMS)

    rows = [(room, row) for room in ROOMS for row in re.findall(r"^\| (`.*)$", rooms[room], re.MULTILINE)]
    wrong = {
        f"{room}/{name}"
        for room, row in rows
        for name in re.findall(r"`([\w/]+(?:\.py|/))`", row.split(" | ")[0])
        if (ROOT / room / name).exists() == (row.split(" | ")[1].startswith("**planned**"))
    }

    assert wrong == set()


def tables_of_the_scene_page() -> dict[str, dict[str, str]]:
    """Return key and default of each table, by its name in the file."""
    text = (ROOT / "docs/scene-file.md").read_text(encoding="utf-8").split("## Every key")[1]
    parts = re.split(r"^(?:Top of the file:|`\[(\w+)\]`.*:)$", text, flags=re.MULTILINE)[1:]
    return {
        name or "": dict(re.findall(r"^\| `(\w+)` \| (.+?) \|", rows, re.MULTILINE))
        for name, rows in zip(parts[::2], parts[1::2], strict=True)
    }


@pytest.mark.parametrize("name", ["", "laser", "surface", "noise", "sun", "detector"])
def test_the_scene_page_tells_every_key_and_its_default(name: str) -> None:
    told = tables_of_the_scene_page()[name]

    scene = parse_scene("[sun]\n")
    table = getattr(scene, name) if name else scene

    keys = [key for key in table.__struct_fields__ if not isinstance(getattr(table, key), msgspec.Struct)]
    assert list(told) == keys
    for key, shown in told.items():
        default = None if shown == "none" else msgspec.toml.decode(f"x = {shown.strip('`')}".encode())["x"]
        assert getattr(table, key) == (tuple(default) if isinstance(default, list) else default), key


def test_the_scenes_of_the_scene_page_are_accepted(tmp_path: Path) -> None:
    for file in ("crater.tif", "pulse.csv"):
        (tmp_path / file).touch()

    scenes = [parse_scene(text, folder=tmp_path) for text in toml_blocks(ROOT / "docs/scene-file.md")]

    assert [scene.surface.kind for scene in scenes] == ["crater", "fractal", "dtm", "plane"]


def test_the_python_of_the_scene_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "docs/scene-file.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}

    exec(block, names)

    assert names["window"].counts.shape == (16064,)
    assert "predicted error of a sample" in capsys.readouterr().out
