# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive as an MCAP file with messages of ROS 2: poses, transforms, statuses, map and scans."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Status
from maxcon.export.pose_rows import PoseRow, covariance_of
from maxcon.export.scene import Scene, SceneEpoch
from maxcon.geometry import Pose
from maxcon.io.crs import to_wgs84
from maxcon.io.recordings.recording import (
    Entry,
    RecordingKind,
    cloud_content,
    header_of,
    position_and_turn,
    write_recording,
)

CRS_FRAME, MAP_FRAME, SENSOR_FRAME = "crs", "map", "sensor"  # "map" is near the drive: viewers can draw in it
INFO, WARN = 20, 30  # levels of rcl_interfaces/msg/Log


def write_mcap(path: Path, scene: Scene, rows: Sequence[PoseRow], epochs: Iterable[SceneEpoch]) -> None:
    """Write a drive, which has localized epochs, as topics of an MCAP file; each message has the time of its epoch."""
    write_recording(path, RecordingKind.MCAP, _entries(scene, rows, epochs))


def _entries(scene: Scene, rows: Sequence[PoseRow], epochs: Iterable[SceneEpoch]) -> Iterator[Entry]:
    poses = [row.pose for row in rows if row.pose is not None]
    places = [(pose.x, pose.y) for pose in poses]
    lonlats = iter(() if scene.crs is None else to_wgs84(scene.crs, places))
    T_crs_map = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0).translated(scene.origin)
    yield _transform(rows[0].time, "/tf_static", CRS_FRAME, MAP_FRAME, T_crs_map)
    if len(points := scene.map_points(scene.tiles_around(poses))):
        yield _cloud(rows[0].time, "/map", MAP_FRAME, points)
    for epoch in epochs:
        row = epoch.row
        yield _status(row)
        if row.pose is None:
            continue
        local = scene.local(row.pose)
        yield _pose(row, local)
        yield _transform(row.time, "/tf", MAP_FRAME, SENSOR_FRAME, local)
        if len(epoch.points):
            yield _cloud(row.time, "/scan", SENSOR_FRAME, epoch.points)
        if scene.crs is not None:
            yield _fix(row, row.pose.z, next(lonlats))


def _cloud(time: float, topic: str, frame: str, points: NDArray[np.float32]) -> Entry:
    content = {"header": header_of(time, frame), **cloud_content(dict(zip("xyz", points.T, strict=True)))}
    return Entry(time, topic, "sensor_msgs/msg/PointCloud2", content)


def _status(row: PoseRow) -> Entry:
    level = INFO if row.status == Status.LOCALIZED else WARN
    content = {"stamp": header_of(row.time, "")["stamp"], "level": level, "name": "maxcon", "msg": row.words}
    return Entry(row.time, "/status", "rcl_interfaces/msg/Log", {**content, "file": "", "function": ""})


def _pose(row: PoseRow, pose: Pose) -> Entry:
    place = {"pose": position_and_turn(pose, ("position", "orientation")), "covariance": covariance_of(row).ravel()}
    content = {"header": header_of(row.time, MAP_FRAME), "pose": place}
    return Entry(row.time, "/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", content)


def _transform(time: float, topic: str, parent: str, child: str, pose: Pose) -> Entry:
    place = position_and_turn(pose, ("translation", "rotation"))
    content = {"header": header_of(time, parent), "child_frame_id": child, "transform": place}
    return Entry(time, topic, "tf2_msgs/msg/TFMessage", {"transforms": [content]})


def _fix(row: PoseRow, z: float, lonlat: list[float]) -> Entry:
    covariance = covariance_of(row)[:3, :3]
    content = {
        "header": header_of(row.time, SENSOR_FRAME), "status": dict(status=0, service=1), "latitude": lonlat[1],
        "longitude": lonlat[0], "altitude": z, "position_covariance": covariance.ravel(),
        "position_covariance_type": 3 if covariance.any() else 0,
    }  # fmt: skip
    return Entry(row.time, "/fix", "sensor_msgs/msg/NavSatFix", content)
