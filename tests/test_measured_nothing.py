"""A run that measured nothing, or whose receiver is not the known one, does not end as if all were well."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.cli.main import main
from belahil.uncertainty import by_chance
from belahil.verdict import disagreement, overall

BENCH = '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n'
TOF = ("tof-linearity", "--shots", "2", "--separations", "6", "--peaks-mv", "60")
ENERGY = (
    "energy-calibration",
    "--shots",
    "4",
    "--peaks-mv",
    "60",
    "--widths-ns",
    "15,30,60",
    "--footprints",
    "1",
)
GAINS = ("characterize", "--codes", "4", "--amplitudes-mvpp", "30", "--frequencies-mhz", "1,19")
ARRIVAL = ("arrival-time", "--widths", "8", "--pulse-windows", "8", "--footprints", "0")


def run(folder: Path, *words: str, receiver: str = "") -> int:
    bench = folder / "bench.toml"
    bench.write_text(f"{BENCH}[emulation.receiver]\n{receiver}\n")
    return main([*words, "--bench", str(bench), "--out", str(folder / "run")])


def checks(folder: Path) -> list[tuple[str, str, str]]:
    summary = json.loads((folder / "run" / "summary.json").read_text())
    return [(one["limit"], one["label"], one["verdict"]) for one in summary["checks"]]


@pytest.mark.parametrize(
    ("words", "limit", "status"),
    [
        (("tx-delay", "--shots", "12", "--delay-ns", "900"), "threshold", "no_pulse"),
        (
            ("tof-linearity", "--separations", "2", "--shots", "1", "--peaks-mv", "1", "--widths-ns", "8"),
            "clock_ppm",
            "no_usable_point",
        ),
        pytest.param(
            (*ENERGY, "--peaks-mv", "200", "--gain-code", "15"),
            "slope",
            "no_usable_point",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            (*ARRIVAL, "--gain-code", "15", "--peak-mv", "100"),
            "delay",
            "too_few_points",
            marks=pytest.mark.slow,
        ),
        (GAINS, "gain", "too_few_points"),
    ],
    ids=lambda one: one[0] if isinstance(one, tuple) else "",
)
def test_a_run_that_measured_nothing_is_undecided_and_says_why(
    words: tuple[str, ...], limit: str, status: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, *words) == 1

    out = capsys.readouterr().out
    assert f"undecided: {limit} ({status})\nverdict: undecided\n" in out
    assert checks(tmp_path) == [(limit, status, "undecided")]
    assert "<td>whatever is measured</td>" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "Infinity" not in (tmp_path / "run" / "report.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "words",
    [TOF, pytest.param(ENERGY, marks=pytest.mark.slow), pytest.param(ARRIVAL, marks=pytest.mark.slow)],
    ids=lambda words: words[0],
)
@pytest.mark.parametrize("cutoff_hz", [19e6, pytest.param(13e6, marks=pytest.mark.slow)])
def test_a_receiver_that_is_not_the_known_one_fails_and_one_that_is_has_no_verdict(
    words: tuple[str, ...], cutoff_hz: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = cutoff_hz == 19e6

    assert run(tmp_path, *words, receiver=f"cutoff_hz = {cutoff_hz}") == (0 if known else 1)

    out = capsys.readouterr().out
    assert f"verdict: {'none' if known else 'fail'}\n" in out
    assert ("fail: chi_square (" in out) != known
    assert {(limit, verdict) for limit, _, verdict in checks(tmp_path)} == (
        set() if known else {("chi_square", "fail")}
    )


NOISE = ("noise", "--codes", "4", "--dark-windows", "2")
TX = ("tx-delay", "--shots", "20")
PARITY = ("rfm-parity", "--shots", "2", "--snrs", "10", "--widths-ns", "40", "--model-windows", "100")


@pytest.mark.parametrize(
    "words",
    [NOISE, *(pytest.param(one, marks=pytest.mark.slow) for one in (ENERGY, TOF, TX, PARITY))],
    ids=lambda words: words[0],
)
def test_the_receiver_that_was_assumed_is_told(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Given a run, whose windows are analysed with no more known than the preset
    run(tmp_path, *words)
    windows = ("--windows", str(tmp_path / "run" / "data.nc"), "--out", str(tmp_path / "again"))
    capsys.readouterr()

    main([words[0], *windows])

    assert capsys.readouterr().out.count("receiver assumed: preset bela-grm\n") == 1
    assert "receiver assumed: preset bela-grm" in (tmp_path / "again" / "report.html").read_text("utf-8")


@pytest.mark.slow
def test_a_characterized_receiver_is_told_by_its_date(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = ("characterize", "--codes", "4", "--amplitudes-mvpp", "50", "--frequencies-mhz", "1,10,15,19,25")
    assert main([*known, "--bench", "simulated", "--quiet", "--out", str(tmp_path / "known")]) == 0
    began = json.loads((tmp_path / "known" / "summary.json").read_text())["started"]

    assert run(tmp_path, *NOISE, "--receiver", str(tmp_path / "known")) == 0

    assert f"receiver assumed: characterization begun {began}\n" in capsys.readouterr().out


@pytest.mark.slow
def test_pulses_near_the_noise_fail_no_receiver(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Given the known receiver, and pulses that its noise bends by more than chance
    assert run(tmp_path, *ENERGY, "--peaks-mv", "0.2") == 1

    assert "undecided: chi_square (" in capsys.readouterr().out
    assert {(limit, verdict) for limit, _, verdict in checks(tmp_path)} == {("chi_square", "undecided")}
    assert all(label.endswith(", pulse_below_noise") for _, label, _ in checks(tmp_path))


@given(chi_square=st.floats(0, 1e6), degrees_of_freedom=st.integers(1, 200))
def test_only_what_chance_does_not_make_is_a_disagreement(chi_square: float, degrees_of_freedom: int) -> None:
    found = disagreement("both", chi_square, degrees_of_freedom)

    assert overall(found) == ("none" if by_chance(chi_square, degrees_of_freedom) else "fail")
    # the limit that is shown has four digits
    assert all(chi_square > one.high * (1 - 1e-3) and math.isfinite(one.high) for one in found)
