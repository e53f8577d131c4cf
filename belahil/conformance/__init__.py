r"""Does a driver keep what its protocol promises? `check_generator` and `check_digitizer` try any object.

The rules follow from `belahil.interfaces` alone, so that a laboratory can try a driver of its own:

    report = check_generator(my_generator, max_vpp=0.2)
    print(*report.results, sep="\n")
    report.require()
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from belahil.clock import SystemClock
from belahil.conformance import digitizer as of_digitizer
from belahil.conformance import digitizer_refusals, generator_refusals
from belahil.conformance import generator as of_generator
from belahil.conformance.generator import GeneratorTried
from belahil.conformance.rules import ConformanceReport, RuleResult, judged
from belahil.conformance.stand import GuardedGenerator, Receiving
from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from belahil.bench import Bench
    from belahil.interfaces import Clock, Digitizer, FunctionGenerator

__all__ = [
    "DIGITIZER_RULES",
    "GENERATOR_RULES",
    "ConformanceReport",
    "RuleResult",
    "check_bench",
    "check_digitizer",
    "check_generator",
    "played_on",
]

GENERATOR_RULES = (*of_generator.RULES, *generator_refusals.RULES)
DIGITIZER_RULES = (*of_digitizer.RULES, *digitizer_refusals.RULES)


def check_generator(
    generator: FunctionGenerator,
    *,
    max_vpp: float,
    load_ohm: float = 50.0,
    digitizer: Digitizer | None = None,
    trigger: Literal["generator", "digitizer"] = "generator",
    trigger_delay_s: float = 0.0,
    settle_s: float = 0.0,
    clock: Clock | None = None,
    close: bool = True,
) -> ConformanceReport:
    """Try everything that `FunctionGenerator` promises.

    Parameters
    ----------
    generator : FunctionGenerator
        Just opened. Its output is off afterwards, on every way out.
    max_vpp : float
        Twice the largest magnitude that may leave the output, V into `load_ohm`. What lies beyond is asked
        for, to be refused, while the output is off.
    load_ohm : float
        The load that it is set to, ohm; ``inf`` for high impedance.
    digitizer : Digitizer or None
        At the other end, to see what is played; without one those rules do not apply.
    trigger : {"generator", "digitizer"}
        Who triggers the other one there.
    trigger_delay_s, settle_s : float
        As in ``[bench]``, s.
    clock : Clock or None
        By which both wait; None: that of this computer.
    close : bool
        Whether to close it at the end, which its rules of closing need.

    Returns
    -------
    ConformanceReport
        A rule that fails does not keep the others from being tried.

    Raises
    ------
    RefusedInput
        `max_vpp` is not above zero.
    """
    player = _player(generator, max_vpp, load_ohm, trigger_delay_s, trigger)
    seen_by = (
        None if digitizer is None else Receiving(digitizer, None, None, clock or SystemClock(), settle_s)
    )
    tried = GeneratorTried(player, seen_by)
    with _left_off(generator, close):
        results = judged(GENERATOR_RULES, tried)
        if close:
            results += judged(of_generator.CLOSING_RULES, tried)
    return _of_generator(player, results)


def check_digitizer(
    digitizer: Digitizer,
    *,
    generator: FunctionGenerator | None = None,
    max_vpp: float = 0.0,
    load_ohm: float = 50.0,
    start: Callable[[], None] | None = None,
    trigger: Literal["generator", "digitizer"] = "generator",
    trigger_delay_s: float = 0.0,
    settle_s: float = 0.0,
    clock: Clock | None = None,
    close: bool = True,
) -> ConformanceReport:
    """Try everything that `Digitizer` promises.

    Parameters
    ----------
    digitizer : Digitizer
        Just opened, nothing armed.
    generator : FunctionGenerator or None
        Before it: starts the windows that wait for one, and drives it to the ends of its converter. It stays
        open, its output off.
    max_vpp, load_ohm : float
        For `generator`, as in `check_generator`.
    start : callable or None
        Starts a window with ``trigger="generator"`` in place of `generator`.
    trigger, trigger_delay_s, settle_s, clock
        As in `check_generator`.
    close : bool
        Whether to close it at the end, which its rules of closing need.

    Returns
    -------
    ConformanceReport
        A rule that fails does not keep the others from being tried.

    Raises
    ------
    RefusedInput
        A generator was given, and `max_vpp` is not above zero.
    """
    player = None
    if generator is not None:
        player = _player(generator, max_vpp, load_ohm, trigger_delay_s, trigger)
    tried = Receiving(digitizer, player, start, clock or SystemClock(), settle_s)
    with _left_off(generator, False):
        results = judged(DIGITIZER_RULES, tried)
    if close:
        results += judged(of_digitizer.CLOSING_RULES, tried)
    return _of_digitizer(tried, results)


def check_bench(bench: Bench) -> tuple[ConformanceReport, ConformanceReport]:
    """Try generator and digitizer of an open bench, each with the other; both are closed at the end.

    Parameters
    ----------
    bench : Bench
        Its ``max_vpp`` is kept. It can only be closed afterwards.

    Returns
    -------
    tuple of ConformanceReport
        Of the generator, and of the digitizer.
    """
    player = _on(bench)
    digitizer, clock, settle_s = bench.digitizer, bench.clock, bench.config.bench.settle_s
    eye = Receiving(digitizer, None, None, clock, settle_s)
    driven = Receiving(digitizer, player, None, clock, settle_s, first_shot=1 << 20)
    tried = GeneratorTried(player, eye)
    with _left_off(player.generator, True):
        generator_seen = judged(GENERATOR_RULES, tried)
        digitizer_seen = judged(DIGITIZER_RULES, driven)
        generator_seen += judged(of_generator.CLOSING_RULES, tried)
    digitizer_seen += judged(of_digitizer.CLOSING_RULES, replace(driven, player=None))
    return _of_generator(player, generator_seen), _of_digitizer(driven, digitizer_seen)


def played_on(bench: Bench) -> tuple[str, ...]:
    """Say what `check_bench` plays on a bench, a line for each stimulus; nothing is sent."""
    return _on(bench).plays()


def _on(bench: Bench) -> GuardedGenerator:
    part, table = bench.config.generator, bench.config.bench
    into_load_vpp = part.max_vpp * bench.setting_per_cut_volt
    return _player(bench.generator, into_load_vpp, part.load_ohm, table.trigger_delay_s, table.trigger)


def _player(
    generator: FunctionGenerator,
    max_vpp: float,
    load_ohm: float,
    trigger_delay_s: float,
    trigger: Literal["generator", "digitizer"],
) -> GuardedGenerator:
    if not max_vpp > 0:
        raise RefusedInput(f"max_vpp = {max_vpp!r}: must be above zero, V into the generator's load")
    return GuardedGenerator(generator, max_vpp, load_ohm, trigger_delay_s, trigger)


@contextmanager
def _left_off(generator: FunctionGenerator | None, close: bool) -> Iterator[None]:
    """Leave the output off; a driver that fails in that was told of by its rules."""
    try:
        yield
    finally:
        if generator is not None:
            with suppress(Exception):
                generator.output(False)
            if close:
                with suppress(Exception):
                    generator.close()


def _of_generator(player: GuardedGenerator, results: tuple[RuleResult, ...]) -> ConformanceReport:
    identity = ""
    plays: tuple[str, ...] = ()
    with suppress(Exception):
        identity = player.generator.identity
        plays = player.plays()
    return ConformanceReport("generator", identity, plays, results)


def _of_digitizer(tried: Receiving, results: tuple[RuleResult, ...]) -> ConformanceReport:
    identity = ""
    plays: tuple[str, ...] = ()
    with suppress(Exception):
        identity = tried.digitizer.identity
        plays = () if tried.player is None else tried.player.plays()
    return ConformanceReport("digitizer", identity, plays, results)
