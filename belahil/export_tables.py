"""Results in the data file: a variable for each column of a table and for each single number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import STATUSES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from belahil.outcome import Number, Table

NO_FLOAT = 9.969209968386869e36  # the default fill value of NetCDF


def write_table(file: Any, name: str, table: Table) -> None:
    """Write the columns of a table, each under its own name.

    Parameters
    ----------
    file : h5netcdf.File
        Open for writing.
    name : str
        Of the table, for what goes wrong.
    table : Table
        A dimension that the file has already must have as many rows there.

    Raises
    ------
    ValueError
        Two sizes of one dimension, or a status that is not in `belahil.outcome.STATUSES`.
    """
    for column, (values, unit, long_name) in table.columns.items():
        dimensions = (table.dimension, table.across)[: values.ndim]
        for dimension, size in zip(dimensions, values.shape, strict=True):
            known = file.dimensions.get(dimension)
            if known is None:
                file.dimensions[dimension] = size
            elif known.size != size:
                raise ValueError(f"table {name}: {size} rows, dimension {dimension} has {known.size}")
        data, fill, more = _stored(values)
        fill = None if column == table.dimension else fill
        made = file.create_variable(column, dimensions, data.dtype, data=data, fillvalue=fill)
        made.attrs["long_name"] = long_name
        made.attrs.update(more or {"units": unit})


def write_numbers(file: Any, numbers: Mapping[str, Number]) -> None:
    """Write single numbers, each with its standard uncertainty in ``<name>_u``; the fill value for None."""
    for name, (estimate, unit, words) in numbers.items():
        values = (NO_FLOAT, NO_FLOAT)
        if estimate is not None:
            values = (estimate.value, estimate.standard_uncertainty)
        told = (words, f"standard uncertainty of: {words}")
        for ending, value, long_name in zip(("", "_u"), values, told, strict=True):
            made = file.create_variable(name + ending, (), "f8", data=value, fillvalue=NO_FLOAT)
            made.attrs["long_name"] = long_name
            made.attrs["units"] = unit


def _stored(values: NDArray[Any]) -> tuple[NDArray[Any], Any, dict[str, Any]]:
    """Return what goes to the file, its fill value, and attributes that take the place of a unit."""
    missing = np.ma.getmaskarray(values)
    data = np.ma.getdata(values)
    if data.dtype.kind in "UO":
        flags = np.array([STATUSES.index(str(word)) for word in data], np.int8)
        meanings = {
            "flag_values": np.arange(len(STATUSES), dtype=np.int8),
            "flag_meanings": " ".join(STATUSES),
        }
        return flags, None, meanings
    if data.dtype.kind == "f":
        missing = missing | np.isnan(data)
        return np.where(missing, NO_FLOAT, data), NO_FLOAT, {}
    if data.dtype.kind == "b":
        return data.astype(np.int8), None, {}
    lowest = np.iinfo(data.dtype).min if data.dtype.kind == "i" else np.iinfo(data.dtype).max
    return np.where(missing, lowest, data).astype(data.dtype), lowest if missing.any() else None, {}
