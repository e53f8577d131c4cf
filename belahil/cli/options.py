"""Options that commands share, and how lists are written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Common:
    """What the common options say.

    Parameters
    ----------
    bench, seed, out, resume, record
        None where the user said nothing.
    quiet, json : bool
        Say less; print ``summary.json``.
    """

    bench: str | None
    seed: int | None
    out: Path | None
    resume: Path | None
    quiet: bool
    json: bool
    record: Path | None = None


def _tell_version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        from belahil.provenance import belahil_version

        click.echo(f"belahil {belahil_version()}")
        ctx.exit()


version_option = click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_tell_version,
    help="Tell the version and stop.",
)


def common_options(function: F) -> F:
    """Add ``--bench --out --resume --seed --record --quiet --json --version`` to a command."""
    for option in reversed(
        (
            click.option(
                "--bench",
                metavar="FILE|emulated|simulated|replay:FILE",
                help="The bench; emulated when left out. With replay:FILE, which --record wrote, options "
                "left out are the recorded ones.",
            ),
            click.option(
                "--out",
                type=click.Path(path_type=Path),
                metavar="DIR",
                help="Run folder, new or empty; a dated one here when left out.",
            ),
            click.option(
                "--resume",
                type=click.Path(path_type=Path),
                metavar="DIR",
                help="Continue the run in this folder; everything else is taken from it.",
            ),
            click.option(
                "--seed", type=int, metavar="N", help="Seed of the emulation, in place of [emulation] seed."
            ),
            click.option(
                "--record",
                type=click.Path(path_type=Path),
                metavar="FILE",
                help="Record every byte of the links in this new file, for --bench replay:FILE.",
            ),
            click.option("--quiet", is_flag=True, help="Say nothing but errors."),
            click.option("--json", "as_json", is_flag=True, help="Print summary.json and nothing else."),
            version_option,
        )
    ):
        function = option(function)
    return function


def windows_option(function: F) -> F:
    """Add ``--windows`` to a measuring command whose procedure has a `recorded_plan`."""
    return click.option(
        "--windows",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Analyse the windows in this file, the data.nc of a run, in place of measuring.",
    )(function)


def receiver_option(function: F) -> F:
    """Add ``--receiver`` to a command whose procedure compares with what is known of the receiver."""
    return click.option(
        "--receiver",
        type=click.Path(path_type=Path),
        metavar="RUN",
        help="Run folder of `belahil characterize`: what is known of the receiver; its preset when left out.",
    )(function)


def found_again(place: str | None) -> str | None:
    """Return a file's whole path, which a run resumed from another folder finds; a ready scene as it is."""
    if place is None or not Path(place).is_file():
        return place
    return str(Path(place).absolute())


def common(
    bench: str | None,
    out: Path | None,
    resume: Path | None,
    seed: int | None,
    record: Path | None,
    quiet: bool,
    as_json: bool,
) -> Common:
    """Check the common options of the command at work against each other and against its own.

    Raises
    ------
    click.UsageError
        ``--resume`` beside something that it takes from the folder, or a negative seed.
    """
    if resume is not None:
        beside = _beside_resume(click.get_current_context())
        if beside:
            raise click.UsageError(
                f"--resume {resume} takes everything from that folder; leave out {', '.join(beside)}"
            )
    if seed is not None and seed < 0:
        raise click.UsageError(f"--seed {seed}: must not be negative")
    return Common(bench, seed, out, resume, quiet, as_json, record)


def _beside_resume(context: click.Context) -> list[str]:
    given = click.core.ParameterSource.COMMANDLINE
    return [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name not in ("resume", "quiet", "as_json")
        and context.get_parameter_source(parameter.name or "") is given
    ]


class Codes(click.ParamType[tuple[int, ...]]):
    """Gain codes: numbers and spans, as in ``0-3,7``."""

    name = "codes"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Return the codes in the order given."""
        found: list[int] = []
        for part in str(value).split(","):
            low, dash, high = part.strip().partition("-")
            if not low.isdecimal() or (dash and not high.isdecimal()):
                self.fail(f"{value!r}: write gain codes as 0-15 or 4,5", param, ctx)
            span = range(int(low), int(high if dash else low) + 1)
            if not span or len(span) > 256:
                self.fail(f"{value!r}: {part.strip()} is no span of gain codes", param, ctx)
            found += span
        return tuple(found)


class Decimals(click.ParamType[tuple[float, ...]]):
    """Positive numbers with commas between, times a power of ten; ``3`` milli becomes exactly ``0.003``."""

    name = "list"

    def __init__(self, power: int) -> None:
        self._power = power

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the numbers in SI units."""
        found = []
        for part in str(value).split(","):
            try:
                number = Decimal(part.strip())
            except InvalidOperation:
                self.fail(f"{value!r}: write numbers with commas between, as 3,13,30", param, ctx)
            if not number.is_finite() or number <= 0:
                self.fail(f"{value!r}: {part.strip()} must be above zero", param, ctx)
            found.append(float(number.scaleb(self._power)))
        return tuple(found)
