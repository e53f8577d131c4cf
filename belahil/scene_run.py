"""The run folder of a scene: the results of a simulation, which nothing needs to resume.

It holds what the folder of a `belahil.run.Run` holds, with ``scene.toml`` in place of ``bench.toml`` and
without a journal: the scene and its seed make every shot again.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belahil.errors import StorageError
from belahil.provenance import belahil_version, command_line, software
from belahil.run import SCHEMA, utc_now
from belahil.run_folder import refuse_used
from belahil.storage import storage_error, write_whole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from belahil.outcome import Outcome
    from belahil.receiver import DigitizerSpec
    from belahil.values import Shot

SCENE_HEADER = "# The scene as this run used it.\n\n"


class SceneRun:
    """A run folder for one simulation.

    Parameters
    ----------
    folder : str or Path
        New or empty.
    procedure : str
        Name of the procedure.
    scene : str
        The scene as used, TOML with comments.
    seed : int
        Of its draws.
    instruments : mapping of str to str
        What was simulated, by part.

    Raises
    ------
    RefusedInput
        The folder has something in it.
    StorageError
        It cannot be made or written.
    """

    def __init__(
        self, folder: str | Path, procedure: str, scene: str, seed: int, instruments: Mapping[str, str]
    ) -> None:
        self.folder, self.procedure, self.seed = Path(folder), procedure, seed
        self._instruments, self._started = dict(instruments), utc_now()
        refuse_used(self.folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise storage_error(f"--out {folder}: cannot be made", error) from error
        write_whole(self.folder / "scene.toml", SCENE_HEADER + scene)
        self._log(f"begun with belahil {belahil_version()}: {command_line()}")

    def finish(
        self,
        outcome: Outcome,
        shots: Sequence[Shot],
        conditions: Mapping[str, str],
        not_modelled: Sequence[str] = (),
        digitizer: DigitizerSpec | None = None,
    ) -> dict[str, Any]:
        """Write data file, figures, report and, last, the summary; return the summary.

        `digitizer` says what the receiver is, for who reads the windows again.

        Raises
        ------
        StorageError
            A file could not be written.
        """
        from belahil.results import write_results

        summary = {
            "schema": SCHEMA,
            "procedure": self.procedure,
            "source": "simulated",
            "verdict": "none",
            "seed": self.seed,
            "software": software(),
            "instruments": self._instruments,
            "started": self._started,
            "finished": utc_now(),
            "results": outcome.results,
        }
        text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        write_results(self.folder, summary, shots, outcome, (), conditions, not_modelled, digitizer=digitizer)
        self._log(f"finished with {len(shots)} shots")
        write_whole(self.folder / "summary.json", text)
        return summary

    def _log(self, line: str) -> None:
        try:
            with open(self.folder / "log.txt", "a", encoding="utf-8") as file:
                file.write(f"{utc_now()} {line}\n")
        except OSError as error:
            raise StorageError(f"{self.folder / 'log.txt'}: cannot be written") from error
