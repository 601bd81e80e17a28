# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""CountThenGicp: the cell of most hits in a coarse map, and generalized ICP from there."""

import math
from dataclasses import dataclass, field

import numpy as np

from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.lab.baselines.gicp import Gicp
from maxcon.lab.baselines.map_targets import Place, thin
from maxcon.lab.baselines.started import Aligner, StartedMethod, check_options, no_answer, number
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.exhaustive import exhaustive
from maxcon.search.objectives import Count
from maxcon.search.space import SearchSpace


@dataclass(frozen=True)
class CountThenGicp(StartedMethod):
    """Localizes scans in two steps: where most points hit coarse voxels of the map, then GICP from there.

    The idea of 3D-BBS (branch and bound by hit count in a voxel map) followed by GICP, made from parts of this
    package: the space around the prior is searched exhaustively; z, roll and pitch are the prior's until GICP
    starts. The answer is that of `Gicp.localize` from the best cell; the prior with the status `NO_MATCH` if no point
    hit the map in any cell. SearchSpaceError if there are too many cells.

    Parameters
    ----------
    half_width : float
        Largest offset from the prior in x and in y, m; widened to whole voxels and one more, so that the boundary
        is searched on either side.
    heading_half_width_deg : float
        Largest turn from the prior's heading, degrees; widened to whole steps.
    voxel : float
        Edge of the coarse voxels, and the step in x and y, m.
    heading_step_deg : float
        Between headings, degrees: the default moves a point at 57 m by a voxel of 1 m.
    thinning : float
        The scan is thinned to one point, the mean, per cube of this edge, m, before hits are counted.
    gicp : Gicp
        What follows. Its `targets` keep the coarse map too.
    """

    half_width: float = number(3.0, "m")
    heading_half_width_deg: float = number(2.0, "degrees", may_be_zero=True)
    voxel: float = number(1.0, "m")
    heading_step_deg: float = number(1.0, "degrees")
    thinning: float = number(0.75, "m", may_be_zero=True)
    gicp: Gicp = field(default_factory=Gicp)

    def __post_init__(self) -> None:
        check_options(self)

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
