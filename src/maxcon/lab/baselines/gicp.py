"""Gicp: generalized ICP by the package small_gicp; CountThenGicp: from the cell of most hits in a coarse map."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import needs_extra
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import invert
from maxcon.lab.baselines.map_targets import MapTargets, Place, thin
from maxcon.lab.baselines.started import Aligner, StartedMethod, check_options, no_answer
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.exhaustive import exhaustive
from maxcon.search.objectives import Count
from maxcon.search.space import SearchSpace

MATCH_VARIANCE = 2e-3
"""Variance along the common normal of a scan point and a map point on a plane: small_gicp gives each 1e-3."""


def check_small_gicp() -> Any:
    """Return the package small_gicp, or say that it is missing, before the work that leads to it."""
    with needs_extra("small_gicp", "for generalized ICP", "baselines"):
        import small_gicp
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
    """Localizes scans by generalized ICP, both clouds made of small planes, in all six unknowns; else as `Icp`."""

    gate: float = 3.0
    thinning: float = 0.75
    max_iterations: int = 50
    step_tolerance: float = 1e-3
    turn_tolerance: float = 2e-3
    target_edge: float = 0.5
    n_neighbours: int = 10  # from which the covariance of a point is estimated, in scan and map
    targets: MapTargets = field(default_factory=MapTargets, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_options(self, "thinning")

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
        small_gicp = check_small_gicp()
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
        found = check_small_gicp().align(
            self.target.cloud, self.source.cloud, self.target.tree, T_target_source, registration_type="GICP",
            max_correspondence_distance=self.method.gate, num_threads=1, max_iterations=self.method.max_iterations,
            rotation_epsilon=self.method.turn_tolerance, translation_epsilon=self.method.step_tolerance,
        )  # fmt: skip
        n_matched = int(found.num_inliers)
        if not n_matched:
            return no_answer(start)
        T_target_source, hessian = np.asarray(found.T_target_source), np.asarray(found.H)
        if not (np.isfinite(T_target_source).all() and np.isfinite(hessian).all()):
            return no_answer(start, Status.NOT_CONVERGED)
        rotation = T_target_source[:3, :3]
        # Unknowns are rotation, then translation, in sensor axes: N of x and y in map axes.
        N = np.asarray(rotation @ hessian[3:, 3:] @ rotation.T, dtype=np.float64)[:2, :2]
        is_determined, cofactor = invert(MATCH_VARIANCE * 0.5 * (N + N.T))
        status = Status.LOCALIZED if found.converged else Status.NOT_CONVERGED
        status = status if is_determined else Status.UNDETERMINED
        pose = Pose.from_rotation(T_target_source[:3, 3] + self.target.origin, rotation)
        share = n_matched / self.source.n_points
        return Estimate(pose, float(n_matched), None, status, cofactor, share)

    def n_near_map(self, pose: Pose, distance: float) -> int:
        if not (self.source.n_points and self.target.n_points):
            return 0
        points = np.asarray(self.source.cloud.points())[:, :3]
        placed = points @ pose.rotation.T + (pose.position - self.target.origin)
        _, squares = self.target.tree.batch_nearest_neighbor_search(placed)
        return int((np.asarray(squares) <= distance**2).sum())


@dataclass(frozen=True)
class CountThenGicp(StartedMethod):
    """Localizes scans as 3D-BBS followed by GICP does: GICP from the cell at which most points hit coarse voxels."""

    half_width: float = 3.0  # largest offset from the prior in x and in y, m; widened to whole voxels and one more
    heading_half_width_deg: float = 2.0  # largest turn from the prior's heading, degrees; widened to whole steps
    voxel: float = 1.0  # edge of the coarse voxels, and the step in x and y, m
    heading_step_deg: float = 1.0  # between headings, degrees: the default moves a point at 57 m by a voxel of 1 m
    thinning: float = 0.75  # the scan is thinned to one point per cube of this edge, m, before hits are counted
    gicp: Gicp = field(default_factory=Gicp)  # what follows. Its `targets` keep the coarse map too.

    def __post_init__(self) -> None:
        check_options(self, "heading_half_width_deg", "thinning")

    @property
    def window(self) -> SearchSpace:
        """Cells of the coarse search."""
        n_cells = math.ceil(self.half_width / self.voxel - 1e-9) + 1
        n_turns = math.ceil(self.heading_half_width_deg / self.heading_step_deg - 1e-9)
        return SearchSpace(n_cells * self.voxel, self.voxel, n_turns * self.heading_step_deg, self.heading_step_deg)

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> "_CountThenGicpAligner":
        """Thin the scan, and make both maps around it, which all priors within `spread` (m) share."""
        spread += math.sqrt(2.0) * self.window.half_width
        place = Place.of_scan(scan.points, around, self.gicp.gate, spread)
        points = thin(scan.points, self.thinning)
        key = ("count", place, self.voxel, self.gicp.target_edge)
        coarse = self.gicp.targets.get(point_map, key, lambda: self._coarse(point_map, place))
        fine = self.gicp.prepare(scan, point_map, around, spread)
        return _CountThenGicpAligner(self.window, Scan(points, np.zeros_like(points)), coarse, fine)

    def _coarse(self, point_map: PointMap, place: Place) -> PointMap:
        points, _ = self.gicp.targets.planes(point_map, place, self.gicp.target_edge)
        return PointMap.from_points(points, np.zeros_like(points), self.voxel)


@dataclass(frozen=True, slots=True, eq=False)
class _CountThenGicpAligner:
    """A thinned scan, the coarse map around it, and GICP prepared for any start in the space."""

    space: SearchSpace
    scan: Scan
    coarse: PointMap
    fine: Aligner

    def align(self, start: Pose) -> Estimate:
        """Search the space around a pose, and iterate from its best cell."""
        hits = exhaustive(self.scan, self.coarse, start, self.space)
        cell = hits.best_cell(Count())
        return self.fine.align(self.space.pose(cell, start)) if hits.moments[..., 0].any() else no_answer(start)

    def n_near_map(self, pose: Pose, distance: float) -> int:
        return self.fine.n_near_map(pose, distance)
