"""The rules of the house: who imports whom, whose packages are used, what is shipped."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("belahil", "drivers", "sim", "procedures")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def run(arguments: list[str], folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    clean = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    clean.pop("PYTHONPATH", None)
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=clean | environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


# ---- who imports whom

LINT = "import importlinter.cli as c; raise SystemExit(c.lint_imports(no_cache=True))"


@pytest.fixture
def toy_house(tmp_path: Path) -> Path:
    """Rooms with empty modules under the house's own rules."""
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for module in (
        "belahil/values",
        "belahil/__main__",
        "belahil/cli/main",
        "drivers/links",
        "sim/build",
        "sim/plant",
        "sim/receiver_model",
        "sim/noise",
        "sim/instruments",
        "sim/devices/grm",
        "sim/transports/visa",
        "procedures/sweep",
    ):
        path = tmp_path / f"{module}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        (path.parent / "__init__.py").touch()
        (path.parent.parent / "__init__.py").touch()
        path.touch()
    return tmp_path


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("belahil/values.py", "import sim.plant"),
        ("belahil/values.py", "from drivers import links"),
        ("belahil/values.py", "import serial"),
        ("belahil/values.py", "from belahil.cli.main import main"),
        ("drivers/links.py", "from sim import build"),
        ("drivers/links.py", "from procedures.sweep import sweep"),
        ("sim/plant.py", "import drivers"),
        ("sim/plant.py", "def late():\n    import usb.core"),
        ("sim/devices/grm.py", "import pyvisa"),
        ("sim/plant.py", "from sim.devices.grm import device"),
        ("sim/noise.py", "from sim.receiver_model import model"),
        ("procedures/sweep.py", "from sim.plant import Plant"),
        ("procedures/sweep.py", "from sim.instruments import generator"),
        ("procedures/sweep.py", "from sim.devices.grm import device"),
        ("procedures/sweep.py", "from sim import build"),
        ("procedures/sweep.py", "import drivers.links"),
    ],
)
def test_a_forbidden_import_is_found(toy_house: Path, module: str, line: str) -> None:
    (toy_house / module).write_text(line + "\n")

    answer = run(["-c", LINT], toy_house)

    assert answer.returncode == 1, answer.stdout + answer.stderr
    assert "1 broken" in answer.stdout


def test_allowed_imports_are_let_through(toy_house: Path) -> None:
    for module, line in {
        "belahil/__main__.py": "from belahil.cli.main import main",
        "belahil/cli/main.py": "import sim.build, drivers.links, procedures.sweep, belahil.values",
        "drivers/links.py": "import belahil.values, pyvisa, serial, usb.core",
        "sim/build.py": "import sim.plant, sim.transports.visa, sim.instruments",
        "sim/transports/visa.py": "import pyvisa, sim.devices.grm",
        "sim/receiver_model.py": "import sim.noise",
        "procedures/sweep.py": "import belahil.values, sim.receiver_model, sim.noise",
    }.items():
        (toy_house / module).write_text(line + "\n")

    answer = run(["-c", LINT], toy_house)

    assert answer.returncode == 0, answer.stdout + answer.stderr


def test_the_house_keeps_its_rules() -> None:
    answer = run(["-c", LINT], ROOT)

    assert answer.returncode == 0, answer.stdout + answer.stderr


# ---- whose packages are used

STAND_IN_COMMAND_LINE = """
import json, os, sys
def main():
    numpy_before = "numpy" in sys.modules
    import drivers, sim, procedures
    print(json.dumps({
        "threads": os.environ["OPENBLAS_NUM_THREADS"],
        "numpy_before": numpy_before,
        "rooms": [drivers.__file__, sim.__file__, procedures.__file__],
    }))
    return 7
"""


@pytest.fixture
def small_house(tmp_path: Path) -> Path:
    """The real entry point, guard and rooms, with a command line that tells what it sees."""
    house = tmp_path / "house"
    for room in ROOMS:
        (house / room).mkdir(parents=True)
        shutil.copy(ROOT / room / "__init__.py", house / room)
    for module in ("__main__.py", "_neighbours.py", "_blas.py"):
        shutil.copy(ROOT / "belahil" / module, house / "belahil")
    (house / "belahil/cli").mkdir()
    (house / "belahil/cli/__init__.py").touch()
    (house / "belahil/cli/main.py").write_text(STAND_IN_COMMAND_LINE)
    return house


def start(house: Path, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    folder.mkdir(exist_ok=True)
    # -S: no installed packages, among them an editable belahil
    return run(["-S", "-m", "belahil"], folder, PYTHONPATH=str(house), **environment)


@pytest.mark.parametrize("name", ["drivers", "sim", "procedures"])
@pytest.mark.parametrize("kind", ["module", "package"])
def test_a_users_own_file_beside_him_does_no_harm(
    small_house: Path, tmp_path: Path, name: str, kind: str
) -> None:
    folder = tmp_path / "desk"
    theirs = folder / (f"{name}.py" if kind == "module" else f"{name}/__init__.py")
    theirs.parent.mkdir(parents=True)
    theirs.write_text("raise SystemExit('a stranger was imported')\n")

    answer = start(small_house, folder)

    assert answer.returncode == 7, answer.stderr
    seen = json.loads(answer.stdout)
    assert seen["rooms"] == [
        str(small_house / room / "__init__.py") for room in ("drivers", "sim", "procedures")
    ]


@pytest.mark.parametrize("name", ["drivers", "sim", "procedures"])
def test_a_file_overwritten_by_another_package_is_told_in_one_line(
    small_house: Path, tmp_path: Path, name: str
) -> None:
    (small_house / name / "__init__.py").write_text('"""Drivers for everything."""\n')

    answer = start(small_house, tmp_path / "desk")

    assert (answer.returncode, answer.stdout) == (2, "")
    assert answer.stderr.count("\n") == 1
    assert f"'{name}'" in answer.stderr
    assert "another package's file" in answer.stderr
    assert "an environment of its own" in answer.stderr


def test_a_room_that_lies_elsewhere_is_told_with_its_place(small_house: Path, tmp_path: Path) -> None:
    shutil.rmtree(small_house / "sim")
    elsewhere = tmp_path / "desk/sim.py"
    elsewhere.parent.mkdir()
    elsewhere.touch()

    answer = start(small_house, tmp_path / "desk")

    assert answer.returncode == 2
    assert f"found {elsewhere}" in answer.stderr
    assert str(small_house / "sim") in answer.stderr


def test_a_missing_room_is_told(small_house: Path, tmp_path: Path) -> None:
    shutil.rmtree(small_house / "procedures")

    answer = start(small_house, tmp_path / "desk")

    assert answer.returncode == 2
    assert "found none" in answer.stderr


def test_one_blas_thread_is_asked_for_before_numpy(small_house: Path, tmp_path: Path) -> None:
    seen = json.loads(start(small_house, tmp_path / "desk").stdout)

    assert (seen["threads"], seen["numpy_before"]) == ("1", False)


def test_a_users_number_of_blas_threads_stands(small_house: Path, tmp_path: Path) -> None:
    answer = start(small_house, tmp_path / "desk", OPENBLAS_NUM_THREADS="3")

    assert json.loads(answer.stdout)["threads"] == "3"


# ---- what is shipped


def source_files() -> list[Path]:
    return [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]


def distribution(requirement: str) -> str:
    return re.split(r"[<>=!~\[; ]", requirement, maxsplit=1)[0]


IMPORT_NAME = {"pyserial": "serial", "pyusb": "usb", "pyvisa-py": "pyvisa_py", "tomli-w": "tomli_w"}
DECLARED = {distribution(text) for text in PROJECT["dependencies"]}
GROUPS = PROJECT["optional-dependencies"]
EXTRAS = {distribution(text) for group in GROUPS.values() for text in group}
AT_RUN_TIME = DECLARED | {distribution(text) for name in GROUPS.keys() - {"dev"} for text in GROUPS[name]}


def imported_names(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


def test_what_is_imported_is_declared() -> None:
    known = set(ROOMS) | set(sys.stdlib_module_names)
    allowed = {IMPORT_NAME.get(name, name) for name in AT_RUN_TIME} | known

    strangers = {
        str(path.relative_to(ROOT)): unknown
        for path in source_files()
        if (unknown := imported_names(path) - allowed)
    }

    assert strangers == {}


def test_what_is_declared_is_imported() -> None:
    loaded_by_others = {"pyvisa-py", "h5py"}  # by pyvisa, as a backend; by h5netcdf, as its storage
    used = set().union(*map(imported_names, source_files()))

    idle = {name for name in DECLARED - loaded_by_others if IMPORT_NAME.get(name, name) not in used}

    assert idle == set()


def test_each_dependency_has_its_reason() -> None:
    table = (ROOT / "docs/dependencies.md").read_text(encoding="utf-8")

    reasons = {name.strip("` ") for name in re.findall(r"^\| (`[^|]+`) \|", table, flags=re.MULTILINE)}

    assert reasons == DECLARED | EXTRAS


def test_every_room_is_typed_and_every_folder_a_package() -> None:
    assert [room for room in ROOMS if not (ROOT / room / "py.typed").is_file()] == []
    assert {path.parent for path in source_files() if not (path.parent / "__init__.py").is_file()} == set()
