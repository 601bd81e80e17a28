# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The best cell of a search, and what its matches and its neighbours say of it (decision 4)."""

import math
from dataclasses import dataclass, replace

import numpy as np

from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.integrity import Trust, invert, reasons_to_doubt_answer, reasons_to_doubt_scan
from maxcon.objectives import Moments, Objective
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search import Multiplicity, Weighting, exhaustive
from maxcon.search_space import Cell, SearchSpace

__all__ = ["BestCell", "judge"]


@dataclass(frozen=True, slots=True)
class BestCell:
    """What a search found: its best cell with score and moments, and Helmert's score of the runner-up over its own.

    The space is of one height, around the prior raised to it. Whether the cell lies at the rim of what is searched is
    told by whoever looked beyond; None where the space is all that is.
    """

    space: SearchSpace
    prior: Pose
    cell: Cell
    score: float
    moments: Moments
    runner_up: float
    is_at_rim: bool | None = None

    @property
    def pose(self) -> Pose:
        """T_map_sensor of the cell, local frame."""
        return self.space.pose(self.cell, self.prior)


def judge(
    best: BestCell,
    scan: Scan,
    searched: Scan,
    point_map: PointMap,
    trust: Trust,
    *,
    objective: Objective,
    multiplicity: str | Multiplicity,
    weighting: str | Weighting,
) -> Estimate:
    """Say how far a best cell may be trusted, and what casts doubt on it.

    Parameters
    ----------
    best : BestCell
        The cell.
    scan, searched : Scan
        The whole scan, and the thinned one that was searched with, sensor frame.
    point_map : PointMap
        The map.
    trust : Trust
        From where on the answer is not trusted.
    objective, multiplicity, weighting
        What the search was made with.
    """
    space, prior, cell = best.space, best.prior, best.cell
    _, nxx, nxy, nyy = (float(moment) for moment in best.moments)
    is_determined, cofactor = invert(np.array([[nxx, nxy], [nxy, nyy]]))
    share = _matched_share(best, multiplicity, searched, point_map)
    further = _beyond(best) if best.is_at_rim is None else None
    is_at_rim = space.is_at_rim(cell) if best.is_at_rim is None else best.is_at_rim
    if further is not None and not is_at_rim:
        one_heading = replace(space, heading_half_width_deg=0.0)
        found = exhaustive(
            searched, point_map, further, one_heading, multiplicity=multiplicity, weighting=weighting
        )
        is_at_rim = bool(found.score(objective).max() > best.score)
    status = trust.judge(
        is_determined=is_determined, share=share, is_at_rim=is_at_rim, runner_up=best.runner_up
    )
    reasons = reasons_to_doubt_scan(scan, prior)
    if multiplicity == Multiplicity.OCCUPIED:  # otherwise N counts map points, not matches
        reasons += reasons_to_doubt_answer(best.moments)
    return Estimate(best.pose, best.score, cell, status, cofactor, share, best.runner_up, "; ".join(reasons))


def _beyond(best: BestCell) -> Pose | None:
    """The prior turned by one step more than the outermost heading, where that is the best one."""
    space, heading = best.space, best.cell[0]
    if not space.is_outermost(heading):
        return None
    step = math.radians(space.step_deg)
    beyond = space.headings[heading] + (step if heading > 0 else -step)
    return replace(best.prior, heading=best.prior.heading + float(beyond))


def _matched_share(
    best: BestCell, multiplicity: str | Multiplicity, scan: Scan, point_map: PointMap
) -> float:
    """Share of the scan's points that match at a cell; a count of map points has to be counted anew."""
    if multiplicity == Multiplicity.OCCUPIED:
        return float(best.moments[0]) / len(scan)
    here = SearchSpace(half_width=0.0, heading_half_width_deg=0.0)
    return float(exhaustive(scan, point_map, best.pose, here).moments[0, 0, 0, 0]) / len(scan)
