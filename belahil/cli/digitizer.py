"""``belahil digitizer``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Codes, Decimals, common, common_options, receiver_option, windows_option


class _Levels(click.ParamType[tuple[float, ...]]):
    """Levels with commas between, at most 0 dBFS."""

    name = "list"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the numbers."""
        try:
            return tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r}: write levels with commas between, as -1,-7", param, ctx)


@click.command("digitizer", short_help="SINAD, ENOB, SFDR, THD, and how the two converters differ.")
@click.option("--codes", type=Codes(), metavar="0-15|4,5", help="Gain codes; all when left out.")
@click.option(
    "--levels-dbfs",
    type=_Levels(),
    metavar="LIST",
    help="Peaks of the sines at the converter, dB of half its span; -1,-7 when left out.",
)
@click.option(
    "--frequencies-mhz",
    "frequencies_hz",
    type=Decimals(6),
    metavar="LIST",
    help="Frequencies, MHz; four coherent ones from 1 to 29 MHz when left out.",
)
@click.option(
    "--records", type=click.IntRange(min=2), metavar="N", help="Windows of each sine; 4 when left out."
)
@receiver_option
@windows_option
@common_options
def command(
    codes: tuple[int, ...] | None,
    levels_dbfs: tuple[float, ...] | None,
    frequencies_hz: tuple[float, ...] | None,
    records: int | None,
    receiver: Path | None,
    windows: Path | None,
    **given: Any,
) -> int:
    """Test a receiver's digitizer with sines, after IEEE Std 1057, by its gain codes."""
    from belahil.cli.measuring import Job, perform

    chosen: dict[str, Any] = {
        "codes": codes,
        "levels_dbfs": levels_dbfs,
        "frequencies_hz": frequencies_hz,
        "records": records,
        "receiver": receiver,
    }
    return perform(Job("digitizer", "DigitizerOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    lines = []
    for row in results["gain_codes"]:
        name = "receiver without gain codes" if row["code"] is None else f"gain code {row['code']}"
        if row["sinad"] is None:
            lines.append(f"{name}: {row['status']}")
            continue
        lines.append(
            f"{name}, {one_text(row['level_dbfs'])} FS at {row['frequency_hz'] / 1e6:.3g} MHz: "
            f"SINAD {one_text(row['sinad'])}, ENOB {one_text(row['enob'])}, "
            f"SFDR {_or_bound(row, 'sfdr', 'at_least', '>')}, THD {_or_bound(row, 'thd', 'at_most', '<')}"
        )
    between = results["interleave"]
    if between["gain"] is not None:
        lines.append(
            f"even minus odd converter: gain {one_text(between['gain'])}, offset "
            f"{one_text(between['offset_v'])}, skew {one_text(between['skew_s'])}"
        )
    return lines


def _or_bound(row: dict[str, Any], name: str, ending: str, sign: str) -> str:
    from belahil.report.tables import one_text

    return one_text(row[name]) if row[name] else f"{sign} {row[f'{name}_{ending}']:.1f} dB"
