"""Fit of a scan to the map at a refined pose (D12): what the residuals of the adjustment do not show.

A wrong place, a distorted scan and a map that is off leave traces in partners farther away than the adjustment takes:
patches of surface that lie beside the map, a side whose walls do, and residuals that follow a pattern, such as a scan
stretched by the motion during its turn: the pose is then that of the scan without it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.map import PointMap
from maxcon.map.voxel_table import VoxelTable
from maxcon.refine.adjustment import Refined
from maxcon.refine.patterns import PATCH_POINTS, PATTERNS, Effects, Partners, explain
from maxcon.scan import Scan

PATCH_OFF = 0.05
"""A patch of the scan is off if the median of the distances of its points exceeds this, m."""
USUALLY_OFF, FALSE_ALARM_SIGMAS = 0.15, 4.0
"""At right answers at most this ratio of the patches is off, but for so many sigmas of a number drawn at random."""
SIDE_POINTS, FACING, MOST_FOUND = 60, 0.75, 0.25
"""Walls to one side are tested if they have so many points whose normals have at least this part along the axis, of
which at most this ratio was found on the map."""
FARTHEST, TOGETHER, DISPLACED = 1.6, 0.24, 0.4
"""They are displaced if the map has walls that face alike up to so far beside them, m, the points' distances from these
agree within so much, m, and the points beside are more than this ratio of those beside and those found."""
FOUND_BEFORE = 2
"""Added to the number of found points: few are less certain than many."""
MOST_HIDDEN_FOUND = 0.05
"""Walls nearer than those of the map may be new, and hide these, unless at most this ratio of the side is found."""
NEAR, CLOSE, FEWEST_NEAR = 0.21, 0.05, 200
"""Of the points within `NEAR` of their planes, m, the ratio within `CLOSE` tells whether the map explains the scan: at
wrong places points lie near some plane by chance. Fewer points tell nothing."""
LEAST_CLOSE, THIN, EXACT, LOSS, SMALL_CELL = 0.88, 0.026, 0.0125, 10.0, 0.09
"""This ratio must be close if the scan's surfaces are no thicker than `THIN`, m, and the map's sigma is no larger than
`EXACT`; else less, by `LOSS` times the excess. Maps of cells larger than `SMALL_CELL`, m, blur surfaces: no test."""
FEWEST_AHEAD, LEAST_AHEAD = 50.0, 0.12
"""Of points on walls ahead, if they weigh so much, the share with a normal is at least this ratio of that aside."""
N_NEXT, NEIGHBOURS, FEWEST_PAIRS = 4, 0.6, 50
"""The thickness of a scan's surfaces is how far its points lie from the planes of those before them, in the median of
at least so many pairs, of points with at most so many steps between them that are nearer to each other, m."""
LEVEL = 0.5
"""A wall point has a normal with a vertical part below this."""
UNKNOWN, COVERED = 2.0, 0.25
"""The misfit where a scan is explained in no way, or in two from two places; within this distance, m, the covariance
covers both of them."""
MOST_PATTERNS = 2
"""So many patterns are corrected, one after the other: a vehicle in a bend moves ahead and turns."""
UNMODELLED = 0.33
"""This ratio of the shift that a pattern causes is left as an error: motion is not as even as the pattern."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How a scan fits the map at a refined pose.

    misfit: how far the worst of the tests is beyond its limit, as a ratio; right answers have less than 1.
    words: what was noticed, for a reader; empty if nothing.
    refined: the pose, of the scan without the pattern that it has, if it has one.
    covariance: shape (6, 6), of x, y, z, roll, pitch and heading: what patterns add to that of the pose.
    """

    misfit: float
    words: str
    refined: Refined
    covariance: NDArray[np.float64]


def fit_of(refined: Refined, sample: Scan, point_map: PointMap, table: VoxelTable) -> Fit:
    """Test how a scan fits the map at a refined pose.

    sample: the scan's, of which the pose was refined; table: the voxels around it.
    """
    partners, errors, doubts = Partners.of(refined, point_map, table), np.zeros((6, 6)), []
    effects = Effects.of(partners, PATTERNS, refined.start_weights)
    for _ in range(MOST_PATTERNS):
        explanation = explain(refined, partners, effects, sample, point_map, table)
        best = explanation.corrected
        is_corrected = best is not None and best.pattern.is_of_scan
        if best is not None:
            words = best.words(" (corrected)" if is_corrected else "")
            doubts.append((abs(best.size) / best.pattern.largest, f"the scan {words}"))
            if is_corrected:
                shift = UNMODELLED * best.refined.pose.less(refined.pose)
                errors += np.outer(shift, shift)
                refined, sample, partners = best.refined, best.scan, best.partners
        for rival in explanation.rivals:
            shift = rival.refined.pose.less(refined.pose)
            if np.hypot(*shift[:2]) > COVERED:
                doubts.append((UNKNOWN, f"it may as well be that, seen from another place, the scan {rival.words()}"))
                break
            errors += np.outer(shift, shift)
        if explanation.unexplained is not None:
            doubts.append((UNKNOWN, f"residuals stay unexplained where the scan {explanation.unexplained.words()}"))
        if not is_corrected:
            break
        effects = Effects.of(partners, PATTERNS, refined.start_weights)
    errors += effects.unseen()
    doubts += [
        *_patches_beside(partners, point_map.cell), *_displaced_sides(partners, point_map, table),
        *_loose(refined, point_map), *_smeared(refined),
    ]  # fmt: skip
    misfit, words = max((each for each, _ in doubts), default=0.0), "; ".join(words for _, words in doubts)
    return Fit(misfit, words, refined, errors)


def _patches_beside(partners: Partners, cell: float) -> list[tuple[float, str]]:
    """The misfit, and words, if more patches lie beside the map than at right answers."""
    is_near = partners.patches >= 0
    patches, distances = partners.patches[is_near], partners.distances[is_near]
    ordered = distances[np.lexsort((distances, patches))]
    counts = np.bincount(patches)
    is_large = counts >= PATCH_POINTS
    first, counts = (np.cumsum(counts) - counts)[is_large], counts[is_large]
    medians = 0.5 * (ordered[first + (counts - 1) // 2] + ordered[first + counts // 2])
    n, n_off = len(medians), int(np.count_nonzero(np.abs(medians) > max(PATCH_OFF, 0.5 * cell)))
    expected = USUALLY_OFF * n + FALSE_ALARM_SIGMAS * math.sqrt(USUALLY_OFF * (1.0 - USUALLY_OFF) * n)
    if n_off <= expected:
        return []
    return [(n_off / expected, f"{n_off} of {n} patches of surface lie beside those of the map")]


def _displaced_sides(partners: Partners, point_map: PointMap, table: VoxelTable) -> list[tuple[float, str]]:
    """The misfit, and words, where walls to one side lie beside walls of the map that face alike, all as far off.

    A map that is off on one side, and a scan stretched during its turn, displace one side. Walls that are merely not
    found may be new, and so may be what hides walls of the map, such as a scaffold, while others of them are found.
    """
    is_wall = np.abs(partners.normals @ partners.pose.rotation[2]) < LEVEL
    is_found, is_left, doubts = partners.patches >= 0, partners.points[:, 1] > 0.0, []
    for axis, facing in ((1, "to the way"), (0, "along the way")):
        faces = is_wall & (np.abs(partners.normals[:, axis]) > FACING)
        for side, words in ((is_left, "left"), (~is_left, "right")):
            on_side = faces & side
            n, n_found = int(np.count_nonzero(on_side)), int(np.count_nonzero(on_side & is_found))
            if n < SIDE_POINTS or n_found > MOST_FOUND * n:
                continue
            chosen = np.flatnonzero(on_side & ~is_found)
            behind = partners.distances_within(FARTHEST, chosen, point_map, table)
            chosen, behind = chosen[np.isfinite(behind)], behind[np.isfinite(behind)]
            offsets = behind * np.sign(partners.normals[chosen, axis])
            order = np.argsort(offsets, kind="stable")
            offsets, behind = offsets[order], behind[order]
            beside = np.searchsorted(offsets, offsets + TOGETHER, "right") - np.arange(len(offsets))
            n_beside = int(beside.max(initial=0))
            ratio = n_beside / (n_beside + n_found + FOUND_BEFORE)
            if ratio > DISPLACED:
                first = int(np.argmax(beside))
                off = float(np.median(behind[first : first + n_beside]))
                if off < 0.0 and n_found > MOST_HIDDEN_FOUND * n:
                    continue
                found = f"of {n} wall points to the {words} facing {facing} {n_found} are found"
                doubts.append((ratio / DISPLACED, f"{found}, and {n_beside} lie {abs(off):.1f} m beside the map"))
    return doubts


def _loose(refined: Refined, point_map: PointMap) -> list[tuple[float, str]]:
    """The misfit, and words, if points lie near the map, but fewer close to it than the scan's own noise explains."""
    distances = np.abs(refined.residuals)
    n_near = int(np.count_nonzero(distances < NEAR))
    if point_map.cell > SMALL_CELL or n_near < FEWEST_NEAR:
        return []
    ratio = np.count_nonzero(distances < CLOSE) / n_near
    if ratio >= LEAST_CLOSE:
        return []
    thickness = surface_thickness(refined.points, refined.normals)
    if thickness is None:
        return []
    least = LEAST_CLOSE - LOSS * max(0.0, thickness - THIN, point_map.sigma - EXACT)
    if ratio >= least:
        return []
    words = f"of the points within {NEAR:g} m of the map's surfaces {ratio:.0%} lie within {CLOSE:g} m of them"
    return [(least / max(ratio, 1e-9), words)]


def _smeared(refined: Refined) -> list[tuple[float, str]]:
    """The misfit, and words, if hardly any point on walls ahead has a normal of its own, as those aside have.

    Sweeps that are put together without the vehicle's motion blur what it drives towards.
    """
    on_walls = np.flatnonzero((refined.weights > 0.0) & (np.abs(refined.planes[:, 2]) < LEVEL))
    facing = np.abs(refined.planes[on_walls, :3] @ refined.pose.rotation[:, :2]) > FACING
    weights, has_normal = refined.weights[on_walls], refined.normals[on_walls].any(axis=1)
    (ahead, aside), (own_ahead, own_aside) = weights @ facing, (weights * has_normal) @ facing
    if min(ahead, aside) < FEWEST_AHEAD or own_aside == 0.0:
        return []
    ratio = own_ahead / ahead / (own_aside / aside)
    if ratio >= LEAST_AHEAD:
        return []
    words = (
        f"of the points on walls ahead and behind {own_ahead / ahead:.0%} have a normal, aside {own_aside / aside:.0%}"
    )
    return [(LEAST_AHEAD / max(ratio, 1e-9), f"{words}: are sweeps put together without their motion?")]


def surface_thickness(points: NDArray[np.float64], normals: NDArray[np.float64]) -> float | None:
    """How far the next points of a scan lie from the plane of a point, in the median, m; None where few are near."""
    from maxcon.refine import kernels

    distances = kernels.next_distances(points, normals, N_NEXT, NEIGHBOURS)
    return float(np.median(distances)) if len(distances) >= FEWEST_PAIRS else None
