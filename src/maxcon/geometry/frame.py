# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The local frame of a map (D1), and the voxels that coordinates in it fall into (D4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.geometry.arrays import as_points
from maxcon.geometry.pose import Pose

# Indices stay in int32 with room for a search space on every side: at 6 cm that is 64,000 km.
INDEX_LIMIT = 2**30


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The frame everything inside a map is expressed in: metres about a float64 origin, with a CRS.

    - origin: global coordinates of the local (0, 0, 0), m, float64: a float32 northing of 5.8e6 m has steps of 0.5 m.
    - crs: WKT of the global coordinate reference system; None where it is not known.
    """

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    crs: str | None = None

    def __post_init__(self) -> None:
        origin = tuple(float(value) for value in self.origin)
        if len(origin) != 3 or not np.isfinite(origin).all():
            raise ArrayError(f"Expected three finite numbers as the origin of a LocalFrame, got {self.origin}.")
        object.__setattr__(self, "origin", origin)

    def to_local(self, points_global: ArrayLike) -> NDArray[np.float64]:
        """Local coordinates, shape (n, 3), m, of global ones."""
        return np.subtract(as_points(points_global, "points_global"), self.origin)

    def to_global(self, points_local: ArrayLike) -> NDArray[np.float64]:
        """Global coordinates, shape (n, 3), m, of local ones."""
        return np.add(as_points(points_local, "points_local"), self.origin)

    def pose_to_local(self, pose_global: Pose) -> Pose:
        """Return the same pose with its position in this frame."""
        return pose_global.translated(-np.array(self.origin))

    def pose_to_global(self, pose_local: Pose) -> Pose:
        """Return the same pose with its position in global coordinates."""
        return pose_local.translated(self.origin)


def voxel_indices(points: NDArray[np.float64], cell: float) -> NDArray[np.int32]:
    """Index floor(coordinate / cell) of each point's voxel, (n, 3); ArrayError beyond 2^30 (64,000 km at 6 cm)."""
    scaled = np.floor(points / cell)
    if scaled.size and max(scaled.max(), -scaled.min()) >= INDEX_LIMIT:
        raise ArrayError(
            f"Expected points within {INDEX_LIMIT * cell:.3g} m of the local origin, got"
            f" {np.abs(points).max():.3g} m. Express them in a local frame."
        )
    return scaled.astype(np.int32)


def voxel_centers(indices: NDArray[np.int32], cell: float) -> NDArray[np.float64]:
    """Centre of each voxel, shape (n, 3), local frame, m."""
    return (indices.astype(np.float64) + 0.5) * cell
