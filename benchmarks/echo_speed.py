"""From footprint to samples: how long, how exact, and how long a straightforward program takes for the same.

    python benchmarks/echo_speed.py
    python benchmarks/echo_speed.py --pixels 35 --shots 200

The straightforward program is what one would write at once with NumPy and SciPy: pixels of a square, a
histogram of delays on 0.1 ns, its convolution with the pulse, a digital Butterworth filter, and every 125th
value. Both see the same ground, the same number of pixels and the same pulse, on one thread. Errors are
max |dV| / peak on a plane of 10 degrees against Fourier integration. The figures are of this machine; nothing
asserts them.
"""

from __future__ import annotations

import argparse
import math
import platform
import statistics
import time
from collections.abc import Callable

from belahil._blas import pin_to_one_thread

pin_to_one_thread()

import numpy as np  # noqa: E402
import scipy  # noqa: E402
from scipy.signal import butter, lfilter  # noqa: E402

from belahil import butterworth  # noqa: E402
from sim.beam import beam_sigma_m  # noqa: E402
from sim.echo import GridEcho  # noqa: E402
from sim.footprint_plan import FootprintPlan  # noqa: E402
from sim.kernel import Kernel  # noqa: E402
from sim.laser import Laser, pulse_shape  # noqa: E402
from sim.loops import loops  # noqa: E402
from sim.reference import plane_echo  # noqa: E402
from sim.terrain import Surface  # noqa: E402
from sim.terrain_grid import Grid  # noqa: E402

SPEED_OF_LIGHT = 299792458.0
ALTITUDE_M = 1e6
POSTS_M = 1.5
INTERVAL_S, COUNT = 12.5e-9, 42
FINE_S, FINE_COUNT = 0.1e-9, 8000
LEAD_S = 200e-9
LASER = Laser(divergence_rad=50e-6)
PULSE = pulse_shape(LASER)
SIGMA_M = beam_sigma_m(LASER, ALTITUDE_M)[0]
SLOPE = math.tan(math.radians(10.0))


def fractal(size: int = 512) -> np.ndarray:
    """Heights with a Hurst exponent of 0.8, on a slope of 10 degrees."""
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(size, POSTS_M), np.fft.fftfreq(size, POSTS_M)))
    k[0, 0] = np.inf
    z = np.fft.ifft2(np.fft.fft2(np.random.default_rng(1).standard_normal((size, size))) * k**-1.8).real
    z *= 0.5 / np.std(z[:, 7:] - z[:, :-7])
    return z - z.mean() + SLOPE * POSTS_M * (np.arange(size) - size // 2)


class Straightforward:
    def __init__(self, heights_m: np.ndarray, pixels: int) -> None:
        self.heights_m, self.pixels = heights_m, pixels
        self.edges_s = np.arange(FINE_COUNT + 1) * FINE_S
        times_s = np.arange(-12e-9, 48e-9, FINE_S)
        self.zero = round(12e-9 / FINE_S)
        self.pulse = PULSE.density(times_s)
        self.b, self.a = butter(3, 19e6, fs=1 / FINE_S)

    def samples(self, x_m: float, y_m: float, first_s: float) -> np.ndarray:
        i0 = round(y_m / POSTS_M) - self.pixels // 2
        j0 = round(x_m / POSTS_M) - self.pixels // 2
        z = self.heights_m[i0 : i0 + self.pixels, j0 : j0 + self.pixels]
        y = POSTS_M * np.arange(i0, i0 + self.pixels) - y_m
        x = POSTS_M * np.arange(j0, j0 + self.pixels) - x_m
        square = x[None, :] ** 2 + y[:, None] ** 2
        weights = np.exp(-square / (2 * SIGMA_M**2)) * POSTS_M**2 / (2 * math.pi * SIGMA_M**2)
        delay_s = (square / ALTITUDE_M - 2 * z) / SPEED_OF_LIGHT
        light, _ = np.histogram(delay_s - first_s + LEAD_S, bins=self.edges_s, weights=weights)
        rate = np.convolve(light, self.pulse)[self.zero : self.zero + FINE_COUNT]
        volts = lfilter(self.b, self.a, rate)
        # A bin's light counts from its middle; the nearest value is that of the bin before the sample.
        begin = round(LEAD_S / FINE_S)
        return np.asarray(volts[begin :: round(INTERVAL_S / FINE_S)][:COUNT])


def ours(heights_m: np.ndarray, pixels: int, bins_per_sample: int) -> GridEcho:
    # A disc of as many pixels as the square.
    reach = POSTS_M * pixels / math.sqrt(math.pi) / SIGMA_M
    plan = FootprintPlan(
        "grid", 1e-4, 0.2, reach, reach * SIGMA_M, POSTS_M, INTERVAL_S / bins_per_sample, pixels**2
    )
    surface = Surface("dtm", relief=Grid(heights_m, POSTS_M, 0.0, 0.0), albedo=1.0)
    kernel = Kernel(PULSE, butterworth.poles(19e6, 3))
    return GridEcho(surface, LASER, ALTITUDE_M, plan, kernel, INTERVAL_S, COUNT)


def microseconds(run: Callable[[int], object], shots: int) -> float:
    """Median time of a shot."""
    times = []
    for k in range(shots):
        begin = time.perf_counter()
        run(k)
        times.append(time.perf_counter() - begin)
    return 1e6 * statistics.median(times)


def plane_error(samples: Callable[[np.ndarray, float, float, float], np.ndarray]) -> float:
    """max |dV| / peak of a plane, worst of places between posts and samples."""
    size = 160
    heights_m = np.tile(SLOPE * POSTS_M * (np.arange(size) - size // 2), (size, 1))
    kernel, worst = Kernel(PULSE, butterworth.poles(19e6, 3)), 0.0
    for part in (0.0, 0.3, 0.5):
        x = y = POSTS_M * (size // 2 + part)
        below_s = -2 * SLOPE * POSTS_M * part / SPEED_OF_LIGHT
        first_s = below_s - (120 + 3 * part) * 1e-9
        # The ground seen from above the beam's centre is a plane through a point off the origin.
        times_s = first_s + INTERVAL_S * np.arange(COUNT) - below_s
        true = plane_echo(kernel, (SLOPE, 0.0), (0.0, 0.0), SIGMA_M, ALTITUDE_M, times_s)
        worst = max(worst, float(np.abs(samples(heights_m, x, y, first_s) - true).max() / true.max()))
    return worst


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pixels", type=int, nargs="*", default=[35, 67])
    parser.add_argument("--shots", type=int, default=100)
    chosen = parser.parse_args()
    print(
        f"python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, one thread"
    )
    print(f"loops: {loops().__name__}")  # type: ignore[attr-defined]
    heights_m = fractal()
    draw = np.random.default_rng(3)
    places_m = draw.uniform(120, 640, (chosen.shots, 2))
    nearest = np.rint(places_m / POSTS_M).astype(int)
    first_s = -2 * heights_m[nearest[:, 1], nearest[:, 0]] / SPEED_OF_LIGHT - 150e-9
    print("pixels  straightforward          batch                    one by one")
    for pixels in chosen.pixels:
        # Where the square is smaller than the beam, longer bins lose nothing beside it.
        bins = 5 if pixels < 50 else 10
        plain, fast = Straightforward(heights_m, pixels), ours(heights_m, pixels, bins)
        fast.samples(places_m, first_s)
        slow_us, batch_us, single_us = [], [], []
        for _ in range(5):  # in turn, so that both meet the same machine
            slow_us.append(
                microseconds(lambda k, p=plain: p.samples(*places_m[k], first_s[k]), chosen.shots)  # type: ignore[misc]
            )
            batch_us.append(
                microseconds(lambda _, f=fast: f.samples(places_m, first_s), 20) / chosen.shots  # type: ignore[misc]
            )
            single_us.append(
                microseconds(
                    lambda k, f=fast: f.samples(places_m[k : k + 1], first_s[k : k + 1]),  # type: ignore[misc]
                    chosen.shots,
                )
            )
        slow, batch, single = map(statistics.median, (slow_us, batch_us, single_us))
        print(
            f"{pixels:2d} x {pixels:2d}  {slow:7.1f} us              {batch:6.2f} us  x {slow / batch:5.1f}"
            f"       {single:6.2f} us  x {slow / single:5.1f}"
        )
        errors = (
            plane_error(lambda z, x, y, t, n=pixels: Straightforward(z, n).samples(x, y, t)),  # type: ignore[misc]
            plane_error(
                lambda z, x, y, t, n=pixels, b=bins: ours(z, n, b).samples(  # type: ignore[misc]
                    np.array([[x, y]]), np.array([t])
                )[0][0]
            ),
        )
        print(f"  error   {errors[0]:.1e}                 {errors[1]:.1e}")


if __name__ == "__main__":
    main()
