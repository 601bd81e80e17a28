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
    """r itself, in x and y."""

    def normal_equations(
        self, arms: NDArray[np.float64], offsets: NDArray[np.float64], normals: NDArray[np.float64]
    ) -> NormalEquations:
        """Linearize at the present pose; arms from the sensor, residuals, normals of the map, (n, 3), its axes, m."""
        x, y, _ = arms.T
        matrix, gradient = np.zeros((3, 3)), np.zeros(3)
        for along in [normals] if self is Residual.PLANE else np.eye(3)[:2, None]:
            columns = np.broadcast_arrays(along[:, 0], along[:, 1], along[:, 1] * x - along[:, 0] * y)
            design = np.column_stack(columns)
            matrix += design.T @ design
            gradient += design.T @ (along * offsets).sum(axis=1)
        return matrix, gradient


def smallest_step(equations: NormalEquations, arm: float) -> tuple[NDArray[np.float64], bool]:
    """Shortest step d with N d = -gradient, and whether no direction is open; a turn is as long as at `arm`, m."""
    matrix, gradient = equations
    scale = np.array([1.0, 1.0, 1.0 / max(arm, 1e-3)])
    step, _, rank, _ = np.linalg.lstsq(matrix * np.outer(scale, scale), -scale * gradient, rcond=OPEN_RATIO)
    return scale * step, bool(rank == len(scale))


@dataclass(frozen=True, slots=True, eq=False)
class _Target:
    """Points of the map, their normals, each of shape (n, 3), and a tree to find the nearest."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    tree: Any


@dataclass(frozen=True)
class Icp(StartedMethod):
    """Localizes scans by ICP in x, y and heading; z, roll and pitch are the prior's (D2).

    **State the gate with every figure**: from the paper's 5 x 5 starts, point-to-plane fails in 37 of 40 epochs of a
    simulated drive with 1 m and in none with 3 m. `score` counts the correspondences of the last step, `share` is their
    fraction; `cofactor` is the inverse of the x, y block of N, which with `point` cannot tell an open direction.
    """

    residual: str | Residual = Residual.PLANE  # or "point"
    gate: float = 1.0  # a scan point farther than this from every map point has no partner, m
    thinning: float = 0.75  # the scan is thinned to a mean per cube of this edge, m; 0: the near ground outvotes all
    max_iterations: int = 100  # point-to-point slides along a wall by a little in each step: 50 are too few
    step_tolerance: float = 3e-3  # converged when a step is shorter than this, m,
    turn_tolerance: float = 5e-4  # and turns less than this, rad
    target_edge: float = 0.25  # the map's voxels are merged to a mean per cube of this edge, m
    targets: MapTargets = field(default_factory=MapTargets, repr=False, compare=False)  # methods may share one

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
