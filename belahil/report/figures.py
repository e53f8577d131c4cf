"""Figures as files: vector and PNG, with a label where the data are not from hardware."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.storage import replacing

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from matplotlib.figure import Figure

LABELS = {
    "emulated": "EMULATED DATA",
    "simulated": "SIMULATED DATA",
    "replay": "REPLAYED DATA",
    "hardware": "",
}
DOTS_PER_INCH = 160
LABEL_INCHES = 0.145  # height of the label below a figure
SIDE_INCHES = 0.06  # beside labels of axes


def save_figures(
    folder: Path, figures: Mapping[str, Callable[[], Figure]], source: str
) -> list[dict[str, str]]:
    """Draw each figure and write ``figure-<name>.svg`` and ``.png``.

    Parameters
    ----------
    folder : Path
        The run folder.
    figures : mapping of str to callable
        Each draws one figure.
    source : str
        Decides the label.

    Returns
    -------
    list of dict
        ``caption``, ``svg`` and ``png`` (file names) of each.

    Raises
    ------
    StorageError
        A file could not be written.
    """
    saved = []
    for name, draw in figures.items():
        figure = draw()
        if LABELS[source]:
            _mark(figure, LABELS[source])
        files = {"svg": f"figure-{name}.svg", "png": f"figure-{name}.png"}
        # Without date and with a fixed salt, so that equal results give equal files.
        _save(figure, folder / files["svg"], "svg", name, {"Date": None, "Title": name})
        # What the first has laid out serves the second too: laying out costs as much as drawing.
        figure.set_layout_engine(None)
        _save(figure, folder / files["png"], "png", name, {"Title": name})
        caption = str(figure.get_label() or name.replace("_", " ").replace("-", " ").capitalize())
        saved.append({"caption": caption, **files})
    return saved


def _mark(figure: Figure, label: str) -> None:
    engine = figure.get_layout_engine()
    if engine is not None and engine.get().get("rect") == (0, 0, 1, 1):
        # Else the label stands on the legend of an axis.
        foot, side = LABEL_INCHES / figure.get_figheight(), SIDE_INCHES / figure.get_figwidth()
        engine.set(rect=(side, foot, 1 - 2 * side, 1 - foot))  # type: ignore[call-arg]
    below = 0.2 * LABEL_INCHES / figure.get_figheight()
    figure.text(0.995, below, label, ha="right", va="bottom", fontsize=8, color="#a00000", weight="bold")
    size = 4 * figure.get_figwidth()  # points, so that the words fill half the width
    figure.text(
        0.5, 0.5, label, ha="center", va="center", fontsize=size, rotation=24, color="#a00000", alpha=0.07
    )


def _save(figure: Figure, path: Path, kind: str, name: str, metadata: dict[str, str | None]) -> None:
    from matplotlib import rc_context

    with replacing(path) as temporary, rc_context({"svg.hashsalt": name, "svg.fonttype": "path"}):
        figure.savefig(temporary, format=kind, dpi=DOTS_PER_INCH, metadata=metadata)
