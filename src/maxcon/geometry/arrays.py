# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Checks of arrays that come from outside, so that everything below may trust them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError

# A float32 unit vector read from a file is off by 1e-7; files with 2 to 3 decimals are off by 1e-3.
UNIT_TOLERANCE = 5e-3


def as_points(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `values` as float64 of shape (n, 3), all finite; else an ArrayError."""
    try:
        points = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArrayError(f"Expected `{name}` to be numbers of shape (n, 3), got {type(values).__name__}.") from error
    if points.ndim != 2 or points.shape[1] != 3:
        hint = " Transpose it?" if points.ndim == 2 and points.shape[0] == 3 else ""
        raise ArrayError(f"Expected `{name}` to have shape (n, 3), got {points.shape}.{hint}")
    if not np.isfinite(points).all():
        n_bad = int((~np.isfinite(points).all(axis=1)).sum())
        raise ArrayError(
            f"Expected finite coordinates in `{name}`, got {n_bad} of {len(points)} rows with NaN or infinity."
            " Drop those rows."
        )
    return points


def as_unit_normals(values: ArrayLike, n_points: int, name: str) -> NDArray[np.float64]:
    """Return `values` as float64 unit normals of shape (n_points, 3), zeros for none; else an ArrayError."""
    normals = as_points(values, name)
    if len(normals) != n_points:
        raise ArrayError(f"Expected `{name}` to have one row per point, {n_points}, got {len(normals)}.")
    lengths = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    wrong = (np.abs(lengths - 1.0) > UNIT_TOLERANCE) & (lengths != 0.0)
    if wrong.any():
        raise ArrayError(
            f"Expected unit normals in `{name}` (or zeros for none), got length {lengths[wrong][0]:.3g}"
            f" in row {int(np.flatnonzero(wrong)[0])}. Divide each row by its length."
        )
    return normals
