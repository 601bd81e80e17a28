# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Gicp: generalized ICP, plane to plane, by the package small_gicp."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MissingExtraError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import invert
from maxcon.lab.baselines.map_targets import MapTargets, Place, thin
from maxcon.lab.baselines.started import StartedMethod, check_options, no_answer, number, whole_number
from maxcon.map import PointMap
from maxcon.scan import Scan

MATCH_VARIANCE = 2e-3
"""Variance along the common normal of a scan point and a map point on a plane: small_gicp gives each 1e-3."""
LEAST_NEIGHBOURS = 5
"""Fewer make no plane."""


def check_small_gicp() -> None:
    """Say that small_gicp is missing before the work that leads to it."""
    _small_gicp()


def _small_gicp() -> Any:
    try:
        import small_gicp
    except ImportError as error:
        raise MissingExtraError(
            "Expected the package small_gicp for generalized ICP, got none installed. pip install 'maxcon[baselines]'"
        ) from error
    return small_gicp


@dataclass(frozen=True, slots=True, eq=False)
class _Cloud:
    """Points about `origin` with covariances, and their tree, as small_gicp keeps them."""

    cloud: Any
    tree: Any
    n_points: int
    origin: NDArray[np.float64]


@dataclass(frozen=True)
class Gicp(StartedMethod):
    """Localizes scans by generalized ICP: both clouds are made of small planes.

    Unknown are all six: x, y, z, roll, pitch and heading. In a map without ground, little holds z and pitch. What is
    said of `Icp` about ground points, the gate, the estimate and `targets` holds here too, but `cofactor` is in units
    of the variance of one match of two planes that face each other, all else held; `NOT_CONVERGED` is small_gicp's own
    word.

    Parameters
    ----------
    gate : float
        A scan point farther than this from every map point has no partner, m. State it with every figure.
    thinning : float
        The scan is thinned to one point, the mean, per cube of this edge, m; 0 for all points.
    max_iterations : int
        Largest number of steps.
    step_tolerance, turn_tolerance : float
        The iteration has converged when a step is shorter than this, m, and turns less than this, rad.
    target_edge : float
        The voxels of the map are merged to one point, the mean, per cube of this edge, m.
    n_neighbours : int
        Neighbours from which the covariance of a point is estimated, in scan and map.
    targets : MapTargets
        Cache of what is made of the map.
    """

    gate: float = number(3.0, "m")
    thinning: float = number(0.75, "m", may_be_zero=True)
    max_iterations: int = whole_number(50)
    step_tolerance: float = number(1e-3, "m")
    turn_tolerance: float = number(2e-3, "rad")
    target_edge: float = number(0.5, "m")
    n_neighbours: int = whole_number(10, LEAST_NEIGHBOURS)
    targets: MapTargets = field(default_factory=MapTargets, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_options(self)

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> "_GicpAligner":
        """Make the clouds of the scan and of the map around it, which all starts within `spread` (m) share."""
        place = Place.of_scan(scan.points, around, self.gate, spread)
        source = self._cloud(thin(scan.points, self.thinning), np.zeros(3))
        key = ("gicp", place, self.target_edge, self.n_neighbours)
        target = self.targets.get(point_map, key, lambda: self._target(point_map, place))
        return _GicpAligner(self, source, target)

    def _target(self, point_map: PointMap, place: Place) -> _Cloud:
        points, _ = self.targets.planes(point_map, place, self.target_edge)
        return self._cloud(points, np.array([*place.middle, 0.0]))

    def _cloud(self, points: NDArray[np.float64], origin: NDArray[np.float64]) -> _Cloud:
        small_gicp = _small_gicp()
        cloud = small_gicp.PointCloud(points - origin)
        tree = small_gicp.KdTree(cloud) if len(points) else None
        if len(points):
            small_gicp.estimate_covariances(cloud, tree, num_neighbors=self.n_neighbours)
        return _Cloud(cloud, tree, len(points), origin)


@dataclass(frozen=True, slots=True, eq=False)
class _GicpAligner:
    """A thinned scan and the map around it, ready for any start near by."""

    method: Gicp
    source: _Cloud
    target: _Cloud

    def align(self, start: Pose) -> Estimate:
        """Iterate from a start to the end."""
        if not (self.source.n_points and self.target.n_points):
            return no_answer(start)
        T_target_source = np.eye(4)
        T_target_source[:3, :3] = start.rotation
        T_target_source[:3, 3] = start.position - self.target.origin
        found = _small_gicp().align(
            self.target.cloud,
            self.source.cloud,
            self.target.tree,
            T_target_source,
            registration_type="GICP",
            max_correspondence_distance=self.method.gate,
            num_threads=1,
            max_iterations=self.method.max_iterations,
            rotation_epsilon=self.method.turn_tolerance,
            translation_epsilon=self.method.step_tolerance,
        )
        n_matched = int(found.num_inliers)
        if not n_matched:
            return no_answer(start)
        T_target_source, hessian = np.asarray(found.T_target_source), np.asarray(found.H)
        if not (np.isfinite(T_target_source).all() and np.isfinite(hessian).all()):
            return no_answer(start, Status.NOT_CONVERGED)
        is_determined, cofactor = invert(_normal_matrix(hessian, T_target_source[:3, :3]))
        status = Status.LOCALIZED if found.converged else Status.NOT_CONVERGED
        status = status if is_determined else Status.UNDETERMINED
        pose = Pose.from_rotation(T_target_source[:3, 3] + self.target.origin, T_target_source[:3, :3])
        share = n_matched / self.source.n_points
        return Estimate(pose, float(n_matched), None, status, cofactor, share)

    def n_near_map(self, pose: Pose, distance: float) -> int:
        if not (self.source.n_points and self.target.n_points):
            return 0
        points = np.asarray(self.source.cloud.points())[:, :3]
        placed = points @ pose.rotation.T + (pose.position - self.target.origin)
        _, squares = self.target.tree.batch_nearest_neighbor_search(placed)
        return int((np.asarray(squares) <= distance**2).sum())


def _normal_matrix(hessian: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """N of x and y in map axes; small_gicp's unknowns are rotation, then translation, in sensor axes."""
    N = np.asarray(rotation @ hessian[3:, 3:] @ rotation.T, dtype=np.float64)[:2, :2]
    return MATCH_VARIANCE * 0.5 * (N + N.T)
