# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coarse to fine: a wide space is searched in a level of the map, then finely where that leaves it open (D11)."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, wrap_angle
from maxcon.map import PointMap
from maxcon.map.layout import LEVEL_FACTORS
from maxcon.scan import Scan
from maxcon.search import Found, Standing
from maxcon.search.best_cell import BestCell
from maxcon.search.objectives import Helmert
from maxcon.search.space import PAPER_STEP_DEG, SearchSpace

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
            min(LEVEL_FACTORS, key=lambda factor: abs(math.log(factor * point_map.cell / self.cell)))
        )

    def cells(self, space: SearchSpace, point_map: PointMap) -> SearchSpace:
        """Return the cells of an open space that are searched."""
        return space.at(self.of(point_map).cell, self.heading_step_deg)


COARSE = Level(0.48, 2.0, 1.0)
"""Eight voxels of a map of 6 cm."""

WIDE = Level(0.96, 2.0, 2.0)
"""Sixteen: what a space of more than MANY_CELLS coarse cells is searched in before."""
MANY_CELLS = 2**19

# Scores in large cells rank places less sharply than those in small ones: a place that reaches so much of the share
# that is asked for is looked at in small cells too, ...
BLUNT, BLUNT_WIDE = 0.85, 0.75
# ... of so many places at most, the highest; the next one counts with its share of the best large cell.
MOST_PLACES, MOST_WIDE_PLACES = 12, 256
# More cells of the first level take minutes.
MOST_LARGE_CELLS = 2**28
# Coarse cells are searched so far around a wide one, m and degrees, and small ones around a coarse one; from a best
# small one at the rim of that it is gone on.
AROUND_WIDE, AROUND_WIDE_DEG = 0.96, 2.0
AROUND, AROUND_DEG = 0.48, 1.5
MOST_CLIMBS = 4
# Cells this near to each other, m and degrees, are of one place.
SAME_PLACE, SAME_PLACE_DEG = 1.0, 4.0


@dataclass(frozen=True, slots=True)
class OpenPlaces:
    """Places that large cells leave open.

    Parameters
    ----------
    poses : list of Pose
        One for each place, the highest score first.
    rest : float
        Share of the best large cell's score that no other place exceeds.
    """

    poses: list[Pose]
    rest: float


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
        The map: it is searched in a level first, in two of a space of very many cells.
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        An open one.
    share : float
        Of the score of the best place, above 0 to 1.

    Returns
    -------
    list of BestCell
        The best place first; none where nothing scores. Each is the best cell, of the map's own voxels, of a window
        around a large one. `runner_up` is a ratio to its own score by Helmert's: of the highest other place that was
        searched in small cells; of one given up there, the share (of the objective, whichever it is); or the share
        below which large cells were not followed, which is proved for large cells and evidence for small ones.

    Raises
    ------
    SearchSpaceError
        If the space has more than 2^28 cells of the first level.
    """
    is_wide = COARSE.cells(space, point_map).n_cells > MANY_CELLS
    find = _places_in_wide_cells if is_wide else _places_in_coarse_cells
    places = find(search, scan, point_map, prior, space, share)
    window = _window(space, AROUND, AROUND_DEG, COARSE.of(point_map).cell).at(point_map.cell)
    found = _fine_places(search, scan, point_map, places.poses, window, share)
    fine = distinct_places(found)
    scores = [float(Helmert().score(best.moments)) for best in fine]
    rest = places.rest
    if len(found) < len(places.poses):  # a place that was given up scores less than the share
        rest = max(rest, math.nextafter(share, 0.0))
    return [
        replace(
            best,
            runner_up=max([rest * score, *scores[:k], *scores[k + 1 :]]) / score if score > 0.0 else math.inf,
            is_at_rim=_is_at_rim(best.pose, prior, space, point_map.cell),
        )
        for k, (best, score) in enumerate(zip(fine, scores, strict=True))
    ]


def _places_in_coarse_cells(
    search: Search, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, share: float
) -> OpenPlaces:
    """Places of a space where coarse cells may reach a share of the best small one."""
    found = _search_level(search, COARSE, scan, point_map, prior, space, BLUNT * share)
    return _distinct_places(_poses_reaching(found, COARSE.cells(space, point_map), prior), BLUNT * share, MOST_PLACES)


def _places_in_wide_cells(
    search: Search, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, share: float
) -> OpenPlaces:
    """The same for a space of very many: coarse cells are searched around wide ones alone."""
    found = _search_level(search, WIDE, scan, point_map, prior, space, BLUNT_WIDE * share)
    reaching = _poses_reaching(found, WIDE.cells(space, point_map), prior)
    wide = _distinct_places(reaching, BLUNT_WIDE * share, MOST_WIDE_PLACES)
    window = _window(space, AROUND_WIDE, AROUND_WIDE_DEG, WIDE.of(point_map).cell)
    least, standing = BLUNT * share, None
    scored: list[tuple[float, Pose]] = []
    for pose in wide.poses:
        found = _search_level(search, COARSE, scan, point_map, pose, window, least, standing)
        scored += _poses_reaching(found, COARSE.cells(window, point_map), pose)
        if standing is None or least * found.score > standing.score:
            standing = Standing(least * found.score, found.moments)
    coarse = _distinct_places(scored, least, MOST_PLACES)
    return replace(coarse, rest=max(coarse.rest, wide.rest))


def _search_level(
    search: Search,
    level: Level,
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    least: float,
    standing: Standing | None = None,
) -> Found:
    """Search all cells of a level in an open space, for all that reach a share of the best one."""
    cells = level.cells(space, point_map)
    if cells.n_cells > MOST_LARGE_CELLS:
        raise SearchSpaceError(
            f"Expected at most {MOST_LARGE_CELLS:,} cells of {cells.cell_edge:g} m and {cells.step_deg:g} degrees, got"
            f" {cells.n_cells:,}. Narrow the search space."
        )
    thinned = scan.thinned(level.thinning)
    return search(thinned, level.of(point_map), prior, cells, share=least, lists_all=True, standing=standing)


def _poses_reaching(found: Found, cells: SearchSpace, prior: Pose) -> list[tuple[float, Pose]]:
    """Scores and poses of the cells that reached what was asked; none where nothing scores."""
    if found.score <= 0.0:
        return []
    raised = cells.raised(prior, found.height)
    return [
        (upper, cells.pose((heading, y, x), raised))
        for (heading, y, x), upper in zip(found.reaching.cells.tolist(), found.reaching.upper.tolist(), strict=True)
    ]


def _distinct_places(scored: list[tuple[float, Pose]], least: float, most: int) -> OpenPlaces:
    """At most so many places that reach a share of the best score; of the cells of one the highest stands for all."""
    poses: list[Pose] = []
    ordered = sorted(scored, key=lambda each: -each[0])
    for score, pose in ordered:
        share = score / ordered[0][0]
        if share < least:
            break
        if any(_is_same_place(pose, other) for other in poses):
            continue
        if len(poses) == most:
            return OpenPlaces(poses, share)
        poses.append(pose)
    return OpenPlaces(poses, least)


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
    search: Search, scan: Scan, point_map: PointMap, pose: Pose, window: SearchSpace, standing: Standing | None
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


def distinct_places(best: list[BestCell]) -> list[BestCell]:
    """One best cell of each place, the highest score first."""
    distinct: list[BestCell] = []
    poses: list[Pose] = []
    for each in sorted(best, key=lambda each: -each.score):
        pose = each.pose
        if not any(_is_same_place(pose, other) for other in poses):
            distinct.append(each)
            poses.append(pose)
    return distinct


def _window(space: SearchSpace, around: float, around_deg: float, large_cell: float) -> SearchSpace:
    """What is searched around a large cell, m and degrees: in no direction that the space leaves out."""
    return SearchSpace(
        min(around, space.half_width),
        heading_half_width_deg=min(around_deg, space.heading_half_width_deg),
        height_half_width=min(0.5 * large_cell, space.height_half_width),
    )


def _is_same_place(one: Pose, other: Pose) -> bool:
    turn_deg = math.degrees(abs(wrap_angle(one.heading - other.heading)))
    return math.hypot(one.x - other.x, one.y - other.y) <= SAME_PLACE and turn_deg <= SAME_PLACE_DEG


def _is_at_rim(pose: Pose, prior: Pose, space: SearchSpace, cell: float) -> bool:
    """Whether a pose lies in the outermost cell of a space, or beyond."""
    offsets = (pose.x - prior.x, pose.y - prior.y)
    turn_deg = math.degrees(abs(wrap_angle(pose.heading - prior.heading)))
    # Offsets run from -half_width to half_width - cell; half a cell, so that rounding decides nothing. Of two columns
    # none is an inner one: only what lies beyond them is far then.
    rim = 0.5 * cell if space.half_width > 1.5 * cell else -0.5 * cell
    is_low, is_high = min(offsets) < rim - space.half_width, max(offsets) > space.half_width - cell - rim
    is_far = space.half_width > 0.0 and (is_low or is_high)
    return is_far or turn_deg > space.heading_half_width_deg + 0.5 * PAPER_STEP_DEG
