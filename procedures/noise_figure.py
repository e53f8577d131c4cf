"""The figure of a noise measurement: rms against gain code, and the spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

if TYPE_CHECKING:
    from procedures.dark_noise import DarkNoise


def noise_figure(found: dict[int | None, DarkNoise]) -> Figure:
    """Draw noise against gain code, and noise density against frequency."""
    figure = Figure(figsize=(9.5, 4.0), layout="constrained")
    figure.set_label(
        "Left: analog noise at the converter by gain code (bars: two standard uncertainties) and the raw "
        "value, with quantization and converter offsets. Right: one-sided noise density at the converter, "
        "one line for each code."
    )
    left, right = figure.subplots(1, 2)
    codes = [0 if code is None else code for code in found]
    known = [(code, one.rms) for code, one in zip(codes, found.values(), strict=True) if one.rms is not None]
    left.errorbar(
        [code for code, _ in known],
        [1e3 * one.value for _, one in known],
        [2e3 * one.standard_uncertainty for _, one in known],
        fmt="o-",
        color="#0072B2",
        ms=4,
        lw=1,
        label="analog",
    )
    left.plot(
        codes,
        [1e3 * one.rms_total.value for one in found.values()],
        "x",
        color="#D55E00",
        ms=5,
        label="raw",
    )
    left.set_xlabel("gain code")
    left.set_ylabel("noise at the converter, mV rms")
    left.set_ylim(bottom=0)
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    left.legend(fontsize=9)
    shades = colormaps["viridis"](np.linspace(0, 0.92, len(found)))
    for shade, (code, one) in zip(shades, found.items(), strict=True):
        density = 1e9 * np.sqrt(one.density_v2_per_hz[1:-1])
        label = "noise" if code is None else f"code {code}"
        right.plot(one.frequency_hz[1:-1] / 1e6, density, color=shade, lw=1, label=label)
    right.set_xlabel("frequency, MHz")
    right.set_ylabel("noise density, nV/√Hz")
    right.set_yscale("log")
    if len(found) > 6:
        # Room below the curves, which fill the rest.
        right.set_ylim(bottom=right.get_ylim()[0] / 4)
        right.legend(fontsize=7, ncols=4, loc="lower center")
    else:
        right.legend(fontsize=7)
    return figure
