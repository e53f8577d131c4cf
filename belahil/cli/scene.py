"""``belahil scene``: list the ready scenes, show one with the sources of its numbers, write one to edit."""

from __future__ import annotations

from pathlib import Path

import click

from belahil.cli.options import version_option


@click.group("scene", short_help="List, show or write a scene.")
@version_option
def command() -> None:
    """Scenes: what is there between laser and receiver, for `belahil simulate`."""


@command.command("list", short_help="The scenes that come with the program.")
def list_() -> int:
    """List the scenes that come with the program, each with what it is."""
    from sim.scene import ready_scenes
    from sim.scene_text import described

    names = ready_scenes()
    for name in names:
        print(f"{name:<{max(map(len, names))}}  {described(name)}")
    return 0


@command.command("show", short_help="A scene with every key, its unit and its source.")
@click.argument("scene")
def show(scene: str) -> int:
    """Print SCENE, a TOML file or the name of a ready scene, as TOML with every key that acts.

    Comments tell the unit, where the number is from, and whether it is assumed; keys that may have a value
    and have none; and what follows from the scene, such as the photons of its echo.
    """
    from sim.scene import load_scene
    from sim.scene_text import commented

    print(commented(load_scene(scene)), end="")
    return 0


@command.command("new", short_help="Write a scene file to edit.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--from",
    "origin",
    metavar="SCENE",
    default="night",
    show_default=True,
    help="The scene to begin with: a TOML file, or the name of a ready one.",
)
def new(file: Path, origin: str) -> int:
    """Write a scene FILE with every key that acts, as `belahil scene show` prints it."""
    from belahil.errors import RefusedInput
    from belahil.storage import write_whole
    from sim.scene import load_scene
    from sim.scene_text import commented

    text = commented(load_scene(origin))
    if file.exists():
        raise RefusedInput(f"{file}: is there already; give another name")
    write_whole(file, text)
    print(f"scene file: {file}; simulate it with: belahil simulate {file}")
    return 0
