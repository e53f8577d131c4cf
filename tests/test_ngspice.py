"""The receiver's filter against a circuit: a ladder of R, L and C, solved by ngspice."""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from belahil import butterworth
from belahil.pole_response import response
from sim.kernel import Kernel
from sim.presets import laser_preset
from sim.pulse_shape import PulsePiece, PulseShape
from sim.scene import Scene

RESISTANCE_OHM = 50.0
STEP_S = 5e-12
CENTRE_S, END_S = 30e-9, 200e-9
SIGMA_S = laser_preset("bela").fwhm_s / math.sqrt(8 * math.log(2))
CORNERS = ((0.0, 0.0), (10e-9, 0.0), (15e-9, 1.0), (25e-9, 1.0), (60e-9, 0.2), (60.5e-9, 0.0), (END_S, 0.0))
"""Time in s and volts of a pulse of straight lines."""

pytestmark = pytest.mark.skipif(
    shutil.which("ngspice") is None,
    reason="ngspice is not installed (Debian, Ubuntu: apt-get install ngspice)",
)


def ladder(source: str, cutoff_hz: float, resistance_ohm: float = RESISTANCE_OHM) -> str:
    """Return a third-order Butterworth low-pass between two equal resistances: C, L, C.

    The elements of the prototype of order n at 1 rad/s and 1 ohm are 2 sin((2 k - 1) pi / (2 n)).
    """
    first, second, third = (2 * math.sin((2 * k - 1) * math.pi / 6) for k in (1, 2, 3))
    omega = 2 * math.pi * cutoff_hz
    return "\n".join(
        [
            "third-order Butterworth ladder",
            source,
            f"R1 in a {resistance_ohm!r}",
            f"C1 a 0 {first / (omega * resistance_ohm)!r}",
            f"L2 a b {second * resistance_ohm / omega!r}",
            f"C3 b 0 {third / (omega * resistance_ohm)!r}",
            f"R4 b 0 {resistance_ohm!r}",
            ".options reltol=1e-10 abstol=1e-18 vntol=1e-14 chgtol=1e-24 method=trap",
            ".control",
            "set numdgt=14",
            f"tran {STEP_S!r} {END_S!r} 0 {STEP_S!r}",
            "wrdata out.txt v(b)",
            "quit",
            ".endc",
            ".end",
        ]
    )


def solved(folder: Path, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and volts behind the ladder, without the loss of one half between equal resistances."""
    (folder / "ladder.cir").write_text(ladder(source, Scene().truth.cutoff_hz), encoding="ascii")
    done = subprocess.run(
        ["ngspice", "-b", "ladder.cir"], cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert (folder / "out.txt").is_file(), done.stdout + done.stderr
    times_s, volts = np.loadtxt(folder / "out.txt").T
    return times_s, 2 * volts


def receiver_poles() -> tuple[complex, ...]:
    truth = Scene().truth
    assert (truth.order, truth.highpass_hz) == (3, 0.0)
    return butterworth.poles(truth.cutoff_hz, truth.order)


def test_a_laser_pulse_behind_the_filter_is_that_of_a_circuit(tmp_path: Path) -> None:
    # Given a Gaussian of unit area per nanosecond, as the circuit's source
    height = 1e-9 / (math.sqrt(2 * math.pi) * SIGMA_S)
    source = f"B1 in 0 V={height!r}*exp(-0.5*((time-{CENTRE_S!r})/{SIGMA_S!r})^2)"
    kernel = Kernel(PulseShape((PulsePiece(1.0, SIGMA_S),)), receiver_poles())

    times_s, volts = solved(tmp_path, source)
    expected = 1e-9 * kernel.exact(times_s - CENTRE_S)

    # Then closed form and table are within 1e-6 of the peak, the table with its own 1e-7
    peak = expected.max()
    assert np.abs(volts - expected).max() <= 1e-6 * peak
    assert np.abs(volts - 1e-9 * kernel.at(times_s - CENTRE_S)).max() <= 1.1e-6 * peak
    assert expected.min() < -0.09 * peak


def test_a_pulse_of_straight_lines_behind_the_filter_is_that_of_a_circuit(tmp_path: Path) -> None:
    # Given corners on a grid of half a nanosecond
    source = "V1 in 0 PWL(" + " ".join(f"{time_s!r} {volts!r}" for time_s, volts in CORNERS) + ")"
    grid_s = 0.5e-9 * np.arange(round(END_S / 0.5e-9) + 1)
    played = np.interp(grid_s, *np.array(CORNERS).T)

    times_s, volts = solved(tmp_path, source)
    expected = response(played, 2e9, 0.0, "linear", receiver_poles(), times_s)

    assert np.abs(volts - expected).max() <= 1e-6 * expected.max()
