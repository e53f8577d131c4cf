"""``belahil scene``: what it lists, shows and writes is what `belahil simulate` takes."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.cli.main import main
from belahil.errors import ConfigError
from sim.explain import explained
from sim.scene import load_scene, parse_scene, ready_scenes
from sim.scene_checks import is_idle
from sim.scene_text import commented

Captured = pytest.CaptureFixture[str]


def test_the_ready_scenes_are_listed_with_what_they_are(capsys: Captured) -> None:
    assert main(["scene", "list"]) == 0

    rows = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert [name for name, _ in rows] == list(ready_scenes())
    assert all(len(text.split()) > 5 and not text.startswith("#") for _, text in rows)


@pytest.mark.parametrize("name", ready_scenes())
def test_a_scene_is_shown_whole_with_the_sources_of_its_numbers(name: str, capsys: Captured) -> None:
    assert main(["scene", "show", name]) == 0

    # Then it is the scene, in a file that can be read
    text, scene = capsys.readouterr().out, load_scene(name)
    assert parse_scene(text) == scene
    # And every key of a table stands there when it acts, and only then
    tables = tomllib.loads(text)
    for title in ("laser", "surface", "noise", "detector"):
        table = getattr(scene, title)
        acting = {
            key
            for key in table.__struct_fields__
            if not is_idle(table, key) and getattr(table, key) not in (None, "")
        }
        assert set(tables[title]) == acting
    # And what is known of each number is told beside it, or below
    for line in explained(scene):
        said = re.search(rf"^(?:# )?{line.key} = [^#\n]*(?:#(.*))?$", full_names(text), re.MULTILINE)
        assert said, line.key
        note = said[1] or ""
        assert ("assumed: " in note) == line.assumed
        assert line.source in ("scene", "choice of the scene", "default of a scene") or line.source in note
        assert line.unit in ("", "1") or f" {line.unit}" in note


def full_names(text: str) -> str:
    """Put the table before each key, as `sim.explain` does."""
    table, lines = "", []
    for line in text.splitlines():
        found = re.match(r"\[(\w+)\]", line)
        table = f"{found[1]}.".replace("electronics.", "receiver.") if found else table if line else ""
        lines.append(re.sub(r"^(# )?(\w+)(?= = )", rf"\g<1>{table}\2", line))
    return "\n".join(lines)


ODD = {
    "another receiver": "[electronics]\ncutoff_hz = 18.5e6\nclock_ppm = 20.0\n"
    "interleave = { gain = 0.01 }\ngain_by_code = [" + ", ".join(f"{k + 1}.5" for k in range(16)) + "]\n",
    "a bias that does nothing": "[detector]\nmultiplication = 60.0\nbias_v = 310.0\n",
    "quotation marks": "[laser]\npulse = 'table'\ntable = 'a \"quoted\" pulse.csv'\n",
    "a terrain model": "[surface]\nkind = 'dtm'\nfile = 'ground.npy'\ndatum_m = -3.5\nspacing_m = 2.0\n",
    "a crater's rim": "[surface]\nkind = 'crater'\nrim_height_m = 0.5\n",
    "darkness of a file": "[noise]\ndark_windows = 'dark.npy'\ndark_laser = 'off'\n",
    "an ellipse": "[laser]\nbeam = 'elliptical'\nellipticity = 0.3\njitter_rad = [1e-6, 2e-6]\n[sun]\n",
}


@pytest.mark.parametrize("text", ODD.values(), ids=ODD)
def test_any_scene_comes_back(text: str, tmp_path: Path) -> None:
    # Given a scene that uses keys which the ready ones leave alone
    np.save(tmp_path / "ground.npy", np.zeros((40, 40)))
    np.save(tmp_path / "dark.npy", np.zeros((2, 64)))
    (tmp_path / 'a "quoted" pulse.csv').write_text("0,0\n1e-9,1\n2e-9,0\n")
    scene = parse_scene(text, folder=tmp_path)
    # When it is written with comments, then the same scene is read back
    assert parse_scene(commented(scene)) == scene


@given(
    altitude_m=st.floats(1, 1e9),
    slope_deg=st.floats(0, 89),
    dark_rms_v=st.floats(0, 10),
    kind=st.sampled_from(["plane", "crater", "boulder", "fractal", "multifractal"]),
    seed=st.integers(0, 2**40),
)
def test_every_digit_comes_back(
    altitude_m: float, slope_deg: float, dark_rms_v: float, kind: str, seed: int
) -> None:
    scene = parse_scene(
        f"altitude_m = {altitude_m!r}\nseed = {seed}\n[surface]\nkind = '{kind}'\nslope_deg = {slope_deg!r}\n"
        f"[noise]\ndark_rms_v = {dark_rms_v!r}\n"
    )
    assert parse_scene(commented(scene)) == scene


def test_keys_without_a_value_are_told(capsys: Captured) -> None:
    for name, key in (
        ("crater", ""),
        ("plane", "dark_rms_v"),
        ("day", "dark_windows"),
        ("fractal", "reflectance_map"),
    ):
        assert main(["scene", "show", name]) == 0
        text = capsys.readouterr().out
        assert bool(re.search(rf"^# {key} +# .", text, re.MULTILINE)) == bool(key)
    assert main(["scene", "show", "night"]) == 0
    assert "# [sun]: without this table it is night" in capsys.readouterr().out


@pytest.mark.parametrize(("more", "origin"), [([], "night"), (["--from", "crater"], "crater")])
def test_a_new_scene_file_is_the_scene_that_it_is_from(
    more: list[str], origin: str, tmp_path: Path, capsys: Captured
) -> None:
    file = tmp_path / "mine.toml"
    assert main(["scene", "new", str(file), *more]) == 0
    assert f"belahil simulate {file}" in capsys.readouterr().out
    assert load_scene(file) == load_scene(origin)
    # And a file that is there is never written over
    assert main(["scene", "new", str(file)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert load_scene(file) == load_scene(origin)


def test_a_new_scene_may_be_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "first.toml").write_text("altitude_m = 777e3\n")
    assert main(["scene", "new", str(tmp_path / "new.toml"), "--from", str(tmp_path / "first.toml")]) == 0
    assert load_scene(tmp_path / "new.toml").altitude_m == 777e3


@pytest.mark.parametrize("words", [["show", "moon"], ["new", "x.toml", "--from", "moon"]])
def test_a_scene_that_is_not_there_is_refused(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["scene", *words]) == 2
    said = capsys.readouterr()
    assert "ready scenes: ambient, boulder" in said.err
    assert said.out == ""
    assert not list(tmp_path.iterdir())
    with pytest.raises(ConfigError):
        load_scene("moon")
