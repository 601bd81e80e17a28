# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive as messages, as a recorder would have written them: clouds, positions, orientations and odometry."""

import os
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.io.geographic import GeographicFrame
from maxcon.io.recordings.writing import Entry, RecordingKind, open_writer
from maxcon.io.scans import Scans
from maxcon.scan.trajectory import Trajectory

__all__ = ["Topics", "cloud_message", "record_drive"]


class Topics(NamedTuple):
    """Names of the topics of a recorded drive."""

    points: str = "/points"
    fix: str = "/gnss/fix"
    imu: str = "/imu/data"
    odometry: str = "/odometry"


def record_drive(
    path: str | os.PathLike[str],
    kind: RecordingKind,
    scans: Scans,
    prior: Trajectory,
    crs: str,
    *,
    sigma: float = 0.0,
    odometry: Trajectory | None = None,
    overwrite: bool = False,
) -> None:
    """Write scans and poses as a recording: clouds, positions of a GNSS receiver, orientations of an IMU, odometry.

    Parameters
    ----------
    path : path
        File to write, or folder for a ROS 2 bag.
    kind : RecordingKind
        The format to write.
    scans : Scans
        All their returns are written, with the time of each point where it is known.
    prior : Trajectory
        T_map_sensor, written as NavSatFix and Imu.
    crs : str
        CRS of the prior's coordinates; heights are taken for ellipsoidal ones, unless the CRS says otherwise.
    sigma : float
        Standard deviation along each axis that the receiver states for its positions, m; it states none if 0.
    odometry : Trajectory, optional
        T_odometry_sensor, written as Odometry.
    overwrite : bool
        Whether an existing folder of a ROS 2 bag is replaced; an existing file always is.

    Raises
    ------
    MissingExtraError
        If the extra `recordings` is not installed.
    FileError
        If the recording cannot be written.
    """
    entries = _in_order(scans, prior, GeographicFrame(crs), sigma, odometry)
    with open_writer(Path(path), kind, overwrite=overwrite) as writer:
        for entry in entries:
            writer.write(entry)


def _in_order(
    scans: Scans, prior: Trajectory, frame: GeographicFrame, sigma: float, odometry: Trajectory | None
) -> Iterator[Entry]:
    """Yield all messages in order of time; at equal times poses come before clouds."""
    entries = _fixes(prior, frame, sigma) + ([] if odometry is None else _odometry(odometry))
    poses = deque(sorted(entries, key=lambda entry: entry.time))
    for i, time in enumerate(scans.times):
        while poses and poses[0].time <= time:
            yield poses.popleft()
        yield cloud_message(scans, i)
    yield from poses


def cloud_message(scans: Scans, i: int, topic: str | None = None) -> Entry:
    """Return scan number `i` as a PointCloud2 message: all its returns, with the time of each where it is known."""
    raw = scans.read(i, 0.0, np.inf)
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    columns = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if raw.point_times is not None:
        fields.append(("t", 12, 7))
        columns.append(("t", "<f4"))
    records = np.empty(len(raw.points), dtype=columns)
    for axis, name in enumerate("xyz"):
        records[name] = raw.points[:, axis]
    if raw.point_times is not None:
        records["t"] = raw.point_times
    step = records.dtype.itemsize
    content = {
        "height": 1,
        "width": len(records),
        "fields": [dict(name=name, offset=at, datatype=code, count=1) for name, at, code in fields],
        "is_bigendian": False,
        "point_step": step,
        "row_step": step * len(records),
        "data": records.view(np.uint8),
        "is_dense": True,
    }
    return Entry(raw.time, topic or Topics().points, "sensor_msgs/msg/PointCloud2", content)


def _fixes(prior: Trajectory, frame: GeographicFrame, sigma: float) -> list[Entry]:
    """Messages of a GNSS receiver and an IMU for each pose; both refer to true north, not to that of the map grid."""
    places = frame.to_geographic(prior.positions)
    turns = frame.quaternions_to_enu(places, prior.quaternions_xyzw)
    covariance = np.diag([sigma**2] * 3).ravel()
    entries = []
    for time, (latitude, longitude, height), turn in zip(prior.times, places.tolist(), turns, strict=True):
        fix = {
            "status": dict(status=0, service=1),
            "latitude": latitude,
            "longitude": longitude,
            "altitude": height,
            "position_covariance": covariance,
            "position_covariance_type": 2 if sigma > 0.0 else 0,
        }
        entries.append(Entry(float(time), Topics().fix, "sensor_msgs/msg/NavSatFix", fix))
        imu = {
            "orientation": _quaternion(turn),
            "orientation_covariance": np.zeros(9),
            "angular_velocity": _vector(np.zeros(3)),
            "angular_velocity_covariance": np.zeros(9),
            "linear_acceleration": _vector(np.zeros(3)),
            "linear_acceleration_covariance": np.zeros(9),
        }
        entries.append(Entry(float(time), Topics().imu, "sensor_msgs/msg/Imu", imu))
    return entries


def _odometry(odometry: Trajectory) -> list[Entry]:
    entries = []
    for i, time in enumerate(odometry.times):
        position = _vector(odometry.positions[i])
        pose = {"position": position, "orientation": _quaternion(odometry.quaternions_xyzw[i])}
        twist = {"linear": _vector(np.zeros(3)), "angular": _vector(np.zeros(3))}
        content = {
            "child_frame_id": "sensor",
            "pose": dict(pose=pose, covariance=np.zeros(36)),
            "twist": dict(twist=twist, covariance=np.zeros(36)),
        }
        entries.append(Entry(float(time), Topics().odometry, "nav_msgs/msg/Odometry", content))
    return entries


def _vector(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))


def _quaternion(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyzw", values.tolist(), strict=True))
