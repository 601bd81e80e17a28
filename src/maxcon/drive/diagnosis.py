"""Why epochs of a drive are not localized: heights far off the map's ground, or a usual slip of axes and angles."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.localize import MAP_MARGIN, DriveOptions, EpochEstimate, Method
from maxcon.errors import ArrayError, FileError, TrajectoryError
from maxcon.estimate import Status
from maxcon.geometry import Pose
from maxcon.geometry.pose import angles_from_quaternions, quaternions_from_angles
from maxcon.io.scans import RawScan, Scans
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory

LOWEST, HIGHEST = -5.0, 12.0
"""A sensor on a vehicle, and the errors of its receiver, lie between these above the ground, m."""
USUAL, FAR_OFF = 1.9, 2.0  # m above the ground, of a sensor on a car; farther off, a prior is tried at that height
REACH, N_POSES = 5.0, 50  # heights of the ground are those so far, m, around so many poses of a prior
MOST_TRIED = 3  # epochs; all of them must fit better
CLEARLY, ALIKE, FEW_REFUSED = 1.05, 1.1, 0.8
"""An alternative is named if its scores sum to more than CLEARLY times those as read, and the best to at most ALIKE
times that. A drive of which this part of the epochs is localized is held for right."""
WITHOUT_SEARCH = (Status.UNREADABLE, Status.NO_PRIOR, Status.OUTSIDE_MAP, Status.FAILED)

Points = NDArray[np.float64]


def check_heights(point_map: PointMap, prior: Trajectory, *, are_orthometric: bool = False) -> None:
    """Refuse heights of a prior (TrajectoryError) that lie far above or below the map's ground in the median."""
    median = above_ground(point_map, point_map.frame.to_local(prior.positions))
    if not (median < LOWEST or median > HIGHEST):
        return
    kind = "ellipsoidal heights of the receiver"
    hint = (
        "Are the map's heights above the geoid? Say how high that is above the ellipsoid there: --geoid-height,"
        f" about {median - 2.0:.0f} here."
    )
    if are_orthometric:
        kind = "heights above the geoid"
        hint = "Are the map's heights ellipsoidal? Then give the prior ellipsoidal heights too."
    side = "above" if median > 0 else "below"
    raise TrajectoryError(f"Expected the prior near the map's ground, got {kind} {abs(median):.1f} m {side} it. {hint}")


def heights_in_words(median: float) -> str:
    """Return how high a prior lies above the map's ground (m), and what may be wrong; empty where it is not known."""
    if math.isnan(median):
        return ""
    words = f"the prior lies {abs(median):.1f} m {'above' if median >= 0.0 else 'below'} the map's ground"
    if LOWEST <= median <= HIGHEST:
        return words
    kind, other = ("ellipsoid", "geoid") if median > 0.0 else ("geoid", "ellipsoid")
    return (
        f"{words}. Are its heights above the {kind}, and the map's above the {other}? Take about {median - 2.0:.0f} m"
        " off its z"
    )


def above_ground(point_map: PointMap, positions: NDArray[np.float64]) -> float:
    """Return the median height above the map's ground of some positions, (n, 3), local frame, m; NaN if unknown."""
    above = []
    for x, y, z in positions[:: max(1, len(positions) // N_POSES)].tolist():
        if point_map.covers(x, y, REACH):
            heights = point_map.ground_around(x, y, REACH).heights
            known = heights[np.isfinite(heights)]
            if len(known):
                above.append(z - float(np.median(known)))
    return float(np.median(above)) if above else math.nan


@dataclass(frozen=True, slots=True)
class Alternative:
    """Something that may be meant otherwise."""

    words: str  # what, and what to do about it, behind "would be localized were "
    prior: Callable[[Pose], Pose] = lambda prior: prior  # the prior, local frame, if it is meant so
    # the scan's points, sensor frame, if they are meant so: of those that were read, the prior, the map's local origin
    points: Callable[[Points, Pose, Points], Points] = lambda points, prior, origin: points
    needs_angles: bool = False  # whether it is one of priors that are read as angles, not as quaternions


def _scalar_first(prior: Pose) -> Pose:
    x, y, z, w = quaternions_from_angles(prior.roll, prior.pitch, prior.heading).tolist()
    roll, pitch, heading = angles_from_quaternions(np.array([y, z, w, x])).tolist()
    return replace(prior, roll=roll, pitch=pitch, heading=heading)


def _angles_in(unit: str, factor: float) -> Alternative:
    words = f"the angles of the prior in {unit}"
    return Alternative(
        words, lambda prior: Pose(*prior.position.tolist(), *(factor * prior.values[3:]).tolist()), needs_angles=True
    )


def _turn(words: str, roll_deg: float, heading_deg: float) -> Alternative:
    turn = Pose(0.0, 0.0, 0.0, math.radians(roll_deg), 0.0, math.radians(heading_deg))
    angles = " and ".join(f"{key}_deg = {deg:g}" for key, deg in (("roll", roll_deg), ("heading", heading_deg)) if deg)
    words = f"the sensor {words}: give a --mounting file with {angles} under [sensor]"
    return Alternative(words, lambda prior: prior @ turn)


def _lower(off: float) -> Alternative:
    words = f"the prior some {abs(off):.0f} m {'lower' if off > 0.0 else 'higher'}"
    words += ": is its z that of another point, or another height reference?"
    return Alternative(words, lambda prior: prior.translated([0.0, 0.0, -off]))


def _scaled(words: str, factor: float) -> Alternative:
    return Alternative(f"the scans {words}", points=lambda points, prior, origin: factor * points)


def _placed(frame: str, factor: float) -> Alternative:
    words = f"the scans in {frame}: write them in the sensor's frame"
    return Alternative(words, points=lambda points, prior, origin: prior.inverse.apply(points - factor * origin))


MIRRORED = Alternative(
    "the scans not mirrored: turn the sign of their y", points=lambda points, prior, origin: points * [1, -1, 1]
)
ALTERNATIVES = (
    Alternative("the quaternions of the prior qw qx qy qz: write them as qx qy qz qw", _scalar_first),
    _turn("turned by 90 degrees to the left", 0.0, 90.0),
    _turn("turned by 90 degrees to the right", 0.0, -90.0),
    _turn("turned by 180 degrees", 0.0, 180.0),
    _turn("upside down", 180.0, 0.0),
    _turn("upside down and turned by 180 degrees", 180.0, 180.0),
    Alternative(
        "the headings of the prior those of a compass: a heading is 90 degrees less a bearing",
        lambda prior: replace(prior, heading=math.pi / 2.0 - prior.heading),
    ),
    _angles_in("degrees: name their columns roll_deg, pitch_deg, heading_deg", math.pi / 180.0),
    _angles_in("radians: name their columns roll, pitch, heading", 180.0 / math.pi),
    MIRRORED,
    _scaled("in millimetres: divide their coordinates by 1000", 0.001),
    _scaled("in feet: multiply their coordinates by 0.3048", 0.3048),
    _placed("global coordinates", 1.0),
    _placed("the map's local frame", 0.0),
)


def alternative_that_fits(
    point_map: PointMap, scans: Scans, epochs: Sequence[EpochEstimate], method: Method, options: DriveOptions,
    *, has_angles: bool = True,
) -> str:  # fmt: skip
    """Return in words which alternative all epochs that are tried fit clearly better; empty if there is none to try.

    Where nearly all are localized only mirrored scans are tried, which fit streets that are alike on both sides.

    has_angles: whether the priors may have been read as angles.
    """
    searched = [epoch for epoch in epochs if epoch.prior and epoch.status not in WITHOUT_SEARCH]
    n_localized = sum(epoch.pose_global is not None for epoch in epochs)
    tried = []
    for number in {round(float(at)) for at in np.linspace(0, len(searched) - 1, MOST_TRIED)} if searched else ():
        with suppress(FileError):
            tried.append((searched[number], scans.read(searched[number].epoch, 0.0, math.inf)))
    if not tried:
        return ""
    are_fine = n_localized >= FEW_REFUSED * len(epochs)
    scores: dict[str, float] = {}
    off = above_ground(point_map, np.array([epoch.prior.position for epoch, _ in tried if epoch.prior])) - USUAL
    alternatives = [each for each in ALTERNATIVES if has_angles or not each.needs_angles]
    for alternative in (MIRRORED,) if are_fine else (*alternatives, *([_lower(off)] if abs(off) > FAR_OFF else ())):
        found = [_score(alternative, epoch, raw, point_map, method, options) for epoch, raw in tried]
        own = [epoch.estimate.score if epoch.estimate and epoch.pose_global else 0.0 for epoch, _ in tried]
        are_higher = all(score > before for score, before in zip(found, own, strict=True))
        if are_higher and sum(found) > CLEARLY * sum(own):
            scores[alternative.words] = sum(found)
    if scores:
        verb = "fit better" if n_localized else "be localized"
        best = [words for words in scores if ALIKE * scores[words] >= max(scores.values())]
        return f"{len(tried)} of {len(tried)} tried would {verb} were {'; or were '.join(best)}"
    return "" if n_localized else "meant otherwise (axes, angles, frames) they are not localized either"


def _score(
    alternative: Alternative, epoch: EpochEstimate, raw: RawScan, point_map: PointMap, method: Method,
    options: DriveOptions,
) -> float:  # fmt: skip
    """The score of an epoch meant otherwise; 0 where it is not localized."""
    if epoch.prior is None:
        return 0.0
    meant = alternative.prior(epoch.prior)
    points_sensor = alternative.points(raw.points, epoch.prior, np.array(point_map.frame.origin))
    ranges = np.linalg.norm(points_sensor, axis=1)
    kept = points_sensor[(ranges >= options.min_range) & (ranges <= options.max_range)]
    if not (len(kept) and point_map.covers(meant.x, meant.y, MAP_MARGIN)):
        return 0.0
    try:
        estimate = method.localize(Scan(kept, time=raw.time), point_map, meant)
    except ArrayError:  # numbers that no map can hold
        return 0.0
    return estimate.score if estimate.is_localized else 0.0
