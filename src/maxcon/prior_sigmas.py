# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Standard deviations of a prior, from a covariance that can be one."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import SearchSpaceError

__all__ = ["sigmas_of"]

# Covariances come printed with some six digits: what they violate by less is rounding.
ROUNDING = 1e-6


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
    if not np.isfinite(matrix).all():
        raise SearchSpaceError(
            "Expected finite numbers in `covariance`, got NaN or infinity. Without a covariance, give half widths."
        )
    variances = np.diag(matrix)
    if variances.min() < 0.0:
        raise SearchSpaceError(
            f"Expected variances >= 0 on the diagonal of `covariance`, got {variances.min():g}."
        )
    sigmas = np.sqrt(variances)
    scales = np.where(sigmas > 0.0, sigmas, 1.0)
    correlations = matrix / scales / scales[:, None]  # free of units: m^2 beside rad^2
    if np.abs(correlations - correlations.T).max() > ROUNDING:
        raise SearchSpaceError(
            f"Expected a symmetric `covariance`, got {matrix.tolist()}. Take the mean of it and its transpose?"
        )
    if np.linalg.eigvalsh(correlations).min() < -ROUNDING:
        raise SearchSpaceError(
            f"Expected `covariance` to be positive semidefinite, got {matrix.tolist()}: its covariances are too"
            " large for its variances. Are all in m and rad, and none a standard deviation?"
        )
    return np.asarray(sigmas, dtype=np.float64)
