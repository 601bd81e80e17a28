# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coarse-to-fine search: automatic cells, first those of a level of the map, then its own around what is left (D11)."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, wrap_angle
from maxcon.map import PointMap
from maxcon.map.layout import LEVEL_FACTORS
from maxcon.scan import Scan
from maxcon.search.objectives import Helmert, Moments
from maxcon.search.scored_cells import Found, Incumbent
from maxcon.search.space import PAPER_STEP_DEG, Cell, SearchSpace


@dataclass(frozen=True, slots=True)
class Level:
    """Cell edge (m) and heading step (degrees) of a search in a level of the map, and edge (m) of the scan's thinning.

    The level is that of 1, 2, 4, ... 32 of the map's voxels whose edge comes nearest to `cell`.
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

MOST_LARGE_CELLS = 2**28
"""More cells of the first level take minutes, and are refused."""

# Scores in large cells rank poses less sharply than those in small ones: a candidate that reaches so much of the asked
# ratio is searched in small cells too, ...
BLUNT, BLUNT_WIDE = 0.85, 0.75
# ... of so many at most, the highest; the next one counts with its ratio to the best large cell.
MOST_CANDIDATES, MOST_WIDE_CANDIDATES = 12, 256
# Coarse cells are searched so far around a wide one, m and degrees, and small ones around a coarse one; hill climbing
# goes on from a best small one at the boundary of that.
AROUND_WIDE, AROUND_WIDE_DEG = 0.96, 2.0
AROUND, AROUND_DEG = 0.48, 1.5
MOST_CLIMBS = 4
# Cells this near to each other, m and degrees, are one candidate.
SAME_POSE, SAME_POSE_DEG = 1.0, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class BestCell:
    """The best cell of a search at one height, and Helmert's score of the second best candidate over its own.

    space, prior: the cells of its height, and the prior raised to it.
    cell, score, moments: index, score and moments, shape (4,), of the cell.
    runner_up: the ratio.
    is_at_boundary: whether the cell lies at the boundary of the whole space; None where `space` is that.
    """

    space: SearchSpace
    prior: Pose
    cell: Cell
    score: float
    moments: Moments
    runner_up: float
    is_at_boundary: bool | None = None

    @property
    def pose(self) -> Pose:
        """T_map_sensor of the cell, local frame."""
        return self.space.pose(self.cell, self.prior)


@dataclass(frozen=True, slots=True)
class LeftOpen:
    """Poses that large cells leave open, the highest score first; no other exceeds the ratio `rest` to the best."""

    poses: list[Pose]
    rest: float


class Search(Protocol):
    """An exact search for the best cell of a space, and if asked for every cell that reaches a ratio to its score."""

    def __call__(
        self,
        scan: Scan,
        point_map: PointMap,
        prior: Pose,
        space: SearchSpace,
        *,
        share: float = 1.0,
        lists_all: bool = False,
        incumbent: Incumbent | None = None,
    ) -> Found:
        """Search."""
        ...


def best_candidates(
    search: Search, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, share: float
) -> list[BestCell]:
    """Find the best cell of an open space, and other candidates that may reach a ratio to its score.

    search: used in large cells, and in small ones.
    scan, point_map, prior: as of `exhaustive`. A level of the map is searched first, or two of them in a space of very
        many cells.
    space: an open one.
    share: the ratio, above 0 to 1.
    Returns the best one first; none where nothing scores. Each is the best of the map's own cells in a window around a
        large one. `runner_up` is a ratio to its own score by Helmert's: of the highest other candidate that was
        searched in small cells; of one given up there, the ratio asked for (of the objective, whichever it is); or the
        ratio below which large cells were not followed, which is proved for large cells and evidence for small ones.
    """
    is_wide = COARSE.cells(space, point_map).n_cells > MANY_CELLS
    find = _in_wide_cells if is_wide else _in_coarse_cells
    left_open = find(search, scan, point_map, prior, space, share)
    window = _window(space, AROUND, AROUND_DEG, COARSE.of(point_map).cell).at(point_map.cell)
    found = _in_small_cells(search, scan, point_map, left_open.poses, window, share)
    fine = distinct_candidates(found)
    scores = [float(Helmert().score(best.moments)) for best in fine]
    rest = left_open.rest
    if len(found) < len(left_open.poses):  # a candidate that was given up scores less than the ratio
        rest = max(rest, math.nextafter(share, 0.0))
    return [
        replace(
            best,
            runner_up=max([rest * score, *scores[:k], *scores[k + 1 :]]) / score if score > 0.0 else math.inf,
            is_at_boundary=_is_at_boundary(best.pose, prior, space, point_map.cell),
        )
        for k, (best, score) in enumerate(zip(fine, scores, strict=True))
    ]


def distinct_candidates(best: list[BestCell]) -> list[BestCell]:
    """One best cell of each candidate, the highest score first."""
    distinct: list[BestCell] = []
    for each in sorted(best, key=lambda each: -each.score):
        if not any(_is_same(each.pose, other.pose) for other in distinct):
            distinct.append(each)
    return distinct


def _in_coarse_cells(
    search: Search, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, share: float
) -> LeftOpen:
    """Poses of a space where coarse cells may reach a ratio to the best small one."""
    found = _search_level(search, COARSE, scan, point_map, prior, space, BLUNT * share)
    return _distinct(_reaching(found, COARSE.cells(space, point_map), prior), BLUNT * share, MOST_CANDIDATES)


def _in_wide_cells(
    search: Search, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, share: float
) -> LeftOpen:
    """The same for a space of very many: coarse cells are searched around wide ones alone."""
    found = _search_level(search, WIDE, scan, point_map, prior, space, BLUNT_WIDE * share)
    reaching = _reaching(found, WIDE.cells(space, point_map), prior)
    wide = _distinct(reaching, BLUNT_WIDE * share, MOST_WIDE_CANDIDATES)
    window = _window(space, AROUND_WIDE, AROUND_WIDE_DEG, WIDE.of(point_map).cell)
    least, incumbent = BLUNT * share, None
    scored: list[tuple[float, Pose]] = []
    for pose in wide.poses:
        found = _search_level(search, COARSE, scan, point_map, pose, window, least, incumbent)
        scored += _reaching(found, COARSE.cells(window, point_map), pose)
        if incumbent is None or least * found.score > incumbent.score:
            incumbent = Incumbent(least * found.score, found.moments)
    coarse = _distinct(scored, least, MOST_CANDIDATES)
    return replace(coarse, rest=max(coarse.rest, wide.rest))


def _search_level(
    search: Search,
    level: Level,
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    least: float,
    incumbent: Incumbent | None = None,
) -> Found:
    """Search all cells of a level in an open space, for all that reach a ratio to the best one."""
    cells = level.cells(space, point_map)
    if cells.n_cells > MOST_LARGE_CELLS:
        raise SearchSpaceError(
            f"Expected at most {MOST_LARGE_CELLS:,} cells of {cells.cell_edge:g} m and {cells.step_deg:g} degrees, got"
            f" {cells.n_cells:,}. Narrow the search space."
        )
    thinned = scan.thinned(level.thinning)
    return search(thinned, level.of(point_map), prior, cells, share=least, lists_all=True, incumbent=incumbent)


def _reaching(found: Found, cells: SearchSpace, prior: Pose) -> list[tuple[float, Pose]]:
    """Scores and poses of the cells that reached what was asked; none where nothing scores."""
    if found.score <= 0.0:
        return []
    raised, reaching = cells.raised(prior, found.height), found.reaching
    return [
        (upper, cells.pose((heading, y, x), raised))
        for (heading, y, x), upper in zip(reaching.cells.tolist(), reaching.upper.tolist(), strict=True)
    ]


def _distinct(scored: list[tuple[float, Pose]], least: float, most: int) -> LeftOpen:
    """At most so many candidates that reach a ratio to the best score; of near cells the highest stands for all."""
    poses: list[Pose] = []
    ordered = sorted(scored, key=lambda each: -each[0])
    for score, pose in ordered:
        ratio = score / ordered[0][0]
        if ratio < least:
            break
        if any(_is_same(pose, other) for other in poses):
            continue
        if len(poses) == most:
            return LeftOpen(poses, ratio)
        poses.append(pose)
    return LeftOpen(poses, least)


def _in_small_cells(
    search: Search, scan: Scan, point_map: PointMap, poses: list[Pose], window: SearchSpace, share: float
) -> list[BestCell]:
    """The best small cells around poses: of the first, and of others that reach a ratio to the best so far."""
    fine: list[BestCell] = []
    incumbent: Incumbent | None = None
    for pose in poses:
        best = _climb(search, scan, point_map, pose, window, incumbent)
        if best is None:
            continue
        fine.append(best)
        if incumbent is None or share * best.score > incumbent.score:
            incumbent = Incumbent(share * best.score, best.moments)
    return fine


def _climb(
    search: Search, scan: Scan, point_map: PointMap, pose: Pose, window: SearchSpace, incumbent: Incumbent | None
) -> BestCell | None:
    """Hill climbing: the best small cell around a pose; around that, as long as it lies at the boundary of the window.

    None where no cell scores as much as the incumbent.
    """
    for _ in range(1 + MOST_CLIMBS):
        found = search(scan, point_map, pose, window, incumbent=incumbent)
        if incumbent is not None and found.score < incumbent.score:
            return None
        raised = window.raised(pose, found.height)
        best = BestCell(window.plane, raised, found.cell, found.score, found.moments, 0.0)
        if not (window.is_at_boundary(found.cell) or window.is_outermost(found.cell[0])):
            break
        pose = best.pose
    return best


def _window(space: SearchSpace, around: float, around_deg: float, large_cell: float) -> SearchSpace:
    """What is searched around a large cell, m and degrees: in no direction that the space leaves out."""
    return SearchSpace(
        min(around, space.half_width),
        heading_half_width_deg=min(around_deg, space.heading_half_width_deg),
        height_half_width=min(0.5 * large_cell, space.height_half_width),
    )


def _is_same(one: Pose, other: Pose) -> bool:
    turn_deg = math.degrees(abs(wrap_angle(one.heading - other.heading)))
    return math.hypot(one.x - other.x, one.y - other.y) <= SAME_POSE and turn_deg <= SAME_POSE_DEG


def _is_at_boundary(pose: Pose, prior: Pose, space: SearchSpace, cell: float) -> bool:
    """Whether a pose lies in the outermost cell of a space, or beyond."""
    offsets = (pose.x - prior.x, pose.y - prior.y)
    turn_deg = math.degrees(abs(wrap_angle(pose.heading - prior.heading)))
    # Offsets run from -half_width to half_width - cell; half a cell, so that rounding decides nothing. Of two columns
    # none is an inner one: only what lies beyond them is far then.
    margin = 0.5 * cell if space.half_width > 1.5 * cell else -0.5 * cell
    is_low, is_high = min(offsets) < margin - space.half_width, max(offsets) > space.half_width - cell - margin
    is_far = space.half_width > 0.0 and (is_low or is_high)
    return is_far or turn_deg > space.heading_half_width_deg + 0.5 * PAPER_STEP_DEG
