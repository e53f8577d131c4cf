"""The conformance suite on every driver, emulated device and transport."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from belahil.bench import Bench, open_bench
from belahil.cli.main import main
from belahil.config import BenchConfig
from belahil.conformance import DIGITIZER_RULES, GENERATOR_RULES, ConformanceReport, check_bench
from belahil.conformance.digitizer import CLOSING_RULES as CLOSING_DIGITIZER
from belahil.conformance.generator import CLOSING_RULES as CLOSING_GENERATOR
from belahil.errors import LinkClosed
from belahil.generators import FAMILIES
from belahil.oscilloscopes import SCOPES
from belahil.receiver import RECEIVERS
from sim.instruments import SimulatedGenerator
from tests import conformance_benches as benches
from tests.conformance_benches import placed, text

NEVER = {"refuses_foreign_words", "takes_every_gain_code"}
"""What does not apply where a spec has every trigger and product, or no gain codes."""


def every(rooms: dict[str, tuple[str, ...]]) -> list[tuple[str, str]]:
    return [(name, transport) for name, transports in rooms.items() for transport in transports]


def conforms(bench: Bench) -> tuple[ConformanceReport, ConformanceReport]:
    """Try both instruments of a bench; every rule holds, and only what cannot apply does not."""
    reports = check_bench(bench)
    for report in reports:
        report.require()
        assert {one.rule for one in report.results if one.status == "not_applicable"} <= NEVER
    return reports


def test_no_procedure_reaches_round_the_interlock() -> None:
    # given that a bench hands out its drivers, to those who try drivers
    modules = (Path(__file__).parent.parent / "procedures").rglob("*.py")
    # then no procedure takes them
    taken = re.compile(r"\bbench\.(generator|digitizer)\b")
    assert [path.name for path in modules if taken.search(path.read_text(encoding="utf-8"))] == []


def test_no_driver_is_forgotten() -> None:
    # then the matrix has every family of generators, every oscilloscope and every receiver
    assert set(benches.GENERATORS) == set(FAMILIES)
    assert set(benches.SCOPES) == set(SCOPES)
    assert set(benches.RECEIVERS) == set(RECEIVERS)


@pytest.mark.parametrize(
    ("bench", "link"),
    [
        (text(), "serial"),
        (text("siglent-sdg"), "usb"),
        (text(digitizer="siglent-sds", receiver="analog"), "visa"),
    ],
    ids=["grm", "siglent", "oscilloscope"],
)
def test_a_recorded_check_is_replayed_equal(tmp_path: Path, bench: str, link: str) -> None:
    # given an emulated bench whose check is recorded
    with open_bench(placed(bench, "emulated", f"emulated:{link}"), record=tmp_path / "links") as opened:
        first = conforms(opened)
    # when the recording answers the real drivers
    with open_bench(f"replay:{tmp_path / 'links'}") as opened:
        again = conforms(opened)
    # then every rule holds again, and the same was seen
    assert again == first


@pytest.mark.slow
@pytest.mark.parametrize(("family", "transport"), every(benches.GENERATORS))
def test_generators(family: str, transport: str) -> None:
    with benches.with_generator(family, transport) as bench:
        conforms(bench)


@pytest.mark.slow
@pytest.mark.parametrize(("driver", "transport"), every(benches.SCOPES))
def test_oscilloscopes(driver: str, transport: str) -> None:
    with benches.with_scope(driver, transport) as bench:
        conforms(bench)


@pytest.mark.slow
@pytest.mark.parametrize(("receiver", "transport"), every(benches.RECEIVERS))
def test_receivers_on_the_grm_link(receiver: str, transport: str) -> None:
    with benches.with_receiver(receiver, transport) as bench:
        conforms(bench)


WHOLE = [
    *(text(family) for family in FAMILIES),
    *(text(receiver=receiver) for receiver in RECEIVERS),
    *(text(digitizer=driver, receiver="analog") for driver in SCOPES),
]


@pytest.mark.slow
@pytest.mark.parametrize("bench", WHOLE)
def test_simulated_instruments(bench: str) -> None:
    with open_bench(placed(bench, "simulated", "simulated")) as opened:
        conforms(opened)


@pytest.mark.slow
@pytest.mark.parametrize("bench", WHOLE)
def test_recordings(tmp_path: Path, bench: str) -> None:
    link = "emulated:serial" if '"grm"' in bench else "emulated:visa"
    test_a_recorded_check_is_replayed_equal(tmp_path, bench, link.removeprefix("emulated:"))


@pytest.mark.slow
@pytest.mark.parametrize("served", ["address", "hislip_address", "pty_address"])
def test_a_recording_over_a_network_is_replayed_equal(tmp_path: Path, served: str) -> None:
    # given a check whose time-outs were those of this computer's clock
    with benches.far(text(), served, record=tmp_path / "links") as bench:
        first = conforms(bench)
    # then the replay sees the same, at the same times
    with open_bench(f"replay:{tmp_path / 'links'}") as bench:
        assert conforms(bench) == first


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        '[bench]\ntrigger = "digitizer"\ntrigger_delay_s = 3e-7\n',
        "[bench]\ntrigger_delay_s = 2.5e-6\nsettle_s = 0.01\n",
        "load_ohm = inf\nattenuation_db = 20.0\n",
        "load_ohm = 75.0\nmax_vpp = 0.1\n",
    ],
    ids=["digitizer triggers", "late trigger", "high impedance", "small"],
)
@pytest.mark.parametrize("family", FAMILIES)
def test_other_benches(family: str, more: str) -> None:
    bench = text(family)
    bench = more + bench if more.startswith("[bench]") else bench.replace("[digitizer]", more + "[digitizer]")
    with open_bench(placed(bench, "emulated", "emulated:serial")) as opened:
        conforms(opened)


@pytest.mark.hardware
def test_the_bench_of_the_laboratory(bench: Bench, bench_config: BenchConfig) -> None:
    # given real instruments, named by --bench FILE
    assert bench.source == "hardware"
    # then both keep what their protocols promise
    for report in check_bench(bench):
        report.require()


# ---- the command, and its page

Captured = pytest.CaptureFixture[str]
PAGE = (Path(__file__).parent.parent / "docs" / "conformance.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """Return the rows of the table below a heading of the page."""
    lines = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0].splitlines()
    table = [line.split("|")[1:-1] for line in lines if line.startswith("|")]
    return [[cell.strip(" `") for cell in row] for row in table[2:]]


def test_the_command_says_what_is_played_and_what_was_seen(tmp_path: Path, capsys: Captured) -> None:
    # when a bench is tried
    out = tmp_path / "report.json"
    assert main(["bench", "conform", "simulated", "--out", str(out)]) == 0
    told = capsys.readouterr().out
    # then what is played comes first, every rule has its line, and the file says the same
    assert told.index("a sine of 1 MHz and 250 mVpp") < told.index("generator: Agilent")
    written = json.loads(out.read_text(encoding="utf-8"))
    assert (written["schema"], written["source"]) == (1, "simulated")
    for report, rules in zip(written["reports"], (23, 24), strict=True):
        assert report["holds"]
        assert len(report["results"]) == rules
        for one in report["results"]:
            assert f"  {one['rule']} " in told
            assert one["seen"] in told


def test_a_rule_that_fails_is_status_1(monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    monkeypatch.setattr(SimulatedGenerator, "trigger", lambda self: None)
    assert main(["bench", "conform", "simulated"]) == 1
    told = capsys.readouterr().out
    assert "promised: a trigger that nothing waits for is refused" in told
    assert "20 of 23 rules hold, 3 fail, 0 do not apply" in told


def test_a_link_that_is_lost_is_status_3(monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    def gone(self: SimulatedGenerator, stimulus: object, trigger: str) -> None:
        raise LinkClosed("nobody is there")

    monkeypatch.setattr(SimulatedGenerator, "prepare", gone)
    assert main(["bench", "conform", "simulated"]) == 3
    assert "LinkClosed: nobody is there" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["--record", "links"], ["--out", "no/such/report.json"], ["--seed", "-1"]])
def test_what_cannot_be_is_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "conform", "simulated", *words]) == 2
    assert not list(tmp_path.iterdir())


def test_the_page_names_every_rule_and_everything_that_was_tried() -> None:
    for heading, rules in (
        ("What a generator promises", (*GENERATOR_RULES, *CLOSING_GENERATOR)),
        ("What a digitizer promises", (*DIGITIZER_RULES, *CLOSING_DIGITIZER)),
    ):
        assert rows(heading) == [[one.name, one.promise] for one in rules]
    told = {name: tuple(transports.split(", ")) for _, name, transports in rows("What was tried")}
    assert told == benches.GENERATORS | benches.SCOPES | benches.RECEIVERS


def test_the_example_of_the_page_runs(monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    # given a laboratory with a driver of its own
    laboratory = ModuleType("my_lab")
    laboratory.MyGenerator = lambda address: open_bench("simulated").generator  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "my_lab", laboratory)
    example = PAGE.split("```python\n")[1].split("```")[0]
    # when it tries it as the page says, then every rule has its line
    exec(compile(example, "conformance.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) == 23
