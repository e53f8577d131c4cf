"""What a procedure hands over when it has analysed its shots; the run folder is made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from belahil.values import Estimate
    from belahil.verdict import Check

    Column = tuple[NDArray[Any], str, str]
    """Array of shape (n,) or (n, m), its SI unit, and what it is in a few words."""

    Number = tuple[Estimate | None, str, str]
    """A measured number or None, its SI unit, and what it is in a few words."""

STATUSES = (
    "ok",
    "clipped",
    "below_dither",
    "no_signal",
    "short_record",
    "frequency_not_measurable",
    "no_usable_point",
    "too_few_points",
    "cutoff_not_identified",
    "order_not_identified",
    "noise_clipped",
    "noise_below_dither",
    "noise_no_signal",
    "saturated",
    "width_undetermined",
    "no_pulse",
    "inverted",
    "too_few_samples",
    "not_converged",
    "differs",
    "no_samples",
    "no_candidates",
    "no_marker",
    "another_receiver",
    "not_known",
    "marker_lost",
    "echo_too_faint",
    "mixed_gain_codes",
    "equal_windows",
    "pulse_below_noise",
    "no_light",
    "not_two_pulses",
    "not_significant",
    "too_few_amplitudes",
    "not_identified",
    "inconsistent",
)
"""All words of a status column. The place of a word is its number in data files, so new ones go last."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of results, one row for each value of one dimension.

    Parameters
    ----------
    columns : mapping of str to (ndarray of shape (n,) or (n, m), unit, long_name)
        Floats, integers, or strings (out of `STATUSES`); a masked array where a value is missing. The column
        that is named like the dimension becomes its coordinate.
    dimension : str
        Name of the rows in the data file.
    across : str
        Name of the second dimension, where a column has one.

    Raises
    ------
    ValueError
        Columns of different lengths, or of two dimensions where only one has a name.
    """

    columns: Mapping[str, Column]
    dimension: str
    across: str = ""

    def __post_init__(self) -> None:
        shapes = {name: column[0].shape for name, column in self.columns.items()}
        deepest = 2 if self.across else 1
        if any(not 1 <= len(shape) <= deepest for shape in shapes.values()) or (
            len({shape[0] for shape in shapes.values()}) != 1
        ):
            raise ValueError(f"columns of one table need one row count; these have the shapes {shapes}")


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """One contribution to the uncertainty of one result.

    Parameters
    ----------
    quantity : str
        The result, for example ``gain, code 4``.
    source : str
        Where the contribution comes from, for example ``[generator] uncertainty.amplitude_relative``.
    value : float
        Standard uncertainty that this source alone would give, in `unit`.
    unit : str
        SI unit of the result.
    share : float
        Part of the combined variance, 0 to 1.
    """

    quantity: str
    source: str
    value: float
    unit: str
    share: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """Results, tables, figures and budget of a procedure.

    Parameters
    ----------
    results : dict
        Ready for JSON, as ``summary.json`` shows them; nothing in it depends on link, time or path.
    tables : mapping of str to Table
        For the data file, in which each column is a variable of its name.
    numbers : mapping of str to Number
        For the data file.
    figures : mapping of str to callable
        Each call draws one figure; the key names its files. Its label (``Figure.set_label``) is its caption.
    budget : sequence of BudgetLine
        Largest first within one quantity.
    conditions : mapping of str to str
        Circumstances by name, for the report.
    notes : sequence of str
        Sentences for the report: conditions, and what is not modelled.
    verdict_values : mapping of str to sequence of (label, Estimate or None)
        For each key of ``[limits]`` what is compared with it; None where nothing was measured.
    checks : sequence of Check
        What the procedure itself compares and decides, whatever ``[limits]`` holds; the verdict covers both.
    said : sequence of str
        What the terminal tells of the results, line by line; the report begins with it.
    """

    results: dict[str, Any]
    tables: Mapping[str, Table] = field(default_factory=dict)
    numbers: Mapping[str, Number] = field(default_factory=dict)
    figures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    budget: Sequence[BudgetLine] = ()
    conditions: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    verdict_values: Mapping[str, Sequence[tuple[str, Estimate | None]]] = field(default_factory=dict)
    checks: Sequence[Check] = ()
    said: Sequence[str] = ()
