"""Candidates of an open space: poses of large cells, adjusted to the map and scored in its own voxels there (D11)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices
from maxcon.map import PointMap
from maxcon.map.voxel_table import VoxelTable
from maxcon.refine import adjustment
from maxcon.refine.ground import fit_ground_plane
from maxcon.scan import Scan, one_per_cube
from maxcon.search import Multiplicity, Weighting, coarse
from maxcon.search.objectives import Moments, Objective, scores_of
from maxcon.search.space import SearchSpace

# Without ground in the map nothing holds height and tilt while partners are far away; m and rad.
HELD_HEIGHT_SIGMA, HELD_TILT_SIGMA = 0.03, 0.002
# Points so near to the scan's own ground plane are left out of the coarse search, m.
ON_GROUND = 0.25
# Candidates that reach this ratio to the best score are adjusted once more, by these passes, before they are compared.
CONTENDING, COMPARED = 0.5, adjustment.LAST_PASSES[:1]
# A scan whose y axis is to the right is a mirror image. Its image is adjusted to the end if the share of matches of one
# point in so many is at least this ratio to that of the scan itself.
MIRROR, SOME, NEARLY = np.array([1.0, -1.0, 1.0]), 4, 0.97
# A window that reaches no farther than this, m and degrees, is within reach of the adjustment: no large cells are
# searched.
IN_REACH, IN_REACH_DEG = 0.5, 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose that large cells left open, adjusted to the map."""

    pose: Pose  # T_map_sensor, local frame
    score: float  # by the objective
    moments: Moments  # (4,), of the sample, in the map's own voxels
    share: float  # of the points of the sample that match
    is_mirrored: bool = False  # whether the mirror image of the scan fits better


@dataclass(frozen=True, slots=True)
class Scoring:
    """How much a pose is worth: its objective, and how matches are counted and weighed."""

    objective: Objective
    multiplicity: Multiplicity
    weighting: Weighting


def find_candidates(
    scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, ratio: float, scoring: Scoring, n_threads: int = 1
) -> tuple[list[Candidate], float]:
    """Find the candidates of an open space, the highest score first, and the ratio that no other place exceeds."""
    if space.half_width <= IN_REACH and space.heading_half_width_deg <= IN_REACH_DEG and not space.height_half_width:
        left_open = coarse.LeftOpen([prior], 0.0)
    else:
        points = coarse_sample(scan)
        left_open = coarse.coarse_search(points, point_map, prior, space, ratio, n_threads)
    if not left_open.poses:
        return [], left_open.rest_ratio
    sample = scan.sample
    table = adjustment.table_around(sample, point_map, left_open.poses)
    adjust = partial(adjusted_candidate, sample, point_map, scoring=scoring, table=table)
    found = distinct([adjust(pose, adjustment.FROM_LARGE_CELLS) for pose in left_open.poses])
    contending = [each for each in found if each.score >= CONTENDING * found[0].score]
    if len(contending) > 1:
        found = distinct([adjust(each.pose, COMPARED) for each in contending] + found[len(contending) :])
    if found and left_open.image is not None:
        found[0] = replace(found[0], is_mirrored=_fits_better(sample, found[0], left_open.image, point_map, scoring))
    return found, left_open.rest_ratio


def _fits_better(sample: Scan, found: Candidate, image: Pose, point_map: PointMap, scoring: Scoring) -> bool:
    """Whether the mirror image of a scan fits better around a pose than the scan itself at a candidate."""
    mirrored = Scan(sample.points * MIRROR, sample.normals * MIRROR)
    table = adjustment.table_around(mirrored, point_map, [image])
    some = Scan(mirrored.points[::SOME], mirrored.normals[::SOME])
    fit = adjusted_candidate(some, point_map, image, adjustment.FROM_LARGE_CELLS, scoring, table)
    if fit.share < NEARLY * found.share:
        return False
    fit = adjusted_candidate(mirrored, point_map, fit.pose, COMPARED, scoring, table)
    own = adjusted_candidate(sample, point_map, found.pose, COMPARED, scoring)
    return fit.score > own.score and fit.share > own.share


def distinct(found: list[Candidate]) -> list[Candidate]:
    """Return the candidates with matches, the highest score first; of those at one place the highest."""
    kept: list[Candidate] = []
    for each in sorted(found, key=lambda each: -each.score):
        if each.share > 0.0 and not any(coarse.is_same_place(each.pose, other.pose) for other in kept):
            kept.append(each)
    return kept


def coarse_sample(scan: Scan) -> NDArray[np.float64]:
    """Points for the coarse search, shape (n, 3), sensor frame, m: above the scan's own ground, one of each cube.

    Of many those with a normal come first, as clutter has none, and some of each kind, evenly by distance.
    """
    points, normals, T_ground_sensor = scan.sample.points, scan.sample.normals, fit_ground_plane(scan)
    distances = np.hypot(points[:, 0], points[:, 1])
    is_asked = distances <= coarse.FARTHEST
    if T_ground_sensor is not None:
        up = rotation_matrices(T_ground_sensor.roll, T_ground_sensor.pitch, 0.0)[2]
        is_asked &= np.abs(points @ up + T_ground_sensor.z) > ON_GROUND
    points, normals, distances = points[is_asked], normals[is_asked], distances[is_asked]
    kept = one_per_cube(points, coarse.THINNING, normals)
    if len(kept) <= coarse.MOST_POINTS:
        return points[kept]
    has_normal = normals[kept].any(axis=1)
    points, n = points[kept][np.lexsort((distances[kept], ~has_normal))], int(has_normal.sum())
    n_first = min(n, coarse.MOST_POINTS)
    return np.concatenate([_spread(points[:n], n_first), _spread(points[n:], coarse.MOST_POINTS - n_first)])


def _spread(rows: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """So many of some rows, evenly."""
    return np.asarray(rows[np.linspace(0, len(rows) - 1, n).astype(int)])


def adjusted_candidate(
    sample: Scan, point_map: PointMap, start: Pose, passes: Sequence[adjustment.Pass], scoring: Scoring,
    table: VoxelTable | None = None,
) -> Candidate:  # fmt: skip
    """Return the candidate that a start is adjusted to, by the sample of a scan."""
    if table is None:
        table = adjustment.table_around(sample, point_map, [start])
    is_held = passes is adjustment.FROM_LARGE_CELLS and not point_map.has_ground
    sigmas = (HELD_HEIGHT_SIGMA, HELD_TILT_SIGMA) if is_held else (adjustment.HEIGHT_SIGMA, adjustment.TILT_SIGMA)
    unknowns, _ = adjustment.adjusted(sample, point_map, table, start, adjustment.weights_of_start(*sigmas), passes)
    moments = matched = moments_at(sample, point_map, table, unknowns, scoring)
    if scoring.multiplicity is Multiplicity.POINTS:
        matched = moments_at(sample, point_map, table, unknowns, replace(scoring, multiplicity=Multiplicity.OCCUPIED))
    score = float(scores_of(scoring.objective, moments[None])[0])
    return Candidate(Pose(*unknowns.tolist()), score, moments, float(matched[0]) / max(1, len(sample)))


def moments_at(
    sample: Scan, point_map: PointMap, table: VoxelTable, unknowns: NDArray[np.float64], scoring: Scoring
) -> Moments:
    """Moments, shape (4,), of a scan at a pose (6,): those of a cell that stands for it."""
    from maxcon.refine import partner_kernels

    moments = np.zeros(4)
    weights = float(scoring.weighting is not Weighting.ONE), scoring.weighting.without_normal
    partner_kernels.add_moments(
        sample.points, sample.normals, unknowns, point_map.cell, weights, point_map.is_signed,
        scoring.multiplicity is Multiplicity.POINTS, table, moments,
    )  # fmt: skip
    return moments
