"""Energy and integrals of echoes without noise: planes of every slope, and footprints of a terrain model.

Every point is normalized as the paper's fits are, to an avalanche gain of 48.4 and a receiver's gain of 5.19.

Not modelled here: noise, converters, and saturation. An echo meets the receiver as `sim.chain.Chain` has it,
with the filter of the receiver under test in place of the scene's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.delay_curve import NARROWEST_S, WIDEST_S
from belahil.errors import RefusedInput
from belahil.pole_response import response
from procedures.energy_fit import EnergyFit, bins, fit_energy
from procedures.pulse_energy import PulseEnergy, pulse_energy
from sim.chain import Chain
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.detector import multiplication, volts_per_photon_rate
from sim.draws import Draws
from sim.echo import GridEcho, echo
from sim.footprint import delays
from sim.kernel import Kernel
from sim.laser import photon_energy_j, pulse_shape
from sim.pulse_shape import FWHM_OF_SIGMA
from sim.rfm import RangeFinder
from sim.template_bank import TemplateBank
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.known_receiver import KnownReceiver
    from sim.scene import Scene

REFERENCE_M, REFERENCE_GAIN = 48.4, 5.19
"""Gain of the photodiode and of the receiver to which the paper scales its fits."""

PHASES = 8
"""Places of a pulse between two samples."""

_SAMPLES = 512
_PLANES = 31


@dataclass(frozen=True, eq=False)
class EnergyPoints:
    """Points of a calibration; only pulses with a fit.

    Parameters
    ----------
    gaussian_s, window_s, rectified_s : ndarray, shape (n,)
        Integrals of `procedures.pulse_energy.PulseEnergy`, each divided by the amplitude, s.
    energy_j_per_v : ndarray, shape (n,)
        Optical energy divided by the amplitude, at the reference gains, J/V.
    fwhm_s, amplitude_v : ndarray, shape (n,)
        As detected.
    """

    gaussian_s: NDArray[np.float64]
    window_s: NDArray[np.float64]
    rectified_s: NDArray[np.float64]
    energy_j_per_v: NDArray[np.float64]
    fwhm_s: NDArray[np.float64]
    amplitude_v: NDArray[np.float64]

    def of(self, integral: str) -> NDArray[np.float64]:
        """Return one of the integrals by its name without ``_s``."""
        found: NDArray[np.float64] = getattr(self, f"{integral}_s")
        return found

    def within(self, narrowest_s: float, widest_s: float) -> EnergyPoints:
        """Return the points of a range of detected widths."""
        inside = (self.fwhm_s >= narrowest_s) & (self.fwhm_s <= widest_s)
        return EnergyPoints(*(getattr(self, name)[inside] for name in self.__dataclass_fields__))

    def fit(self, integral: str, groups: NDArray[np.int64] | None = None) -> EnergyFit | None:
        """Fit line and curve; in bins of equally many points where there are no groups."""
        x = self.of(integral)
        if groups is None:
            groups = bins(x, max(1, min(24, x.size // 8)))
        return fit_energy(x, self.energy_j_per_v, groups)

    @classmethod
    def of_pulses(cls, pulses: Iterable[PulseEnergy], energies_j: Iterable[float]) -> EnergyPoints:
        """Collect the pulses that have a fit; `energies_j` are at the reference gains."""
        rows = [
            (
                pulse.gaussian_v_s / pulse.amplitude_v,
                pulse.window_v_s / pulse.amplitude_v,
                pulse.rectified_v_s / pulse.amplitude_v,
                energy_j / pulse.amplitude_v,
                pulse.fwhm_s,
                pulse.amplitude_v,
            )
            for pulse, energy_j in zip(pulses, energies_j, strict=True)
            if pulse.usable
        ]
        return cls(*np.array(rows, dtype=np.float64).reshape(-1, 6).T)


def energy_per_volt_second(scene: Scene) -> float:
    """Return the optical energy that makes 1 V s at the cut, J: E_ph / (q eps_qe M R_f)."""
    return photon_energy_j(scene.laser.wavelength_m) / volts_per_photon_rate(scene.detector)


def at_reference(scene: Scene, gain: float) -> float:
    """Return the factor of an energy, (M / 48.4) (G / 5.19), that takes it to the reference gains."""
    return multiplication(scene.detector) / REFERENCE_M * gain / REFERENCE_GAIN


def finder_of(receiver: KnownReceiver, window_samples: int) -> RangeFinder:
    """Return a range finder that keeps one candidate."""
    return RangeFinder(TemplateBank(receiver.sample_interval_s), 1, window_samples, compiled=False)


def played_points(
    pulses: Sequence[SampledPulse], receiver: KnownReceiver, scene: Scene, finder: RangeFinder
) -> list[EnergyPoints]:
    """Return what a known receiver of gain 1 makes of each pulse, at `PHASES` places between two samples."""
    factor = energy_per_volt_second(scene) * at_reference(scene, 1.0)
    found = []
    for pulse in pulses:
        interval_s = receiver.true_interval_s
        volts, area_v_s = np.asarray(pulse.volts), played_area_v_s(pulse)
        middle_s = pulse.start_s + int(np.argmax(np.abs(volts))) / pulse.sample_rate_hz
        first_s = middle_s - _SAMPLES // 2 * interval_s
        energies = []
        for phase in range(PHASES):
            times_s = first_s + (phase / PHASES + np.arange(_SAMPLES)) * interval_s
            samples = response(
                volts,
                pulse.sample_rate_hz,
                pulse.start_s,
                pulse.interpolation,
                (*pulse.poles, *receiver.poles),
                times_s,
                receiver.zeros,
            )
            # The receiver's clock is believed, as it is in a measured window.
            energies.append(_at_peak(samples, receiver.sample_interval_s, finder))
        found.append(EnergyPoints.of_pulses(energies, [factor * area_v_s] * PHASES))
    return found


def played_area_v_s(pulse: SampledPulse) -> float:
    """Return the area of a played pulse, V s, exactly; poles of unit gain at 0 Hz do not change it."""
    step_s = 1 / pulse.sample_rate_hz
    if pulse.interpolation == "hold":
        return float(pulse.volts.sum()) * step_s
    return float(pulse.volts[:-1].sum() + pulse.volts[1:].sum()) * step_s / 2


def plane_points(scene: Scene, receiver: KnownReceiver, finder: RangeFinder) -> EnergyPoints:
    """Return echoes of planes, from level ground to one that makes them 110 ns wide, in closed form."""
    pulse = pulse_shape(scene.laser)
    kernel = Kernel(pulse, receiver.poles, receiver.zeros, volts_per_photon_rate(scene.detector))
    factor = photon_energy_j(scene.laser.wavelength_m) * at_reference(scene, 1.0)
    interval_s = receiver.sample_interval_s
    energies = []
    for width_s in np.linspace(NARROWEST_S, WIDEST_S, _PLANES):
        # Nearly, since squares of widths add: evenly spread behind the filter.
        spread = kernel.widened(math.sqrt(width_s**2 - NARROWEST_S**2) / FWHM_OF_SIGMA)
        for phase in range(PHASES):
            times_s = (np.arange(_SAMPLES) - _SAMPLES // 2 + phase / PHASES) * interval_s
            energies.append(_at_peak(spread.exact(times_s), interval_s, finder))
    return EnergyPoints.of_pulses(energies, [factor] * len(energies))


def footprint_points(
    scene: Scene, receiver: KnownReceiver, finder: RangeFinder, altitudes_m: Sequence[float], footprints: int
) -> EnergyPoints:
    """Return echoes of footprints at random places of a terrain model.

    Parameters
    ----------
    scene : Scene
        Its ground is a terrain model, from a file or made. Its altitude does not count.
    receiver : KnownReceiver
        Its filter takes the place of the scene's.
    finder : RangeFinder
        Of that receiver.
    altitudes_m : sequence of float
        At each of which there are so many footprints, m.
    footprints : int
        Drawn by the scene's seed, so that all altitudes see the same places.

    Raises
    ------
    RefusedInput
        As `refuse_ground`.
    """
    electronics = structs.replace(
        scene.electronics,
        cutoff_hz=receiver.cutoff.value,
        order=receiver.order,
        highpass_hz=receiver.highpass_hz,
    )
    interval_s = receiver.sample_interval_s
    surface, pulses, energies = None, [], []
    for altitude_m in altitudes_m:
        chain = Chain(structs.replace(scene, altitude_m=altitude_m, electronics=electronics), surface=surface)
        surface = chain.surface
        refuse_ground(chain)
        rng = Draws(scene.seed, 0).stream("footprints")
        centres_m, first_s = _places(surface.relief, chain.plan.radius_m, footprints, interval_s, rng)
        volts, lit = _echoes(chain, centres_m, first_s, interval_s)
        optical_j = chain.light_kernel.gain * photon_energy_j(scene.laser.wavelength_m)
        for row, share in zip(volts, lit, strict=True):
            pulses.append(_at_peak(row, interval_s, finder))
            energies.append(float(share) * optical_j * at_reference(scene, 1.0))
    return EnergyPoints.of_pulses(pulses, energies)


def _at_peak(volts: NDArray[np.float64], interval_s: float, finder: RangeFinder) -> PulseEnergy:
    """Integrate a pulse without noise, which needs no search."""
    half = finder.correlation_window_samples // 2
    first = min(max(int(np.argmax(volts)) - half, 0), volts.size - 2 * half)
    return pulse_energy(volts, interval_s, finder, first)


def refuse_ground(chain: Chain) -> None:
    """Refuse a chain whose ground has no places to choose footprints from.

    Raises
    ------
    RefusedInput
        Ground that is no terrain model, or light that a field of view or a law of scattering weighs.
    """
    if not isinstance(chain.surface.relief, Grid) or chain.has_factor:
        raise RefusedInput(
            f"footprints on a surface of kind {chain.scene.surface.kind}: a terrain model is needed (dtm, "
            "fractal, multifractal), with a constant radiation factor and a field of view wider than the beam"
        )


def _echoes(
    chain: Chain, centres_m: NDArray[np.float64], first_s: NDArray[np.float64], interval_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Samples and energies of footprints: in a row where posts are dense enough, else one by one.

    One by one the beam is pointed there, whose slant tilts the ground by at most a milliradian.
    """
    scene = chain.scene
    place = scene.laser, scene.altitude_m, chain.plan
    try:
        row = GridEcho(chain.surface, *place, chain.kernel, interval_s, _SAMPLES)
    except RefusedInput:
        volts, lit = np.zeros((len(centres_m), _SAMPLES)), np.zeros(len(centres_m))
        for k, (centre_m, begin_s) in enumerate(zip(centres_m, first_s, strict=True)):
            x, y = np.arctan(centre_m / scene.altitude_m)
            light = delays(chain.surface, *place, (float(x), float(y)), align_s=float(begin_s))
            lit[k] = light.total
            volts[k] = echo(chain.kernel, light, float(begin_s), interval_s, _SAMPLES)
        return volts, lit
    return row.samples(centres_m, first_s)


def _places(
    relief: object, radius_m: float, count: int, interval_s: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw centres a footprint away from the edges, and first samples with the echo in the middle."""
    assert isinstance(relief, Grid)
    low = np.array([relief.x_min_m, relief.y_min_m])
    span = relief.spacing_m * (np.array(relief.values.shape[::-1]) - 1)
    room = np.maximum(span / 2 - radius_m - 2 * relief.spacing_m, 0.0)
    draws = rng.uniform(-1.0, 1.0, (count, 2))
    centres_m = low + span / 2 + draws * room
    heights_m, _ = relief.sample(centres_m[:, 0], centres_m[:, 1])
    phases = rng.uniform(0.0, 1.0, count)
    first_s = -2 * heights_m / SPEED_OF_LIGHT_M_PER_S + (phases - _SAMPLES // 2) * interval_s
    return centres_m, first_s
