"""One campaign of played echoes on every kind of bench, with a receiver that was characterized before."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from belahil.cli.main import main
from tests.test_served_bench import _served

TRUTH = """
[generator]
driver = "keysight-33500"
address = "emulated"
attenuation_db = 20.0
bandwidth_hz = 30e6
[digitizer]
driver = "grm"
link = "emulated:serial"
[emulation]
seed = 31
[emulation.generator]
bandwidth_hz = 30e6
[emulation.receiver]
cutoff_hz = 17.2e6
highpass_hz = 25e3
clock_ppm = 25.0
interleave = { gain = 0.012, offset_v = 2e-3, skew_s = 60e-12 }
"""
WORDS = ["pulse-shape", "night", "--slopes-deg", "0,10", "--shots", "60", "--dark-windows", "6", "--quiet"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench file with its truth, and a characterization of its receiver."""
    made = tmp_path_factory.mktemp("benches")
    (made / "truth.toml").write_text(TRUTH)
    words = ["characterize", "--codes", "4,5", "--bench", str(made / "truth.toml"), "--quiet"]
    assert main([*words, "--out", str(made / "known")]) == 0
    return made


def results(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text())["results"]
    return found


@pytest.mark.slow
def test_emulated_simulated_and_real_addresses_give_equal_results(folder: Path, tmp_path: Path) -> None:
    # given the same truth in this process, without links, and behind real addresses
    simulated = TRUTH.replace('"emulated"', '"simulated"').replace("emulated:serial", "simulated")
    (tmp_path / "simulated.toml").write_text(simulated)
    known = ["--receiver", str(folder / "known")]
    # when the same campaign runs on each, with a characterized receiver
    for name, bench in (("emulated", folder / "truth.toml"), ("simulated", tmp_path / "simulated.toml")):
        assert main([*WORDS, *known, "--bench", str(bench), "--out", str(tmp_path / name)]) == 0
    with _served(folder / "truth.toml") as (_, (address, link, *_)):
        served = TRUTH[: TRUTH.index("[emulation]")].replace("emulated:serial", link)
        served = served.replace('address = "emulated"', f'address = "{address}"\nvisa_library = "@py"')
        (tmp_path / "served.toml").write_text(served)
        words = [*WORDS, *known, "--bench", str(tmp_path / "served.toml"), "--out", str(tmp_path / "served")]
        assert main(words) == 0
    # then all results are equal, and every prediction holds with all that was hidden
    found = results(tmp_path / "emulated")
    assert found == results(tmp_path / "simulated") == results(tmp_path / "served")
    for case in found["cases"]:
        assert 0.9 < case["played"]["reduced_chi_square"]["value"] < 1.1
        assert case["verdict"] == "agrees"
        assert {"gain", "cutoff", "highpass", "interleave_gain", "interleave_skew"} <= set(
            case["played"]["pulls"]
        )


@pytest.mark.slow
def test_without_the_characterization_the_hidden_receiver_is_found_to_differ(
    folder: Path, tmp_path: Path
) -> None:
    # given the preset, which knows nothing of what this receiver hides
    words = [*WORDS, "--bench", str(folder / "truth.toml"), "--out", str(tmp_path / "run")]
    # when the same campaign runs
    status = main(words)
    # then it fails
    assert status == 1
    assert results(tmp_path / "run")["verdict"] == "differs"


def test_a_gain_code_that_was_not_characterized_is_refused_before_anything_is_measured(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a characterization of codes 4 and 5
    words = [*WORDS, "--gain-code", "7", "--receiver", str(folder / "known")]
    # when code 7 is asked for
    status = main([*words, "--bench", str(folder / "truth.toml"), "--out", str(tmp_path / "run")])
    # then it is refused in one line
    assert status == 2
    assert "gain code 7" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_recorded_windows_are_compared_with_a_characterized_receiver(folder: Path, tmp_path: Path) -> None:
    # given a run with the characterized receiver
    known = ["--receiver", str(folder / "known")]
    live = tmp_path / "live"
    assert main([*WORDS, *known, "--bench", str(folder / "truth.toml"), "--out", str(live)]) == 0
    # when its windows are analysed again, once with and once without it
    words = ["pulse-shape", "--windows", str(live / "data.nc"), "--quiet"]
    assert main([*words, *known, "--out", str(tmp_path / "known")]) == 0
    assert main([*words, "--out", str(tmp_path / "unknown")]) == 1
    # then the first says the same as the run, the second that it differs
    pairs = zip(results(live)["cases"], results(tmp_path / "known")["cases"], strict=True)
    for one, other in pairs:
        value = one["played"]["reduced_chi_square"]["value"]
        assert other["played"]["reduced_chi_square"]["value"] == pytest.approx(value, rel=1e-9)
    assert results(tmp_path / "unknown")["verdict"] == "differs"
