"""Scan: the points of one epoch, in the sensor frame, with their normals; and thinning.

A ring scanner's points lie 0.2 degrees apart along a ring and 2 degrees apart across: the nearest neighbours of a point
are all on its own ring, and say nothing of the surface. So its normal is that of a window of angles around it that
grows until more than one ring is in it. Near surfaces have most of the points: thinning leaves one in each cube.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.geometry.arrays import as_points, as_unit_normals, read_only_view
from maxcon.geometry.pose import Pose, rotation_matrices

SAMPLE_EDGE, MOST_NORMALS = 0.4, 2500
"""Edge of the cubes of `Scan.sample`, m. Where more of its points have a normal, so many do for a pose, not all."""
NEAREST_GROUND, FARTHEST_GROUND = 2.5, 30.0
"""Ground is looked for between these distances, m: nearer there is the vehicle, farther rings lie apart."""
GROUND_CELL, GROUND_THICKNESS = 0.5, 0.12  # of each cell the points up to so much above the lowest are taken, m
GROUND_TILT_STEP = math.radians(4.0)
"""Cells are level to a half of this: the points of many poses are those of one search."""


def _frozen(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array, contiguous and read-only: normals and thinned scans made of it are kept beside it."""
    values = np.ascontiguousarray(values)
    values.flags.writeable = False
    return values


def estimate_scan_normals(
    points: NDArray[np.float64], is_asked: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Unit normals (n, 3) of a scan's points (n, 3), m, sensor frame, turned to the sensor; zeros where none is found.

    Only those asked for (n,) are estimated. Windows reach 6.9 degrees above and below a point: nearer than 1.25 m there
    are none. The same points in another order have the same normals, to the last bit.
    """
    from maxcon.scan.normal_kernels import scan_planes
    from maxcon.scan.window_kernels import azimuths_of, elevations_of, extremes

    points = np.ascontiguousarray(as_points(points, "points"))
    normals = np.empty_like(points)
    if len(points) == 0:
        return normals
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    lowest, highest = extremes(elevations)
    asked = np.ones(len(points), np.bool_) if is_asked is None else is_asked
    scan_planes(points, elevations, azimuths, lowest, highest, asked, normals)
    return normals


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoints:
    """Where the points of an epoch were measured from, by several scanners of one vehicle."""

    scanners: NDArray[np.int64]  # (n,): index into `poses`: which scanner each point comes from
    poses: tuple[Pose, ...]  # T_vehicle_sensor of each scanner

    def __post_init__(self) -> None:
        if len(self.scanners) and not 0 <= self.scanners.min() <= self.scanners.max() < len(self.poses):
            raise ArrayError(
                f"Expected `scanners` from 0 to {len(self.poses) - 1}, got {self.scanners.min()} to"
                f" {self.scanners.max()}."
            )

    def normals(self, points: NDArray[np.float64], is_asked: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return unit normals, (n, 3), of points, (n, 3), m, in the vehicle's frame, for each scanner by itself."""
        normals = np.zeros_like(points)
        for number, pose in enumerate(self.poses):
            rows = np.flatnonzero(self.scanners == number)
            points_sensor = (points[rows] - pose.position) @ pose.rotation
            asked = None if is_asked is None else is_asked[rows]
            normals[rows] = estimate_scan_normals(points_sensor, asked) @ pose.rotation.T
        return normals


class Scan:
    """The points of one epoch with their normals, as read-only copies.

    - points: shape (n, 3), sensor frame, m, finite. Drop (0, 0, 0) and NaN returns first (the readers do).
    - normals: shape (n, 3), unit normals in the sensor frame, turned to the sensor's side, zeros where there is none;
      estimated from the points when first asked for if None.
    - time: when the scan was taken, s.
    - viewpoints: where each point was measured from, if several scanners did; the sensor frame is the vehicle's then.

    An ArrayError if a shape is wrong, a value is not finite or a normal is not a unit vector.
    """

    def __init__(
        self, points: ArrayLike, normals: ArrayLike | None = None, time: float = 0.0,
        viewpoints: Viewpoints | None = None,
    ) -> None:  # fmt: skip
        self.points: NDArray[np.float64] = _frozen(as_points(points, "points").copy())
        self.time = float(time)
        self.viewpoints = viewpoints
        self._thinned: dict[float, Scan] = {}
        self._lowest: dict[tuple[int, int], NDArray[np.float64]] = {}
        if not np.isfinite(self.time):
            raise ArrayError(f"Expected a finite `time` of the scan, got {time}.")
        if viewpoints is not None and len(viewpoints.scanners) != len(self.points):
            raise ArrayError(f"Expected viewpoints of {len(self.points)} points, got {len(viewpoints.scanners)}.")
        if normals is not None:
            self.normals = _frozen(as_unit_normals(normals, len(self.points), "normals").copy())

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals, sensor frame, shape (n, 3); zeros where the points around do not determine one."""
        if self.viewpoints is not None:
            return _frozen(self.viewpoints.normals(self.points))
        return _frozen(estimate_scan_normals(self.points))

    def thinned(self, edge: float) -> Scan:
        """Return the scan with one of its points in each cube of an edge (m) of a grid in the sensor frame; 0 for all.

        A point with a normal comes before one without, then the nearest to the middle of the cube: which points are
        kept does not depend on their order. The normals are those of the whole scan.
        """
        if not 0.0 <= edge < math.inf:
            raise OptionError(f"Expected `edge` of thinning >= 0 m, got {edge}. With 0 all points are kept.")
        if edge == 0.0 or len(self) == 0:
            return self
        if edge not in self._thinned:
            kept = one_per_cube(self.points, edge, self.normals)
            self._thinned[edge] = self._part(self.points[kept], self.normals[kept])
        return self._thinned[edge]

    @cached_property
    def sample(self) -> Scan:
        """One of the points, drawn by lot, in each cube of `SAMPLE_EDGE`, with their normals; of many with one, some.

        Points are drawn before normals are known: these are estimated for them alone, from all points around. More
        points cost time and make no pose better.
        """
        kept = one_per_cube(self.points, SAMPLE_EDGE, by_lot=True)
        normals = self.__dict__.get("normals")
        if normals is None:
            is_asked = np.zeros(len(self), np.bool_)
            is_asked[kept] = True
            estimate = estimate_scan_normals if self.viewpoints is None else self.viewpoints.normals
            normals = estimate(self.points, is_asked)
        points, normals = self.points[kept], normals[kept]
        n_normals = int(np.count_nonzero(normals.any(axis=1)))
        if n_normals > MOST_NORMALS:
            kept = one_per_cube(points, SAMPLE_EDGE, by_lot=True, most=len(points) * MOST_NORMALS // n_normals)
            points, normals = points[kept], normals[kept]
        return self._part(points, normals)

    def lowest_points(self, roll: float = 0.0, pitch: float = 0.0) -> NDArray[np.float64]:
        """Means of the lowest points in cells of half a metre, shape (m, 3), sensor frame: what may be ground.

        `roll` and `pitch` are the sensor's, rad; the cells are level for the nearest multiples of `GROUND_TILT_STEP`.
        """
        from maxcon.scan import thinning_kernels

        steps = round(roll / GROUND_TILT_STEP), round(pitch / GROUND_TILT_STEP)
        if steps not in self._lowest:
            level = rotation_matrices(steps[0] * GROUND_TILT_STEP, steps[1] * GROUND_TILT_STEP, 0.0)
            self._lowest[steps] = thinning_kernels.lowest_of_cells(
                self.points, np.ascontiguousarray(level), GROUND_CELL, NEAREST_GROUND, FARTHEST_GROUND, GROUND_THICKNESS
            )
        return self._lowest[steps]

    def _part(self, points: NDArray[np.float64], normals: NDArray[np.float64]) -> Scan:
        """A scan of some of the points, which were checked already."""
        part = object.__new__(Scan)
        part.points, part.normals = _frozen(points), _frozen(normals)
        part.time, part.viewpoints, part._thinned, part._lowest = self.time, None, {}, {}
        return part

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, perhaps in another process: its arrays are read-only again."""
        self.__dict__.update(state)
        for name in self.__dict__.keys() & {"points", "normals"}:
            self.__dict__[name] = _frozen(self.__dict__[name])

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"Scan({len(self)} points, time={self.time!r})"


def one_per_cube(
    points: NDArray[np.float64], edge: float, normals: NDArray[np.float64] | None = None, *, by_lot: bool = False,
    most: int | None = None,
) -> NDArray[np.int64]:  # fmt: skip
    """Indices, ascending, of one of the points (n, 3), m, in each cube of an edge (m), whatever their order.

    A point with a normal comes first, then the nearest to the middle; or, `by_lot`, one drawn by a hash of coordinates:
    the nearest prefers a side of a noisy surface, and so moves a pose by millimetres. The grid is turned then: where a
    wall runs along the sides of cubes, a few stray points beyond them would weigh as much as all others. If there are
    more than `most` cubes, so many of them are drawn by lot.
    """
    from maxcon.scan import thinning_kernels

    normals = np.empty((0, 3)) if normals is None else normals
    most = len(points) if most is None else most
    kept = thinning_kernels.one_per_cube(read_only_view(points), read_only_view(normals), edge, by_lot, most)
    return np.asarray(kept, np.int64)
