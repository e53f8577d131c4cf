"""Bad scenes: a typed result or one clear line and its exit status, from the functions and from the command.

What is impossible is refused before anything is computed; what is possible and returns no light is a result.
Never a number that is not one.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from belahil.cli.main import main
from belahil.errors import BelahilError, ConfigError, RefusedInput
from procedures.simulate import SimulateOptions
from sim.accuracy import FLOOR, Accuracy
from sim.chain import Chain
from sim.scene import load_scene
from sim.terrain_grid import OffTerrain

DTM = "[surface]\nkind = 'dtm'\nfile = 'ground.npy'\nspacing_m = 1.5\n"
FLAT = np.zeros((80, 80))


@dataclass(frozen=True)
class Refused:
    """A scene that is refused."""

    name: str
    text: str
    error: type[BelahilError]
    said: tuple[str, ...]
    heights_m: np.ndarray | None = None


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    yield
    assert not list(tmp_path.glob("**/*.tmp"))


def beside(value: float) -> np.ndarray:
    """A terrain model that has data far from the beam only."""
    heights = np.full((80, 80), np.nan)
    heights[:2, :3] = value
    return heights


REFUSED = [
    Refused(
        "unknown key",
        "[laser]\nenrgy_j = 0.05\n",
        ConfigError,
        ("[laser] has an unknown key `enrgy_j`", "allowed: preset", "energy_j"),
    ),
    Refused("unknown table", "[lazer]\n", ConfigError, ("unknown key `lazer`", "allowed: altitude_m")),
    Refused(
        "unknown preset",
        "[laser]\npreset = 'x'\n",
        ConfigError,
        ('preset = "x" is unknown', "allowed: bela, gala-like"),
    ),
    Refused(
        "footprint off the terrain model",
        "[laser]\npointing_rad = [0.01, 0.0]\n" + DTM,
        OffTerrain,
        ("(5000.17, 0) m", "the terrain has no ground there"),
        FLAT,
    ),
    Refused("no data at all", DTM, OffTerrain, ("no post has data",), np.full((80, 80), np.nan)),
    Refused("no data in the beam", DTM, OffTerrain, ("the terrain has no ground there",), beside(0.0)),
    Refused(
        "infinite heights", DTM, RefusedInput, ("values that are not finite",), np.full((80, 80), np.inf)
    ),
    Refused("one post", DTM, RefusedInput, ("holds no 2 x 2 posts",), np.zeros((1, 1))),
    Refused("no file", DTM, ConfigError, ("[surface] file", "no such file")),
    Refused(
        "bias at breakdown",
        "[detector]\nbias_v = 391.43\nbreakdown_v = 391.43\n",
        ConfigError,
        ("[detector] bias_v = 391.43", "must be below the breakdown voltage, 391.43 V"),
    ),
    Refused(
        "bias above breakdown",
        "[detector]\nbias_v = 450.0\n",
        ConfigError,
        ("[detector] bias_v = 450", "must be below the breakdown voltage", "apd_temperature_c = 20"),
    ),
    Refused(
        "bias above breakdown in the cold",
        "[detector]\nbias_v = 385.0\napd_temperature_c = -40.0\n",
        ConfigError,
        ("must be below the breakdown voltage", "apd_temperature_c = -40"),
    ),
    Refused("bias below zero", "[detector]\nbias_v = -1.0\n", ConfigError, ("[detector] bias_v", ">= 0.0")),
    Refused("no bias", "[detector]\nbias_v = nan\n", ConfigError, ("[detector] bias_v",)),
    Refused(
        "reflectance below zero", "[surface]\nreflectance = -0.1\n", ConfigError, ("reflectance", ">= 0.0")
    ),
    Refused("altitude 0", "altitude_m = 0.0\n", ConfigError, ("altitude_m: expected a number >= 1.0",)),
    Refused(
        "altitude below 0", "altitude_m = -5e5\n", ConfigError, ("altitude_m: expected a number >= 1.0",)
    ),
    Refused("no altitude", "altitude_m = nan\n", ConfigError, ("altitude_m",)),
    Refused("endless altitude", "altitude_m = inf\n", ConfigError, ("altitude_m: expected a number <= 1",)),
    Refused(
        "no energy", "[laser]\nenergy_j = 0.0\n", ConfigError, ("[laser] energy_j: expected a number >=",)
    ),
    Refused("a wall", "[surface]\nslope_deg = 90.0\n", ConfigError, ("slope_deg: expected a number < 90.0",)),
]


def written(text: str, heights_m: np.ndarray | None = None) -> Path:
    if heights_m is not None:
        np.save("ground.npy", heights_m)
    path = Path("scene.toml")
    path.write_text(text)
    return path


def simulate(*words: str) -> tuple[int, str, str]:
    """Run the command in this process; exit status, and what it printed on both ways."""
    runner = CliRunner()
    with runner.isolation() as (out, err, _):
        status = main(["simulate", *words])
        sys.stdout.flush()
        sys.stderr.flush()
        return status, out.getvalue().decode(), err.getvalue().decode()


def refused_by_the_command(*words: str) -> str:
    """Run what must be refused: nothing but one line, status 2, and no folder left."""
    status, out, err = simulate(*words, "--quiet", "--out", "run")
    assert (status, out) == (2, "")
    assert err.startswith("belahil: ")
    assert err.count("\n") == 1
    assert not Path("run").exists()
    return err


@pytest.mark.parametrize("bad", REFUSED, ids=lambda bad: bad.name)
def test_an_impossible_scene_is_refused_with_one_line(bad: Refused) -> None:
    path = written(bad.text, bad.heights_m)
    # When it is loaded and its chain made, or its echo
    with pytest.raises(RefusedInput) as refused:
        Chain(load_scene(path)).echo()
    # Then the error has its type and one line with what is wrong
    assert isinstance(refused.value, bad.error)
    assert refused.value.exit_status == 2
    assert "\n" not in str(refused.value)
    for part in bad.said:
        assert part in str(refused.value)
    # And the command says the same
    said = refused_by_the_command(str(path), "--shots", "1")
    for part in bad.said:
        assert part in said


@pytest.mark.parametrize("tolerance", [-1e-4, 0.0, FLOOR / 2, 1e-12, 1.0, math.inf, math.nan])
def test_a_tolerance_that_cannot_be_met_is_refused(tolerance: float) -> None:
    with pytest.raises(RefusedInput, match="must be below 1 and at least 1e-10"):
        Accuracy(tolerance)
    with pytest.raises(RefusedInput, match="must be below 1 and at least 1e-10"):
        Accuracy(SimulateOptions(tolerance).tolerance)
    said = refused_by_the_command("plane", "--tolerance", repr(tolerance))
    assert f"tolerance {tolerance!r}: must be below 1 and at least 1e-10, the floor of" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["plane", "--tolerance", "small"], "'small' is not a valid float"),
        (["plane", "--shots", "0"], "0 is not in the range x>=1"),
        (["plane", "--seed", "-1"], "-1 is not in the range x>=0"),
        (["moon"], "scene moon: no such file; ready scenes: ambient, boulder"),
    ],
)
def test_options_that_cannot_be_are_refused(words: list[str], said: str) -> None:
    assert said in refused_by_the_command(*words)


DARK = {
    "zero reflectance": ("[surface]\nreflectance = 0.0\n", None),
    "zero reflectance of a terrain model": (DTM + "reflectance = 0.0\n", FLAT),
    "zero radiation factor": ('[surface]\nphotometry = "factor"\nradiation_factor = 0.0\n', None),
    "a field of view beside the footprint": ("[detector]\nboresight_rad = [0.01, 0.0]\n", None),
}


@pytest.mark.parametrize("name", DARK)
def test_a_scene_without_light_is_a_result_that_says_so(name: str) -> None:
    path = written(*DARK[name])
    # Given the functions
    chain = Chain(load_scene(path))
    light = chain.echo()
    assert light.status != "ok"
    assert "\n" not in light.status
    assert (light.photons, light.energy_j) == (0.0, 0.0)
    assert np.all(np.isfinite(chain.samples().volts))
    # And the command
    status, out, err = simulate(str(path), "--shots", "1", "--quiet", "--out", "run")
    assert (status, out, err) == (0, "", "")
    text = Path("run/summary.json").read_text()
    results = strictly(text)["results"]
    assert results["status"] == "no_light"
    assert results["echo"]["photons"] == 0
    assert {case["status"] for case in results["cases"]} == {"no_light"}
    assert results["cases"][0]["arrival_s"] is None


def strictly(text: str) -> dict:  # type: ignore[type-arg]
    """Read JSON that knows no NaN and no infinity."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} in a summary")

    return json.loads(text, parse_constant=refuse)  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("text", "heights_m"),
    [
        ("altitude_m = 1.0\n", None),
        ("[surface]\nslope_deg = 89.9\n", None),
        ("[surface]\nreflectance = 1e-300\n", None),
        (DTM, np.zeros((3, 3))),
    ],
    ids=["1 m above ground", "nearly a wall", "hardly any light", "nine posts"],
)
def test_at_the_edge_of_what_is_allowed_there_are_numbers(text: str, heights_m: np.ndarray | None) -> None:
    path = written(text, heights_m)
    status, out, err = simulate(str(path), "--shots", "1", "--quiet", "--out", "run")
    assert (status, out, err) == (0, "", "")
    results = strictly(Path("run/summary.json").read_text())["results"]
    assert results["echo"]["photons"] >= 0
    assert 0 <= results["terrain_posts_error"] <= 1
