"""Where in its window a played pulse comes, whoever triggers."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from belahil.config import BenchConfig


def first_sample(config: BenchConfig) -> tuple[float, float]:
    """Return the delay to ask a window for, and the time of a stimulus at which the window then begins.

    Parameters
    ----------
    config : BenchConfig
        ``[bench] trigger`` and ``trigger_delay_s``.

    Returns
    -------
    delay_s : float
        For the window's request, s.
    begin_s : float
        Time of the first sample, to one sample, on the time axis of a stimulus, s. Never below zero: a
        generator plays nothing before its trigger.
    """
    delay_s = config.bench.trigger_delay_s
    # The generator's trigger output starts the window `delay_s` later; the receiver's shot pulse starts the
    # generator `delay_s` later, so the window waits for it.
    return (0.0, delay_s) if config.bench.trigger == "generator" else (delay_s, 0.0)
