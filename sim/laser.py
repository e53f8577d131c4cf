"""The laser: how many photons, when, where they go, and how that changes from shot to shot.

What this does not model: speckle, chirp, a shape that changes across the beam or with the energy, ageing (set
`energy_j` instead), and correlation of the jitter between shots.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from belahil import strict_toml
from belahil.errors import ConfigError, RefusedInput
from sim.beam import BeamImage, beam_image, beam_sigma_m, beam_weights
from sim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_PER_S
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape
from sim.scene_tables import Laser

if TYPE_CHECKING:
    from sim.draws import Draws

__all__ = [
    "BeamImage",
    "Laser",
    "PulsePiece",
    "PulseShape",
    "beam_image",
    "beam_sigma_m",
    "beam_weights",
    "energy_factor",
    "photon_energy_j",
    "photon_number",
    "pointing_jitter",
    "pulse_shape",
    "read_pulse_table",
]


def photon_energy_j(wavelength_m: float) -> float:
    """Return h c / lambda, J."""
    return PLANCK_J_S * SPEED_OF_LIGHT_M_PER_S / wavelength_m


def photon_number(laser: Laser) -> float:
    """Return the photons of a pulse, N_0 = E_T lambda / (h c).

    A float: the number is beyond the integers that a float counts one by one, and no draw needs it.

    Examples
    --------
    >>> print(f"{photon_number(Laser()):.4g}")
    2.678e+17
    """
    return laser.energy_j / photon_energy_j(laser.wavelength_m)


def pulse_shape(laser: Laser) -> PulseShape:
    """Return S_T(t) of a laser: the Gaussian's centre is at t = 0, a table keeps the times of its file.

    Raises
    ------
    ConfigError
        The table cannot be used.
    """
    if laser.pulse == "table":
        return read_pulse_table(laser.table)
    tail_s = laser.tail_s if laser.pulse == "tailed" else 0.0
    return PulseShape((PulsePiece(1.0, laser.fwhm_s / FWHM_OF_SIGMA, tail_s),))


def read_pulse_table(path: str, table: str = "[laser]") -> PulseShape:
    """Read a pulse from a text file: time in s and relative power, a row each.

    Columns are parted by commas or spaces. Lines that begin with # are left out, and so is a first line of
    column names. `table` is what messages call the table of keys that names the file.

    Raises
    ------
    ConfigError
        The file cannot be read, or is no pulse.
    """
    where = f"{table} table = {path}"
    text = strict_toml.read(path, "pulse table").replace(",", " ")
    first, _, rest = text.partition("\n")
    if first.strip() and first.strip()[0].isalpha():
        text = rest
    try:
        rows = np.loadtxt(io.StringIO(text), ndmin=2)
    except ValueError as error:
        raise ConfigError(f"{where}: not a table of numbers ({error})") from error
    if rows.shape[1] != 2:
        raise ConfigError(f"{where}: has {rows.shape[1]} columns; needs two, time in s and relative power")
    try:
        return PulseShape(times_s=rows[:, 0], relative=rows[:, 1])
    except RefusedInput as error:
        raise ConfigError(f"{where}: {error}") from error


def pointing_jitter(laser: Laser, draws: Draws) -> tuple[float, float]:
    """Return how far a shot's beam points from the laser's pointing, rad; the draw is "pointing"."""
    towards = draws.stream("pointing").standard_normal(2)
    return float(laser.jitter_rad[0] * towards[0]), float(laser.jitter_rad[1] * towards[1])


def energy_factor(laser: Laser, draws: Draws) -> float:
    """Return a shot's energy relative to the laser's; the draw is "energy"."""
    return 1.0 + laser.energy_jitter * float(draws.stream("energy").standard_normal())
