"""Hidden transmitted pulses, drawn without the program's emulation: what an analysis must find again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from belahil import butterworth
from belahil.pulse_bound import filtered_noise_covariance
from belahil.stimuli import TransmittedPulse
from belahil.values import Estimate, RangeWindow, Shot
from procedures.known_receiver import KnownCode, KnownReceiver
from procedures.tx_definitions import CorrelationWindow
from procedures.tx_families import fit_hard
from procedures.tx_pulse import KnownPulse, OpticalPulse, tailed_pulse
from procedures.tx_response import CutResponses
from procedures.tx_windows import PulseWindows

INTERVAL_S = 12.5e-9
STEP_V = 2.0 / 4096
NOISE_V = 0.83e-3
ZERO = 2048


def receiver(cutoff_hz: float = 19e6, relative: float = 0.0, highpass_hz: float = 0.0) -> KnownReceiver:
    """What an analysis is told: one gain code, 4."""
    return KnownReceiver(
        "test",
        INTERVAL_S,
        2,
        12,
        2.0,
        3,
        Estimate(cutoff_hz, relative * cutoff_hz, "Hz"),
        (KnownCode(4, Estimate(5.19, 0.05), Estimate(NOISE_V, 0.05 * NOISE_V, "V")),),
        highpass=Estimate(highpass_hz, 0.0, "Hz") if highpass_hz else None,
    )


@dataclass(frozen=True)
class Truth:
    """A pulse, a cut, a filter, and how it is sampled.

    `width` is that of a soft edge; `snr` is the detected peak over the noise.
    """

    pulse: OpticalPulse
    threshold: float = 0.17
    width: float = 0.0
    cutoff_hz: float = 19e6
    highpass_hz: float = 0.0
    snr: float = 50.0
    jitter: float = 0.014
    baseline_v: tuple[float, float] = (0.0, 0.0)
    noise_v: float = NOISE_V

    def clean(self, arrivals_s: np.ndarray, samples: int, start: int) -> np.ndarray:
        """Volts without noise, detected peak 1, shape (n, samples); the pulse peaks at sample `start`."""
        poles = butterworth.poles(self.cutoff_hz, 3, self.highpass_hz)
        zeros = int(self.highpass_hz > 0)
        times_s = (np.arange(samples) - start) * INTERVAL_S - arrivals_s[:, None]
        fine_s = np.linspace(-20e-9, 150e-9, 1701)
        peak = self._response(poles, zeros, fine_s).max()
        return self._response(poles, zeros, times_s.ravel()).reshape(times_s.shape) / peak

    def _response(self, poles: tuple[complex, ...], zeros: int, times_s: np.ndarray) -> np.ndarray:
        made = CutResponses(self.pulse, poles, zeros, times_s)
        if not self.width:
            return made.exact(self.threshold)
        nodes, weights = np.polynomial.legendre.leggauss(24)
        levels = self.threshold + self.width / 2 * nodes
        return 0.5 * np.sum(
            [weight * made.exact(float(level)) for level, weight in zip(levels, weights, strict=True)], axis=0
        )

    def shots(self, number: int, seed: int, samples: int = 160, start: int = 40) -> list[Shot]:
        """Windows with coloured noise and quantization."""
        rng = np.random.default_rng(seed)
        arrivals_s = rng.uniform(0, 1, number) * INTERVAL_S
        peaks_v = self.snr * NOISE_V * (1 + self.jitter * rng.standard_normal(number))
        poles = butterworth.poles(self.cutoff_hz, 3, self.highpass_hz)
        zeros = int(self.highpass_hz > 0)
        volts = self.clean(arrivals_s, samples, start) * peaks_v[:, None]
        if self.noise_v:
            covariance = filtered_noise_covariance(poles, zeros, INTERVAL_S, samples, self.noise_v)
            root = np.linalg.cholesky(covariance + 1e-12 * self.noise_v**2 * np.eye(samples))
            volts += rng.standard_normal((number, samples)) @ root.T
        volts[:, 0::2] += self.baseline_v[0]
        volts[:, 1::2] += self.baseline_v[1]
        return as_shots(volts)


def as_shots(volts: np.ndarray, code: int | None = 4) -> list[Shot]:
    """Digitize rows of volts."""
    counts = np.rint(volts / STEP_V) + ZERO
    clipped = np.count_nonzero((counts < 0) | (counts > 4095), axis=1)
    counts = np.clip(counts, 0, 4095).astype(np.int16)
    return [
        Shot(
            TransmittedPulse(),
            RangeWindow(row, STEP_V, float(ZERO), INTERVAL_S, 0.0, code, shot, int(lost)),
            "2026-01-01T00:00:00.000+00:00",
        )
        for shot, (row, lost) in enumerate(zip(counts, clipped, strict=True))
    ]


@dataclass(frozen=True)
class Case:
    """A hidden truth, what an analysis is told, and how many windows it gets."""

    kind: str
    truth: Truth
    known_pulse: KnownPulse
    known_receiver: KnownReceiver
    windows: int

    @property
    def delay_s(self) -> float:
        """The true delay: centre of the fitted Gaussian minus peak of the light."""
        truth = self.truth
        gate = CorrelationWindow(INTERVAL_S, 42)
        poles = butterworth.poles(truth.cutoff_hz, 3, truth.highpass_hz)
        response = CutResponses(truth.pulse, poles, int(truth.highpass_hz > 0), gate.times_s)
        found = gate.centre_s(response.exact(truth.threshold))
        assert found is not None
        return found

    def expected_gain(self, found: PulseWindows) -> float:
        """Chi-square that the best hard cut of the told pulse leaves of the true shape, without noise."""
        windows = found.likelihood(self.known_receiver, "common")
        assert found.grid is not None
        responses = CutResponses(
            self.known_pulse.pulse(), self.known_receiver.poles, self.known_receiver.zeros,
            found.grid.times_s,
        )  # fmt: skip
        arrivals_s = np.arange(16) / 16 * INTERVAL_S
        shape = self.truth.clean(arrivals_s, found.grid.count, found.grid.before)
        white = self.truth.snr * NOISE_V * shape @ windows.whitener.T
        clean = replace(windows, white=white, odd=np.zeros(16, bool))
        best = fit_hard(clean, responses, lambda one: float(clean.fit(one).explained.sum()))
        return self.windows / 16 * float(np.sum(white**2) - best.merit)


def case(number: int, kind: str, known_exactly: bool = False) -> Case:
    """Draw a case: threshold 5 to 40 %, cut-off 15 to 25 MHz, tail 3 to 20 ns, SNR 50, 100 to 400 windows.

    ``inside``: a hard cut of a tailed pulse; cut-off, fall and rise are told wrong by their uncertainties.
    ``table``: the same, and the power is bent by 1 to 20 % rms in a way that no parameter has. ``ac``: the
    same as inside, behind an AC coupling of 0.5 to 300 kHz that nobody told.
    """
    rng = np.random.default_rng([20261129, number])
    cutoff_hz, tail_s = rng.uniform(15e6, 25e6), 3e-9 * (20 / 3) ** rng.uniform()
    fwhm_s, threshold, windows = (
        rng.uniform(4.5e-9, 6.5e-9),
        rng.uniform(0.05, 0.4),
        int(rng.integers(100, 401)),
    )
    relative = 0.0 if known_exactly else 3e-4 * (0.01 / 3e-4) ** rng.uniform()
    fall, rise = (0.0, 0.0) if known_exactly else rng.uniform(0.01, 0.05, 2)
    off = rng.standard_normal(3) * (relative, fall, rise)
    size = 0.01 * 20 ** rng.uniform() if kind == "table" else 0.0
    told = KnownPulse(fwhm_s * (1 + off[2]), tail_s * (1 + off[1]), float(fall), float(rise), size)
    pulse = tailed_pulse(fwhm_s, tail_s)
    if size:
        pulse = bent(pulse, rng, size)
    highpass_hz = 500.0 * 600 ** rng.uniform() if kind == "ac" else 0.0
    return Case(
        kind,
        Truth(pulse, threshold, cutoff_hz=cutoff_hz, highpass_hz=highpass_hz),
        told,
        receiver(cutoff_hz * (1 + off[0]), relative),
        windows,
    )


def bent(pulse: OpticalPulse, rng: np.random.Generator, size: float) -> OpticalPulse:
    """Multiply a pulse by a smooth random function, `size` its rms; the peak is 1 at 0 again."""
    nodes_s = np.arange(-24e-9, 200e-9, 4e-9) + rng.uniform(0, 4e-9)
    bend = np.interp(pulse.times_s, nodes_s, size * rng.standard_normal(nodes_s.size))
    relative = pulse.relative * np.exp(bend)
    top = int(relative.argmax())
    return OpticalPulse(-top * pulse.step_s, pulse.step_s, relative / relative[top])
