"""pytest plugin: a bench as a fixture, procedures as tests, runs as artefacts.

Everything but pytest is imported where it is used, so that a project that uses none of it pays nothing.
"""

from __future__ import annotations

import argparse
import os
import re
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.procedure_run import ProcedureRun
    from belahil.pytest_recordings import Recordings

_BENCH: pytest.StashKey[BenchConfig] = pytest.StashKey()
_OPEN: pytest.StashKey[list[Bench]] = pytest.StashKey()
_RECORDINGS: pytest.StashKey[Recordings | None] = pytest.StashKey()
_FIXTURES = {"bench_config", "belahil_open", "belahil_run"}
_RECORDING = "belahil_recording"
_PROPERTY = re.compile(r"belahil_(?P<procedure>[\w-]+)_(?P<what>verdict|folder)")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--bench``, ``--belahil-seed``, ``-out``, ``-record`` and the key ``belahil_bench``."""
    group = parser.getgroup("belahil", "belahil: receivers of laser altimeters")
    words: dict[str, Any] = {
        "dest": "belahil_bench",
        "metavar": "FILE|emulated|simulated|replay:FILE|replay:DIR",
        "help": "The bench of the tests; that of the key belahil_bench, or emulated, when left out. With "
        "replay:DIR each test replays what --belahil-record DIR recorded of it.",
    }
    try:
        group.addoption("--bench", "--belahil-bench", **words)
    except (ValueError, argparse.ArgumentError):  # another plugin has it: the long name is left
        group.addoption("--belahil-bench", **words)
    group.addoption(
        "--belahil-seed", type=int, metavar="N", help="Seed of the emulation, in place of [emulation] seed."
    )
    group.addoption(
        "--belahil-out",
        metavar="DIR",
        help="Where run folders are kept; pytest's temporary directory when left out.",
    )
    group.addoption(
        "--belahil-record",
        metavar="DIR",
        help="Record every byte of the links, a file for each bench that a test opens; new or empty.",
    )
    parser.addini("belahil_bench", "bench of the tests: a file beside this one, or a name", default="")


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker, and refuse a bench that cannot be used before any test runs."""
    config.addinivalue_line("markers", "hardware: needs real instruments; skipped on any other bench")
    asked = [config.getoption(f"belahil_{option}") for option in ("seed", "record")]
    if _named(config) or any(option is not None for option in asked):
        _bench_config(config)
        _recordings(config)


def pytest_report_header(config: pytest.Config) -> str | None:
    """Say which bench was asked for, if any was."""
    if not _named(config):
        return None
    bench = _bench_config(config)
    seed = "" if bench.source == "hardware" else f", seed {bench.emulation.seed}"
    return f"belahil: bench {_named(config)} ({bench.source}{seed})"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what needs real instruments where there are none.

    A project may have a marker of the same name for other instruments. Its tests are left alone unless they
    use a bench, or one is named.
    """
    marked = [item for item in items if item.get_closest_marker("hardware")]
    if marked and not _named(config):
        theirs = len([line for line in config.getini("markers") if re.match(r"hardware\b", line)]) > 1
        marked = [item for item in marked if not theirs or _FIXTURES & set(getattr(item, "fixturenames", ()))]
    if marked and (source := _bench_config(config).source) != "hardware":
        recordings = _recordings(config)
        marked = [item for item in marked if recordings is None or not recordings.holds(item.nodeid)]
        reason = f"needs real instruments, and the bench is {source}: name theirs with --bench FILE"
        for item in marked:
            item.add_marker(pytest.mark.skip(reason=reason))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name each run folder with its verdict, and each recording, also those of tests that passed."""
    # The reports of one test's phases each carry all its properties.
    reports = [one for found in terminalreporter.stats.values() for one in found]
    told = [(report.nodeid, getattr(report, "user_properties", ())) for report in reports]
    runs = dict.fromkeys((test, *run) for test, properties in told for run in _runs(properties))
    files = dict.fromkeys(
        str(value) for _, properties in told for name, value in properties if name == _RECORDING
    )
    if runs or files:
        terminalreporter.section("belahil runs")
    for _, procedure, verdict, folder in runs:
        terminalreporter.line(f"{procedure}: {verdict} {folder}")
    for file in files:
        terminalreporter.line(f"recorded: {file}")


def _runs(properties: Sequence[tuple[str, object]]) -> Iterator[tuple[str, str, str]]:
    """Yield procedure, verdict and folder of each run that a test made."""
    verdict = ""
    for name, value in properties:
        found = _PROPERTY.fullmatch(name)
        if found and found["what"] == "verdict":
            verdict = str(value)
        elif found:
            yield found["procedure"], verdict, str(value)


@pytest.fixture(scope="session")
def bench_config(request: pytest.FixtureRequest) -> BenchConfig:
    """The bench of ``--bench`` as a `belahil.config.BenchConfig`, for the whole session."""
    return _bench_config(request.config)


@pytest.fixture
def bench(request: pytest.FixtureRequest, bench_config: BenchConfig) -> Iterator[Bench]:
    """An open `belahil.bench.Bench`, fresh for each test; its output is off afterwards."""
    from belahil.errors import BelahilError

    opened = _opened(request, bench_config)
    shared = request.config.stash.setdefault(_OPEN, [])
    failed = ""
    try:
        with opened:
            shared.append(opened)
            yield opened
            shared.remove(opened)
    except BelahilError as error:
        failed = "; ".join([f"belahil: {error}", *getattr(error, "__notes__", [])])
    # Outside of the handler: pytest would show what is inside belahil.
    if failed:
        pytest.fail(failed, pytrace=False)


@pytest.fixture(scope="session")
def belahil_open(request: pytest.FixtureRequest, bench_config: BenchConfig) -> Callable[[], Bench]:
    """Open a `belahil.bench.Bench` of your own, recorded or replayed as those of the tests are."""
    return lambda: _opened(request, bench_config)


@pytest.fixture(scope="session")
def belahil_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RunsProcedures:
    """Measure a procedure, and fail the test when its verdict is ``fail`` or ``undecided``.

    ``belahil_run("characterize", codes=[4])`` returns a `belahil.procedure_run.ProcedureRun`. It measures on
    the `bench` of the test, or opens one where the test has none.
    """
    asked = request.config.getoption("belahil_out")
    out = (
        tmp_path_factory.mktemp("belahil") if asked is None else request.config.invocation_params.dir / asked
    )
    return RunsProcedures(request, out)


class RunsProcedures:
    """What the fixture ``belahil_run`` is: a function that measures a procedure.

    Parameters
    ----------
    request : pytest.FixtureRequest
        Of the fixture.
    out : Path
        Run folders go into folders named like their tests here.
    """

    def __init__(self, request: pytest.FixtureRequest, out: Path) -> None:
        self._request = request
        self._out = out

    def __call__(
        self,
        procedure: str,
        *,
        bench: Bench | None = None,
        limits: Mapping[str, Sequence[float]] | None = None,
        must_pass: bool = True,
        **options: Any,
    ) -> ProcedureRun:
        """Measure a procedure.

        Parameters
        ----------
        procedure : str
            As its command is called: ``"characterize"``.
        bench : Bench or None
            An open one; None takes the test's fixture `bench`, or opens one.
        limits : mapping or None
            In place of ``[limits]`` of the bench file: ``{"cutoff_hz": (18e6, 20e6)}``.
        must_pass : bool
            False returns a run whose verdict is not ``pass`` too.
        **options
            Of the procedure, in SI units: ``codes=[4]``, ``amplitudes_vpp=[0.03]``.

        Raises
        ------
        BelahilError
            The procedure, an option or the plan was refused, or an instrument failed.
        """
        __tracebackhide__ = True
        from belahil.errors import BelahilError

        try:
            run = self._run(procedure, bench, limits, options)
        except BelahilError as error:
            # Its line says it all; what is inside belahil does not help who wrote the test.
            raise error.with_traceback(None) from None
        self._keep(run)
        if must_pass and not run.passed:
            pytest.fail(f"belahil {run}", pytrace=False)
        return run

    def _run(
        self,
        procedure: str,
        bench: Bench | None,
        limits: Mapping[str, Sequence[float]] | None,
        options: Mapping[str, Any],
    ) -> ProcedureRun:
        from belahil.config import LimitsTable
        from belahil.errors import BelahilError
        from belahil.procedure_run import run_procedure
        from belahil.strict_toml import typed

        allowed = None if limits is None else typed(dict(limits), LimitsTable, "limits")
        open_ones = self._request.config.stash.setdefault(_OPEN, [])
        with ExitStack() as stack:
            there = bench or next(reversed(open_ones), None)
            if there is None:
                there = stack.enter_context(self._request.getfixturevalue("belahil_open")())
            folder = self._folder(procedure)
            try:
                return run_procedure(procedure, there, folder, options, limits=allowed)
            except BelahilError:
                with suppress(OSError):  # goes only where nothing was begun
                    folder.rmdir()
                    folder.parent.rmdir()
                raise

    def _folder(self, procedure: str) -> Path:
        """Make a new folder, named like the test; those of earlier sessions stay."""
        name, _ = _current()
        test = re.sub(r"[^\w.-]+", "-", name.rpartition("/")[2]).strip("-")[:80]
        number = 1
        while True:
            folder = self._out / test / (procedure if number == 1 else f"{procedure}-{number}")
            try:
                folder.mkdir(parents=True)
            except FileExistsError:
                number += 1
            else:
                return folder

    def _keep(self, run: ProcedureRun) -> None:
        _, phase = _current()
        for item in _current_items(self._request):
            item.add_report_section(phase, "belahil", str(run))
            item.user_properties += [
                (f"belahil_{run.procedure}_verdict", run.verdict),
                (f"belahil_{run.procedure}_folder", str(run.folder)),
            ]


def _current() -> tuple[str, str]:
    """Return the id of the running test and its phase: setup, call or teardown."""
    name, _, phase = os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")
    return name, phase.strip("()")


def _current_items(request: pytest.FixtureRequest) -> list[pytest.Item]:
    name, _ = _current()
    return [item for item in request.session.items if item.nodeid == name]


def _named(config: pytest.Config) -> str:
    """Return the bench that option or ini file names, if any."""
    asked: str | None = config.getoption("belahil_bench")
    if asked is not None:
        return asked
    named: str = config.getini("belahil_bench")
    beside = (config.inipath or config.rootpath / "pytest.ini").parent / named
    return str(beside) if named and beside.is_file() else named


def _bench_config(config: pytest.Config) -> BenchConfig:
    """Read the bench once a session.

    Raises
    ------
    pytest.UsageError
        It cannot be read, or it is real and several processes would use it.
    """
    if _BENCH not in config.stash:
        config.stash[_BENCH] = _read_bench(config)
    return config.stash[_BENCH]


def _read_bench(config: pytest.Config) -> BenchConfig:
    from belahil._blas import pin_to_one_thread

    pin_to_one_thread()
    from belahil.config import load_bench, seeded
    from belahil.errors import BelahilError

    name, seed = _named(config) or "emulated", config.getoption("belahil_seed")
    recordings = _recordings(config)
    try:
        replays = recordings is not None and recordings.replays
        bench = recordings.first_bench() if recordings is not None and replays else load_bench(name)
        bench = bench if seed is None else seeded(bench, seed, "--belahil-seed")
    except BelahilError as error:
        raise pytest.UsageError(f"belahil: {error}") from error
    if recordings is not None and not recordings.replays and bench.source in ("simulated", "replay"):
        raise pytest.UsageError(
            f"belahil: --belahil-record {recordings.folder}: the bench is {bench.source} and has no links"
        )
    if bench.source == "hardware" and (config.getoption("numprocesses", 0) or 0) > 1:
        raise pytest.UsageError(f"belahil: bench {name} is real and serves one process; leave out -n")
    return bench


def _recordings(config: pytest.Config) -> Recordings | None:
    """Return where tests are recorded or replayed one by one; None where they are not.

    Raises
    ------
    pytest.UsageError
        They cannot be recorded there.
    """
    if _RECORDINGS not in config.stash:
        config.stash[_RECORDINGS] = _find_recordings(config)
    return config.stash[_RECORDINGS]


def _find_recordings(config: pytest.Config) -> Recordings | None:
    name, record = _named(config), config.getoption("belahil_record")
    if record is None and not name.startswith("replay:"):
        return None
    from belahil.errors import RefusedInput
    from belahil.pytest_recordings import recordings_at

    try:
        # The workers of pytest-xdist begin when the first of them may have recorded already.
        return recordings_at(
            config.invocation_params.dir, record, name, may_be_filled=hasattr(config, "workerinput")
        )
    except RefusedInput as error:
        raise pytest.UsageError(f"belahil: {error}") from error


def _opened(request: pytest.FixtureRequest, config: BenchConfig) -> Bench:
    """Open a bench, recorded or replayed where that was asked for, or fail in one line."""
    from belahil._neighbours import complaint
    from belahil.bench import open_bench
    from belahil.config import load_bench
    from belahil.errors import BelahilError

    wrong = complaint(Path(__file__).resolve().parent.parent)
    if wrong is not None:
        pytest.fail(wrong, pytrace=False)
    recordings = _recordings(request.config)
    try:
        if recordings is None:
            return open_bench(config)
        file = recordings.next_file(_current()[0])
        if recordings.replays:
            return open_bench(load_bench(f"replay:{file}"))
        for item in _current_items(request):
            item.user_properties.append((_RECORDING, str(file)))
        return open_bench(config, record=file)
    except BelahilError as error:
        failed = f"belahil: {error}"
    # Outside of the handler: pytest would show what is inside belahil.
    pytest.fail(failed, pytrace=False)
