"""What ``belahil bench twin`` does: from a run folder to a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from pathlib import Path


def written_twin(run: Path, file: Path, seed: int) -> list[str]:
    """Write the twin of a characterized receiver.

    Parameters
    ----------
    run : Path
        A finished run folder of ``belahil characterize``.
    file : Path
        Bench file to be made.
    seed : int
        Of its chance.

    Returns
    -------
    list of str
        A line for each fact.

    Raises
    ------
    RefusedInput
        There is no such run, the receiver cannot be emulated, or the file is there already.
    StorageError
        A file cannot be read or written.
    """
    from belahil.config import as_toml, check_bench
    from belahil.recorded import read_windows
    from belahil.run_folder import read_bench, read_json
    from belahil.storage import write_whole
    from belahil.twin import twin_of

    if not (run / "summary.json").is_file():
        raise RefusedInput(f"{run}: there is no finished run; needed is one of belahil characterize")
    if file.exists():
        raise RefusedInput(f"{file}: is there already; give another name")
    summary = read_json(run / "summary.json")
    windows = read_windows(run / "data.nc")
    step_v = float(windows.columns["volts_per_count"][0])
    made = twin_of(summary, read_bench(run), windows.spec, step_v, seed)
    check_bench(made.config)
    head = [f"A twin of the receiver that was characterized from {summary.get('started')} on.", *made.told]
    write_whole(file, "".join(f"# {line}\n" for line in head) + "\n" + as_toml(made.config))
    return [*made.told, f"bench file: {file}; measure it with: belahil characterize --bench {file}"]
