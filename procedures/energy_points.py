"""From the windows of played pulses to points of a calibration, each with its status."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.stimuli import SampledPulse
from procedures.clipping import with_clipping
from procedures.energy_fit import clusters
from procedures.energy_model import (
    EnergyPoints,
    at_reference,
    energy_per_volt_second,
    finder_of,
    played_area_v_s,
)
from procedures.played_pulses import played_pulses
from procedures.pulse_energy import PulseEnergy, window_energy

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from belahil.receiver import ReceiverSpec
    from belahil.values import Shot
    from procedures.known_receiver import KnownReceiver
    from sim.rfm import RangeFinder
    from sim.scene import Scene


_SAME_INTERVAL = 1e-6
"""Relative difference of nominal sample intervals; the true ones differ by the clock's error."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """What the windows say.

    Parameters
    ----------
    shot : ndarray of int, shape (n,)
        Index in the plan; every array has a row for each window with a sampled pulse.
    pulses : tuple of PulseEnergy
        Found.
    area_v_s, width_s, peak_v : ndarray, shape (n,)
        Of the stimulus as played at the cut: area, V s; full width, s, and height, V, of the Gaussian of the
        same moments.
    energy_j : ndarray, shape (n,)
        Optical energy that such an area stands for, at the reference gains, J.
    gain : ndarray, shape (n,)
        Known gain at the window's gain code.
    group : ndarray of int, shape (n,)
        Pulses of one played width have one number.
    stimuli : tuple of SampledPulse
        One for each group.
    finder : RangeFinder
        Of the receiver.
    """

    shot: NDArray[np.int64]
    pulses: tuple[PulseEnergy, ...]
    area_v_s: NDArray[np.float64]
    width_s: NDArray[np.float64]
    peak_v: NDArray[np.float64]
    energy_j: NDArray[np.float64]
    gain: NDArray[np.float64]
    group: NDArray[np.int64]
    stimuli: tuple[SampledPulse, ...]
    finder: RangeFinder

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Windows with a pulse that has both integrals, shape (n,)."""
        return np.array([one.usable for one in self.pulses], dtype=np.bool_)

    @property
    def points(self) -> EnergyPoints:
        """The usable ones."""
        return EnergyPoints.of_pulses(self.pulses, self.energy_j)

    @property
    def counted(self) -> dict[str, int]:
        """How many windows have each status."""
        return dict(sorted(Counter(one.status for one in self.pulses).items()))


def read_shots(
    shots: Iterable[Shot],
    receiver: KnownReceiver,
    scene: Scene,
    preset: ReceiverSpec,
    converters: int,
    bits: int,
) -> Readings:
    """Find the pulse of each window of a sampled pulse.

    Parameters
    ----------
    shots : iterable of Shot
        Those of other stimuli are left out.
    receiver : KnownReceiver
        Its gains, and its sample interval.
    scene : Scene
        Its detector turns an area at the cut into an energy.
    preset : ReceiverSpec
        That the bench file names: length of a correlation window, and the interval it is counted in.
    converters, bits : int
        As in `procedures.pulse_energy.window_energy`.
    """
    finder = finder_of(receiver, preset.correlation_window_samples)
    intervals_s = (receiver.sample_interval_s, preset.digitizer.sample_interval_s)
    gains = {one.code: one.gain.value for one in receiver.codes}
    rows, pulses, stimuli = [], [], []
    for shot in shots:
        played = shot.played
        if not isinstance(played, SampledPulse):
            continue
        window = with_clipping(shot, bits).window
        area_v_s, parts = played_area_v_s(played), played_pulses(played)
        gain = gains.get(window.gain_code, 0.0)
        energy_j = area_v_s * energy_per_volt_second(scene) * at_reference(scene, gain)
        width_s, peak_v = (parts[0].width_s, parts[0].peak_v) if parts else (0.0, 0.0)
        rows.append((window.shot, area_v_s, width_s, peak_v, energy_j, gain))
        if any(abs(window.sample_interval_s / one - 1) > _SAME_INTERVAL for one in intervals_s):
            pulses.append(PulseEnergy("another_receiver"))
        elif not gain or not area_v_s > 0 or len(parts) != 1:
            pulses.append(PulseEnergy("not_known"))
        else:
            pulses.append(window_energy(window, finder, converters, bits))
        stimuli.append(played)
    table = np.array(rows, dtype=np.float64).reshape(-1, 6).T
    group = clusters(table[2])
    return Readings(
        shot=table[0].astype(np.int64),
        pulses=tuple(pulses),
        area_v_s=table[1],
        width_s=table[2],
        peak_v=table[3],
        energy_j=table[4],
        gain=table[5],
        group=group,
        stimuli=tuple(stimuli[int(np.argmax(group == one))] for one in range(group.max(initial=-1) + 1)),
        finder=finder,
    )
