# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coarse to fine: a wide space is searched in a level of the map, then finely where that leaves it open (D11)."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from maxcon.best_cell import BestCell
from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, wrap_angle
from maxcon.objectives import Helmert
from maxcon.point_map import PointMap
from maxcon.point_map.level import FACTORS
from maxcon.scan import Scan
from maxcon.search import Found, Standing
from maxcon.search_space import PAPER_STEP_DEG, SearchSpace

__all__ = ["COARSE", "Level", "Search", "best_places"]


@dataclass(frozen=True, slots=True)
class Level:
    """How coarsely a space is searched.

    Parameters
    ----------
    cell : float
        Edge of the cells, m; what 1, 2, 4, ... 32 of the map's voxels come nearest to it.
    heading_step_deg : float
        Degrees.
    thinning : float
        One point of the scan is searched with in each cube of this edge, m.
    """

    cell: float
    heading_step_deg: float
    thinning: float

    def of(self, point_map: PointMap) -> PointMap:
        """Return the level of a map that is searched."""
        return point_map.level(
            min(FACTORS, key=lambda factor: abs(math.log(factor * point_map.cell / self.cell)))
        )


COARSE = Level(0.48, 2.0, 1.0)
"""Eight voxels of a map of 6 cm."""

# The score of a place in large cells says by about so much less what it is in small ones: what reaches this much of the
# share that is asked for is looked at in small cells too, ...
BLUNT = 0.85
# ... of so many places at most, the highest: where more fit, none stands out.
MOST_PLACES = 12
# More large cells take minutes: half a kilometre at any heading.
MOST_CELLS = 2**28
# Small cells are searched so far around a large one, m and degrees; a best one at the rim is climbed from.
AROUND, AROUND_DEG = 0.48, 1.5
MOST_CLIMBS = 4
# Cells this near to each other, m and degrees, are of one place.
SAME_PLACE, SAME_PLACE_DEG = 1.0, 4.0


class Search(Protocol):
    """An exact search for the best cell of a space, and if asked for every cell that reaches a share of its score."""

    def __call__(
        self,
        scan: Scan,
        point_map: PointMap,
        prior: Pose,
        space: SearchSpace,
        *,
        share: float = 1.0,
        lists_all: bool = False,
        standing: Standing | None = None,
    ) -> Found:
        """Search."""
        ...


def best_places(
    search: Search, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, share: float
) -> list[BestCell]:
    """Find the best place of an open space, and the others that may reach a share of its score.

    Parameters
    ----------
    search : Search
        What is asked in large cells, and in small ones.
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        The map: it is searched in a level first.
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        An open one.
    share : float
        Of Helmert's score of the best place, above 0 to 1.

    Returns
    -------
    list of BestCell
        The best place first; none where nothing scores. Each is the best cell, of the map's own voxels, of a window
        around a large one. `runner_up` is what is known of the others: Helmert's score where they were looked at in
        small cells, and what was proved in large ones where not.

    Raises
    ------
    SearchSpaceError
        If the space has more than 2^28 large cells.
    """
    level = COARSE.of(point_map)
    large = space.at(level.cell, COARSE.heading_step_deg)
    if large.n_cells > MOST_CELLS:
        raise SearchSpaceError(
            f"Expected at most {MOST_CELLS:,} cells of {level.cell:g} m and {COARSE.heading_step_deg:g} degrees, got"
            f" {large.n_cells:,}. Narrow the search space."
        )
    least = BLUNT * share
    found = search(scan.thinned(COARSE.thinning), level, prior, large, share=least, lists_all=True)
    if found.score <= 0.0:
        return []
    poses, left_out = _places_left_open(found, large, prior, least)
    window = _window(space, point_map.cell, level.cell)
    fine = _distinct(_fine_places(search, scan, point_map, poses, window, share))
    scores = [float(Helmert().score(best.moments)) for best in fine]
    return [
        replace(
            best,
            runner_up=max([left_out * score, *scores[:k], *scores[k + 1 :]]) / score
            if score > 0.0
            else math.inf,
            is_at_rim=_is_at_rim(best.pose, prior, space, point_map.cell),
        )
        for k, (best, score) in enumerate(zip(fine, scores, strict=True))
    ]


def _places_left_open(
    found: Found, large: SearchSpace, prior: Pose, least: float
) -> tuple[list[Pose], float]:
    """Places where large cells reach a share of the best one, the highest first; and the share that none else reaches.

    Of the cells of a place the highest stands for all.
    """
    raised = large.raised(prior, found.height)
    cells, shares = found.reaching.cells, found.reaching.upper / found.score
    places: list[Pose] = []
    for number in np.argsort(-shares, kind="stable"):
        heading, y, x = cells[number].tolist()
        pose = large.pose((heading, y, x), raised)
        if any(_is_same_place(pose, other) for other in places):
            continue
        if len(places) == MOST_PLACES:
            return places, float(shares[number])
        places.append(pose)
    return places, least


def _fine_places(
    search: Search, scan: Scan, point_map: PointMap, poses: list[Pose], window: SearchSpace, share: float
) -> list[BestCell]:
    """The best small cells around poses: of the first, and of others that reach a share of the best so far."""
    fine: list[BestCell] = []
    standing: Standing | None = None
    for pose in poses:
        best = _climbed(search, scan, point_map, pose, window, standing)
        if best is None:
            continue
        fine.append(best)
        if standing is None or share * best.score > standing.score:
            standing = Standing(share * best.score, best.moments)
    return fine


def _climbed(
    search: Search,
    scan: Scan,
    point_map: PointMap,
    pose: Pose,
    window: SearchSpace,
    standing: Standing | None,
) -> BestCell | None:
    """The best small cell around a pose; around that, as long as scores rise at the rim of the window.

    None where no cell scores as much as what stands.
    """
    for _ in range(1 + MOST_CLIMBS):
        found = search(scan, point_map, pose, window, standing=standing)
        if standing is not None and found.score < standing.score:
            return None
        raised = window.raised(pose, found.height)
        best = BestCell(window.plane, raised, found.cell, found.score, found.moments, 0.0)
        if not (window.is_at_rim(found.cell) or window.is_outermost(found.cell[0])):
            break
        pose = window.pose(found.cell, raised)
    return best


def _distinct(best: list[BestCell]) -> list[BestCell]:
    """One best cell of each place, the highest score first."""
    distinct: list[BestCell] = []
    poses: list[Pose] = []
    for each in sorted(best, key=lambda each: -each.score):
        pose = each.pose
        if not any(_is_same_place(pose, other) for other in poses):
            distinct.append(each)
            poses.append(pose)
    return distinct


def _window(space: SearchSpace, cell: float, large_cell: float) -> SearchSpace:
    """The small cells that are searched around a large one: in no direction that the space leaves out."""
    return SearchSpace(
        min(AROUND, space.half_width),
        heading_half_width_deg=min(AROUND_DEG, space.heading_half_width_deg),
        height_half_width=min(0.5 * large_cell, space.height_half_width),
    ).at(cell)


def _is_same_place(one: Pose, other: Pose) -> bool:
    turn_deg = math.degrees(abs(wrap_angle(one.heading - other.heading)))
    return math.hypot(one.x - other.x, one.y - other.y) <= SAME_PLACE and turn_deg <= SAME_PLACE_DEG


def _is_at_rim(pose: Pose, prior: Pose, space: SearchSpace, cell: float) -> bool:
    """Whether a pose lies in the outermost cell of a space, or beyond."""
    offset = max(abs(pose.x - prior.x), abs(pose.y - prior.y))
    turn_deg = math.degrees(abs(wrap_angle(pose.heading - prior.heading)))
    is_far = space.half_width > 0.0 and offset > space.half_width - cell
    return is_far or turn_deg > space.heading_half_width_deg + 0.5 * PAPER_STEP_DEG
