"""``belahil emulate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from belahil.cli.options import version_option

if TYPE_CHECKING:
    from belahil.config import BenchConfig


@click.command("emulate", short_help="Serve an emulated bench to other processes.")
@click.option("--bench", metavar="FILE|emulated", default="emulated", help="Its [emulation] is the truth.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    metavar="N",
    help="Seed of the emulation, in place of [emulation] seed.",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option("--scpi-port", type=click.IntRange(0, 65535), default=0, help="Port of the generator; 0: any.")
@click.option("--link-port", type=click.IntRange(0, 65535), default=0, help="Port of the receiver; 0: any.")
@click.option("--hislip-port", type=click.IntRange(0, 65535), default=0, help="Port of HiSLIP; 0: any.")
@click.option("--pty", is_flag=True, help="Offer both at pseudo-terminals too (not on Windows).")
@click.option(
    "--baud",
    type=click.FloatRange(min=1),
    metavar="RATE",
    help="Bytes leave no faster on the GRM link and on pseudo-terminals, ten bits each.",
)
@click.option(
    "--latency-ms",
    type=click.FloatRange(min=0),
    default=0.0,
    metavar="T",
    help="Every answer leaves so much later.",
)
@click.option(
    "--client",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write, or replace, a bench file with which another process measures this bench.",
)
@version_option
def command(
    bench: str,
    seed: int | None,
    host: str,
    scpi_port: int,
    link_port: int,
    hislip_port: int,
    pty: bool,
    baud: float | None,
    latency_ms: float,
    client: Path | None,
) -> int:
    """Serve the instruments of an emulated bench over TCP until Ctrl-C or SIGTERM; the status is 0 then.

    Prints where they are, and a bench file for the process that measures them. The truth stays here.
    """
    import math

    from msgspec.structs import replace

    from belahil.config import load_bench
    from belahil.errors import RefusedInput
    from belahil.storage import write_whole
    from sim.transports.server import Served, Serving, serve

    config = load_bench(bench)
    if config.source == "replay":
        raise RefusedInput(f"--bench {bench}: a recording holds no truth to emulate")
    if config.source == "hardware":
        raise RefusedInput(
            f"--bench {bench}: is {config.source}; needed is one whose instruments are emulated"
        )
    if seed is not None:
        config = replace(config, emulation=replace(config.emulation, seed=seed))

    def announce(served: Served) -> None:
        text = client_file(config, served.address, served.link)
        if client is not None:
            write_whole(client, text)
        for name, places in (
            ("generator:", (served.address, served.hislip_address, served.pty_address)),
            ("receiver: ", (served.link, served.hislip_link, served.pty_link)),
        ):
            for place in filter(None, places):
                print(f"# {name} {place}")
        print(
            f"# a bench file for another process{f', written to {client}' if client else ''}:\n{text}",
            flush=True,
        )

    how = Serving(host, scpi_port, link_port, hislip_port, pty, baud or math.inf, latency_ms / 1e3)
    serve(config, announce, how, lambda line: print("belahil:", line, file=sys.stderr, flush=True))
    return 0


def client_file(config: BenchConfig, address: str, link: str) -> str:
    """Write the bench file of a client: the same bench, elsewhere, without its truth.

    Parameters
    ----------
    config : BenchConfig
        What is served.
    address, link : str
        Where.
    """
    import tomllib

    import tomli_w

    from belahil.config import as_toml

    tables = tomllib.loads(as_toml(config))
    del tables["emulation"]
    # "@py" is PyVISA-py, which speaks TCP without a vendor's library.
    tables["generator"] |= {"address": address, "visa_library": "@py"}
    tables["digitizer"] |= {"link": link}
    return tomli_w.dumps(tables)
