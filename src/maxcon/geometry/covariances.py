# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Checks of covariances of x, y and heading, and standard deviations from them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import SearchSpaceError

# Covariances in files have some six digits: smaller asymmetries and negative eigenvalues are rounding.
ROUNDING = 1e-6


class CovarianceFault(NamedTuple):
    """The index of the first matrix that is no covariance, and why, for an error message."""

    row: int
    words: str


def first_covariance_fault(matrices: NDArray[np.float64]) -> CovarianceFault | None:
    """Return the first matrix that cannot be a covariance, or None if all can.

    matrices : shape (n, 3, 3), of x, y and heading: m^2, m rad and rad^2.
    """
    is_finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    finite = np.where(is_finite[:, None, None], matrices, 0.0)
    variances = np.diagonal(finite, axis1=1, axis2=2)
    is_positive = variances.min(axis=1) >= 0.0
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    scales = np.where(sigmas > 0.0, sigmas, 1.0)
    # Tested as correlations, without units, as m^2 stands beside rad^2; cut at 2, as all beyond 1 is too large alike.
    with np.errstate(over="ignore"):
        correlations = np.clip(finite / scales[:, None, :] / scales[:, :, None], -2.0, 2.0)
    is_symmetric = np.asarray(np.abs(correlations - correlations.transpose(0, 2, 1)).max(axis=(1, 2)) <= ROUNDING)
    is_semidefinite = np.linalg.eigvalsh(correlations).min(axis=1) >= -ROUNDING
    is_good = is_finite & is_positive & is_symmetric & is_semidefinite
    if is_good.all():
        return None
    row = int(np.argmin(is_good))
    values = matrices[row].tolist()
    if not is_finite[row]:
        words = "Expected finite numbers in a covariance, got NaN or infinity. Without a covariance, give half widths."
    elif not is_positive[row]:
        words = f"Expected variances >= 0 on the diagonal of a covariance, got {variances[row].min():g}."
    elif not is_symmetric[row]:
        words = f"Expected a symmetric covariance, got {values}. Take the mean of it and its transpose?"
    else:
        words = (
            f"Expected a positive semidefinite covariance of x, y and heading, got {values}: its covariances are too"
            " large for its variances. Are all in m and rad, and none a standard deviation?"
        )
    return CovarianceFault(row, words)


def sigmas_of(covariance: ArrayLike) -> NDArray[np.float64]:
    """Standard deviations of x, y (m) and heading (rad), shape (3,), of a prior's covariance, shape (3, 3).

    A SearchSpaceError if it cannot be a covariance.
    """
    try:
        matrix = np.asarray(covariance, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SearchSpaceError(
            f"Expected `covariance` to be numbers of shape (3, 3), got {type(covariance).__name__}."
        ) from error
    if matrix.shape != (3, 3):
        raise SearchSpaceError(
            f"Expected `covariance` of (x, y, heading) to have shape (3, 3), got {matrix.shape}."
            " Take its rows and columns of x, y and heading."
        )
    fault = first_covariance_fault(matrix[None])
    if fault is not None:
        raise SearchSpaceError(fault.words)
    return np.sqrt(np.diag(matrix))
