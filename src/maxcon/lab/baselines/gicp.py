# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Gicp: generalized ICP, plane to plane, by the package small_gicp."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MissingExtraError, OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import invert
from maxcon.lab.baselines.map_targets import MapTargets, Place, thin
from maxcon.lab.baselines.started import check_iteration, check_steps
from maxcon.map import PointMap
from maxcon.scan import Scan

__all__ = ["Gicp"]

MATCH_VARIANCE = 2e-3
"""Variance along the common normal of a scan point and a map point on a plane: small_gicp gives each 1e-3."""
LEAST_NEIGHBOURS = 5


def check_small_gicp() -> None:
    """Say that small_gicp is missing before the work that leads to it."""
    _small_gicp()


def _small_gicp() -> Any:
    """Return the package."""
    try:
        import small_gicp
    except ImportError as error:
        raise MissingExtraError(
            "Expected the package small_gicp for generalized ICP, got none installed. pip install 'maxcon[baselines]'"
        ) from error
    return small_gicp


@dataclass(frozen=True, slots=True)
class _Cloud:
    """Points about `origin` with covariances, and their tree, as small_gicp keeps them."""

    cloud: Any
    tree: Any
    n_points: int
    origin: NDArray[np.float64]


@dataclass(frozen=True)
class Gicp:
    """Localizes scans by generalized ICP: both clouds are made of small planes.

    Unknown are all six: x, y, z, roll, pitch and heading of the answer are as GICP found them. In a map without
    ground, little holds z and pitch. What is said of `Icp` about ground points and the gate holds here too.

    Parameters
    ----------
    gate : float
        A scan point farther than this from every map point has no partner, m. State it with every figure.
    thinning : float
        The scan is thinned to one point, the mean, per cube of this edge, m; 0 for all points.
    max_iterations : int
        Largest number of steps.
    step_tolerance, turn_tolerance : float
        The iteration has come to rest when a step is shorter than this, m, and turns less than this, rad.
    target_edge : float
        The voxels of the map are merged to one point, the mean, per cube of this edge, m.
    n_neighbours : int
        From so many of its neighbours the covariance of a point is estimated, in scan and map.
    targets : MapTargets
        Keeps what was made of the map; methods with the same object share it.

    Raises
    ------
    OptionError
        If a value is out of its range.

    Notes
    -----
    Threads, pickles and copies: as with `Icp`.
    """

    gate: float = 3.0
    thinning: float = 0.75
    max_iterations: int = 50
    step_tolerance: float = 1e-3
    turn_tolerance: float = 2e-3
    target_edge: float = 0.5
    n_neighbours: int = 10
    targets: MapTargets = field(default_factory=MapTargets, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_iteration(self)
        check_steps("n_neighbours", self.n_neighbours, 10)
        if self.n_neighbours < LEAST_NEIGHBOURS:
            raise OptionError(
                f"Expected `n_neighbours` from {LEAST_NEIGHBOURS}, got {self.n_neighbours}: fewer make no plane."
            )

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Find the pose of a scan in the map.

        Parameters
        ----------
        scan : Scan
            Points of one epoch, sensor frame; its normals are not used.
        point_map : PointMap
            The map; its normals are not used.
        prior : Pose
            T_map_sensor to start from, local frame of the map.

        Returns
        -------
        Estimate
            As that of `Icp.localize`; `cofactor` is in units of the variance of one match of two planes that
            face each other, all else held. `NOT_CONVERGED` is small_gicp's own word.

        Raises
        ------
        MissingExtraError
            If small_gicp is not installed.
        """
        return self.prepare(scan, point_map, prior).align(prior)

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


@dataclass(frozen=True, slots=True)
class _GicpAligner:
    """A thinned scan and the map around it, ready for any start near by."""

    method: Gicp
    source: _Cloud
    target: _Cloud

    def align(self, start: Pose) -> Estimate:
        """Iterate from a start to the end."""
        nothing = Estimate(start, 0.0, None, Status.NO_MATCH, np.diag([np.inf, np.inf]))
        if not (self.source.n_points and self.target.n_points):
            return nothing
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
            return nothing
        T_target_source, hessian = np.asarray(found.T_target_source), np.asarray(found.H)
        if not (np.isfinite(T_target_source).all() and np.isfinite(hessian).all()):
            return Estimate(start, 0.0, None, Status.NOT_CONVERGED, np.diag([np.inf, np.inf]))
        is_determined, cofactor = invert(_normal_matrix(hessian, T_target_source[:3, :3]))
        status = Status.LOCALIZED if found.converged else Status.NOT_CONVERGED
        pose = Pose.from_rotation(T_target_source[:3, 3] + self.target.origin, T_target_source[:3, :3])
        share = n_matched / self.source.n_points
        status = status if is_determined else Status.UNDETERMINED
        return Estimate(pose, float(n_matched), None, status, cofactor, share)

    def n_near_map(self, pose: Pose, distance: float) -> int:
        """How many points of the thinned scan lie within `distance` (m) of the map's points at a pose."""
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
