# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maximum-consensus localization: the page to read first.

The paper's method in the order of the paper: every cell of a search space around the prior is a candidate
pose; each match of a scan point with the map adds to its cell; the cell whose matches determine the
position best is the answer.
"""

import math
from dataclasses import dataclass, field, replace

from maxcon.accumulator import Accumulator, highest
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust, invert, runner_up_ratio
from maxcon.objectives import Helmert, Objective
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search import Multiplicity, Weighting, exhaustive
from maxcon.search_space import Cell, SearchSpace

__all__ = ["MaximumConsensus"]


@dataclass(frozen=True)
class MaximumConsensus:
    """Localizes scans by exhaustive search for the cell of highest score (equations (1), (2) and (6)).

    Parameters
    ----------
    space : SearchSpace
        The candidate poses around each prior; the paper's if not given.
    objective : Objective
        What a cell is worth; Helmert's point error if not given. Any object with ``score(moments)``.
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    n_threads : int
        Headings searched at the same time; the answer does not depend on it.
    trust : Trust
        From where on an answer is not called localized.
    weighting : {"cosine", "one"}
        Weight of a match in N: max(0, n_scan . n_map), the paper's, or 1 (D5).

    Raises
    ------
    OptionError
        If the multiplicity or the weighting is unknown.
    """

    space: SearchSpace = field(default_factory=SearchSpace)
    objective: Objective = field(default_factory=Helmert)
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED
    n_threads: int = 1
    trust: Trust = field(default_factory=Trust)
    weighting: str | Weighting = Weighting.COSINE

    def __post_init__(self) -> None:
        object.__setattr__(self, "multiplicity", Multiplicity.parse(self.multiplicity))
        object.__setattr__(self, "weighting", Weighting.parse(self.weighting))

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Find the pose of a scan in the map.

        Parameters
        ----------
        scan : Scan
            Points (and normals) of one epoch, sensor frame.
        point_map : PointMap
            The map; its voxel edge is the space's cell edge.
        prior : Pose
            T_map_sensor before localization, local frame of the map.

        Returns
        -------
        Estimate
            Its `status` says whether the pose may be used.

        Raises
        ------
        SearchSpaceError
            If the cell edge is not the map's, or the space is too large.
        """
        return self.conclude(self.accumulate(scan, point_map, prior), scan, point_map)

    def accumulate(self, scan: Scan, point_map: PointMap, prior: Pose) -> Accumulator:
        """Moments of every cell: what `conclude` decides on, and what plots show."""
        return exhaustive(
            scan, point_map, prior, self.space,
            multiplicity=self.multiplicity, weighting=self.weighting, n_threads=self.n_threads,
        )  # fmt: skip

    def conclude(self, accumulator: Accumulator, scan: Scan, point_map: PointMap) -> Estimate:
        """Take the best cell of an accumulator of this scan, and say how far it may be trusted."""
        space, prior, moments = accumulator.space, accumulator.prior, accumulator.moments
        scores = accumulator.score(self.objective)
        cell = highest(scores, space)
        is_determined, cofactor = invert(accumulator.normal_matrix(cell))
        if not moments[..., 0].any():
            return Estimate(prior, 0.0, cell, Status.NO_MATCH, cofactor)
        pose = space.pose(cell, prior)
        share = _matched_share(accumulator, cell, self.multiplicity, scan, point_map)
        helmert = scores if isinstance(self.objective, Helmert) else accumulator.score(Helmert())
        runner_up = runner_up_ratio(helmert, cell, space, self.trust.guard_radius)
        status = self.trust.judge(
            is_determined=is_determined,
            share=share,
            is_at_rim=space.is_at_rim(cell) or self._rises_beyond(accumulator, cell, scan, point_map),
            runner_up=runner_up,
        )
        return Estimate(pose, float(scores[cell]), cell, status, cofactor, share, runner_up)

    def _rises_beyond(self, accumulator: Accumulator, cell: Cell, scan: Scan, point_map: PointMap) -> bool:
        """Whether the best heading is the outermost, and one more step would score higher still."""
        space, prior = accumulator.space, accumulator.prior
        n_headings = space.shape[0]
        if n_headings == 1 or cell[0] not in (0, n_headings - 1):
            return False
        step = math.radians(space.heading_step_deg)
        beyond = space.headings[cell[0]] + (step if cell[0] > 0 else -step)
        turned = replace(prior, heading=prior.heading + float(beyond))
        one_heading = replace(space, heading_half_width_deg=0.0)
        further = exhaustive(
            scan, point_map, turned, one_heading, multiplicity=self.multiplicity, weighting=self.weighting
        )
        return bool(further.score(self.objective).max() > accumulator.score(self.objective)[cell])


def _matched_share(
    accumulator: Accumulator,
    cell: Cell,
    multiplicity: str | Multiplicity,
    scan: Scan,
    point_map: PointMap,
) -> float:
    """Share of the scan's points that match at a cell; a count of map points has to be counted anew."""
    if multiplicity == Multiplicity.OCCUPIED:
        return float(accumulator.moments[cell][0]) / len(scan)
    here = SearchSpace(half_width=0.0, cell=accumulator.space.cell, heading_half_width_deg=0.0)
    pose = accumulator.space.pose(cell, accumulator.prior)
    return float(exhaustive(scan, point_map, pose, here).moments[0, 0, 0, 0]) / len(scan)
