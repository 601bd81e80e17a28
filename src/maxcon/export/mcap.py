# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MCAP with messages of ROS 2: poses with covariances, transforms, and positions in latitude and longitude."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.poses_table import COVARIANCES
from maxcon.export.pose_rows import PoseRow
from maxcon.geometry import Pose
from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.crs import to_wgs84
from maxcon.io.recordings.writing import Entry, RecordingKind, header_of, write_recording

CRS_FRAME, MAP_FRAME, SENSOR_FRAME = "crs", "map", "sensor"
"""Names of the frames: that of the CRS, a local one near the drive, in which viewers can draw, and the scanner's."""
ROUND = 100.0
"""The local frame's origin is a multiple of this, m."""


def write_mcap(path: Path, rows: Sequence[PoseRow], crs: str | None = None) -> None:
    """Write the localized epochs as topics of an MCAP file; each message has the time of its epoch.

    /pose (PoseWithCovarianceStamped, in the frame `map`), /tf (`map` to `sensor`), /tf_static (`crs` to `map`), and if
    the CRS is known /fix (NavSatFix, heights as the map has them). Needs the extra `recordings`.
    """
    write_recording(path, RecordingKind.MCAP, _entries(rows, crs))


def _entries(rows: Sequence[PoseRow], crs: str | None) -> Iterator[Entry]:
    found = [(row, row.pose) for row in rows if row.pose is not None]
    origin = np.floor(found[0][1].position / ROUND) * ROUND
    lonlats = None if crs is None else to_wgs84(crs, [(pose.x, pose.y) for _, pose in found])
    T_crs_map = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0).translated(origin)
    yield _transform(found[0][0].time, "/tf_static", CRS_FRAME, MAP_FRAME, T_crs_map)
    for number, (row, pose) in enumerate(found):
        local = pose.translated(-origin)
        yield _pose(row, local)
        yield _transform(row.time, "/tf", MAP_FRAME, SENSOR_FRAME, local)
        if lonlats is not None:
            yield _fix(row, pose.z, lonlats[number])


def _covariance(row: PoseRow) -> NDArray[np.float64]:
    """Of x, y, z and the turns about the three axes, (6, 6); zeros where it is not known."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = [row.numbers.get(name, 0.0) for name in COVARIANCES]
    return matrix + np.triu(matrix, 1).T


def _position_and_turn(pose: Pose, names: tuple[str, str]) -> dict[str, dict[str, float]]:
    turn = quaternions_from_angles(pose.roll, pose.pitch, pose.heading).ravel().tolist()
    position = pose.position.tolist()
    return {names[0]: dict(zip("xyz", position, strict=True)), names[1]: dict(zip("xyzw", turn, strict=True))}


def _pose(row: PoseRow, pose: Pose) -> Entry:
    content = {
        "header": header_of(row.time, MAP_FRAME),
        "pose": {"pose": _position_and_turn(pose, ("position", "orientation")), "covariance": _covariance(row).ravel()},
    }
    return Entry(row.time, "/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", content)


def _transform(time: float, topic: str, parent: str, child: str, pose: Pose) -> Entry:
    transform = {
        "header": header_of(time, parent),
        "child_frame_id": child,
        "transform": _position_and_turn(pose, ("translation", "rotation")),
    }
    return Entry(time, topic, "tf2_msgs/msg/TFMessage", {"transforms": [transform]})


def _fix(row: PoseRow, z: float, lonlat: tuple[float, float]) -> Entry:
    covariance = _covariance(row)[:3, :3]
    content = {
        "header": header_of(row.time, SENSOR_FRAME),
        "status": dict(status=0, service=1),
        "latitude": lonlat[1],
        "longitude": lonlat[0],
        "altitude": z,
        "position_covariance": covariance.ravel(),
        "position_covariance_type": 3 if covariance.any() else 0,
    }
    return Entry(row.time, "/fix", "sensor_msgs/msg/NavSatFix", content)
