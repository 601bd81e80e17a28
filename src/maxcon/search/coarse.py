"""Coarse search: every large cell of an open space is scored, and those near the best are candidates (D11).

The score of a large cell is Helmert's, of the voxels of a level of the map that the points meet, all of weight one.
It is bounded first by sums of bytes along two axes, which is fast, and computed where the bound leaves it open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, rotation_matrices, wrap_angle
from maxcon.map import PointMap
from maxcon.map.layout import PRODUCT_STEPS
from maxcon.map.normal_grid import NormalGrid
from maxcon.search.objectives import Helmert, Scores
from maxcon.search.prepared_scan import in_threads
from maxcon.search.space import SearchSpace

CELL, STEP_DEG = 0.48, 2.0
"""Edge of large cells, m, of which the nearest level of the map is taken; step between headings, degrees."""
THINNING = 2.0  # edge of the cubes of which one point each is searched with, m
MOST_POINTS = 400  # so many tell places apart as well as more
FARTHEST, BELOW, ABOVE = 60.0, 5.0, 13.0
"""Points farther away, and more below or above the sensor, are not searched with, m."""
MOST_CELLS, MOST_VOXELS = 2**26, 2**29
"""Larger search spaces, and dense grids around them, take more than 2 GB, and are refused."""
MOST_CANDIDATES = 12
SAME_POSE, SAME_POSE_DEG = 1.0, 4.0  # cells this near to each other, m and degrees, are one candidate
AT_ONCE, MOST_CERTAIN = 64, 0.9
"""So many cells are scored at once; at first some whose bound reaches this ratio to the highest one."""
IMAGE_RATIO, IMAGE_WITHIN, IMAGE_WITHIN_DEG = 0.75, 6.0, 4.0
"""The mirror image of the scan is kept if it reaches this ratio to the best score, within so much of the best cell, m
and degrees, in the search space."""
MOST_SCORED = 4096  # where so many cells are worth nothing, as along a single wall, no more are scored


@dataclass(frozen=True, slots=True)
class LeftOpen:
    """Poses of large cells that score nearly as much as the best, the highest first; no other exceeds `rest_ratio`."""

    poses: list[Pose]
    rest_ratio: float  # to the best score
    image: Pose | None = None  # where the mirror image of the scan scores most near the best pose, if enough


def coarse_search(
    points: NDArray[np.float64], point_map: PointMap, prior: Pose, space: SearchSpace, ratio: float, n_threads: int = 1
) -> LeftOpen:
    """Find all large cells of an open space, at every height, that reach a ratio to the best; of near ones the highest.

    points: shape (n, 3), sensor frame, one of each cube of `THINNING`, without the ground. No poses if nothing scores.
    """
    level = point_map.nearest_level(CELL)
    cells = space.at(level.cell, STEP_DEG)
    points = _about_sensor(points, prior)
    reach = float(np.hypot(points[:, 0], points[:, 1]).max(initial=0.0)) + cells.reach + 2.0 * level.cell
    heights = prior.z - BELOW - space.height_half_width, prior.z + ABOVE + space.height_half_width
    n_voxels = (2.0 * reach) ** 2 * (heights[1] - heights[0]) / level.cell**3
    if cells.plane.n_cells > MOST_CELLS or n_voxels > MOST_VOXELS:
        raise SearchSpaceError(
            f"Expected at most {MOST_CELLS:,} cells of {cells.cell_edge:g} m and {cells.step_deg:g} degrees a height,"
            f" and {MOST_VOXELS:,} voxels around them, got {cells.plane.n_cells:,} and {n_voxels:,.0f}."
            " Narrow the search space."
        )
    grid = level.normals_around(prior.x, prior.y, reach, heights)
    found: list[tuple[float, Pose]] = []
    best = 0.0
    for raised in cells.priors(prior):
        scores, reaching = highest_cells(points, grid, raised, cells.plane, ratio, best, n_threads)
        best = max(best, scores.max(initial=0.0))
        found += _distinct(scores, reaching, cells, raised)
    left_open = _left_open(found, ratio)
    if not found:
        return left_open
    pose = left_open.poses[0]
    around = prior.with_height_and_tilt_of(pose) if space.half_width < IMAGE_WITHIN else pose
    within = min(IMAGE_WITHIN, space.half_width), min(IMAGE_WITHIN_DEG, space.heading_half_width_deg)
    return replace(left_open, image=_image(points, grid, around, within, best, n_threads))


def _image(
    points: NDArray[np.float64], grid: NormalGrid, pose: Pose, within: tuple[float, float], score: float, n_threads: int
) -> Pose | None:
    """Where the mirror image of a scan, y for -y, scores most around a pose, if as much as `IMAGE_RATIO` of a score."""
    cells = SearchSpace(within[0], heading_half_width_deg=within[1]).at(grid.cell, STEP_DEG)
    scores, reaching = highest_cells(points * [1.0, -1.0, 1.0], grid, pose, cells, 1.0, IMAGE_RATIO * score, n_threads)
    if not len(scores):
        return None
    heading, y, x = reaching[np.argmax(scores)].tolist()
    return cells.pose((heading, y, x), replace(pose, roll=-pose.roll))


def _about_sensor(points: NDArray[np.float64], prior: Pose) -> NDArray[np.float64]:
    """Points with the prior's roll and pitch applied, without those too far away."""
    points = points @ rotation_matrices(prior.roll, prior.pitch, 0.0).T
    is_near = np.hypot(points[:, 0], points[:, 1]) <= FARTHEST
    return np.ascontiguousarray(points[is_near & (points[:, 2] >= -BELOW) & (points[:, 2] <= ABOVE)])


def highest_cells(
    points: NDArray[np.float64], grid: NormalGrid, prior: Pose, cells: SearchSpace, ratio: float, best: float,
    n_threads: int,
) -> tuple[Scores, NDArray[np.int64]]:  # fmt: skip
    """Scores and indices, (m, 3), of cells that reach a ratio to the best one, or `best` (bounds: design section 3)."""
    from maxcon.search import coarse_kernels

    headings = prior.heading + cells.headings
    shape, n_offsets = cells.shape, cells.shape[1]
    corner = np.array([prior.x + cells.offsets[0], prior.y + cells.offsets[0], prior.z])

    def sums(values: NDArray[np.uint8], is_asked: NDArray[np.bool_]) -> NDArray[np.integer]:
        total = np.empty(shape, np.uint16 if len(points) <= coarse_kernels.POINTS_AT_ONCE else np.int32)

        def add(part: slice) -> None:
            coarse_kernels.sum_windows(
                points, headings[part], is_asked[part], corner, grid.cell, grid.low, grid.shape, values, total[part]
            )

        in_threads(add, len(headings), n_threads, n_threads)
        return total

    def cells_of(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.column_stack(np.unravel_index(numbers, shape))

    def scores(asked: NDArray[np.int64]) -> Scores:
        moments = np.zeros((len(asked), 4))
        coarse_kernels.cell_moments(
            points, headings, corner, grid.cell, grid.low, grid.shape, grid.normals, asked, n_offsets, moments
        )
        return Helmert().score(moments)

    blocks = np.arange(0, n_offsets, coarse_kernels.COLUMNS)
    along = sums(grid.along, np.ones((*shape[:2], len(blocks)), bool))
    least = math.ceil(max(MOST_CERTAIN * float(along.max()), ratio * best * PRODUCT_STEPS, 1.0))
    leading = cells_of(np.flatnonzero(along >= least)[:AT_ONCE])
    best = max(best, scores(leading).max(initial=0.0))
    is_open = along >= math.ceil(max(ratio * best * PRODUCT_STEPS, 1.0))
    across = sums(grid.across, np.logical_or.reduceat(is_open, blocks, axis=2))
    numbers = np.flatnonzero(is_open)
    bounds = Helmert().bound_by_axes(*(each.ravel()[numbers] / PRODUCT_STEPS for each in (along, across)))
    is_asked = (bounds > 0.0) & (bounds >= ratio * best)
    bounds, asked = bounds[is_asked], cells_of(numbers[is_asked])
    order = np.argsort(-bounds, kind="stable")
    bounds, asked = bounds[order], asked[order]
    found = np.empty(0)
    while len(found) < (len(asked) if best > 0.0 else min(len(asked), MOST_SCORED)):
        if bounds[len(found)] < ratio * best:
            break
        found = np.append(found, scores(asked[len(found) : len(found) + AT_ONCE]))
        best = max(best, found.max())
    reaching = (found > 0.0) & (found >= ratio * best)
    return found[reaching], asked[: len(found)][reaching]


def _distinct(scores: Scores, found: NDArray[np.int64], cells: SearchSpace, prior: Pose) -> list[tuple[float, Pose]]:
    """Scores and poses of at most one candidate more than are followed: of near cells the highest stands for all."""
    order = np.argsort(-scores, kind="stable")
    scores, found = scores[order], found[order]
    places = np.column_stack([cells.offsets[found[:, 2]], cells.offsets[found[:, 1]]])
    headings_deg = np.degrees(cells.headings[found[:, 0]])
    distinct: list[tuple[float, Pose]] = []
    is_left = np.ones(len(scores), bool)
    while is_left.any() and len(distinct) <= MOST_CANDIDATES:
        k = int(np.argmax(is_left))
        distinct.append((float(scores[k]), cells.pose((int(found[k, 0]), int(found[k, 1]), int(found[k, 2])), prior)))
        turns_deg = np.abs((headings_deg - headings_deg[k] + 180.0) % 360.0 - 180.0)
        is_left &= (np.hypot(*(places - places[k]).T) > SAME_POSE) | (turns_deg > SAME_POSE_DEG)
    return distinct


def _left_open(found: list[tuple[float, Pose]], ratio: float) -> LeftOpen:
    """The candidates of all heights that reach a ratio to the best score, and the ratio that others do not exceed."""
    poses: list[Pose] = []
    ordered = sorted(found, key=lambda each: -each[0])
    for score, pose in ordered:
        own = score / ordered[0][0]
        if own < ratio:
            break
        if any(is_same_place(pose, other) for other in poses):
            continue
        if len(poses) == MOST_CANDIDATES:
            return LeftOpen(poses, own)
        poses.append(pose)
    return LeftOpen(poses, ratio)


def is_same_place(one: Pose, other: Pose) -> bool:
    """Whether two poses are one candidate."""
    turn_deg = math.degrees(abs(wrap_angle(one.heading - other.heading)))
    return math.hypot(one.x - other.x, one.y - other.y) <= SAME_POSE and turn_deg <= SAME_POSE_DEG
