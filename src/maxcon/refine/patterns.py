"""Patterns: systematic errors of a scan, or of the map around it, that residuals at a refined pose show (D12).

A scan that is stretched by the motion during its turn, has a wrong scale or ranges that are too long fits the map
better without it. The pose is then that of the scan without.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.map.voxel_table import VoxelTable
from maxcon.refine.adjustment import CLUSTER_EDGE, LAST_PASSES, N_BINS, STEEPEST, Refined, planes_near, refine_sample
from maxcon.scan import Scan

PASSES = LAST_PASSES[:2]  # of the adjustment without a pattern: each round begins where the one before came to rest
GATE = 0.6
"""Partners are looked for along normals up to this distance, m."""
MOST_POINTS = 1400
"""So many points with normals are enough."""
PATCH_POINTS = 4
"""A patch of the scan has at least so many points."""
SIGNIFICANT, NOTABLE_SHIFT = 2.0, 0.04
"""A pattern is tried if one step finds it larger than so many of its standard deviations, and either larger than its
notable size or shifting the pose by more than `NOTABLE_SHIFT`, m."""
LEAST_GAIN = 0.03
"""The scan has a pattern if it is still notable and significant after all steps, and without it the scan's points gain
more weight than this, as a ratio."""
RIVALLING, APART = 0.5, 0.1
"""Another pattern rivals it if it gains more than `RIVALLING` times that, less `LEAST_GAIN`, at a pose that lies more
than `APART` away, m."""
RIVALLING_SIDE = 0.75
"""The ratio for the same pattern of a turn that begins on the other side, which is alike."""
LARGE, INSECURE_GAIN = 5.0, 0.06
"""A pattern of so many times its notable size that a scan does not have is left unexplained; so is the one with the
largest gain if that exceeds this, and its size is not significant."""
TRIAL_POINTS = 1500
"""Patterns are compared by so many points of the sample."""
SECTORS, FEWEST_SECTORS = 36, 27
"""A scan looks all around if it has points in so many sectors of azimuth."""
ITERATIONS, SETTLED = 5, 0.1
"""The size of a pattern is found in so many rounds at most; the last one changes it by less than this ratio."""

Points = NDArray[np.float64]


def _phase(points: Points, ahead: float) -> Points:
    """Part of a turn, shape (n, 1), -1/2 to 1/2, at which a spinning scanner takes each point."""
    return np.arctan2(ahead * points[:, 1], ahead * points[:, 0])[:, None] / (2.0 * math.pi)


def _along(points: Points, axis: int) -> Points:
    return np.broadcast_to(np.eye(3)[axis], points.shape)


def _turning(points: Points) -> Points:
    return np.column_stack([-points[:, 1], points[:, 0], np.zeros(len(points))])


@dataclass(frozen=True, slots=True)
class Pattern:
    """A systematic error that a scan, or the map around it, may have.

    words: with its size, in `unit`s, after "the scan ..."; remedy: what to do.
    direction: how a unit of it moves each point, shape (n, 3), sensor frame (x forward).
    usual: standard deviation of its sizes where nothing is amiss: it moves the pose, and may not show.
    notable, largest: sizes from which it is named, and from which the answer is not trusted.
    moves: of a pattern that arises while a scanner turns, and so only in scans that look all around, the move of the
        pose, (3,), m ahead, m to the left and rad, that a whole turn amounts to.
    is_of_scan: whether the scan must be what is off; where the map may be, too, nothing tells which of the two.
    """

    words: str
    remedy: str
    direction: Callable[[Points], Points]
    usual: float
    notable: float
    largest: float
    unit: float = 1.0
    moves: tuple[float, float, float] | None = None
    is_of_scan: bool = True


DESKEW = "deskew it (--deskew)"
PATTERNS = (
    Pattern(
        "looks {:+.2f} % too large", "are its units and calibration right?", lambda p: p, 0.0015, 0.0035, 0.03, 0.01
    ),
    Pattern(
        "has ranges that look {:+.2f} m too long", "calibrate the scanner",
        lambda p: p / np.sqrt(np.maximum(np.einsum("ij,ij->i", p, p), 1e-18))[:, None], 0.02, 0.05, 0.5,
    ),
    Pattern(
        "looks stretched along the way by {:+.1f} m a turn", DESKEW,
        lambda p: _phase(p, 1.0) * _along(p, 0), 0.06, 0.18, 3.0, moves=(1.0, 0.0, 0.0),
    ),
    Pattern(
        "looks stretched along the way by {:+.1f} m a turn that begins ahead", DESKEW,
        lambda p: _phase(p, -1.0) * _along(p, 0), 0.06, 0.18, 3.0, moves=(1.0, 0.0, 0.0),
    ),
    Pattern(
        "looks twisted by {:+.1f} degrees a turn", DESKEW,
        lambda p: _phase(p, 1.0) * _turning(p), 0.003, 0.008, 0.08, math.pi / 180.0, moves=(0.0, 0.0, 1.0),
    ),
    Pattern(
        "looks twisted by {:+.1f} degrees a turn that begins ahead", DESKEW,
        lambda p: _phase(p, -1.0) * _turning(p), 0.003, 0.008, 0.08, math.pi / 180.0, moves=(0.0, 0.0, 1.0),
    ),
    Pattern(
        "has what is to the left {:+.2f} m farther out than the map, beside what is to the right", "",
        lambda p: (p[:, 1:2] > 0.0) * _along(p, 1), 0.03, 0.08, 0.15, is_of_scan=False,
    ),
    Pattern(
        "has what is ahead {:+.2f} m farther to the left than the map, beside what is behind", "",
        lambda p: (p[:, :1] > 0.0) * _along(p, 1), 0.03, 0.08, 0.15, is_of_scan=False,
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Partners:
    """Points of a scan with normals, at a pose, and their partners within the gate.

    points, normals: shape (n, 3), sensor frame; planes: (n, 4), as `find_partners` made them; distances: (n,), of the
    points from their planes, m, infinite without a partner; patches: (n,), number of each one's patch, points of one
    orientation in one cube, -1 without a partner.
    """

    pose: Pose
    points: Points
    normals: Points
    planes: Points
    distances: NDArray[np.float64]
    patches: NDArray[np.int64]

    @classmethod
    def of(cls, refined: Refined, point_map: PointMap, table: VoxelTable) -> "Partners":
        """Take the partners that some of the points with a normal have at a refined pose, or find some farther away."""
        from maxcon.refine import kernels

        pose = refined.pose
        has_normal = np.flatnonzero(np.einsum("ij,ij->i", refined.normals, refined.normals))
        n_chosen = min(MOST_POINTS, len(has_normal))
        chosen = has_normal[np.arange(n_chosen) * len(has_normal) // max(1, n_chosen)]
        points, normals, planes = refined.points[chosen], refined.normals[chosen], refined.planes[chosen]
        distances = refined.residuals[chosen]
        alone = np.flatnonzero(np.isinf(distances))
        planes[alone], distances[alone] = planes_near(points[alone], normals[alone], pose, GATE, point_map, table)
        is_near = np.isfinite(distances)
        patches, walls = (np.empty(len(points), np.int64) for _ in range(2))
        kernels.number_groups(
            points, planes, is_near.astype(np.float64), pose.position, CLUSTER_EDGE, N_BINS, STEEPEST, patches, walls
        )
        return cls(pose, points, normals, planes, distances, patches)

    def distances_within(
        self, gate: float, chosen: NDArray[np.int64], point_map: PointMap, table: VoxelTable
    ) -> NDArray[np.float64]:
        """How far chosen points lie behind the nearest planes along their normals, m (before them: below 0).

        Infinite beyond a gate.
        """
        points, normals = self.points[chosen], self.normals[chosen]
        planes, distances = planes_near(points, normals, self.pose, gate, point_map, table)
        towards_sensor = np.einsum("ij,ij->i", planes[:, :3], normals @ self.pose.rotation.T)
        return np.asarray(np.copysign(1.0, towards_sensor) * distances)


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """A scan without a pattern.

    size: of the pattern; scan, refined, partners: the scan, its pose, and its partners there; gain: how much more
    weight its points have than those of the scan as it is, as a ratio; significance: of the size, in sigmas.
    """

    pattern: Pattern
    size: float
    scan: Scan
    refined: Refined
    partners: Partners
    gain: float
    significance: float

    def words(self, then: str = "") -> str:
        """What the scan has, and what to do, for a reader, after "the scan"."""
        found = self.pattern.words.format(self.size / self.pattern.unit) + then
        return f"{found}: {self.pattern.remedy}" if self.pattern.remedy else found


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """What a scan has that makes it fit as it does.

    corrected: the scan without the pattern that it has; None if it has none.
    rivals: patterns that explain the scan about as well, from another place.
    unexplained: a pattern that is too large, or gains too much, for a scan that does not have it; None without one.
    """

    corrected: Corrected | None
    rivals: list[Corrected]
    unexplained: Corrected | None


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """What one step of the adjustment finds of patterns, each alone as one more unknown.

    sizes, sigmas: shape (n,), and their standard deviations, cluster-robust, as in `covariance`; shifts: (6, n), how
    the pose moves with a unit of each.
    """

    sizes: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    shifts: NDArray[np.float64]

    @classmethod
    def of(cls, partners: Partners, patterns: Sequence[Pattern], start_weights: NDArray[np.float64]) -> "Effects":
        """The effects of patterns on a pose, which is an observation with some weights, (6,), itself."""
        from maxcon.refine import kernels

        is_near = partners.patches >= 0
        points, planes, patches = partners.points[is_near], partners.planes[is_near], partners.patches[is_near]
        directions = np.empty((len(patterns), *points.shape))
        for each, direction in zip(patterns, directions, strict=True):
            direction[:] = each.direction(points)
        sizes, variances, shifts = np.empty(len(patterns)), np.empty(len(patterns)), np.empty((6, len(patterns)))
        kernels.find_effects(
            points, planes, patches, partners.pose.values, GATE, start_weights, directions, sizes, variances, shifts
        )
        return cls(sizes, np.sqrt(variances), shifts)

    def unseen(self) -> NDArray[np.float64]:
        """Covariance, (6, 6), that all of `PATTERNS` in their usual sizes add to that of a pose.

        Of each as much as the scan does not rule out: the second moment of its size, usual and as found together.
        """
        variances = np.array([each.usual**2 for each in PATTERNS])
        ratios = variances / (variances + self.sigmas**2)
        return np.asarray(self.shifts * (ratios * self.sigmas**2 + (ratios * self.sizes) ** 2) @ self.shifts.T)


def explain(
    refined: Refined, partners: Partners, effects: Effects, sample: Scan, point_map: PointMap, table: VoxelTable
) -> Explanation:
    """Find the pattern that explains a scan best.

    refined, partners: of the sample of a scan, as it is; effects: of `PATTERNS` on its pose.
    """
    suspected = _suspected(effects, partners, sample)
    if not suspected:
        return Explanation(None, [], None)
    step = max(1, len(sample) // TRIAL_POINTS)
    some, weight = Scan(sample.points[::step], sample.normals[::step]), float(refined.weights[::step].sum())
    tried = [_without(*each, refined, weight, some, point_map, table) for each in suspected]
    best = _strongest(tried)
    if best is not None:
        tried += [_without(*each, best.refined, weight, some, point_map, table) for each in _of_other_side(best)]
        best = _strongest(tried)
    tried.sort(key=lambda each: -each.gain)
    rivals = _rivals(tried, best, refined.pose)
    if best is None:
        unexplained = [each for each in tried if abs(each.size) > LARGE * each.pattern.notable]
    else:
        whole = _without(best.pattern, best.size, np.zeros(6), best.refined, weight, sample, point_map, table)
        best, unexplained = replace(whole, gain=best.gain), []
    unexplained += [each for each in tried[:1] if each.gain > INSECURE_GAIN and each.significance < SIGNIFICANT]
    return Explanation(best, rivals, unexplained[0] if unexplained else None)


def _strongest(tried: Sequence[Corrected]) -> Corrected | None:
    """The pattern of the largest gain among those that the scan has."""

    def is_there(each: Corrected) -> bool:
        is_significant = each.significance > SIGNIFICANT and abs(each.size) > each.pattern.notable
        return is_significant and each.gain > LEAST_GAIN

    return max(filter(is_there, tried), key=lambda each: each.gain, default=None)


def _rivals(tried: Sequence[Corrected], best: Corrected | None, place: Pose) -> list[Corrected]:
    """Patterns that explain the scan about as well as the best one, or as none at a place, from elsewhere."""

    def is_as_good(each: Corrected) -> bool:
        if best is None:
            return each.gain > -LEAST_GAIN
        is_of_turn = best.pattern.moves is not None and each.pattern.moves == best.pattern.moves
        return each.gain > (RIVALLING_SIDE * best.gain if is_of_turn else RIVALLING * best.gain - LEAST_GAIN)

    here = place if best is None else best.refined.pose
    return [each for each in tried if is_as_good(each) and _apart(each.refined.pose, here) > APART]


def _of_other_side(found: Corrected) -> list[tuple[Pattern, float, NDArray[np.float64]]]:
    """The same pattern, of a turn that begins on the other side: it moves all points of one side of the scan alike.

    Its size is the same, and the pose lies half of it away, (6,), either way.
    """
    if found.pattern.moves is None:
        return []
    others = [each for each in PATTERNS if each.moves == found.pattern.moves and each is not found.pattern]
    ahead, left, turn = 0.5 * found.size * np.array(found.pattern.moves)
    x, y, _ = found.refined.pose.rotation @ [ahead, left, 0.0]
    return [(each, found.size, side * np.array([x, y, 0.0, 0.0, 0.0, turn])) for each in others for side in (1.0, -1.0)]


def _apart(one: Pose, other: Pose) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


def _suspected(effects: Effects, partners: Partners, sample: Scan) -> list[tuple[Pattern, float, NDArray[np.float64]]]:
    """Patterns that the scan may have, their sizes by one step, and how the pose moves, (6,)."""
    if np.count_nonzero(partners.patches >= 0) < PATCH_POINTS * len(PATTERNS):
        return []
    sizes, sigmas, moves = effects.sizes, effects.sigmas, effects.shifts * effects.sizes
    is_notable = (np.abs(sizes) > [each.notable for each in PATTERNS]) | (np.hypot(*moves[:2]) > NOTABLE_SHIFT)
    is_suspect = is_notable & (np.abs(sizes) > SIGNIFICANT * sigmas)
    is_suspect &= sigmas < [0.5 * each.largest for each in PATTERNS]  # otherwise the scan cannot tell
    is_of_turn = np.array([each.moves is not None for each in PATTERNS])
    if (is_suspect & is_of_turn).any():
        n_sectors = len(np.unique(np.floor(SECTORS * _phase(sample.points[::8], 1.0))))
        is_suspect &= ~is_of_turn | (n_sectors >= FEWEST_SECTORS)
    return [(PATTERNS[k], float(sizes[k]), moves[:, k]) for k in np.flatnonzero(is_suspect)]


def _without(
    pattern: Pattern, size: float, move: NDArray[np.float64], refined: Refined, weight: float, scan: Scan,
    point_map: PointMap, table: VoxelTable,
) -> Corrected:  # fmt: skip
    """The scan without a pattern of a size, from a refined pose that moves with it: both are found in turns.

    weight: of the points with the pattern.
    """
    more, size = size, 0.0
    for _ in range(ITERATIONS):
        size += more
        without = Scan(scan.points - size * pattern.direction(scan.points), scan.normals)
        start = Pose(*(refined.pose.values + move).tolist())
        refined = refine_sample(without, point_map, table, start, refined.start_weights, PASSES)
        partners = Partners.of(refined, point_map, table)
        effects = Effects.of(partners, (pattern,), refined.start_weights)
        more = float(effects.sizes[0])
        move = more * effects.shifts[:, 0]
        if abs(more) < SETTLED * abs(size):
            break
    gain = float(refined.weights.sum()) / max(weight, 1.0) - 1.0
    return Corrected(pattern, size, without, refined, partners, gain, abs(size) / float(effects.sigmas[0]))
