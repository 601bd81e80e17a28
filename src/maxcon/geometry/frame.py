# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LocalFrame: metres about a float64 origin, with a CRS (D1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.geometry.arrays import as_points
from maxcon.geometry.pose import Pose

__all__ = ["LocalFrame"]


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The frame everything inside a map is expressed in.

    Global coordinates stay float64: a float32 at a UTM northing of 5.8e6 m has steps of 0.5 m.

    Parameters
    ----------
    origin : tuple of 3 float
        Global coordinates of the local (0, 0, 0), m.
    crs : str or None
        WKT of the global coordinate reference system; None where it is not known.
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
        points = as_points(points_global, "points_global")
        points_local: NDArray[np.float64] = points - np.array(self.origin)
        return points_local

    def to_global(self, points_local: ArrayLike) -> NDArray[np.float64]:
        """Global coordinates, shape (n, 3), m, of local ones."""
        points = as_points(points_local, "points_local")
        points_global: NDArray[np.float64] = points + np.array(self.origin)
        return points_global

    def pose_to_local(self, pose_global: Pose) -> Pose:
        """Return the same pose with its position in this frame."""
        return pose_global.translated(-np.array(self.origin))

    def pose_to_global(self, pose_local: Pose) -> Pose:
        """Return the same pose with its position in global coordinates."""
        return pose_local.translated(self.origin)
