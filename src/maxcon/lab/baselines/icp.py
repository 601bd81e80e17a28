# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Icp: iterative closest points, point to plane or point to point."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import invert
from maxcon.lab.baselines.map_targets import MapTargets, Place, thin
from maxcon.lab.baselines.started import StartedMethod, check_options, no_answer
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import NamedOption, turn, upright

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

        arms, shape (n, 3): from the sensor to each scan point, axes of the map, m; a turn dh moves it by (-y, x, 0) dh.
        offsets, shape (n, 3): r, m. normals, shape (n, 3): of the map at q; not used by `POINT`.
        The rows of A are the derivatives of the residuals; a step d of Gauss-Newton solves N d = -A^T r.
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

    A turn is as long as the way it moves a point at the distance `arm`, m. Also returns whether no direction is open.
    """
    matrix, gradient = equations
    scale = np.array([1.0, 1.0, 1.0 / max(arm, 1e-3)])
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    is_fixed = values > OPEN_RATIO * values[-1]
    along = vectors[:, is_fixed]
    step = -along @ ((along.T @ (scale * gradient)) / values[is_fixed])
    return scale * step, bool(is_fixed.all())


@dataclass(frozen=True, slots=True, eq=False)
class _Target:
    """Points of the map, their normals, each of shape (n, 3), and a tree to find the nearest."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    tree: Any


@dataclass(frozen=True)
class Icp(StartedMethod):
    """Localizes scans by ICP: the nearest map point of each scan point, a least-squares step, and again.

    Unknown are x, y and heading, which turns about the sensor; z, roll and pitch are the prior's, as with
    maximum consensus (D2). The answer is the nearest minimum, which need not be the right one: what it
    says of itself (`status`, `cofactor`) holds only if it is. Without ground in the map, scan points on the ground,
    on cars and on bushes find no partner within the gate, or a wrong one at the foot of a facade.

    - residual: "plane" or "point": distance of a scan point from the plane of its partner, or from its partner.
    - gate: a scan point farther than this from every map point (in x, y and z together) has no partner, m.
      **State it with every figure**: from the paper's 5 x 5 starts, point-to-plane fails in 37 of 40 epochs
      of a simulated drive with 1 m and in none with 3 m; wrong partners within 3 m cost precision instead.
    - thinning: the scan is thinned to one point, the mean, per cube of this edge, m; 0 for all points. Without it
      the near ground and the nearest facade outvote the rest.
    - max_iterations: point-to-point slides along a wall by a little in each step: 50 are too few.
    - step_tolerance, turn_tolerance: converged when a step is shorter than this, m, and turns less than this, rad.
    - target_edge: the voxels of the map are merged to one point, the mean, per cube of this edge, m.
    - targets: cache of what is made of the map; methods with the same object share it.

    Of the estimate, `score` is the number of correspondences of the last step and `share` their fraction of the thinned
    scan. `cofactor` is the inverse of the x, y block of N at the last step, with the heading held, in units of one
    residual's variance; with `point`, N has the same weight in all directions and cannot tell an open one. Status
    `UNDETERMINED` if N leaves a direction open or nearly so, `NO_MATCH` (and the prior) if no scan point is within the
    gate, `NOT_CONVERGED` if the last step was not small.
    """

    residual: str | Residual = Residual.PLANE
    gate: float = 1.0
    thinning: float = 0.75
    max_iterations: int = 100
    step_tolerance: float = 3e-3
    turn_tolerance: float = 5e-4
    target_edge: float = 0.25
    targets: MapTargets = field(default_factory=MapTargets, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "residual", Residual.parse(self.residual))
        check_options(self, "thinning")

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> "_IcpAligner":
        """Thin the scan and find the map around it: what all starts within `spread` (m) of `around` share."""
        place = Place.of_scan(scan.points, around, self.gate, spread)
        points = thin(scan.points, self.thinning)
        without_normals = Scan(points, np.zeros_like(points), scan.time)
        key = ("icp", place, self.target_edge, self.residual)
        target = self.targets.get(point_map, key, lambda: self._target(point_map, place))
        return _IcpAligner(self, without_normals, target)

    def _target(self, point_map: PointMap, place: Place) -> _Target:
        from scipy.spatial import cKDTree

        points, normals = self.targets.planes(point_map, place, self.target_edge)
        if self.residual is Residual.PLANE:
            is_plane = normals.any(axis=1)
            points, normals = points[is_plane], normals[is_plane]
        # Facades are flat: a balanced, compact tree of them takes twice as long to build and to ask.
        return _Target(points, normals, cKDTree(points, balanced_tree=False, compact_nodes=False))


@dataclass(frozen=True, slots=True, eq=False)
class _IcpAligner:
    """A thinned scan and the map around it, ready for any start near by."""

    method: Icp
    scan: Scan
    target: _Target

    def align(self, start: Pose) -> Estimate:
        """Iterate from a start to the end."""
        method, target, residual = self.method, self.target, Residual(self.method.residual)
        points = upright(self.scan, start).points
        x, y, heading = start.x, start.y, start.heading
        status = Status.NOT_CONVERGED
        for _ in range(method.max_iterations):
            arms = turn(points, heading)
            placed = arms + [x, y, 0.0]
            _, nearest = target.tree.query(placed, distance_upper_bound=method.gate)
            matched = np.flatnonzero(nearest < len(target.points))
            if not len(matched):
                return no_answer(start)
            partners = nearest[matched]
            equations = residual.normal_equations(
                arms[matched], placed[matched] - target.points[partners], target.normals[partners]
            )
            arm = math.sqrt(float((arms[matched, :2] ** 2).sum()) / len(matched))
            step, is_full = smallest_step(equations, arm)
            x, y, heading = x + float(step[0]), y + float(step[1]), heading + float(step[2])
            if math.hypot(step[0], step[1]) < method.step_tolerance and abs(step[2]) < method.turn_tolerance:
                status = Status.LOCALIZED
                break
        is_determined, cofactor = invert(equations[0][:2, :2])
        if not (is_determined and is_full):
            status = Status.UNDETERMINED
        pose = Pose(x, y, start.z, start.roll, start.pitch, heading)
        n_matched, n_points = len(matched), len(points)
        return Estimate(pose, float(n_matched), None, status, cofactor, n_matched / n_points)

    def n_near_map(self, pose: Pose, distance: float) -> int:
        placed = pose.apply(self.scan.points)
        _, nearest = self.target.tree.query(placed, distance_upper_bound=distance)
        return int((nearest < len(self.target.points)).sum())
