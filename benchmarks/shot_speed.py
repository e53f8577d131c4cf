"""A whole shot, from footprint to four refined candidates: ours in rows, and a straightforward program.

    python benchmarks/shot_speed.py
    python benchmarks/shot_speed.py --shots 3000     # for parity of spread and false detections

Both see one terrain from 1000 km, draw 16 064 independent noisy samples a shot, search them with Gaussian
templates, and refine four candidates; signal shot noise is off in both, on one thread. The straightforward
program correlates ten templates by `scipy.signal.fftconvolve` ("default") or `numpy.convolve` ("stronger"),
and fits with `curve_fit`; it sums a square of 35 x 35 pixels, which ends at two standard deviations of the
beam, where ours sums all within four; "same" sums a disc of about as many. Its noise is white, ours has
passed the receiver's filter: both have the same density in the band. White noise is not the same task: what
it has above the band misleads narrow templates and fits. "filtered" is "stronger" whose noise has passed a
third-order Butterworth low-pass as well, so spread and false detections are to be compared with that.

False is a shot none of whose candidates is within `LEAST_M` of the median. The spread is half of what holds
the middle 68.27 % of the others: one shot in some 300 has by chance a noise peak a few metres from the ground
instead, and one such can double the standard deviation of a hundred. The figures are of this machine;
nothing asserts them.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
import warnings

from belahil._blas import pin_to_one_thread

pin_to_one_thread()

import numpy as np  # noqa: E402
from echo_speed import ALTITUDE_M, COUNT, INTERVAL_S, SPEED_OF_LIGHT, Straightforward, fractal  # noqa: E402
from msgspec import structs  # noqa: E402
from scipy.optimize import OptimizeWarning, curve_fit  # noqa: E402
from scipy.signal import butter, fftconvolve, lfilter  # noqa: E402

from sim.accuracy import Accuracy  # noqa: E402
from sim.chain import Chain  # noqa: E402
from sim.scene import load_scene  # noqa: E402
from sim.shot_rows import ShotRows  # noqa: E402
from sim.terrain import Surface  # noqa: E402
from sim.terrain_grid import Grid  # noqa: E402

warnings.simplefilter("ignore", OptimizeWarning)
SIZE, START, PIXELS = 16_064, 8000, 35
REFLECTANCE, NOISE_V = 0.17, 1.4e-3
WIDTHS_S = np.linspace(20e-9, 110e-9, 10)
LEAST_M = 10.0
SAME_POSTS = 0.2
"""Tolerance at which ours sums about as many posts as the square has."""
COLOURED = math.sqrt(2 * 19.897e6 * INTERVAL_S)
"""Rms behind the filter, of noise as dense in its band as white noise of unit rms up to 40 MHz."""


def bell(t: np.ndarray, height: float, centre: float, fwhm: float) -> np.ndarray:
    return height * np.exp(-4 * math.log(2) * ((t - centre) / fwhm) ** 2)


class WholeShot:
    """What a scientist would write at once."""

    def __init__(self, heights_m: np.ndarray, volts: float, convolve, low_pass=None) -> None:  # type: ignore[no-untyped-def]
        self.echo, self.heights_m = Straightforward(heights_m, PIXELS), heights_m
        self.volts, self.convolve, self.low_pass = volts, convolve, low_pass
        self.draws = np.random.default_rng(7)
        self.templates = []
        for width_s in WIDTHS_S:
            reach = math.ceil(1.5 * width_s / INTERVAL_S)
            one = bell(INTERVAL_S * np.arange(-reach, reach + 1), 1.0, 0.0, width_s)
            self.templates.append(one / math.sqrt(one @ one))

    def arrivals_s(self, x_m: float, y_m: float, first_s: float) -> list[float]:
        """Return the candidates from the first sample of the echo at `first_s` on."""
        window = NOISE_V * self.draws.standard_normal(SIZE)
        if self.low_pass:
            window = lfilter(*self.low_pass, window)
        window[START : START + COUNT] += self.volts * self.echo.samples(x_m, y_m, first_s)
        scores = np.array([self.convolve(window, one[::-1], mode="same") for one in self.templates])
        best, found = scores.max(axis=0), []
        for _ in range(4):
            at = int(np.argmax(best))
            found.append((at, WIDTHS_S[int(np.argmax(scores[:, at]))]))
            best[max(0, at - 21) : at + 22] = -np.inf
        return [self.refined(window, at, width_s) + first_s - START * INTERVAL_S for at, width_s in found]

    def refined(self, window: np.ndarray, at: int, width_s: float) -> float:
        low = min(max(0, at - 21), SIZE - 42)
        t_ns, part = 1e9 * INTERVAL_S * np.arange(42), 1e3 * window[low : low + 42]
        begin = (max(part[at - low], 1e-3), t_ns[at - low], 1e9 * width_s)
        try:
            fitted, _ = curve_fit(bell, t_ns, part, p0=begin, maxfev=200)
        except RuntimeError:
            fitted = begin
        return low * INTERVAL_S + 1e-9 * float(fitted[1])


def chain_over(heights_m: np.ndarray, tolerance: float) -> Chain:
    scene = load_scene("fractal")
    laser = structs.replace(scene.laser, jitter_rad=(0.0, 0.0), energy_jitter=0.0, ellipticity=0.0)
    noise = structs.replace(scene.noise, shot=False, dark_rms_v=NOISE_V * COLOURED)
    surface = Surface("fractal", relief=Grid(heights_m, 1.5, 0.0, 0.0), albedo=REFLECTANCE)
    scene = structs.replace(scene, altitude_m=ALTITUDE_M, laser=laser, noise=noise)
    return Chain(scene, Accuracy(tolerance), surface)


def middle_spread(errors_m: np.ndarray) -> float:
    """Half of what holds the middle 68.27 %: the standard deviation of a normal distribution."""
    low, high = np.quantile(errors_m, (0.15866, 0.84134))
    return float(high - low) / 2


def quality(errors_m: np.ndarray) -> str:
    """Spread of the true detections, and share of the false ones, each with its standard error."""
    true = errors_m[np.abs(errors_m - np.median(errors_m)) < LEAST_M]
    share, n, draws = 1 - true.size / errors_m.size, errors_m.size, np.random.default_rng(1)
    again = [middle_spread(draws.choice(true, true.size)) for _ in range(400)]
    return (
        f"spread {middle_spread(true):.3f} +- {np.std(again):.3f} m, "
        f"false {100 * share:.1f} +- {100 * math.sqrt(max(share * (1 - share), 1 / n) / n):.1f} %"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shots", type=int, default=200)
    shots = parser.parse_args().shots
    heights_m = fractal()
    chain = chain_over(heights_m, 1e-3)
    few = chain_over(heights_m, SAME_POSTS)
    print(f"ours: {chain.plan.pixels} posts; with as many as the square of {PIXELS**2}: {few.plan.pixels}")
    ours_of = {"ours": ShotRows(chain), "same": ShotRows(few)}
    volts = chain.kernel.gain * REFLECTANCE * chain.scene.gain
    places_m = np.random.default_rng(3).uniform(120, 640, (shots, 2))
    post = np.rint(places_m / 1.5).astype(int)
    ground_s = -2 * heights_m[post[:, 1], post[:, 0]] / SPEED_OF_LIGHT
    plain = {
        "default": WholeShot(heights_m, volts, fftconvolve),
        "stronger": WholeShot(heights_m, volts, np.convolve),
        "filtered": WholeShot(heights_m, volts, np.convolve, butter(3, 19e6, fs=1 / INTERVAL_S)),
    }
    numbers = np.arange(shots)
    for rows in ours_of.values():
        rows.candidates(numbers[:64], places_m[:64])
    times: dict[str, list[float]] = {name: [] for name in (*ours_of, *plain)}
    errors: dict[str, np.ndarray] = {}
    for _ in range(5):  # in turn, so that all meet the same machine
        for name, rows in ours_of.items():
            begin = time.perf_counter()
            found = rows.candidates(numbers, places_m)
            times[name].append((time.perf_counter() - begin) / shots)
            off = found.arrival_s - ground_s[:, None]
            # What was not found is as wrong as can be.
            off[np.arange(off.shape[1]) >= found.found[:, None]] = 1.0
            errors[name] = np.take_along_axis(off, np.abs(off).argmin(axis=1)[:, None], 1)[:, 0]
        for name, program in plain.items():
            errors_s, spent = [], []
            for k in range(shots if name not in errors else min(shots, 100)):
                begin = time.perf_counter()
                arrivals = program.arrivals_s(*places_m[k], ground_s[k] - 150e-9)
                spent.append(time.perf_counter() - begin)
                errors_s.append(min((t - ground_s[k] for t in arrivals), key=abs))
            times[name].append(statistics.median(spent))
            errors.setdefault(name, np.array(errors_s))
    ours = statistics.median(times["same"])
    for name, row in times.items():
        middle = statistics.median(row)
        text = quality(errors[name] * SPEED_OF_LIGHT / 2)
        print(f"{name:9s} {1e6 * middle:8.1f} us a shot   x {middle / ours:5.1f}   {text}")


if __name__ == "__main__":
    main()
