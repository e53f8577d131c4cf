"""What the default campaign costs: time a window, memory, start-up; links and benches side by side.

    python benchmarks/campaign.py [--repeats N] [--json FILE]

Prints a table and writes all numbers as JSON. The campaign is `belahil characterize` as a user types it: 16
gain codes x 5 amplitudes x 24 frequencies and the dark windows, each time in a fresh process. docs/speed.md
says what the rows mean and holds the table of one run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import pstats
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from belahil._blas import pin_to_one_thread  # noqa: E402

pin_to_one_thread()

from benchmarks.reference_loop import reference_ms  # noqa: E402

BENCHES = {
    "emulated, serial": "",
    "emulated, USB": '[digitizer]\nlink = "emulated:usb"\n',
    "simulated": '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n',
}
HELP_RUNS = 10
# What the project promises, docs/speed.md.
MOST = {"window_ms": 3.0, "harness_ms": 1.0, "memory_mb": 500.0, "help_s": 0.3}


@dataclass(frozen=True, slots=True)
class Exit:
    """How a child process went: wall and CPU time, s, and its largest memory, MB (None: not told here)."""

    wall_s: float
    cpu_s: float | None
    memory_mb: float | None


def ran(command: list[str]) -> Exit:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    begun = time.perf_counter()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment)
    assert child.stderr is not None
    complaint = child.stderr.read()
    cpu_s = memory_mb = None
    if hasattr(os, "wait4"):
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        cpu_s = usage.ru_utime + usage.ru_stime
        memory_mb = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    status = child.wait()
    wall_s = time.perf_counter() - begun
    if status:
        raise SystemExit(f"{' '.join(command)}: status {status}\n{complaint.decode()}")
    return Exit(wall_s, cpu_s, memory_mb)


def belahil(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "belahil", *arguments]


def timed(place: Path, name: str, bench: str, profile: Path | None = None) -> dict[str, Any]:
    """Run the campaign once with clocks at its stages; times in ms a window, less waiting for the disk."""
    result, file = place / f"{name}.json", place / f"{name}.toml"
    file.write_text(bench)
    profiled = ["--profile", str(profile)] if profile else []
    command = [sys.executable, str(ROOT / "benchmarks" / "timed_command.py"), str(result), *profiled, "--"]
    command += ["characterize", "--quiet", "--bench", str(file), "--out", str(place / name)]
    exited = ran(command)
    told = json.loads(result.read_text())
    results = json.loads((place / name / "summary.json").read_text())["results"]
    shutil.rmtree(place / name)  # 130 MB
    stages: dict[str, list[list[float]]] = told["stages"]
    windows = len(stages["shot"])
    wall, cpu = 0, 1

    def seconds(name: str, clock: int) -> float:
        return sum(call[clock] for call in stages[name])

    def each(name: str) -> float:
        return 1e3 * seconds(name, wall) / windows

    def median(times: Iterable[float]) -> float:
        return 1e3 * statistics.median(times)

    pairs = list(zip(stages["shot"], stages["capture"], strict=True))
    rows = {
        "results": json.dumps(results),
        "windows": windows,
        "disk": 1e3 * told["disk_s"] / windows,
        "whole": 1e3 * (exited.wall_s - told["disk_s"]) / windows,
        "whole_cpu": 1e3 * told["cpu_s"] / windows,
        "shot": median(shot[wall] for shot, _ in pairs),
        "capture": median(capture[wall] for _, capture in pairs),
        "path": median(shot[wall] - capture[wall] for shot, capture in pairs),
        "path_cpu": median(shot[cpu] - capture[cpu] for shot, capture in pairs),
        "read_windows": each("read_windows"),
        "write_data": each("write_data"),
        "open_s": seconds("open", cpu) + seconds("plan", cpu),
        "fits_s": seconds("analyse", cpu) - seconds("read_windows", cpu),
        "figures_s": seconds("save_figures", cpu),
        "page_s": seconds("finish", cpu) - seconds("save_figures", cpu) - seconds("write_data", cpu),
    }
    stage_s = sum(seconds(name, cpu) for name in ("open", "plan", "measure", "analyse", "finish"))
    rows["start_s"] = told["cpu_s"] - stage_s
    rows["together"] = rows["path"] + rows["read_windows"] + rows["write_data"]
    return rows


def medians(runs: list[dict[str, Any]]) -> dict[str, float]:
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def profiled_shares(profile: Path) -> dict[str, float]:
    """Return the share of `measure`, in a profile, of emulation, disk and everything else."""
    stats = pstats.Stats(str(profile)).stats  # type: ignore[attr-defined]

    def spent(file: str, name: str) -> float:
        return sum(
            row[3]
            for (path, _, function), row in stats.items()
            if path.replace("\\", "/").endswith(file) and function == name
        )

    whole = spent("procedures/characterize.py", "measure")
    disk = spent("belahil/journal.py", "_wait_for_disk")
    capture = spent("sim/plant.py", "_capture")
    return {
        "emulation": capture / (whole - disk),
        "everything else": (whole - disk - capture) / (whole - disk),
    }


def machine() -> dict[str, Any]:
    import numpy as np

    return {
        "processor": f"{os.cpu_count()} cores, {platform.machine()}",
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5, help="runs of each kind")
    parser.add_argument("--json", type=Path, default=Path("campaign.json"), help="where the numbers go")
    given = parser.parse_args()
    told: dict[str, Any] = {"machine": machine(), "most": MOST}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        help_s = [ran(belahil("--help")).wall_s for _ in range(HELP_RUNS)]
        runs: dict[str, list[dict[str, Any]]] = {kind: [] for kind in BENCHES}
        plain: list[Exit] = []
        reference, results = [reference_ms()], set()
        for repeat in range(given.repeats):
            for kind, bench in BENCHES.items():
                runs[kind].append(timed(place, f"{kind}-{repeat}", bench))
                results.add(runs[kind][-1].pop("results"))
            plain.append(ran(belahil("characterize", "--quiet", "--out", str(place / "plain"))))
            shutil.rmtree(place / "plain")
            reference.append(reference_ms())
        if len(results) > 1:
            raise SystemExit("the benches gave different results: their times are not of the same work")
        profile = place / "profile"
        timed(place, "profiled", "", profile)
        told["profile"] = profiled_shares(profile)
    told["help_s"] = statistics.median(help_s)
    told["reference_ms"] = statistics.median(wall for wall, _ in reference)
    told["reference_cpu_ms"] = statistics.median(cpu for _, cpu in reference)
    told["memory_mb"] = max((one.memory_mb for one in plain if one.memory_mb is not None), default=None)
    told["plain_s"] = [one.wall_s for one in plain]
    told["runs"] = runs
    told["median"] = {kind: medians(several) for kind, several in runs.items()}
    given.json.write_text(json.dumps(told, indent=1) + "\n")
    for line in table(told):
        print(line)
    print(f"all numbers: {given.json}")
    return 0


def table(told: dict[str, Any]) -> Iterable[str]:
    median = told["median"]
    where = told["machine"]
    yield f"{where['processor']}, {where['system']}, Python {where['python']}, numpy {where['numpy']}"
    yield (
        f"reference loop: {told['reference_ms']:.3f} ms a round, {told['reference_cpu_ms']:.3f} ms of it CPU "
        "time (a machine that has other work to do shows a difference)"
    )
    yield ""
    yield f"{'ms a window, without waiting for the disk':54s}" + "".join(f"{kind:>18s}" for kind in median)

    def row(words: str, key: str) -> str:
        return f"{words:54s}" + "".join(f"{one[key]:18.3f}" for one in median.values())

    yield row(f"everything, start to exit (at most {MOST['window_ms']:g})", "whole")
    yield row("  the same in CPU time", "whole_cpu")
    yield row("a shot, from the request to the journal (median)", "shot")
    yield row("  emulation's arithmetic", "capture")
    yield row(f"  harness: all else of a shot (at most {MOST['harness_ms']:g})", "path")
    yield row("  the same in CPU time", "path_cpu")
    yield row("analysis of the windows", "read_windows")
    yield row("NetCDF", "write_data")
    yield row("harness, analysis and NetCDF together", "together")
    yield row("waiting for the disk, not in any row above", "disk")
    yield ""
    yield "seconds of CPU a campaign, whatever its length"
    yield row("  Python and what is imported", "start_s")
    yield row("  opening the bench, checking the plan", "open_s")
    yield row("  filter fits of all gain codes", "fits_s")
    yield row("  figures", "figures_s")
    yield row("  report page, summary", "page_s")
    yield ""
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in told["profile"].items())
    yield f"measuring by the profiler, serial: {shares}"
    memory = "not told by this system" if told["memory_mb"] is None else f"{told['memory_mb']:.0f} MB"
    yield f"largest memory of the whole command (at most {MOST['memory_mb']:g} MB): {memory}"
    yield f"belahil --help, median of {HELP_RUNS} (at most {MOST['help_s']:g} s): {told['help_s']:.3f} s"


if __name__ == "__main__":
    sys.exit(main())
