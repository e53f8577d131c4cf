"""What a chain will do, told before it does it: stages, reasons, predicted error, cost."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from belahil.uncertainty import sized
from sim.chain_noise import ShotNoise
from sim.optical_echo import lasting_s

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim.chain import Chain


def told(chain: Chain) -> str:
    """Return the plan of a chain as lines to print."""
    return "\n".join([*_stages(chain), "", *_errors(chain), "", *_costs(chain)])


def _stages(chain: Chain) -> Iterator[str]:
    rows = [("stage", "place", "draws", "because")]
    rows += [(stage.name, stage.place, stage.draw or "-", stage.reason) for stage in chain.stages]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        yield "  ".join([*cells, row[3]])


def _errors(chain: Chain) -> Iterator[str]:
    plan = chain.plan
    yield f"predicted error of a sample, relative to the peak: {plan.predicted_error:.2g}"
    yield f"  of {plan.tolerance:g} that are allowed ({plan.method})"
    parts = {
        "edge of the beam": plan.beam_cut_error,
        "spacing of the pixels": plan.spacing_error,
        "time bins": plan.deposit_error,
        "curved wavefront": plan.curvature_error,
    }
    for name, error in parts.items():
        if error:
            yield f"  {name}: {error:.2g}"
    if plan.posts_m:
        yield (
            f"apart from it, relief between the posts of the terrain, {plan.posts_m:g} m apart: about "
            f"{chain.posts_error:.2g}; no tolerance makes it less"
        )


def _costs(chain: Chain) -> Iterator[str]:
    plan, samples = chain.plan, chain.correlation_window().sample_count
    yield "cost of a shot"
    if plan.method == "grid":
        bins = math.ceil(_spread_s(chain) / plan.bin_s)
        again = any(stage.name == "pointing jitter" for stage in chain.stages)
        yield (
            f"  footprint: {plan.pixels} pixels, {plan.pixel_m:.3g} m apart within {plan.radius_m:.3g} m"
            + ("; for each shot, since the beam moves" if again else "; once for all shots")
        )
        yield f"  echo: {bins} time bins of {sized(plan.bin_s, 's', 3)} for each of {samples} samples"
    else:
        yield f"  echo: closed form at {samples} samples"
    for noise in chain.light_noise:
        if isinstance(noise, ShotNoise):
            draws = math.ceil((_spread_s(chain) + _pulse_s(chain)) / noise.step_s)
            yield f"  shot noise: {draws} draws, {noise.steps} in a sample interval"
        else:
            yield f"  {noise.effect.replace('_', ' ')}: one draw a sample"
    whole = chain.receiver.spec.max_sample_count
    yield f"  the whole window of {whole} samples only where it is asked for"


def _spread_s(chain: Chain) -> float:
    begin_s, end_s = chain.echo().span_s
    return max(end_s - begin_s - _pulse_s(chain), 0.0)


def _pulse_s(chain: Chain) -> float:
    first_s, last_s = lasting_s(chain.light_kernel)
    return last_s - first_s
