# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What ICP makes small, and its normal equations for x, y and heading."""

import numpy as np
from numpy.typing import NDArray

from maxcon.search.options import NamedOption

__all__ = ["NormalEquations", "Residual", "smallest_step"]

NormalEquations = tuple[NDArray[np.float64], NDArray[np.float64]]
"""N = A^T A, shape (3, 3), and A^T r, shape (3,), of the unknowns x, y (m) and heading (rad)."""

# Eigenvalues below this part of the largest are rounding: the direction is open.
OPEN_RATIO = 1e-6


class Residual(NamedOption, option="residual"):
    """How far a scan point is from its partner in the map, r = p - q."""

    PLANE = "plane"
    """n.r, the distance from the plane through q with normal n: a number, one per correspondence.

    Not the three numbers (nx rx, ny ry, nz rz), whose squares do not sum up to (n.r)^2: in a wall that is not
    parallel to an axis they punish a point for sliding along the wall (design, section 4).
    """

    POINT = "point"
    """r itself."""

    def normal_equations(
        self, arms: NDArray[np.float64], offsets: NDArray[np.float64], normals: NDArray[np.float64]
    ) -> NormalEquations:
        """Linearize half the sum of squared residuals at the present pose.

        arms: shape (n, 3); from the sensor to each scan point, axes of the map, m. A turn dh moves the point by (-y, x,
            0) dh.
        offsets: shape (n, 3); r = p - q, m.
        normals: shape (n, 3); unit normals of the map at q; not used by `POINT`.
        Returns N: shape (3, 3); A^T A; the rows of A are the derivatives of the residuals by x, y and heading.
        Returns gradient: shape (3,); A^T r. A step d of Gauss-Newton solves N d = -gradient.
        """
        x, y, _ = arms.T
        if self is Residual.PLANE:
            design = np.column_stack([normals[:, 0], normals[:, 1], normals[:, 1] * x - normals[:, 0] * y])
            return design.T @ design, design.T @ np.einsum("ij,ij->i", normals, offsets)
        n, turn_x, turn_y = float(len(x)), float(-y.sum()), float(x.sum())
        matrix = np.array([[n, 0.0, turn_x], [0.0, n, turn_y], [turn_x, turn_y, float(x @ x + y @ y)]])
        gradient = [offsets[:, 0].sum(), offsets[:, 1].sum(), x @ offsets[:, 1] - y @ offsets[:, 0]]
        return matrix, np.array(gradient)


def smallest_step(equations: NormalEquations, arm: float) -> tuple[NDArray[np.float64], bool]:
    """Shortest step d with N d = -gradient: nothing moves in a direction that N leaves open.

    equations: N and the gradient.
    arm: a turn is as long as the way it moves a point at this distance, m.
    Returns step: shape (3,); of x, y (m) and heading (rad).
    Returns is_full: whether N leaves no direction open.
    """
    matrix, gradient = equations
    scale = np.array([1.0, 1.0, 1.0 / max(arm, 1e-3)])
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    is_fixed = values > OPEN_RATIO * values[-1]
    along = vectors[:, is_fixed]
    step = -along @ ((along.T @ (scale * gradient)) / values[is_fixed])
    return scale * step, bool(is_fixed.all())
