"""The headline table of `belahil campaign range` to its accuracy: the fast way against whole shots.

    python benchmarks/campaign_range.py
    python benchmarks/campaign_range.py --shots 40      # a longer measurement of a whole shot

The accuracy: in all 24 cells a standard error of 1 % of the spread, and of 5 % of the probability of false
detection or 0.1 point. The fast way is run on two workers with as many sets as that takes. Whole shots by the
project's fastest path are timed on both workers in the same run, few and many: what is common is the start
of the workers and the ground, the rest the pace. How many the same accuracy takes follows, for the
probability, from the binomial distribution, and for the spread from the fourth moment of the errors of
detections. Their time is the start and that number times the pace.
The figures are of this machine; nothing asserts them.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from belahil._blas import pin_to_one_thread

pin_to_one_thread()

import numpy as np  # noqa: E402

from belahil.campaign_run import CampaignPlan  # noqa: E402
from belahil.chunks import Chunk, ChunkStore, run_chunks  # noqa: E402
from belahil.executors import local_workers  # noqa: E402
from procedures.campaign_range import RangeOptions  # noqa: E402
from procedures.range_chunks import correction  # noqa: E402
from procedures.range_parts import brute_chunks, levels_chunks, points, shared_chunks  # noqa: E402
from procedures.range_points import Collected, Drawn, collected  # noqa: E402
from procedures.range_scenes import base_scene, conditions, noise_scene  # noqa: E402
from procedures.range_table import Cell, cell_draws, cells  # noqa: E402
from sim.scene import as_toml  # noqa: E402

SPREAD, PFD, POINT, WORKERS = 0.01, 0.05, 0.001, 2
_FEW = 10


def of_children_s() -> float:
    """Processor time of the workers that have ended; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:
        return 0.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def timed(chunks: list[Chunk]) -> tuple[float, float, Collected]:
    """Compute chunks on two fresh workers; seconds, their processor time, and results."""
    with tempfile.TemporaryDirectory() as folder:
        store, workers = ChunkStore(Path(folder)), local_workers(WORKERS)
        begun, used = time.perf_counter(), of_children_s()
        run_chunks(chunks, store, workers.open, workers.in_flight)
        plan = CampaignPlan(tuple(chunks), as_toml(base_scene()), 1)
        found = collected(plan, list(store.results(plan.chunks)))
        return time.perf_counter() - begun, of_children_s() - used, found


def fourth_moment(drawn: Drawn, row: int, cell: Cell, laws) -> float:  # type: ignore[no-untyped-def]
    """Kurtosis of the errors of detections, by their weights."""
    law = laws[as_toml(noise_scene(drawn.scene))].at(cell.condition.noise_rms_v)
    draws = cell_draws(drawn, row, correction(drawn.scene), cell.bias.value)
    weights, squares = draws.weights(law), draws.error_m**2
    mean = (weights * squares).sum() / weights.sum()
    return float((weights * squares**2).sum() / weights.sum() / mean**2)


def shots_needed(cell: Cell, kurtosis: float) -> float:
    pfd = cell.pfd.value
    for_pfd = pfd * (1 - pfd) / max(PFD * pfd, POINT) ** 2
    for_spread = (kurtosis - 1) / (4 * SPREAD**2) / (1 - pfd)
    return max(for_pfd, for_spread)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sets", type=int, default=8)
    parser.add_argument("--noise-windows", type=int, default=500)
    parser.add_argument("--shots", type=int, default=200, help="on each of eleven terrains in each cell")
    asked = parser.parse_args()
    options = RangeOptions(("table",), sets=asked.sets, noise_windows=asked.noise_windows, shots=asked.shots)
    mean_only = conditions(base_scene())
    every = [
        replace(point, conditions=mean_only, shares=point.shares[: len(mean_only)])
        for point in points(options)
    ]
    levels = levels_chunks(every, options.noise_windows, 1)
    fast = shared_chunks(every) + levels + [chunk for point in every for chunk in point.chunks()]
    one_of_each = [fast[0], fast[1], levels[0], fast[-1], *brute_chunks(replace(options, shots=1), 2)[:2]]
    timed(one_of_each)  # fills the compiler's cache
    seconds, busy, found = timed(fast)
    begun = time.perf_counter()
    laws = found.laws()
    rows = [(drawn, row, cell) for drawn in found.points for row, cell in enumerate(cells(drawn, laws))]
    seconds += time.perf_counter() - begun
    whole = [
        shared_chunks(every) + brute_chunks(replace(options, shots=one), 2) for one in (_FEW, asked.shots)
    ]
    few, many = map(timed, whole)
    counts = [sum(row.size for row in one.shots.values()) for _, _, one in (few, many)]
    print("altitude light reflectance   error m  u %   PFD %  u points   shots that whole ones need")
    total, worst = 0.0, [0.0, 0.0]
    for drawn, row, cell in rows:
        assert cell.spread is not None
        needed = shots_needed(cell, fourth_moment(drawn, row, cell, laws))
        total += needed
        relative = cell.spread.standard_uncertainty / cell.spread.value
        pfd, pfd_u = cell.pfd.value, cell.pfd.standard_uncertainty
        worst = [max(worst[0], relative / SPREAD), max(worst[1], pfd_u / max(PFD * pfd, POINT))]
        print(
            f"{cell.altitude_m / 1e3:6g}   {cell.condition.light:5s} {cell.condition.reflectance:6g}  "
            f"{cell.spread.value:10.3f}  {100 * relative:4.2f}  {100 * pfd:7.3f} {100 * pfd_u:6.3f}"
            f"  {needed:12.0f}"
        )
    pace = (many[0] - few[0]) / (counts[1] - counts[0])
    start = few[0] - pace * counts[0]
    load = (many[1] - few[1]) / (counts[1] - counts[0])
    whole_busy = few[1] + load * (total - counts[0])
    print(f"accuracy reached: {worst[0]:.2f} of what is allowed for the spread, {worst[1]:.2f} for the PFD")
    print(f"fast, {WORKERS} workers, with ground, noise and analysis: {seconds:.1f} s")
    print(f"whole shots: {1e3 * pace:.3f} ms each on {WORKERS} workers, after {start:.1f} s")
    print(f"the same accuracy takes {total:.3g} whole shots: {start + total * pace:.0f} s")
    print(f"fast is {(start + total * pace) / seconds:.1f} times faster")
    if busy:
        print(
            f"processor time, which other programs do not change: {busy:.1f} s against {whole_busy:.0f} s, "
            f"{whole_busy / busy:.1f} times"
        )
    print(f"numpy {np.__version__}")


if __name__ == "__main__":
    main()
