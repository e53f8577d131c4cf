"""``belahil campaign``: studies over many scenes."""

from __future__ import annotations

import importlib

import click

from belahil.cli.options import version_option

CAMPAIGNS: tuple[str, ...] = (
    "energy",
    "orbit",
    "range",
    "reflectance",
    "roughness",
    "temperature",
    "terrain",
)


class _Late(click.Group):
    """Campaigns live in modules of their own, imported when they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(CAMPAIGNS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in CAMPAIGNS:
            return None
        found: click.Command = importlib.import_module(f"belahil.cli.campaign_{cmd_name}").command
        return found


@click.group("campaign", cls=_Late, short_help="Studies over many scenes: range, energy, roughness ...")
@version_option
def command() -> None:
    """Study an instrument over many scenes, on one core or on a cluster.

    A campaign is computed in chunks. It may be stopped at any time; --resume goes on with it.
    """
