from __future__ import annotations

import os

from belahil._blas import pin_to_one_thread

pin_to_one_thread()

from hypothesis import settings  # noqa: E402  (after the pin, since its plugins may import numpy)

# No deadline: a shared machine has slow moments. In continuous integration the same examples each time.
settings.register_profile("house", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, database=None)
settings.load_profile("ci" if os.environ.get("CI") else "house")
