# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Fit of a scan to the map at a refined pose (D12): what the residuals of the adjustment do not show.

A wrong place, a distorted scan and a map that is off leave traces in partners farther away than the adjustment takes:
patches of surface that lie beside the map, halves of the scan of which one has no partners, and residuals that follow
a pattern, such as a scan stretched by the motion during its turn.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.map.voxel_table import VoxelTable
from maxcon.refine.adjustment import CLUSTER_EDGE, LAST_PASSES, LEAST_COSINE, N_BINS, STEEPEST, Refined, adjusted
from maxcon.scan import Scan

GATE = 0.6
"""Partners are looked for along normals up to this distance, m."""
MOST_POINTS = 1400
"""So many points with normals are enough."""
PATCH_POINTS, PATCH_OFF = 4, 0.05
"""A patch of the scan has at least so many points, and is off if the median of their distances exceeds this, m."""
USUALLY_OFF, FALSE_ALARM_SIGMAS = 0.15, 4.0
"""Of right answers up to this fraction of the patches is off, and their number scatters as drawn at random."""
SIDE_POINTS, FACING, LEAST_FOUND = 40, 0.75, 0.25
"""Walls to the left and to the right are compared by so many points each, with a normal of this part along an axis,
where on the better side at least this fraction is found ..."""
LEAST_BESIDE, LEAST_ACROSS = 0.12, 0.15
"""... and on the worse one this ratio to it: of walls that face the way, and of those across it."""
FOUND_BEFORE, ALL_BEFORE = 2, 4
"""Added to the numbers of found and of all points: few are less certain than many."""
LEVEL = 0.5
"""A wall point has a normal with a vertical part below this."""
SIGNIFICANT, SIGNIFICANT_IF_LARGE, NOTABLE_SHIFT = 4.0, 3.0, 0.04
"""A pattern counts if it exceeds so many of its standard deviations, and its own notable size or this shift, m; the
second number is for twice the notable size."""
SECTORS, FEWEST_SECTORS = 36, 27
"""A scan looks all around if it has points in so many sectors of azimuth."""
ITERATIONS, SETTLED = 5, 0.1
"""The size of a pattern is found in so many rounds at most; the last one changes it by less than this ratio."""

Points = NDArray[np.float64]


def _phase(points: Points, ahead: float) -> Points:
    """Part of a turn, shape (n, 1), -1/2 to 1/2, at which a spinning scanner takes each point."""
    return (np.mod(np.arctan2(ahead * points[:, 1], ahead * points[:, 0]) / (2.0 * math.pi) + 0.5, 1.0) - 0.5)[:, None]


def _along(points: Points, axis: int) -> Points:
    return np.broadcast_to(np.eye(3)[axis], points.shape)


def _turning(points: Points) -> Points:
    return np.column_stack([-points[:, 1], points[:, 0], np.zeros(len(points))])


@dataclass(frozen=True, slots=True)
class Pattern:
    """A systematic error that a scan, or the map around it, may have.

    words: with its size, in `unit`s, after "the scan ...".
    direction: how a unit of it moves each point, shape (n, 3), sensor frame (x forward).
    notable, largest: sizes from which it is named, and from which the answer is not trusted.
    is_of_turn: whether it arises while a scanner turns, and so only in scans that look all around.
    """

    words: str
    direction: Callable[[Points], Points]
    notable: float
    largest: float
    unit: float = 1.0
    is_of_turn: bool = False


PATTERNS = (
    Pattern("looks {:+.2f} % too large: are its units and calibration right?", lambda p: p, 0.0035, 0.005, 0.01),
    Pattern(
        "has ranges that look {:+.2f} m too long: calibrate the scanner",
        lambda p: p / np.maximum(np.linalg.norm(p, axis=1), 1e-9)[:, None], 0.05, 0.08,
    ),
    Pattern(
        "looks stretched along the way by {:+.1f} m a turn: deskew it",
        lambda p: _phase(p, 1.0) * _along(p, 0), 0.18, 0.8, is_of_turn=True,
    ),
    Pattern(
        "looks stretched along the way by {:+.1f} m a turn (cut ahead): deskew it",
        lambda p: _phase(p, -1.0) * _along(p, 0), 0.18, 0.8, is_of_turn=True,
    ),
    Pattern(
        "looks twisted by {:+.1f} degrees a turn: deskew it",
        lambda p: _phase(p, 1.0) * _turning(p), 0.008, 0.02, math.pi / 180.0, is_of_turn=True,
    ),
    Pattern(
        "looks twisted by {:+.1f} degrees a turn (cut ahead): deskew it",
        lambda p: _phase(p, -1.0) * _turning(p), 0.008, 0.02, math.pi / 180.0, is_of_turn=True,
    ),
    Pattern(
        "has what is to the left {:+.2f} m farther out than the map, beside what is to the right",
        lambda p: (p[:, 1:2] > 0.0) * _along(p, 1), 0.08, 0.15,
    ),
    Pattern(
        "has what is ahead {:+.2f} m farther to the left than the map, beside what is behind",
        lambda p: (p[:, :1] > 0.0) * _along(p, 1), 0.08, 0.15,
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How a scan fits the map at a refined pose.

    misfit: how far the worst of the tests is beyond its limit, as a ratio; right answers have less than 1.
    words: what was noticed, for a reader; empty if nothing.
    covariance: shape (6, 6), of x, y, z, roll, pitch and heading: what a pattern that is notable, but small enough,
        adds to that of the pose.
    """

    misfit: float
    words: str
    covariance: NDArray[np.float64]


def fit_of(refined: Refined, sample: Scan, point_map: PointMap, table: VoxelTable) -> Fit:
    """Test how a scan fits the map at a refined pose.

    sample: the scan's, of which the pose was refined; table: the voxels around it.
    """
    partners = _Partners.of(sample, refined.pose, point_map, table)
    doubts = [*_patches_beside(partners, point_map.cell), *_missing_sides(partners)]
    errors = np.zeros((6, 6))
    looks_around = len(np.unique(np.floor(SECTORS * _phase(sample.points[::8], 1.0)))) >= FEWEST_SECTORS
    patterns = [each for each in PATTERNS if looks_around or not each.is_of_turn]
    strongest = _strongest(partners, patterns, refined.start_weights)
    if strongest is not None:
        pattern, size = strongest
        size, shift = _settled(pattern, size, refined, sample, point_map, table)
        doubts.append((abs(size) / pattern.largest, f"the scan {pattern.words.format(size / pattern.unit)}"))
        errors = np.outer(shift, shift)
    return Fit(max((misfit for misfit, _ in doubts), default=0.0), "; ".join(words for _, words in doubts), errors)


@dataclass(frozen=True, slots=True, eq=False)
class _Partners:
    """Points of a scan with normals, at a pose, and their partners within the gate.

    points, normals: shape (n, 3), sensor frame; planes: (n, 4), as `find_partners` made them; distances: (n,), of the
    points from their planes, m, infinite without a partner; patches: (n,), number of each one's patch, points of one
    orientation in one cube, -1 without a partner; n_patches: how many there are.
    """

    pose: Pose
    points: Points
    normals: Points
    planes: Points
    distances: NDArray[np.float64]
    patches: NDArray[np.int64]
    n_patches: int

    @classmethod
    def of(cls, sample: Scan, pose: Pose, point_map: PointMap, table: VoxelTable) -> "_Partners":
        """Find the partners of some of the points that have a normal."""
        from maxcon.refine import kernels, partner_kernels

        has_normal = np.flatnonzero(sample.normals.any(axis=1))
        n_chosen = min(MOST_POINTS, len(has_normal))
        chosen = has_normal[np.arange(n_chosen) * len(has_normal) // max(1, n_chosen)]
        points, normals, planes = sample.points[chosen], sample.normals[chosen], np.zeros((len(chosen), 4))
        partner_kernels.find_partners(
            points, normals, pose.values, 1, point_map.cell, (max(2, math.ceil(GATE / point_map.cell)), 0),
            LEAST_COSINE, point_map.is_signed, table, planes,
        )  # fmt: skip
        distances = planes[:, 3] - np.einsum("ij,ij->i", planes[:, :3], pose.apply(points))
        is_near = planes[:, :3].any(axis=1) & (np.abs(distances) < GATE)
        patches, walls = (np.empty(len(points), np.int64) for _ in range(2))
        n_patches, _ = kernels.number_groups(
            points, planes, is_near.astype(np.float64), pose.position, CLUSTER_EDGE, N_BINS, STEEPEST, patches, walls
        )
        return cls(pose, points, normals, planes, np.where(is_near, distances, np.inf), patches, n_patches)


def _patches_beside(partners: _Partners, cell: float) -> list[tuple[float, str]]:
    """The misfit, and words, if more patches lie beside the map than at right answers."""
    is_near = partners.patches >= 0
    patches, distances = partners.patches[is_near], partners.distances[is_near]
    ordered = distances[np.lexsort((distances, patches))]
    counts = np.bincount(patches, minlength=partners.n_patches)
    is_large = counts >= PATCH_POINTS
    first, counts = (np.cumsum(counts) - counts)[is_large], counts[is_large]
    medians = 0.5 * (ordered[first + (counts - 1) // 2] + ordered[first + counts // 2])
    n, n_off = len(medians), int(np.count_nonzero(np.abs(medians) > max(PATCH_OFF, 0.5 * cell)))
    expected = USUALLY_OFF * n + FALSE_ALARM_SIGMAS * math.sqrt(USUALLY_OFF * (1.0 - USUALLY_OFF) * n)
    if n_off <= expected:
        return []
    return [(n_off / expected, f"{n_off} of {n} patches of surface lie beside those of the map")]


def _missing_sides(partners: _Partners) -> list[tuple[float, str]]:
    """The misfit, and words, where walls to one side are not found while those to the other, facing alike, are.

    A map that is off on one side, and a scan stretched during its turn, leave one side without partners.
    """
    is_wall = np.abs(partners.normals @ partners.pose.rotation[2]) < LEVEL
    is_found, is_left, doubts = partners.patches >= 0, partners.points[:, 1] > 0.0, []
    for axis, facing, least_ratio in ((1, "to the way", LEAST_BESIDE), (0, "along the way", LEAST_ACROSS)):
        faces = is_wall & (np.abs(partners.normals[:, axis]) > FACING)
        numbers = np.array([np.count_nonzero(faces & side) for side in (is_left, ~is_left)])
        found = np.array([np.count_nonzero(faces & is_found & side) for side in (is_left, ~is_left)])
        if numbers.min() < SIDE_POINTS:
            continue
        shares = (found + FOUND_BEFORE) / (numbers + ALL_BEFORE)
        k = int(np.argmin(shares))
        if shares[1 - k] >= LEAST_FOUND and shares[k] < least_ratio * shares[1 - k]:
            side = ("left", "right")[k]
            words = f"of {numbers[k]} wall points to the {side} facing {facing} {found[k]} are found"
            doubts.append((float(least_ratio * shares[1 - k] / shares[k]), words))
    return doubts


def _strongest(
    partners: _Partners, patterns: Sequence[Pattern], start_weights: NDArray[np.float64]
) -> tuple[Pattern, float] | None:
    """The most significant of the patterns that are notable, and its size in one step."""
    if np.count_nonzero(partners.patches >= 0) < PATCH_POINTS * len(patterns):
        return None
    sizes, sigmas, shifts = _sizes(partners, patterns, start_weights)
    significance, ratios = np.abs(sizes) / sigmas, np.abs(sizes) / [each.notable for each in patterns]
    counts = (significance > SIGNIFICANT) & ((ratios > 1.0) | (shifts > NOTABLE_SHIFT))
    counts |= (significance > SIGNIFICANT_IF_LARGE) & (ratios > 2.0)
    counts &= sigmas < [0.5 * each.largest for each in patterns]  # otherwise the scan cannot tell
    k = int(np.argmax(np.where(counts, significance, 0.0)))
    return (patterns[k], float(sizes[k])) if counts[k] else None


def _sizes(
    partners: _Partners, patterns: Sequence[Pattern], start_weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Size of each pattern by one step, its standard deviation, and how far it shifts the pose in x and y, m.

    Each alone is one more unknown of the adjustment; standard deviations are cluster-robust, as in `covariance`.
    """
    from maxcon.refine import kernels

    is_near = partners.patches >= 0
    points, distances, normals = partners.points[is_near], partners.distances[is_near], partners.planes[is_near, :3]
    rotation, axes = kernels.rotation_and_axes(partners.pose.values[3:])
    by_pose = np.column_stack([normals, np.cross(points @ rotation.T, normals) @ axes.T])
    normals_sensor = normals @ rotation
    by_pattern = np.column_stack([-np.einsum("ij,ij->i", normals_sensor, each.direction(points)) for each in patterns])
    weights = np.square(1.0 - np.square(distances / GATE))[:, None]
    inverse = np.linalg.inv(by_pose.T @ (weights * by_pose) + np.diag(start_weights))
    moves = inverse @ (by_pose.T @ (weights * by_pattern))
    own = by_pattern - by_pose @ moves  # what the pose cannot take up
    information = np.maximum((weights * own**2).sum(axis=0), 1e-9)
    sizes = (weights * own).T @ distances / information
    scores = weights * own * (distances[:, None] - own * sizes)
    sums = [np.bincount(partners.patches[is_near], column, partners.n_patches) for column in scores.T]
    sigmas = np.maximum(np.sqrt(np.square(sums).sum(axis=1)) / information, 1e-9)
    return sizes, sigmas, np.hypot(*(moves[:2] * sizes))


def _settled(
    pattern: Pattern, size: float, refined: Refined, sample: Scan, point_map: PointMap, table: VoxelTable
) -> tuple[float, NDArray[np.float64]]:
    """Size of a pattern, and how far it shifts the pose, (6,): the scan without it is adjusted anew, in turns."""
    pose, weights = refined.pose, refined.start_weights
    for _ in range(ITERATIONS):
        mended = Scan(sample.points - size * pattern.direction(sample.points), sample.normals)
        unknowns, _ = adjusted(mended, point_map, table, pose, weights, LAST_PASSES)
        pose = Pose(*unknowns.tolist())
        more = float(_sizes(_Partners.of(mended, pose, point_map, table), (pattern,), weights)[0][0])
        size += more
        if abs(more) < SETTLED * abs(size):
            break
    return size, pose.values - refined.pose.values
