"""The report: one page that stands alone, says where its data are from, and recomputes nothing."""

from __future__ import annotations

import html
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from small_run import begin, measure, outcome

from belahil.config import BenchConfig, LimitsTable
from belahil.errors import RefusedInput, StorageError
from belahil.outcome import BudgetLine
from belahil.report import remake
from belahil.report.tables import grids, one_text

VOID = {"meta", "link", "img", "br", "hr", "input", "path", "use", "rect", "line", "stop"}


class Reader(HTMLParser):
    """Collects what a browser would load, the visible text, and whether every element is closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.ids: list[str] = []
        self.feed(page.replace("<wbr>", ""))  # which a reader does not see
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        words = dict(attrs)
        self.loads += [f"{tag} {words[key]}" for key in ("src", "href", "xlink:href") if words.get(key)]
        self.ids += [words["id"] or ""] if "id" in words else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("style", "script"):
            self.text.append(data)


def page_of(folder: Path, config: BenchConfig | None = None, source: str = "emulated") -> str:
    with begin(folder, config, source=source) as run:
        measure(run, 3)
        run.finish(outcome(), {"windows": "3"}, ["converter: no nonlinearity."])
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return page_of(tmp_path_factory.mktemp("report") / "run")


def test_the_page_needs_nothing_but_itself(page: str) -> None:
    reader = Reader(page)
    assert [load for load in reader.loads if not load.split()[1].startswith("#")] == []
    assert not re.search(r"url\((?!#)", page)
    assert "@import" not in page
    assert "<script" not in page
    assert reader.open == []


def test_the_page_tells_all_that_a_reader_asks(page: str) -> None:
    text = " ".join(" ".join(Reader(page).text).split())
    for part in (
        "no verdict",
        "best code 0",
        "gain cutoff (MHz) order free order integer",
        "5.193(12)",
        "19.0123(35)",
        "3.010(20)",
        "no_usable_point",
        "quantity [generator] uncertainty.amplitude_relative noise",
        "gain, code 0 0.0121 (97.0 %) 0.0021 (3.0 %)",
        "Room temperature was not recorded.",
        "converter: no nonlinearity.",
        "generator Agilent Technologies,33522B,EMULATED,0",
        "seed 7",
        "windows 3",
        "numpy",
        "Noise < 1 mV & more",
        "belahil noise --bench bench.toml",
        "[digitizer] driver",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("source", "label"),
    [("emulated", "EMULATED DATA"), ("simulated", "SIMULATED DATA"), ("hardware", None)],
)
def test_data_that_no_hardware_gave_say_so_on_page_and_figures(
    tmp_path: Path, source: str, label: str | None
) -> None:
    page = page_of(tmp_path / "run", source=source)
    assert re.findall(r"(\w+ DATA)", page.split("<svg")[0]) == ([label] * 3 if label else [])
    # The label is drawn as outlines; matplotlib keeps the words in a comment beside each of the two.
    drawing = (tmp_path / "run" / "figure-noise.svg").read_text()
    assert re.findall(r"<!-- (\w+ DATA) -->", drawing) == ([label] * 2 if label else [])


def test_figures_are_in_the_page_and_beside_it(tmp_path: Path) -> None:
    page = page_of(tmp_path / "run")
    drawing = (tmp_path / "run" / "figure-noise.svg").read_text()
    assert drawing[drawing.index("<svg") :].strip() in page
    assert (tmp_path / "run" / "figure-noise.png").read_bytes().startswith(b"\x89PNG")


def test_equal_figures_give_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        page_of(tmp_path / name)
    for file in ("figure-noise.svg", "figure-noise.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_verdict_is_shown_with_its_checks(tmp_path: Path) -> None:
    page = page_of(tmp_path / "run", BenchConfig(limits=LimitsTable(gain=(5.5, 6.0))))
    text = " ".join(" ".join(Reader(page).text).split())
    assert "Verdict fail limit of measured allowed decision gain code 0 5.193(12) 5.5 to 6 fail" in text
    assert "code 1 \N{EN DASH} 5.5 to 6 undecided" in text


def test_what_instruments_say_of_themselves_is_no_markup(tmp_path: Path) -> None:
    with begin(tmp_path / "run", instruments={"generator": "<script>alert(1)</script>"}) as run:
        run.finish(outcome(notes=["<b>bold</b>"]))
    page = (tmp_path / "run" / "report.html").read_text()
    assert "<script" not in page
    assert "<b>" not in page
    assert "&lt;script&gt;alert(1)" in page


def test_a_page_is_made_again_from_the_files_alone(tmp_path: Path) -> None:
    page = page_of(tmp_path / "run")
    for name in ("report.html", "data.nc"):
        (tmp_path / "run" / name).unlink()
    assert remake(tmp_path / "run") == tmp_path / "run" / "report.html"
    assert (tmp_path / "run" / "report.html").read_text(encoding="utf-8") == page


def test_without_a_finished_run_there_is_no_report(tmp_path: Path) -> None:
    with pytest.raises(RefusedInput, match="is it a run folder"):
        remake(tmp_path)
    begin(tmp_path / "run").close()
    with pytest.raises(RefusedInput, match="continue it with --resume"):
        remake(tmp_path / "run")


@pytest.mark.parametrize("name", ["summary.json", "report.json", "figure-noise.svg", "bench.toml"])
def test_a_missing_or_broken_file_is_told(tmp_path: Path, name: str) -> None:
    page_of(tmp_path / "run")
    path = tmp_path / "run" / name
    for content in (b"{\xff", b"{"):
        if name != "bench.toml" or content != b"{":  # which is shown as it is
            path.write_bytes(content)
            with pytest.raises(StorageError, match=re.escape(name)):
                remake(tmp_path / "run")
    if name != "summary.json":
        path.unlink()
        with pytest.raises(StorageError, match=re.escape(name)):
            remake(tmp_path / "run")


def budget_of(folder: Path, lines: list[BudgetLine]) -> str:
    with begin(folder) as run:
        run.finish(outcome(budget=lines))
    page = html.unescape((folder / "report.html").read_text())
    (budget,) = re.findall(r"<h2>Uncertainty budget</h2>(.*?)<h2>", page, re.S)
    return str(budget)


def test_the_budget_is_one_table_whatever_the_number_of_quantities(tmp_path: Path) -> None:
    lines = [BudgetLine(f"gain, code {code}", "noise", 2e-3, "1", 1.0) for code in range(32)]
    lines.append(BudgetLine("cut-off, code 0", "flatness", 1.5e3, "Hz", 1.0))
    lines.append(BudgetLine("cut-off, code 0", "amplitude", 6e-11, "Hz", 1.6e-27))
    lines += [BudgetLine("noise, code 0", source, 1e-4, "V", 0.5) for source in ("noise", "flatness")]
    budget = budget_of(tmp_path / "run", lines)
    assert (budget.count("<table>"), budget.count("<tr>"), budget.count("<details")) == (1, 1 + 34, 0)
    assert "<td>cut-off, code 0</td><td>\N{EN DASH}</td><td>1.5 kHz (100.0 %)</td><td>0</td>" in budget


@pytest.mark.parametrize(
    ("sources", "words"),
    [
        (["scatter"] * 32, "Each of the 32 uncertainties has one source alone: scatter."),
        (
            ["scatter", "[generator] uncertainty.attenuation_db", "scatter"],
            "Each of the 3 uncertainties has one source alone: scatter (2), "
            "[generator] uncertainty.attenuation_db (1).",
        ),
        (["scatter"], "The uncertainty of gain, code 0 has one source alone: scatter."),
    ],
)
def test_a_budget_of_single_sources_is_a_sentence(tmp_path: Path, sources: list[str], words: str) -> None:
    # Given results that have one source each, beside one that moves them by rounding alone
    lines = [BudgetLine(f"gain, code {code}", source, 2e-3, "1", 1.0) for code, source in enumerate(sources)]
    lines.append(BudgetLine("gain, code 0", "amplitude", 6e-17, "1", 1e-27))
    # Then no row repeats that it is all of it
    budget = budget_of(tmp_path / "run", lines)
    assert re.sub(r"<[^>]*>", "", budget).strip() == words
    assert "<table>" not in budget


def test_only_wide_tables_are_dense_and_break_their_words(tmp_path: Path) -> None:
    rows = {
        name: [{f"column {n}": "a_<b>" for n in range(count)}] for name, count in (("wide", 6), ("slim", 5))
    }
    with begin(tmp_path / "run") as run:
        run.finish(outcome(results=rows, budget=(), figures={}))
    page = (tmp_path / "run/report.html").read_text()
    assert re.findall(r'<div class="(wide[ a-z]*)">', page) == ["wide dense", "wide"]
    assert (page.count("<td>a_<wbr>&lt;b&gt;</td>"), page.count("<td>a_&lt;b&gt;</td>")) == (6, 5)


def test_plain_numbers_have_the_prefix_of_their_size() -> None:
    first, second = grids(
        {
            "echo": {"energy_j": 2.5e-16, "photons": 1300.0, "count_s": 3, "drift_ppm": 2e-4},
            "cases": [{"noise_v": 0.0, "at_s": 2.1e-8}, {"noise_v": 8.3e-4, "at_s": None}],
        }
    )

    assert first.rows == (
        ("echo energy", "0.25 fJ"),
        ("echo photons", "1300"),
        ("echo count (s)", "3"),
        ("echo drift (ppm)", "0.0002"),
    )
    assert second.columns == ("noise (µV)", "at (ns)")
    assert second.rows == (("0", "21"), ("830", "\N{EN DASH}"))


def test_a_column_with_a_whole_number_keeps_the_unit_of_its_key() -> None:
    (only,) = grids({"whole": [{"width_s": 0.5}, {"width_s": 3}, {"width_s": 2e-9}]})

    assert (only.columns, only.rows) == (("width (s)",), (("0.5",), ("3",), ("2e-09",)))


def test_an_interval_is_one_cell_in_the_unit_of_what_it_is_of() -> None:
    # Given an interval of a number, one of a list, one with a unit of its own, and a null
    delay = {"value": 19.29e-9, "standard_uncertainty": 0.12e-9, "unit": "s"}
    rows = [
        {
            "delay": delay,
            "delay_interval": {"low": 19.065e-9, "high": 19.529e-9, "coverage": 0.95},
            "late": {"measured": delay, "interval": [-0.4e-9, 21e-9], "ratio": [0.9, 1.2], "ratio_unit": "1"},
        },
        {"delay": None, "delay_interval": None, "late": None},
    ]

    several, one = grids({"rows": rows})[0], grids({"row": rows[0]})[0]

    assert several.columns == (
        "delay (ns)",
        "delay interval at 95 % (ns)",
        "late measured (ns)",
        "late interval (ns)",
        "late ratio",
    )
    assert several.rows[0] == ("19.29(12)", "19.065 to 19.529", "19.29(12)", "-0.4 to 21.0", "0.900 to 1.200")
    assert several.rows[1] == ("\N{EN DASH}",) * 5
    assert dict(one.rows)["row delay interval at 95 %"] == "19.065 to 19.529 ns"


@pytest.mark.parametrize(
    "row",
    [{"interval": [1.0, 2.0]}, {"a": 1.0, "a_interval": [1.0, 2.0]}, {"low": 1.0, "high": 2.0}],
)
def test_numbers_without_a_unit_are_no_interval(row: dict[str, Any]) -> None:
    assert not any(" to " in cell for cell in grids({"rows": [row]})[0].rows[0])


def test_objects_within_a_row_are_a_table_of_their_own() -> None:
    # Given rows of which one holds two objects, one none and one not even the key
    lines = [{"frequency": {"value": 1e6, "standard_uncertainty": 1e4, "unit": "Hz"}}, {"frequency": None}]
    rows = [{"code": 3, "off": {"lines": lines}}, {"code": 4, "off": {"lines": []}}, {"code": 5}]

    # When they are laid out
    first, second = grids({"gain_codes": rows})

    # Then the objects are rows beside the code that they belong to, and no cell holds a bracket
    assert (first.columns, first.rows) == (("code",), (("3",), ("4",), ("5",)))
    assert second.title == "gain codes, off lines"
    assert second.columns == ("code", "frequency (MHz)")
    assert second.rows == (("3", "1.000(10)"), ("3", "\N{EN DASH}"))


def test_objects_at_any_depth_are_tables_and_never_brackets() -> None:
    # Given a list within an object, with rows that hold rows, which hold rows
    def rms(value: float) -> dict[str, Any]:
        return {"value": value, "standard_uncertainty": 0.1 * value, "unit": "m"}

    deep = [{"name": "sloped", "deviations": [{"baseline_m": 1.5, "rms": rms(2.0), "by": [{"part": "a"}]}]}]
    results = {
        "analog": {"areas": deep, "known": 0.5},
        "mixed": [{"a_s": 2e-9}, 3, None],
        "list": [rms(1.0), rms(2e-3)],
    }

    # When they are laid out
    rest, areas, deviations, parts = grids(results)

    # Then each list is a table whose first columns tell whose rows these are, and nothing is Python
    assert rest.rows == (
        ("analog known", "0.5"),
        ("mixed", "a 2 ns, 3, \N{EN DASH}"),
        ("list", "1.00(10) m, 2.00(20) mm"),
    )
    assert (areas.title, areas.columns, areas.rows) == ("analog areas", ("name",), (("sloped",),))
    assert deviations.title == "analog areas, deviations"
    assert deviations.columns == ("name", "baseline (m)", "rms (m)")
    assert deviations.rows == (("sloped", "1.5", "2.00(20)"),)
    assert parts.title == "analog areas, deviations, by"
    assert (parts.columns, parts.rows) == (("name", "baseline (m)", "part"), (("sloped", "1.5", "a"),))


def test_numbers_of_one_column_with_units_that_differ_have_each_their_own() -> None:
    # Given a range error, in metres, beside a probability
    ours = [
        {"value": value, "standard_uncertainty": 0.01, "unit": unit} for value, unit in ((2, "m"), (0.2, "1"))
    ]

    (only,) = grids({"statements": [{"ours": one} for one in ours]})

    assert (only.columns, only.rows) == (("ours",), (("2.000(10) m",), ("0.200(10)",)))


def test_a_length_is_never_in_megametres() -> None:
    (only,) = grids({"cells": [{"altitude_m": 1.4e6}, {"altitude_m": 1.1e6}]})
    assert (only.columns, only.rows) == (("altitude (km)",), (("1400",), ("1100",)))


def test_an_object_that_is_null_in_a_row_has_no_column_beside_those_of_its_parts() -> None:
    (only,) = grids({"rows": [{"late": None, "high": None}, {"late": {"rms": 2}, "high": None}]})
    assert (only.columns, only.rows) == (
        ("high", "late rms"),
        (("\N{EN DASH}", "\N{EN DASH}"), ("\N{EN DASH}", "2")),
    )


@pytest.mark.parametrize("value", [0.0, -1e-15, 3e-12])
def test_a_number_within_its_uncertainty_has_the_prefix_of_the_uncertainty(value: float) -> None:
    told = {"value": value, "standard_uncertainty": 65e-12, "unit": "s"}
    (only,) = grids({"rows": [{"late": told}, {"late": told | {"value": 1e-9}}, {"late": told}]})
    assert one_text(told) == f"{round(1e12 * value) + 0.0:.0f}(65) ps"
    assert only.columns == ("late (ps)",)
    assert only.rows[1] == ("1000(65)",)


def test_the_page_begins_with_what_the_terminal_tells(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as run:
        run.finish(outcome(said=["threshold: 17 % & more"]))
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "<h2>In short</h2>" in page
    assert page.index("<li>threshold: 17 % &amp; more</li>") < page.index("<h2>Results</h2>")


def test_results_of_any_shape_are_laid_out() -> None:
    results = json.loads(
        '{"clock_ppm": {"value": 12.3456, "standard_uncertainty": 0.123, "unit": "1e-6"}, "empty": [],'
        ' "interleave": {"gain": null,'
        ' "skew_s": {"value": 4.2e-11, "standard_uncertainty": 1e-12, "unit": "s"}}'
        ', "flags": [1, 2.5], "rows": [{"a": 1}, {"b_vpp": 2.5, "a": null}]}'
    )
    first, second = grids(results)
    assert first.rows == (
        ("clock", "12.35(12) ppm"),
        ("empty", "\N{EN DASH}"),
        ("interleave gain", "\N{EN DASH}"),
        ("interleave skew", "42.0(1.0) ps"),
        ("flags", "1, 2.5"),
    )
    assert (second.columns, second.rows) == (("a", "b (Vpp)"), (("1", "\N{EN DASH}"), ("\N{EN DASH}", "2.5")))
    assert one_text(None) == "\N{EN DASH}"
