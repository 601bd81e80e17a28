"""Checks of points, normals and covariances that come from outside, so that everything below may trust them."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, SearchSpaceError

# A float32 unit vector read from a file is off by 1e-7; files with 2 to 3 decimals are off by 1e-3.
UNIT_TOLERANCE = 5e-3
ROUNDING = 1e-6  # covariances in files have some six digits: smaller asymmetries and negative eigenvalues are rounding


def as_points(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return `values` as float64 of shape (n, 3), all finite; else an ArrayError."""
    try:
        points = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArrayError(f"Expected `{name}` to be numbers of shape (n, 3), got {type(values).__name__}.") from error
    if points.ndim != 2 or points.shape[1] != 3:
        hint = " Transpose it?" if points.ndim == 2 and points.shape[0] == 3 else ""
        raise ArrayError(f"Expected `{name}` to have shape (n, 3), got {points.shape}.{hint}")
    is_finite = np.isfinite(points)
    if not is_finite.all():  # row by row it takes ten times as long
        found = f"{np.count_nonzero(~is_finite.all(axis=1))} of {len(points)} rows with NaN or infinity"
        raise ArrayError(f"Expected finite coordinates in `{name}`, got {found}. Drop those rows.")
    return points


def as_unit_normals(values: ArrayLike, n_points: int, name: str) -> NDArray[np.float64]:
    """Return `values` as float64 unit normals of shape (n_points, 3), zeros for none; else an ArrayError."""
    normals = as_points(values, name)
    if len(normals) != n_points:
        raise ArrayError(f"Expected `{name}` to have one row per point, {n_points}, got {len(normals)}.")
    lengths = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    wrong = np.flatnonzero((np.abs(lengths - 1.0) > UNIT_TOLERANCE) & (lengths != 0.0))
    if len(wrong):
        found = f"length {lengths[wrong[0]]:.3g} in row {wrong[0]}"
        raise ArrayError(
            f"Expected unit normals in `{name}` (or zeros for none), got {found}. Divide each row by its length."
        )
    return normals


def first_covariance_fault(matrices: NDArray[np.float64]) -> tuple[int, str] | None:
    """Return the number of the first matrix (n, 3, 3) of x, y and heading that is no covariance, and why; or None."""
    is_finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    finite = np.where(is_finite[:, None, None], matrices, 0.0)
    variances = np.diagonal(finite, axis1=1, axis2=2)
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    scales = np.where(sigmas > 0.0, sigmas, 1.0)
    # Tested as correlations, without units, as m^2 stands beside rad^2; cut at 2, as all beyond 1 is too large alike.
    with np.errstate(over="ignore"):
        correlations = np.clip(finite / scales[:, None, :] / scales[:, :, None], -2.0, 2.0)
    is_symmetric = np.abs(correlations - correlations.transpose(0, 2, 1)).max(axis=(1, 2)) <= ROUNDING
    is_semidefinite = np.linalg.eigvalsh(correlations).min(axis=1) >= -ROUNDING
    is_good = is_finite & (variances.min(axis=1) >= 0.0) & is_symmetric & is_semidefinite
    if is_good.all():
        return None
    row = int(np.argmin(is_good))
    return row, (
        "Expected a covariance of x, y and heading, finite, symmetric and positive semidefinite, got"
        f" {matrices[row].tolist()}. Is all in m and rad, and none a standard deviation?"
    )


def sigmas_of(covariance: ArrayLike) -> NDArray[np.float64]:
    """Standard deviations (3,) of a covariance (3, 3) of x, y (m) and heading (rad); else a SearchSpaceError."""
    try:
        matrix = np.asarray(covariance, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (3, 3):
        raise SearchSpaceError(
            f"Expected `covariance` of x, y and heading to be numbers of shape (3, 3), got {matrix.shape}."
            " Take its rows and columns of x, y and heading."
        )
    fault = first_covariance_fault(matrix[None])
    if fault is not None:
        raise SearchSpaceError(fault[1])
    return np.sqrt(np.diag(matrix))


def read_only_view(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array in one piece, read-only: kernels would be compiled once more for arrays that can be written."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
