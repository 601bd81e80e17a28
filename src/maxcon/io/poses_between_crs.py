"""Poses of one projected CRS in the coordinates of another: positions, headings, and how well they are known."""

import math

import numpy as np

from maxcon.errors import CrsError, TrajectoryError
from maxcon.io.crs import PointTransform, parse_crs, plane_of
from maxcon.scan.trajectory import Trajectory


def poses_in_crs(
    poses: Trajectory, source: str, target: str | None, label: str, *, exact_to: float | None = None
) -> tuple[Trajectory, str]:
    """Return poses in the CRS of a map, and in words how they came there; CrsError if less exact than asked for, m.

    source, target: WKT or codes. label: whose poses they are, for messages.

    Headings are turned by the convergence of the two grids, covariances of x, y and heading too, to which is added what
    a change of the datum leaves open. Heights stay what they are, unless both CRS say what theirs are counted from.
    """
    if target is None:
        raise CrsError(
            f"Expected a map with a CRS, to transform {label} into it, got one without. Build it with --crs, or give"
            " poses in its coordinates."
        )
    given = parse_crs(source)
    if given.is_geographic or given.is_geocentric:
        raise CrsError(
            f"Expected a projected CRS of {label}, got {given.name}. Latitudes and longitudes need none named: a CSV"
            " with the columns time,latitude,longitude,... says what they are (docs/priors.md)."
        )
    has_heights = len(given.axis_info) > 2
    transform = PointTransform(source, target if has_heights else plane_of(parse_crs(target)).to_wkt())
    positions, turns = transform.apply(poses.positions), transform.turns(poses.positions)
    is_there = np.isfinite(positions).all(axis=1) & np.isfinite(turns)
    if not is_there.all():
        x, y, _ = poses.positions[np.argmin(is_there)].tolist()
        raise TrajectoryError(
            f"{label}: Expected positions where {given.name} is defined, got x {x:.10g}, y {y:.10g}. Is it their CRS?"
        )
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("z", turns[:, None])
    covariances, operation = poses.covariances, transform.operation
    if operation is not None and exact_to is not None:
        operation.check(exact_to, label)
    if covariances is not None:
        matrices, shift = turned.as_matrix(), 0.0 if operation is None else operation.shift_sigma
        covariances = matrices @ covariances @ matrices.transpose(0, 2, 1) + np.diag([shift, shift, 0.0]) ** 2
    quaternions = (turned * Rotation.from_quat(poses.quaternions_xyzw)).as_quat()
    heights = "" if transform.has_heights else ", heights as they are"
    turn_deg = round(math.degrees(float(np.median(turns))), 3) + 0.0  # no -0
    words = f"{transform.words}{heights}, headings turned by {turn_deg:+.3f} degrees"
    return Trajectory(poses.times, positions, quaternions, covariances), words
