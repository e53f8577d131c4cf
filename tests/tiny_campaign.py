"""``belahil campaign range`` with other work in its chunks; command, engine and folder are the real ones.

    python -m tests.tiny_campaign campaign range --echoes CHUNKS --repeats MILLISECONDS --study-echoes NUMBERS

With ``DEADLY`` in the environment, a path, one of its chunks kills its worker until there is a file.
"""

from __future__ import annotations

import hashlib
import os
import sys
from typing import Any

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from belahil.outcome import Outcome
from procedures import campaign_range
from procedures.campaign_range import RangeOptions


def plan(options: RangeOptions) -> CampaignPlan:
    given = {"seconds": options.repeats / 1e3, "count": options.study_echoes}
    chunks = [Chunk(f"cell {n}", "tests.chunk_work:slow", given | {"seed": n}) for n in range(options.echoes)]
    if "DEADLY" in os.environ:
        own = {"seed": 99, "mark": os.environ["DEADLY"]}
        chunks.insert(1, Chunk("cell of death", "tests.chunk_work:dies_without", own))
    return CampaignPlan(tuple(chunks), "", options.seed)


def analyse(plan: CampaignPlan, results: list[dict[str, Any]]) -> Outcome:
    digests = [hashlib.sha256(one["values"].tobytes()).hexdigest() for one in results]
    return Outcome(results={"cells": {"digests": digests}}, tables={}, figures={})


def put_in_place() -> None:
    campaign_range.plan = plan
    campaign_range.analyse = analyse


if __name__ == "__main__":
    from belahil.__main__ import main

    put_in_place()
    sys.exit(main())
