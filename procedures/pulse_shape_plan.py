"""The plan of a campaign of played echoes, as values: its cases, their shots, their silent windows."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from belahil.stimuli import NoSignal
from belahil.values import WindowRequest
from procedures.plans import PlannedShot

if TYPE_CHECKING:
    from belahil.config import BenchConfig
    from belahil.stimuli import SampledPulse
    from procedures.known_receiver import KnownReceiver
    from procedures.playable import Playable
    from procedures.pulse_echoes import Echo

ShapeStatus = Literal[
    "ok",
    "no_pulse",
    "echo_too_faint",
    "pulse_below_noise",
    "not_converged",
    "saturated",
    "equal_windows",
    "mixed_gain_codes",
    "another_receiver",
    "noise_clipped",
    "noise_no_signal",
    "noise_below_dither",
    "too_few_samples",
]
"""What an echo may say in place of a verdict; `docs/pulse-shape.md` tells what each means."""

LONGEST_STRETCH = 64
"""Samples round a pulse that are compared, at most: correlation windows have 42 or 64."""


@dataclass(frozen=True, slots=True)
class ShapeCase:
    """One echo of the plan.

    Parameters
    ----------
    name : str
        Of its scene and ground, or of a recorded pulse.
    gain_code : int or None
        Of its windows.
    sample_count : int
        Of each window.
    delay_s : float
        From the trigger to the first sample, s.
    members : tuple of int
        Indexes of its shots; none where it cannot be played.
    pulses : tuple of Playable
        One for all shots or one for each; empty for recorded windows, which hold what was played.
    status : str
        "ok", "no_pulse" where there is no light, "echo_too_faint" for this generator and attenuator, or
        "mixed_gain_codes".
    echo : Echo or None
        None for recorded windows.
    """

    name: str
    gain_code: int | None
    sample_count: int
    delay_s: float
    members: tuple[int, ...]
    pulses: tuple[Playable, ...] = ()
    status: ShapeStatus = "ok"
    echo: Echo | None = None

    def pulse_of(self, place: int) -> Playable | None:
        """Return the pulse of a member by its place among them; None for recorded windows."""
        return self.pulses[place % len(self.pulses)] if self.pulses else None


@dataclass(frozen=True, slots=True)
class PulseShapePlan:
    """Every shot of a campaign: silent windows of each gain code, then echo by echo.

    Parameters
    ----------
    cases : tuple of ShapeCase
        Echoes.
    dark : tuple of (int or None, tuple of int)
        Gain codes with the indexes of their silent windows.
    dark_samples : int
        Of a silent window.
    converters, bits : int
        Of the receiver.
    shot_noise : {"absent", "inside"}
        As in the options.
    receiver : KnownReceiver or None
        As in the options.
    advised_db : float or None
        Attenuation that would serve all echoes; None where no single one does, or nothing is known of the
        generator.
    """

    cases: tuple[ShapeCase, ...]
    dark: tuple[tuple[int | None, tuple[int, ...]], ...]
    dark_samples: int
    converters: int
    bits: int
    shot_noise: Literal["absent", "inside"]
    receiver: KnownReceiver | None = None
    advised_db: float | None = None

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """In the order of their indexes; only echoes that can be played have any."""
        found = [
            PlannedShot(WindowRequest(shot, code, self.dark_samples), NoSignal())
            for code, members in self.dark
            for shot in members
        ]
        for case in self.cases:
            for place, shot in enumerate(case.members):
                pulse = case.pulse_of(place)
                assert pulse is not None
                request = WindowRequest(shot, case.gain_code, case.sample_count, case.delay_s)
                found.append(PlannedShot(request, pulse.stimulus))
        return tuple(found)

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint; of pulses their digest."""
        cases = [
            {
                "name": case.name,
                "gain_code": case.gain_code,
                "sample_count": case.sample_count,
                "delay_s": case.delay_s,
                "members": list(case.members),
                "pulses": [_digest(one.stimulus) for one in case.pulses],
                "status": case.status,
            }
            for case in self.cases
        ]
        known = None if self.receiver is None else asdict(self.receiver)
        return {
            "cases": cases,
            "dark": [[code, list(members)] for code, members in self.dark],
            "dark_samples": self.dark_samples,
            "shot_noise": self.shot_noise,
            "receiver": known,
        }


def _digest(pulse: SampledPulse) -> str:
    words = f"{pulse.sample_rate_hz!r} {pulse.start_s!r} {pulse.interpolation} {pulse.poles!r}"
    return hashlib.sha256(pulse.volts.tobytes() + words.encode()).hexdigest()


def trigger_late_s(config: BenchConfig) -> float:
    """Return when the receiver's trigger comes on the time axis of a pulse, as the bench file has it, s."""
    return config.bench.trigger_delay_s * (1 if config.bench.trigger == "generator" else -1)
