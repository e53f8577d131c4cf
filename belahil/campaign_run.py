"""The folder of a campaign: what it was begun with, its chunks, and at the end its results."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belahil.chunks import Chunk, ChunkStore
from belahil.errors import RefusedInput
from belahil.fingerprint import difference, plain
from belahil.provenance import belahil_version, command_line, software
from belahil.run import SCHEMA, utc_now
from belahil.run_folder import claim, lock, read_json
from belahil.storage import write_whole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

    from belahil.outcome import Outcome
    from belahil.storage import FolderLock

BEGUN = "campaign.json"


@dataclass(frozen=True, slots=True)
class CampaignPlan:
    """What a campaign computes.

    Parameters
    ----------
    chunks : tuple of Chunk
        In the order in which they are reduced.
    scene : str
        The scene that the others are variations of, TOML.
    instruments : mapping of str to str
        What is simulated, by part.
    seed : int
        Of all random draws.
    """

    chunks: tuple[Chunk, ...]
    scene: str
    seed: int
    instruments: Mapping[str, str] = field(default_factory=dict)


class CampaignRun:
    """A campaign's folder, open for computing; made by `create` or `resume`.

    Attributes
    ----------
    folder : Path
        Holds everything.
    begun : dict
        ``campaign``, ``options``, ``command``, ``started``, ``software`` version.
    store : ChunkStore
        Results so far.
    """

    def __init__(self, folder: Path, held: FolderLock, begun: dict[str, Any]) -> None:
        self.folder, self.begun, self._lock = folder, begun, held
        self.store = ChunkStore(folder / "chunks")

    @classmethod
    def create(cls, folder: str | Path, campaign: str, options: Mapping[str, Any]) -> CampaignRun:
        """Begin in a new or empty folder.

        Raises
        ------
        RefusedInput
            The folder has something in it.
        StorageError
            It cannot be made or written.
        """
        folder = Path(folder)
        held = claim(folder)
        try:
            begun = {
                "campaign": campaign,
                "options": plain(dict(options)),
                "belahil": belahil_version(),
                "command": command_line(),
                "started": utc_now(),
            }
            write_whole(folder / BEGUN, json.dumps(begun, indent=2) + "\n")
            run = cls(folder, held, begun)
        except BaseException:
            held.release()
            raise
        run.log(f"begun with belahil {belahil_version()}: {command_line()}")
        return run

    @classmethod
    def resume(cls, folder: str | Path, campaign: str) -> CampaignRun:
        """Go on in a folder; options are taken from it.

        Raises
        ------
        RefusedInput
            It holds no campaign of this name, or one that another version of belahil began.
        """
        folder = Path(folder)
        if not (folder / BEGUN).is_file():
            raise RefusedInput(f"--resume {folder}: there is no campaign in this folder")
        held = lock(folder)
        try:
            begun = read_json(folder / BEGUN)
            if begun["campaign"] != campaign:
                raise RefusedInput(
                    f"--resume {folder}: holds a campaign of {begun['campaign']}; "
                    f"use belahil campaign {begun['campaign']} --resume {folder}"
                )
            now = {"belahil": belahil_version()}
            found = difference({"belahil": begun["belahil"]}, now)
            if found is not None and not (folder / "summary.json").is_file():
                raise RefusedInput(f"--resume {folder}: the campaign was begun otherwise: {found}")
            run = cls(folder, held, begun)
        except BaseException:
            held.release()
            raise
        run.log(f"resumed: {command_line()}")
        return run

    @property
    def finished(self) -> bool:
        """Whether the results are there."""
        return (self.folder / "summary.json").is_file()

    def log(self, line: str) -> None:
        """Add a line to ``log.txt``; a full disk must not end a campaign here."""
        with suppress(OSError), open(self.folder / "log.txt", "a", encoding="utf-8") as file:
            file.write(f"{utc_now()} {line}\n")

    def finish(
        self, plan: CampaignPlan, outcome: Outcome, conditions: Mapping[str, str], not_modelled: Sequence[str]
    ) -> dict[str, Any]:
        """Write data file, figures, report and, last, the summary; return the summary.

        Raises
        ------
        StorageError
            A file could not be written; the chunks are untouched.
        """
        from belahil.results import write_results

        write_whole(self.folder / "scene.toml", "# The scene that this campaign varies.\n\n" + plan.scene)
        summary = {
            "schema": SCHEMA,
            "procedure": f"campaign {self.begun['campaign']}",
            "source": "simulated",
            "verdict": "none",
            "checks": [],
            "seed": plan.seed,
            "software": software(),
            "instruments": dict(plan.instruments),
            "started": self.begun["started"],
            "finished": utc_now(),
            "results": outcome.results,
        }
        text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        write_results(self.folder, summary, (), outcome, (), conditions, not_modelled)
        self.log(f"finished with {len(plan.chunks)} chunks")
        write_whole(self.folder / "summary.json", text)
        return summary

    def close(self) -> None:
        """Let go of the folder."""
        self._lock.release()

    def __enter__(self) -> CampaignRun:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
