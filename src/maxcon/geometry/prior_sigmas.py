# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Standard deviations of a prior, from a covariance that can be one."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import SearchSpaceError
from maxcon.geometry.covariances import first_covariance_fault

__all__ = ["sigmas_of"]


def sigmas_of(covariance: ArrayLike) -> NDArray[np.float64]:
    """Standard deviations of x, y (m) and heading (rad), shape (3,), of a covariance that can be one."""
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
