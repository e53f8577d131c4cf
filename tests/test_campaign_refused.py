"""What a campaign refuses is refused before it has a folder, in one line and without a way to go on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from belahil.cli.main import main
from belahil.errors import RefusedInput
from belahil.executors import cluster_workers
from procedures import campaign_range, campaign_terrain, range_variants
from procedures.campaign_terrain import TerrainOptions, plan
from procedures.range_ground import MODEL
from sim.presets import laser_preset
from sim.scene import Scene, as_toml, parse_scene
from sim.terrain_grid import Grid

Captured = pytest.CaptureFixture[str]

CAMPAIGNS = ("energy", "orbit", "range", "reflectance", "roughness", "temperature", "terrain")
REFUSED = [
    *((one, "--cluster nosuch", "write tcp://HOST:PORT") for one in CAMPAIGNS),
    *((one, "--workers 0", "'--workers'") for one in CAMPAIGNS),
    *((one, "--cluster tcp://a:1 --workers 2", "one of them") for one in CAMPAIGNS),
    ("range", "--terrain nosuch", "nosuch: cannot be read"),
    ("range", "--terrain plane", "its ground is a plane"),
    ("range", "--terrain bad.tif", "bad.tif: "),
    ("range", "--terrain bad.toml", "bad.toml: "),
    ("range", "--terrain fractal --parts table", "--terrain fractal: is for the part columns"),
    ("range", "--parts tabel", "--parts tabel: allowed are table, "),
    ("range", "--truth north", "--truth north: allowed are light, "),
    ("range", "--echoes 0", "'--echoes'"),
    ("energy", "--sets 0", "'--sets'"),
    ("reflectance", "--sun noon", "--sun noon: allowed are mean, perihelion"),
    ("roughness", "--terrain nosuch", "nosuch: no such file"),
    ("roughness", "--terrain crater", "its ground is a crater"),
    ("roughness", "--terrain bad.tif", "bad.tif: "),
    ("roughness", "--terrain small.toml", "--terrain small.toml: 41 posts 1.5 m apart have no room"),
    ("roughness", "--altitude-km 50", "--altitude-km 50: allowed is 100 to 1500"),
    ("roughness", "--slope-deg 31", "--slope-deg 31: allowed is 1 to 30"),
    ("roughness", "--ellipticity nan", "--ellipticity nan: allowed is 0 to 0.9"),
    ("roughness", "--per-side 1", "'--per-side'"),
    *(("temperature", f"--{one} nosuch", "scene nosuch: no such file") for one in ("scene", "cold", "hot")),
    ("temperature", "--ambient bad.toml", "bad.toml: "),
    ("temperature", "--slope-deg 90", "--slope-deg 90: allowed is 0 to 89"),
    ("temperature", "--slope-deg 80", "--slope-deg 80: a pulse with its peak "),
    ("temperature", "--azimuth-deg inf", "--azimuth-deg inf: must be finite"),
    ("temperature", "--threshold 1", "--threshold 1: allowed is 0 to below 1"),
    ("terrain", "--terrain nosuch", "nosuch: no such file"),
    ("terrain", "--terrain plane", "its ground is a plane"),
    ("terrain", "--terrain bad.tif", "bad.tif: "),
    ("terrain", "--model nosuch", "nosuch: no such file"),
    ("terrain", "--model boulder", "its ground is a boulder"),
    ("terrain", "--model bad.tif", "bad.tif: "),
    ("terrain", "--area rim", "--area rim: allowed is NAME=X,Y,SIDE"),
    ("terrain", "--area rim=900,0,30", "area rim of 30 m about (900, 0) m holds 21 x 0 posts"),
    ("terrain", "--terrain small.toml --area rim=50,0,30", "area rim of 30 m about (50, 0) m holds"),
    ("terrain", "--tile-m 5", "--tile-m 5: cuts terrain models, and no --model is given"),
    ("terrain", "--tile-m inf --model small.toml", "--tile-m inf: must be positive and finite"),
    ("terrain", "--tile-m 2.5 --model small.toml", "allowed is 3 and more, for up to 400 tiles"),
    ("terrain", "--slope-baseline-m 0", "--slope-baseline-m 0: must be positive and finite"),
    ("terrain", "--slope-baseline-m 601", "--slope-baseline-m 601: the terrain is 600 m wide"),
    ("orbit", "--sun noon", "--sun noon: allowed are mean, perihelion"),
    ("orbit", "--rate-hz nan", "--rate-hz nan: allowed is 0.001 to 1000"),
    ("orbit", "--apoapsis-km 300", "the periapsis must be above 0 and not above the apoapsis"),
    ("orbit", "--slopes-deg 61", "--slopes-deg 61: allowed is 0 to 60"),
    ("orbit", "--limits-km 5000", "--limits-km 5000: allowed is 150 to 3000"),
    ("orbit", "--step-km 1", "--step-km 1: allowed is 5 to 500"),
]


@pytest.fixture(autouse=True)
def inputs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A folder with files that are no terrain models, and with one that is small."""
    (tmp_path / "bad.tif").write_text("no GeoTIFF")
    (tmp_path / "bad.toml").write_text("[surface]\nkind = 7\n")
    (tmp_path / "small.toml").write_text('[surface]\nkind = "fractal"\nextent_m = 60.0\nbaseline_m = 24.0\n')
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("campaign", "words", "said"), REFUSED)
def test_a_refused_campaign_leaves_nothing_behind(
    campaign: str, words: str, said: str, capsys: Captured
) -> None:
    assert main(["campaign", campaign, *words.split(), "--out", "run"]) == 2

    told = capsys.readouterr()
    assert told.out == ""
    assert said in told.err
    assert told.err.count("\n") == 1
    assert "--resume" not in told.err
    assert not Path("run").exists()


def test_a_folder_in_use_is_refused_before_anything_is_planned(
    monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.setattr(campaign_range, "plan", lambda options: 1 / 0)
    Path("run").mkdir()
    Path("run/notes.txt").write_text("mine")

    assert main(["campaign", "range", "--out", "run"]) == 2

    assert "--out run: the folder is not empty" in capsys.readouterr().err
    assert [one.name for one in Path("run").iterdir()] == ["notes.txt"]


def test_a_refusal_in_a_chunk_offers_no_way_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    # given what only the work itself can know
    refused = CampaignPlan((Chunk("steep", "tests.chunk_work:refuses", {}),), "", 1)
    monkeypatch.setattr(campaign_range, "plan", lambda options: refused)
    assert main(["campaign", "range", "--quiet", "--workers", "1", "--out", "run"]) == 2
    told = capsys.readouterr().err
    assert "must be above zero; in chunk steep" in told
    assert "--resume" not in told


@pytest.mark.parametrize(
    "address", ["nosuch", "tcp://a", "tcp://a:b", "tcp://:1", "a:1", "tcp://a:99999", ""]
)
def test_what_is_no_address_is_refused_without_the_library(address: str) -> None:
    with pytest.raises(RefusedInput, match="write tcp://HOST:PORT"):
        cluster_workers(address)


def test_a_terrain_model_may_have_the_name_of_a_kind_of_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(range_variants, "flat_terrains", lambda *_: (None,))
    planned = campaign_range.plan(campaign_range.RangeOptions(("columns",), terrain="fractal"))

    kinds = {one.given["ground"]["kind"] for one in planned.chunks if "ground" in one.given}
    assert kinds == {"plane", MODEL + "fractal"}


@pytest.mark.parametrize(
    ("shape", "said"), [((2000, 3000), "allowed is 123 and more"), ((5, 9000), "narrow")]
)
def test_tiles_are_counted_and_not_made(
    shape: tuple[int, int], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a large model, of which small tiles would be millions
    grid = Grid(np.zeros(shape), 1.0, 0.0, 0.0)
    monkeypatch.setattr(campaign_terrain, "_grid", lambda path: grid)
    monkeypatch.setattr(campaign_terrain, "tiles_of", lambda *_: 1 / 0)
    with pytest.raises(RefusedInput, match=said):
        plan(TerrainOptions(models=("fractal",), tile_m=2.0))


def test_the_smallest_allowed_tiles_are_allowed() -> None:
    with pytest.raises(RefusedInput, match="allowed is 3 and more"):
        plan(TerrainOptions(models=("small.toml",), tile_m=2.9))
    assert plan(TerrainOptions(models=("small.toml",), tile_m=3.0)).chunks


@pytest.mark.parametrize(("pulse", "beam"), [("table", "gaussian"), ("tailed", "image")])
def test_assumed_sets_need_a_laser_with_widths(pulse: str, beam: str) -> None:
    from msgspec import structs

    from procedures.campaign_temperature import TemperatureOptions, _refuse_unchanged

    laser = structs.replace(laser_preset("bela"), pulse=pulse, beam=beam)
    with pytest.raises(RefusedInput, match="give --cold and --hot"):
        _refuse_unchanged(TemperatureOptions(scene="own.toml"), laser)


def test_a_pulse_without_a_tail_gets_none() -> None:
    # given a scene with a Gaussian pulse
    from procedures.campaign_temperature import TemperatureOptions
    from procedures.campaign_temperature import plan as temperatures

    Path("gaussian.toml").write_text(as_toml(Scene(laser=laser_preset("previous-model"))))
    planned = temperatures(TemperatureOptions(scene="gaussian.toml"))

    # then its sets differ in what acts
    sets = {one.name: one.given["scene"] for one in planned.chunks if "scene" in one.given}
    assert sets["cold"] != sets["hot"]
    assert all(parse_scene(text).laser.tail_s == Scene().laser.tail_s for text in sets.values())
