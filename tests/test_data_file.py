"""docs/data-file.md lists every variable of the data file of a real run, and the statuses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import xarray

from belahil import pulse_fit
from belahil.cli.main import main
from belahil.outcome import STATUSES
from procedures import butterworth_fit, dark_noise, pulse_shape_plan, sine_fit
from procedures.candidate_parity import ParityStatus
from procedures.pulse_energy import EnergyStatus
from procedures.pulse_pairs import PairStatus
from procedures.rfm_parity_results import EchoStatus, RunStatus
from procedures.small_signal import SmallSignalStatus

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = (DOCS / "data-file.md").read_text(encoding="utf-8")
SWEEP = ["--codes", "4,5", "--amplitudes-mvpp", "30,480", "--frequencies-mhz", "1,5,15,20,29"]


WORDS = {
    "characterize": SWEEP,
    "noise": ["--codes", "4,5"],
    "tx-delay": ["--shots", "20"],
    "digitizer": ["--codes", "4,5", "--records", "2"],
    "arrival-time": ["--widths", "8", "--pulse-windows", "5", "--terrain", "fractal"],
    "rfm-parity": ["--shots", "20", "--samples", "2000", "--model-windows", "100"],
}
LONG = ("tx-delay", "arrival-time", "rfm-parity")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], xarray.Dataset]:
    folder = tmp_path_factory.mktemp("data-file")

    @cache
    def opened(name: str) -> xarray.Dataset:
        out = folder / name
        assert main([name, *WORDS[name], "--bench", "simulated", "--out", str(out), "--quiet"]) == 0
        with xarray.open_dataset(out / "data.nc") as data:
            return data.load()

    return opened


def told(heading: str) -> list[tuple[str, ...]]:
    (section,) = re.findall(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S)
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| `")]
    return sorted((row[0].strip("`"), row[1].strip(), row[2].strip(), row[3]) for row in rows)


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] if one in LONG else []) for one in WORDS]
)
def test_the_page_lists_every_variable(run: Callable[[str], xarray.Dataset], name: str) -> None:
    written = sorted(
        (
            str(variable),
            ", ".join(map(str, values.dims)),
            str(values.attrs.get("units", values.encoding.get("units", "flags"))),
            str(values.attrs["long_name"]),
        )
        for variable, values in run(name).variables.items()
        if not str(variable).startswith("housekeeping_")
    )
    listed = [*told("Of every shot"), *told(f"Of `belahil {name}`")]
    if name in ("characterize", "digitizer"):
        listed += told("Of shots with sines")
    if name == "rfm-parity":
        listed += told("Of shots with candidates")
    if name in ("arrival-time", "rfm-parity"):
        # the emulated generator has no pole
        listed += [row for row in told("Of shots with sampled pulses") if "pole" not in row[0]]
    assert sorted(listed) == written


def test_points_join_their_windows(run: Callable[[str], xarray.Dataset]) -> None:
    data = run("characterize")
    windows = data.isel(shot=data["point_shot"].values)
    assert np.array_equal(windows["frequency_hz"], data["point_frequency_hz"])
    assert np.array_equal(windows["gain_code"], data["point_gain_code"])
    assert np.array_equal(windows["planned_amplitude_vpp"], data["point_amplitude_vpp"])
    # dark windows have no planned amplitude, and all others belong to a point
    assert np.array_equal(np.flatnonzero(~np.isnan(data["planned_amplitude_vpp"])), data["point_shot"])


def test_the_statuses_are_those_of_the_page(run: Callable[[str], xarray.Dataset]) -> None:
    rows = re.findall(r"^\| (\d+) \| `(\w+)` ", PAGE, re.MULTILINE)
    assert rows == [(str(number), word) for number, word in enumerate(STATUSES)]
    status = run("characterize")["point_status"]
    named = [STATUSES[number] for number in status.values]
    assert set(named) == {"ok", "clipped", "frequency_not_measurable"}  # 20 MHz is a quarter of the rate
    assert status.attrs["flag_meanings"].split() == list(STATUSES)


def test_every_status_that_is_made_has_a_number() -> None:
    dark = get_args(dark_noise.Status)
    made = {"no_usable_point", *get_args(butterworth_fit.Status), *dark, *get_args(sine_fit.SineStatus)}
    made |= {f"noise_{word}" for word in dark if word != "ok"}
    made |= set(get_args(pulse_fit.FitStatus))
    made |= {*get_args(ParityStatus), *get_args(EchoStatus), *get_args(RunStatus)}
    made |= {*get_args(pulse_shape_plan.ShapeStatus), *get_args(SmallSignalStatus)}
    made |= {"no_light"}  # of a simulated echo
    unions = (EnergyStatus, PairStatus)
    made |= {word for union in unions for part in get_args(union) for word in get_args(part)}
    made -= {"masked"}  # which is ok in a table
    assert made == set(STATUSES)


def keys(results: dict[str, Any]) -> set[str]:
    """Names in results and in the objects of its lists; a measured number has no names of its own."""
    named = {key for key in results if key not in ("value", "standard_uncertainty", "unit")}
    inner = [one for value in results.values() for one in (value if isinstance(value, list) else [value])]
    return named.union(*(keys(one) for one in inner if isinstance(one, dict)))


@pytest.mark.parametrize("name", ["characterize", "noise", "tx-delay", "digitizer"])
def test_the_contract_names_every_key_of_the_results(run: Callable[[str], xarray.Dataset], name: str) -> None:
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    contract = text.partition(f"`{name}` fills `results` with")[2].partition("A verdict is given only")[0]
    if not contract:  # it has a page of its own
        contract = (DOCS / f"{name}.md").read_text(encoding="utf-8").partition("## Results")[2]
    results = json.loads((Path(run(name).encoding["source"]).parent / "summary.json").read_text())["results"]
    made = keys(results)
    assert len(made) >= 5
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", contract))))
    assert made - named - set(STATUSES) == set()


def test_noise_density_is_one_variable_that_integrates_to_the_noise(
    run: Callable[[str], xarray.Dataset],
) -> None:
    for name in ("characterize", "noise"):
        data = run(name)
        density = data["noise_density"].sel(code=4)
        step = float(data["noise_frequency"].diff("noise_frequency").mean())
        # the spectrum is that of the raw windows without their mean, offsets of the converters apart
        total = float(density.sum()) * step
        assert total == pytest.approx(float(data["code_noise_total"].sel(code=4)) ** 2, rel=0.05)
