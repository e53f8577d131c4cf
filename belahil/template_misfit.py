"""How well shapes fit the samples of a pulse when only their scale is free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True, eq=False)
class TemplateMisfit:
    """Mean squared residuals.

    Parameters
    ----------
    status : {"ok", "no_pulse"}
        ``no_pulse``: the samples or a shape are zero; then nothing is best.
    best : int or None
        Shape of least misfit.
    mean_square_v2 : ndarray, shape (k,)
        Mean squared residual of each shape, V^2.
    amplitude_v : ndarray, shape (k,)
        Scale of each shape.
    """

    status: Literal["ok", "no_pulse"]
    best: int | None
    mean_square_v2: NDArray[np.floating]
    amplitude_v: NDArray[np.floating]


def template_misfit(volts: ArrayLike, shapes: ArrayLike) -> TemplateMisfit:
    """Scale each shape to the samples by least squares, and return what is left.

    Parameters
    ----------
    volts : array_like of float, shape (n,)
        Samples; single precision stays single.
    shapes : array_like of float, shape (k, n)

    Raises
    ------
    RefusedInput
        Shapes that do not fit together, or values that are not finite.

    Notes
    -----
    The residual is formed before it is squared. The shorter v.v - (v.g)^2 / g.g cancels: in single precision
    nothing is left of a residual of 1e-4 of the pulse.
    """
    samples, each = np.asarray(volts), np.atleast_2d(np.asarray(shapes))
    if samples.ndim != 1 or each.ndim != 2 or each.shape[1] != samples.size or not samples.size:
        raise RefusedInput(f"shapes {each.shape} for samples {samples.shape}: (k, n) and (n,) are allowed")
    if not (np.isfinite(samples).all() and np.isfinite(each).all()):
        raise RefusedInput("samples or shapes are not finite: leave such samples out of both")
    largest = np.abs(each).max(axis=1, keepdims=True)
    unit = each / np.where(largest > 0, largest, 1)
    norm = np.einsum("kn,kn->k", unit, unit)
    scale = (unit @ samples) / np.where(norm > 0, norm, 1)
    residual = samples - scale[:, None] * unit
    mean_square = np.mean(residual * residual, axis=1)
    amplitude = scale / np.where(largest > 0, largest, 1)[:, 0]
    if not samples.any() or not (norm > 0).all():
        return TemplateMisfit("no_pulse", None, mean_square, amplitude)
    return TemplateMisfit("ok", int(np.argmin(mean_square)), mean_square, amplitude)
