"""The command ``belahil``: finds the command's module, and turns what went wrong into a line and a status."""

from __future__ import annotations

import importlib
import os
import sys
import tempfile
import traceback
from difflib import get_close_matches
from typing import TYPE_CHECKING

import click

from belahil.cli.options import version_option
from belahil.cli.signals import Interrupted, watched
from belahil.errors import BelahilError, ReplayDiffers

if TYPE_CHECKING:
    from collections.abc import Sequence

COMMANDS = (
    "characterize",
    "noise",
    "tx-delay",
    "digitizer",
    "arrival-time",
    "energy-calibration",
    "rfm-parity",
    "pulse-shape",
    "simulate",
    "scene",
    "tof-linearity",
    "campaign",
    "accuracy",
    "bench",
    "emulate",
    "report",
    "compare",
)
INTERRUPTED, INTERNAL = 130, 70


def module_of(command: str) -> str:
    """Return the name of the module that holds a command or a procedure."""
    return command.replace("-", "_")


class _Late(click.Group):
    """A group whose commands live in modules of their own, imported when they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        found: click.Command = importlib.import_module(f"belahil.cli.{module_of(cmd_name)}").command
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = get_close_matches(args[0], COMMANDS, 1)
            if not near:
                raise
            raise click.UsageError(f"No such command '{args[0]}'. Did you mean '{near[0]}'?") from error


@click.group("belahil", cls=_Late, context_settings={"help_option_names": ["-h", "--help"]})
@version_option
def belahil() -> None:
    """Measure the receiver of a laser altimeter, on instruments or on emulated ones.

    Status: 0 passed, 1 a limit failed or is undecided, 2 refused input, 3 an instrument or a link failed,
    4 our own storage failed, 70 internal error, 130 interrupted.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str or None
        None takes those of this process.

    Returns
    -------
    int
        Exit status.
    """
    status = 0
    try:
        with watched():
            status = _run(None if arguments is None else list(arguments))
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message(), file=sys.stderr)
        return 2
    except click.ClickException as error:
        return _said(error.format_message(), 2)
    except (Interrupted, click.Abort) as error:
        return _said("; ".join(["interrupted", *getattr(error, "__notes__", [])]), INTERRUPTED)
    except BelahilError as error:
        _said("; ".join([str(error), *getattr(error, "__notes__", [])]), error.exit_status)
        if isinstance(error, ReplayDiffers):
            print(*error.excerpt, sep="\n", file=sys.stderr)
        return error.exit_status
    except BrokenPipeError:
        # Whoever read our output has gone; Python must not try to flush it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except Exception as error:
        where = "; ".join(getattr(error, "__notes__", [])) or f"traceback in {_traceback_file()}"
        return _said(f"internal error, please report it: {type(error).__name__}: {error}; {where}", INTERNAL)
    return status


def _run(arguments: list[str] | None) -> int:
    try:
        return int(belahil.main(args=arguments, prog_name="belahil", standalone_mode=False) or 0)
    except SystemExit as leave:
        # click's way out when whoever read our output has gone.
        raise BrokenPipeError from leave


def _said(line: str, status: int) -> int:
    print("belahil:", " ".join(line.split()), file=sys.stderr)
    return status


def _traceback_file() -> str:
    with tempfile.NamedTemporaryFile(
        "w", prefix="belahil-", suffix=".txt", delete=False, encoding="utf-8"
    ) as file:
        traceback.print_exc(file=file)
    return file.name
