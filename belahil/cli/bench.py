"""``belahil bench``: write a bench file, show what there is, try a bench out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from belahil.cli.options import version_option
from belahil.cli.signals import closing

if TYPE_CHECKING:
    from belahil.config import BenchConfig

_WHERE = "FILE|emulated|simulated|replay:FILE"
_FILE = click.argument("file", required=False, metavar=f"[{_WHERE}]")
_BENCH = click.option("--bench", metavar=_WHERE, help="The same as FILE.")
_SEED = click.option(
    "--seed",
    type=click.IntRange(min=0),
    metavar="N",
    help="Seed of the emulation, in place of [emulation] seed.",
)


@click.group("bench", short_help="Write, show or try out a bench.")
@version_option
def command() -> None:
    """Bench files and benches."""


@command.command("new", short_help="Find instruments and write a bench file with every key.")
@click.argument("file", type=click.Path(path_type=Path), default=Path("bench.toml"))
@click.option("--driver", help="Driver of the generator; keysight-33500 when left out and none is found.")
@click.option("--address", help="Generator: a VISA resource name; emulated when left out and none is found.")
@click.option("--digitizer", help="Driver of the digitizer; grm when left out and none is found.")
@click.option("--link", help="Digitizer: its link (oscilloscope: visa:RESOURCE); by default as the address.")
@click.option("--receiver", help="Preset of the receiver; bela-grm, and analog for an oscilloscope.")
@click.option("--load-ohm", type=float, help="Load setting of the generator; 50 when left out.")
@click.option("--attenuation-db", type=float, help="Between generator and receiver; 0 when left out.")
@click.option("--max-vpp", type=float, help="Largest span at the receiver's input; 0.5 when left out.")
@click.option(
    "--search/--no-search",
    default=None,
    help="Look for instruments; without either, where a user sits at a terminal and names none.",
)
@click.option("--probe", is_flag=True, help="Search, and ask all that is found who it is.")
@click.option("--defaults", is_flag=True, help="Ask the user nothing.")
def new(file: Path, search: bool | None, probe: bool, defaults: bool, **given: Any) -> int:
    """Write a bench FILE (bench.toml) with every key, its value and a comment.

    A search lists VISA resources, serial ports and USB devices. Nothing is sent to any of them before the
    user agrees, one by one or with --probe.
    """
    from belahil.cli.bench_new import Wanted, written_bench

    written_bench(file, Wanted(**given), search, probe, defaults)
    return 0


@command.command("show", short_help="List drivers, receivers and links, or say what a bench is.")
@_FILE
@_BENCH
def show(file: str | None, bench: str | None) -> int:
    """List drivers, models with their limits, receivers and links; with FILE, say what that bench is."""
    from belahil.cli.bench_shown import catalogue, described
    from belahil.config import load_bench

    file = _one_of(file, bench)
    print(catalogue() if file is None else described(load_bench(file)))
    return 0


@command.command("check", short_help="Do the instruments answer, do sine and pulse come back?")
@_FILE
@_BENCH
@click.option("--address", help="Generator, in place of the bench file's.")
@click.option("--link", help="Digitizer, in place of the bench file's.")
@_SEED
@click.option(
    "--receiver",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Compare with this run of characterize in place of the preset.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Record every byte of the links in this new file.",
)
def check(
    file: str | None,
    bench: str | None,
    address: str | None,
    link: str | None,
    seed: int | None,
    receiver: Path | None,
    record: Path | None,
) -> int:
    """Ask both instruments who they are, measure noise, a sine and pulses, and say a line for each.

    The bench is the emulated one when FILE is left out.
    Status 3 when an instrument does not answer, or the sine or a pulse does not come back where it should.
    Status 1 when the gain is not that of --receiver.
    """
    from belahil.bench import open_bench
    from belahil.cli import replaying
    from belahil.cli.bench_tried import tried
    from belahil.config import load_bench
    from belahil.recording import recorded_session

    config = _placed(load_bench(_one_of(file, bench) or "emulated"), address, link)
    known = None
    if receiver is not None:
        from procedures.known_receiver import characterized_receiver

        known = characterized_receiver(receiver)
    agrees = True
    session = recorded_session(config)
    differs = replaying.differing(session, "bench check", {})
    with (
        replaying.compared(session, differs),
        closing(open_bench(config, seed=seed, record=record)) as opened,
    ):
        for fact in tried(opened, known):
            print(fact.line, flush=True)
            agrees &= fact.agrees
    return 0 if agrees else 1


@command.command("conform", short_help="Do both drivers keep what their protocols promise?")
@_FILE
@_BENCH
@_SEED
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Record every byte of the links in this new file, for replay:FILE.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="Write the report as JSON in this file."
)
def conform(
    file: str | None, bench: str | None, seed: int | None, record: Path | None, out: Path | None
) -> int:
    """Try every promise of both drivers on these instruments, and say what was seen of each.

    The bench is the emulated one when FILE is left out. What is played is said first; it stays within
    [generator] max_vpp, and the output is off afterwards.
    Status 1 when a rule fails; 3 when an instrument does not answer or is gone.
    """
    from belahil.cli.bench_conform import conformed
    from belahil.config import load_bench

    return conformed(load_bench(_one_of(file, bench) or "emulated"), seed, record, out)


@command.command("twin", short_help="Make an emulated bench of what a run measured.")
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN")
@click.argument("file", type=click.Path(path_type=Path), default=Path("twin.toml"))
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of the emulation."
)
def twin(run: Path, file: Path, seed: int) -> int:
    """Write a bench FILE (twin.toml) with an emulated receiver like the one that RUN characterized.

    A line for each key says what it is and where it is from; the same lines head the file.
    """
    from belahil.cli.bench_twin import written_twin

    for line in written_twin(run, file, seed):
        print(line)
    return 0


@command.command("parity", short_help="Do emulated instruments answer as the recorded ones did?")
@click.argument("recording", type=click.Path(path_type=Path), metavar="RECORDING")
@click.option(
    "--bench", metavar="FILE", help="Emulated bench, such as a twin, in place of the recorded bench file."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write all of it there as JSON; an older one is replaced.",
)
@click.option(
    "--examples",
    type=click.IntRange(min=1),
    default=3,
    show_default=True,
    metavar="N",
    help="Differences of each kind that are shown for each question.",
)
def parity(recording: Path, bench: str | None, out: Path | None, examples: int) -> int:
    """Write what a RECORDING wrote to emulated instruments, and compare their answers with the recorded ones.

    Status 1 when an answer differs in its words, its error or its shape. Numbers that were measured are told
    apart and may differ.
    """
    from belahil.cli.bench_parity import beside, written
    from belahil.cli.bench_parity_told import report_lines

    found = beside(recording, bench, examples)
    for line in report_lines(found):
        print(line)
    if out is not None:
        written(found, out)
        print(f"all of it: {out}")
    return 1 if found.parity.differ else 0


def _one_of(file: str | None, bench: str | None) -> str | None:
    """Return the bench, which may stand as an argument or behind ``--bench``."""
    if file is not None and bench not in (None, file):
        raise click.UsageError(f"{file} and --bench {bench}: name one bench")
    return bench if file is None else file


def _placed(config: BenchConfig, address: str | None, link: str | None) -> BenchConfig:
    from msgspec.structs import replace

    return replace(
        config,
        generator=replace(config.generator, address=address or config.generator.address),
        digitizer=replace(config.digitizer, link=link or config.digitizer.link),
    )
