"""How often things are done: what makes a campaign quick, counted, since seconds belong to a machine."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_run
from msgspec.structs import replace

from belahil import generators, journal
from belahil.bench import open_bench
from belahil.config import BenchConfig, load_bench
from belahil.grm_link import MAX_PACKET_BYTES
from belahil.journal import Journal
from belahil.run import Run
from belahil.stimuli import NoSignal
from belahil.values import PRODUCTS, WindowRequest
from drivers.serial_link import SerialLink
from drivers.usb_link import UsbLink
from drivers.visa_link import VisaLink
from procedures import characterize
from procedures.characterize import GainOptions, GainPlan
from sim.plant import Plant
from sim.rfm import RangeFinder
from sim.transmitter import Transmitter

ROOT = Path(__file__).resolve().parent.parent
AMPLITUDES_VPP, FREQUENCIES_HZ = (13e-3, 30e-3), (1e6, 5e6, 12e6)


@dataclass(frozen=True)
class Campaign:
    plan: GainPlan
    run: Run


def usb(config: BenchConfig) -> BenchConfig:
    return replace(config, digitizer=replace(config.digitizer, link="emulated:usb"))


Campaigner = Callable[..., Campaign]
Counting = Callable[..., Counter[Any]]


@pytest.fixture
def campaign(tmp_path: Path) -> Iterator[Campaigner]:
    """Measure a small campaign: dark windows, then every code at every amplitude and frequency."""
    with ExitStack() as stack:

        def measured(
            codes: tuple[int, ...],
            config: BenchConfig | None = None,
            frequencies_hz: tuple[float, ...] = FREQUENCIES_HZ,
        ) -> Campaign:
            folder = tmp_path / f"run-{len(list(tmp_path.iterdir()))}"
            options = GainOptions(codes, AMPLITUDES_VPP, frequencies_hz, dark_windows=1)
            with open_bench(config or load_bench("emulated")) as bench:
                plan = characterize.plan(bench, options)
                run = Run.create(folder, "characterize", bench.config, {}, 1, plan=plan.as_json())
                stack.enter_context(run)
                characterize.measure(bench, run, plan)
            return Campaign(plan, run)

        yield measured


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counting:
    """Count the calls of a function by what `of` makes of their arguments."""

    def count(owner: Any, name: str, of: Callable[..., Any] = lambda *given: "calls") -> Counter[Any]:
        counts: Counter[Any] = Counter()
        real = getattr(owner, name)

        def called(*given: Any, **named: Any) -> Any:
            counts[of(*given)] += 1
            return real(*given, **named)

        monkeypatch.setattr(owner, name, called)
        return counts

    return count


def test_the_generator_hears_of_each_stimulus_once_whatever_the_number_of_gain_codes(
    campaign: Campaigner, counted: Counting
) -> None:
    # Given campaigns of two and of eight gain codes with the same stimuli, and one with a frequency more
    sent = counted(VisaLink, "write", lambda link, data: data)
    messages, windows = [], []
    for codes, frequencies_hz in (
        ((0, 1), (1e6, 5e6)),
        (tuple(range(8)), (1e6, 5e6)),
        ((0, 1), (1e6, 5e6, 12e6)),
    ):
        windows.append(len(campaign(codes, frequencies_hz=frequencies_hz).plan.shots))
        messages.append(sent.total())
        sent.clear()
    # Then each window costs the generator one short question, whatever is played
    two, eight, longer = (sent - taken for sent, taken in zip(messages, windows, strict=True))
    # And gain codes cost it nothing more
    assert eight == two
    # And a sine costs one message to set it and one to read it back
    assert longer - two == 2 * len(AMPLITUDES_VPP)


def test_a_window_costs_its_counts_on_the_link_and_little_else(
    campaign: Campaigner, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Given both links, which count their bytes
    octets: Counter[str] = Counter()

    def counting(link: type, name: str) -> None:
        write, read = link.write, link.read  # type: ignore[attr-defined]

        def written(self: Any, data: bytes) -> None:
            octets[name] += len(data)
            write(self, data)

        def taken(self: Any, count: int, timeout_s: float) -> bytes:
            data: bytes = read(self, count, timeout_s)
            octets[name] += len(data)
            return data

        monkeypatch.setattr(link, "write", written)
        monkeypatch.setattr(link, "read", taken)

    counting(SerialLink, "serial")
    counting(UsbLink, "usb")
    # When the same campaign runs over each
    serial = campaign((3, 4))
    campaign((3, 4), usb(load_bench("emulated")))
    windows = len(serial.plan.shots)
    # Then a window is two octets a sample and at most 60 a packet, those that open the link included
    packets = 2 + -(-2 * serial.plan.sample_count // MAX_PACKET_BYTES)
    raw = octets["usb"] / windows
    assert 2 * serial.plan.sample_count < raw < 2 * serial.plan.sample_count + 60 * (packets + 1)
    # And stuffing adds one octet in 254 and three a packet, at most
    assert raw < octets["serial"] / windows < raw * (1 + 1 / 254) + 3 * (packets + 1)


def test_each_shot_waits_for_the_disk_once(campaign: Campaigner, counted: Counting) -> None:
    waited = counted(journal, "_sync")
    made = campaign((4, 5))
    assert waited["calls"] == len(made.plan.shots)


def test_each_window_is_captured_and_sent_once(campaign: Campaigner, counted: Counting) -> None:
    captured = counted(Plant, "_capture", lambda plant, request, trigger_s: request.shot)
    made = campaign((4, 5))
    assert captured == Counter(range(len(made.plan.shots)))


def test_windows_are_searched_only_where_candidates_are_asked_for(counted: Counting) -> None:
    searched = counted(RangeFinder, "search")
    made = counted(Transmitter, "pulse")
    with open_bench("emulated") as bench:
        for shot, products in enumerate(("window", "candidates", "window", "correlation_windows")):
            bench.measure(NoSignal(), WindowRequest(shot, 4, 500, products=products))
    assert searched["calls"] == 2
    assert made["calls"] == 0


def test_candidates_cost_the_link_no_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    octets: Counter[str] = Counter()
    read = UsbLink.read

    def taken(self: Any, count: int, timeout_s: float) -> bytes:
        data: bytes = read(self, count, timeout_s)
        octets[asked] += len(data)
        return data

    monkeypatch.setattr(UsbLink, "read", taken)
    asked = "opening"
    with open_bench(usb(load_bench("emulated"))) as bench:
        for shot, products in enumerate(PRODUCTS):
            asked = products
            window = bench.measure(NoSignal(), WindowRequest(shot, 4, products=products)).window
            assert len(window.candidates) == (0 if products == "window" else 4)
    # An acknowledge of 26 octets, a segment of 38 with a head of 48, 30 a candidate, a table of one octet
    assert octets["candidates"] == 26 + 38 + 48 + 4 * 30 + 1
    assert octets["correlation_windows"] == octets["candidates"] + 4 * 2 * 42
    assert octets["window"] > 2 * 16064
    # and both at once what the samples cost and what the candidates cost
    searched = octets["correlation_windows"] - 26 - 38 - 48 - 1
    assert octets["window_and_candidates"] == octets["window"] + searched


def test_a_stimulus_is_checked_once_for_the_plan_and_once_when_it_is_set(
    campaign: Campaigner, counted: Counting
) -> None:
    checked = counted(generators, "on_grid", lambda stimulus, *more: stimulus)
    made = campaign(tuple(range(8)))
    stimuli = {one.stimulus for one in made.plan.shots}
    # The plan is checked with each gain code once; measuring checks what it changes to.
    assert sum(checked.values()) == 2 * len(stimuli) + len(made.plan.codes) - 1


def test_the_analysis_reads_each_window_twice_and_the_data_file_twice(
    campaign: Campaigner, counted: Counting
) -> None:
    made = campaign((4, 5))
    read = counted(Journal, "read", lambda held, shot: shot)
    outcome = characterize.analyse(made.plan, made.run.shots(), made.run.config)
    assert set(read.values()) == {2}
    assert len(read) == len(made.plan.shots)
    read.clear()
    made.run.finish(outcome)
    assert set(read.values()) == {2}


def test_a_figure_is_laid_out_once_for_both_its_files(tmp_path: Path, counted: Counting) -> None:
    # Given a run whose figures find their margins from their labels
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    laid_out = counted(ConstrainedLayoutEngine, "execute")
    with small_run.begin(tmp_path / "run") as run:
        small_run.measure(run, 3)
        outcome = small_run.outcome()
        # When the report is written, with an SVG and a PNG of each
        run.finish(outcome)
    assert laid_out["calls"] == len(outcome.figures) > 0


def test_the_noise_of_a_window_takes_a_deviate_for_each_sample_and_each_pole(
    campaign: Campaigner, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[int] = []

    class Noted(np.random.Generator):
        def standard_normal(self, size: int) -> Any:  # type: ignore[override]
            drawn.append(size)
            return super().standard_normal(size)

    monkeypatch.setattr(np.random, "Generator", Noted)
    made = campaign((4,))
    assert drawn == [made.plan.sample_count + 3] * len(made.plan.shots)


@pytest.mark.parametrize("command", ["--help", "--version"])
def test_help_loads_nothing_large(command: str) -> None:
    script = (
        "import sys; sys.argv = ['belahil', sys.argv[1]]\n"
        "from belahil.__main__ import main\n"
        "assert main() == 0\n"
        "print(' '.join(sorted({name.partition('.')[0] for name in sys.modules})), file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, command], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = set(done.stderr.split())
    large = {"numpy", "scipy", "matplotlib", "numba", "h5py", "h5netcdf", "pyvisa", "pyvisa_py"}
    large |= {"serial", "usb", "jinja2", "rich", "drivers", "sim", "procedures"}
    assert "click" in loaded
    assert not loaded & large


def test_the_emulated_bench_opens_and_measures_without_scipy_signal() -> None:
    script = (
        "import sys\n"
        "from belahil.bench import open_bench\n"
        "from belahil.stimuli import Sine\n"
        "from belahil.values import WindowRequest\n"
        "with open_bench('emulated') as bench:\n"
        "    bench.measure(Sine(1e6, 0.03), WindowRequest(0, 4))\n"
        "print(' '.join(sys.modules))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert "scipy.linalg" in loaded
    assert not loaded & {"scipy.signal", "scipy.stats", "scipy.optimize", "matplotlib"}
    # nor what searches for candidates and makes a laser's pulse
    assert not loaded & {"sim.rfm", "sim.template_bank", "sim.compiled_rfm", "numba", "sim.laser"}


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_benchmark_runs_and_the_whole_command_stays_below_500_mb(tmp_path: Path) -> None:
    numbers = tmp_path / "numbers.json"
    command = [sys.executable, "benchmarks/campaign.py", "--repeats", "1", "--json", str(numbers)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    told = json.loads(numbers.read_text())
    assert f"all numbers: {numbers}" in done.stdout
    assert {one["windows"] for one in told["median"].values()} == {16 * (5 * 24 + 4)}
    if told["memory_mb"] is not None:  # not told on Windows
        assert 20 < told["memory_mb"] < 500
