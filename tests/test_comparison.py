"""Two runs side by side: what is tested, how many tests are paid for, and what both runs share."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.cli.main import main
from belahil.comparison import RunSide, compare, holm
from belahil.comparison_pairs import pairs
from belahil.config import as_toml, parse_bench
from belahil.errors import RefusedInput

Captured = pytest.CaptureFixture[str]


def measured(value: float, spread: float, unit: str = "V") -> dict[str, Any]:
    return {"value": value, "standard_uncertainty": spread, "unit": unit}


def side(results: dict[str, Any], **words: Any) -> RunSide:
    summary = {
        "procedure": "noise",
        "instruments": {"generator": "A,1,2,3"},
        "seed": None,
        "results": results,
    }
    budget, shares = words.pop("budget", ()), words.pop("shares", None)
    return RunSide("run", summary | words, budget, shares)


def folder(
    path: Path, results: dict[str, Any], budget: list[dict[str, Any]] | None = None, **words: Any
) -> str:
    """A finished run as `belahil compare` reads it."""
    path.mkdir()
    summary = {
        "procedure": "noise",
        "instruments": {"generator": "A,1,2,3"},
        "seed": None,
        "results": results,
    }
    (path / "summary.json").write_text(json.dumps(summary | words))
    (path / "report.json").write_text(json.dumps({"budget": budget or []}))
    bench = '[generator]\naddress = "GPIB::7"\nattenuation_db = 6\n[digitizer]\nlink = "serial:COM3"\n'
    (path / "bench.toml").write_text(as_toml(parse_bench(bench)))
    return str(path)


def test_a_difference_is_told_in_combined_standard_uncertainties() -> None:
    # given two numbers whose uncertainties combine to 5
    first = side({"noise": measured(10.0, 3.0)})
    second = side({"noise": measured(22.5, 4.0)})
    # when they are compared
    (one,) = compare(first, second).numbers
    # then z is the difference over 5, and p that of a normal law: 0.0124 is in any table of it
    assert one.difference is not None
    assert (one.difference.value, one.difference.standard_uncertainty) == (12.5, 5.0)
    assert one.z == 2.5
    assert one.p_value == pytest.approx(0.01242, abs=1e-5)
    assert one.verdict == "differs"


def test_many_numbers_are_paid_for() -> None:
    # given the same difference among nine that agree
    def results(shift: float) -> dict[str, Any]:
        return {f"n{place}": measured(shift if place == 4 else 0.0, math.sqrt(0.5)) for place in range(10)}

    # when z is 2.5, p is 0.0124 and ten tests make 0.124 of it; when z is 3, 0.0027 becomes 0.027
    assert compare(side(results(0.0)), side(results(2.5))).differing == ()
    found = compare(side(results(0.0)), side(results(3.0)))
    assert [one.name for one in found.differing] == ["n4"]
    # and at a level of one in a hundred that is not enough
    assert compare(side(results(0.0)), side(results(3.0)), level=0.01).differing == ()


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.floats(0.001, 0.5))
def test_holm_rejects_what_his_steps_reject(p_values: list[float], level: float) -> None:
    # given Holm's procedure word by word: go up from the smallest, stop at the first that is too large
    rejected: set[int] = set()
    order = sorted(range(len(p_values)), key=lambda place: p_values[place])
    for rank, place in enumerate(order):
        if (len(p_values) - rank) * p_values[place] > level:
            break
        rejected.add(place)
    # then the adjusted values say the same
    assert {place for place, one in enumerate(holm(p_values)) if one <= level} == rejected


def test_runs_of_one_receiver_are_called_different_as_often_as_the_level_says() -> None:
    # given pairs of runs with forty numbers each that differ by chance alone
    rng, wrong, trials = np.random.default_rng(5), 0, 400
    for _ in range(trials):
        first, second = rng.normal(size=(2, 40))
        one, other = (
            side({f"n{place}": measured(float(value), 1.0) for place, value in enumerate(values)})
            for values in (first, second)
        )
        wrong += bool(compare(one, other, level=0.2).differing)
    # then a fifth of the pairs has a difference: 0.181 is exact for independent numbers at Holm's first step,
    # and three standard deviations of a binomial are 0.058
    assert wrong / trials == pytest.approx(1 - (1 - 0.2 / 40) ** 40, abs=0.058)


def test_rows_are_matched_by_what_they_are_of() -> None:
    # given a list in another order, with a row that is missing and one that is new
    def rows(*codes: int) -> dict[str, Any]:
        return {
            "gain_codes": [
                {"code": code, "gain": measured(float(code), 1.0), "status": f"s{code}"} for code in codes
            ]
        }

    found = compare(side(rows(3, 4, 5)), side(rows(5, 4, 6)))
    # then each gain meets its own
    assert [(one.name, one.verdict, one.z) for one in found.numbers] == [
        ("gain_codes[code=3].gain", "only_first", None),
        ("gain_codes[code=4].gain", "agrees", 0.0),
        ("gain_codes[code=5].gain", "agrees", 0.0),
        ("gain_codes[code=6].gain", "only_second", None),
    ]
    assert found.words == ()


def test_rows_of_two_keys_and_rows_without_a_key() -> None:
    rows = [{"code": code, "amplitude_vpp": volts, "n": 1} for code in (1, 2) for volts in (0.1, 0.30000001)]
    names = [pair.name for pair in pairs({"a": rows}, {"a": rows})]
    assert "a[code=2,amplitude_vpp=0.3].n" in names
    same = [{"gain": measured(1.0, 1.0)}, {"gain": measured(2.0, 1.0)}]
    assert [pair.name for pair in pairs({"a": same}, {"a": same})] == ["a[0].gain", "a[1].gain"]


def test_what_one_run_has_not_measured_is_told_with_its_status() -> None:
    full = {"rows": [{"code": 1, "gain": measured(1.0, 0.1), "status": "ok"}], "clock": measured(0.0, 1.0)}
    less = {"rows": [{"code": 1, "gain": None, "status": "too_few_points"}], "clock": measured(0.0, 1.0)}
    found = compare(side(full), side(less))
    assert [(one.verdict, one.statuses) for one in found.numbers] == [
        ("only_first", ("ok", "too_few_points")),
        ("agrees", (None, None)),
    ]
    assert found.words == (("rows[code=1].status", "ok", "too_few_points"),)


def test_other_units_are_not_compared_and_words_are_told() -> None:
    found = compare(
        side({"a": measured(1.0, 0.1, "V"), "b": measured(1.0, 0.1), "best": 4, "float": 1.5}),
        side({"a": measured(1.0, 0.1, "Hz"), "b": measured(1.0, 0.1), "best": 5, "float": 2.5}),
    )
    assert [one.verdict for one in found.numbers] == ["other_unit", "agrees"]
    assert found.words == (("best", 4, 5),)


def test_a_number_without_uncertainty_differs_when_it_is_another() -> None:
    found = compare(side({"a": measured(1.0, 0.0)}), side({"a": measured(1.5, 0.0)}))
    assert (found.numbers[0].z, found.numbers[0].p_value, found.numbers[0].verdict) == (
        math.inf,
        0.0,
        "differs",
    )
    assert compare(side({"a": measured(1.0, 0.0)}), side({"a": measured(1.0, 0.0)})).differing == ()


SOURCE = "[generator] uncertainty.attenuation_db"


def budgeted(gain: float, scatter: float, pad: float, **words: Any) -> RunSide:
    lines = [
        {"quantity": "gain, code 4", "source": source, "value": value, "unit": "1"}
        for source, value in (("scatter of the points", scatter), (SOURCE, pad))
    ]
    number = measured(gain, math.hypot(scatter, pad), "1")
    return side({"gain": number, "other": measured(0.0, 1.0)}, budget=lines, **words)


def test_a_shared_error_does_not_make_two_runs_agree() -> None:
    # given two gains known to 1 % because of the pad, to 0.001 by their scatter, 0.006 apart
    mine, its = {SOURCE: "pad 6 dB"}, {SOURCE: "pad 7 dB"}
    first = budgeted(5.0, 0.001, 0.05, shares=mine)
    # when the pad is the same, then its error is in both, and only its difference counts
    same = compare(first, budgeted(5.006, 0.001, 0.0501, shares=mine))
    assert same.numbers[0].difference is not None
    expected = math.sqrt(2 * 0.001**2 + 0.0001**2)
    assert same.numbers[0].difference.standard_uncertainty == pytest.approx(expected, rel=1e-9)
    assert same.numbers[0].common == (SOURCE,)
    assert same.numbers[0].verdict == "differs"
    # and when it is another one, or nobody knows, both errors count in full
    for shares in (its, {}, None):
        other = compare(first, budgeted(5.006, 0.001, 0.0501, shares=shares)).numbers[0]
        assert other.difference is not None
        assert other.difference.standard_uncertainty == pytest.approx(math.hypot(0.001, 0.001, 0.05, 0.0501))
        assert (other.common, other.verdict) == ((), "agrees")


def test_a_budget_that_does_not_make_up_the_uncertainty_is_not_used() -> None:
    first, second = (budgeted(5.0, 0.001, 0.05, shares={SOURCE: 1}) for _ in range(2))
    second.summary["results"]["gain"] = measured(5.0, 0.06, "1")
    assert compare(first, second).numbers[0].common == ()


def test_what_to_keep_in_mind_is_told() -> None:
    results = {"a": measured(1.0, 0.1)}
    notes = compare(
        side(results, seed=3),
        side(results, seed=3, procedure="characterize", instruments={"generator": "B,1,2,3"}),
    ).notes
    assert len(notes) == 3
    assert notes[0] == "the procedures differ: noise and characterize"
    assert "both runs have seed 3" in notes[1]
    assert notes[2] == "the generators differ: A,1,2,3 and B,1,2,3"
    assert compare(side(results), side(results)).notes == ()


@pytest.mark.parametrize("level", [0.0, 1.0, math.nan])
def test_a_level_is_a_probability(level: float) -> None:
    with pytest.raises(RefusedInput, match="must be above 0 and below 1"):
        compare(side({"a": measured(1.0, 0.1)}), side({"a": measured(1.0, 0.1)}), level)


# ---- the command


def test_the_command_says_what_differs_and_ends_with_1(tmp_path: Path, capsys: Captured) -> None:
    rows = [{"code": code, "gain": measured(5.0, 0.01, "1"), "status": "ok"} for code in range(4)]
    first = folder(tmp_path / "a", {"gain_codes": rows, "best_code": 1})
    moved = [row | {"gain": measured(5.1, 0.01, "1")} if row["code"] == 1 else row for row in rows[:2]]
    second = folder(tmp_path / "b", {"gain_codes": moved, "best_code": 2})
    # when they are compared, then the status is 1
    assert main(["compare", first, second]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"1: {first} (noise)"
    assert any(
        line.split() == ["gain_codes[code=0].gain", "5.000(10)", "5.000(10)", "0.000(14)", "+0.00", "agrees"]
        for line in lines
    )
    assert any("gain_codes[code=1].gain" in line and "+7.07  differs" in line for line in lines)
    assert any(line.startswith("gain_codes[code=2] to [code=3]") and "2 numbers" in line for line in lines)
    assert "best_code: 1 and 2 (no uncertainty, not tested)" in lines
    assert "2 numbers could not be compared" in lines
    assert lines[-1] == "1 of 2 numbers differs at level 0.05 (corrected after Holm)"
    # and when only what differs is asked for, what agrees is left out
    assert main(["compare", first, second, "--differing"]) == 1
    assert "code=0" not in capsys.readouterr().out
    # and a run agrees with itself
    assert main(["compare", first, first]) == 0
    assert capsys.readouterr().out.endswith(
        "none of 4 numbers differs at level 0.05 (corrected after Holm)\n"
    )


def test_the_command_gives_json(tmp_path: Path, capsys: Captured) -> None:
    first = folder(tmp_path / "a", {"a": measured(1.0, 0.0), "b": measured(2.0, 0.1), "c": None})
    second = folder(tmp_path / "b", {"a": measured(1.5, 0.0), "b": None, "c": 3})
    assert main(["compare", first, second, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["tested"], told["differing"], told["correction"]) == (1, ["a"], "Holm")
    assert told["numbers"][0]["difference"] == measured(0.5, 0.0)
    assert told["numbers"][0]["z"] is None  # no uncertainty: JSON has no infinity
    assert told["numbers"][1]["verdict"] == "only_first"
    assert told["words"] == [{"name": "c", "first": None, "second": 3}]


def test_the_command_takes_the_pad_of_one_bench_for_one(tmp_path: Path, capsys: Captured) -> None:
    def run(name: str, gain: float, **words: Any) -> str:
        made = budgeted(gain, 0.001, 0.05)
        return folder(tmp_path / name, made.summary["results"], list(made.budget), **words)

    first, second = run("a", 5.0), run("b", 5.006)
    # given one generator behind one pad, then a difference beyond the scatter is seen
    assert main(["compare", first, second]) == 1
    assert f"taken for one error of both runs: {SOURCE}" in capsys.readouterr().out
    # and not when the user says that nothing is shared, or when another generator answered
    assert main(["compare", first, second, "--independent"]) == 0
    other = run("c", 5.006, instruments={"generator": "A,1,9,3"})
    assert main(["compare", first, other]) == 0
    # and a bench file of another version does not hinder
    (Path(second) / "bench.toml").write_text("[other]\nkey = 1\n")
    assert main(["compare", first, second]) == 0


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "there is no finished run"),
        ({"summary.json": "[]"}, "is no summary of a run"),
        ({"summary.json": '{"procedure": "noise", "results": {"x": 1}}'}, "no measured number in common"),
    ],
)
def test_what_is_no_run_is_refused(
    tmp_path: Path, capsys: Captured, files: dict[str, str], said: str
) -> None:
    first = folder(tmp_path / "a", {"a": measured(1.0, 0.1)})
    (tmp_path / "b").mkdir()
    for name, text in files.items():
        (tmp_path / "b" / name).write_text(text)
    assert main(["compare", first, str(tmp_path / "b")]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
