# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A dataset's drive as a recorder would have written it: a bag, an MCAP file, a capture of packets, or PCD files."""

import os
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.dataset import Dataset
from maxcon.io.geographic import GeographicFrame
from maxcon.io.recordings.writing import Entry, RecordingKind, open_writer
from maxcon.io.scans import Scans, open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.simulation.datasets.dataset_files import CRS
from maxcon.trajectory import Trajectory

__all__ = [
    "RECORDING_NAMES",
    "RecordingKind",
    "ScansKind",
    "Topics",
    "cloud_message",
    "record_dataset",
    "record_drive",
    "write_dataset_scans",
]


class ScansKind(StrEnum):
    """Formats that hold scans only, without poses."""

    PCAP = "pcap"
    PCD = "pcd"


RECORDING_NAMES: dict[RecordingKind | ScansKind, str] = {
    RecordingKind.ROS1: "drive.bag",
    RecordingKind.ROS2: "drive_ros2",
    RecordingKind.MCAP: "drive.mcap",
    ScansKind.PCAP: "drive.pcap",
    ScansKind.PCD: "drive_pcd",
}
"""File or folder, in that of the dataset, of each kind of recording."""


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


def record_dataset(dataset: Dataset, kind: RecordingKind, *, sigma: float = 0.0) -> Path:
    """Write the scans of a dataset, its first prior and its odometry as a recording into its folder; return the path.

    It raises what `record_drive` raises.
    """
    path = dataset.folder / RECORDING_NAMES[kind]
    odometry = None if dataset.odometry is None else read_trajectory(dataset.odometry)
    scans, prior = open_scans(dataset.scans, dataset.times), read_trajectory(dataset.prior)
    record_drive(path, kind, scans, prior, dataset.crs or CRS, sigma=sigma, odometry=odometry, overwrite=True)
    return path


def write_dataset_scans(dataset: Dataset, kind: ScansKind) -> Path:
    """Write the scans of a dataset as a capture of packets or as PCD files into its folder; return the path.

    It raises what `write_capture` and `write_pcd_folder` raise.
    """
    from maxcon.simulation.datasets.pcd_scans import write_pcd_folder
    from maxcon.simulation.datasets.velodyne_packets import write_capture

    path, scans = dataset.folder / RECORDING_NAMES[kind], open_scans(dataset.scans, dataset.times)
    if kind is ScansKind.PCAP:
        write_capture(path, scans)
    else:
        write_pcd_folder(path, scans, overwrite=True)
    return path


def _in_order(
    scans: Scans, prior: Trajectory, frame: GeographicFrame, sigma: float, odometry: Trajectory | None
) -> Iterator[Entry]:
    """Yield all messages in order of time; at equal times poses come before clouds."""
    poses = _fixes(prior, frame, sigma) + ([] if odometry is None else _odometry(odometry))
    poses.sort(key=lambda entry: entry.time)
    for i, time in enumerate(scans.times):
        while poses and poses[0].time <= time:
            yield poses.pop(0)
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
        position = _vector(odometry.positions[i], "Point")
        pose = {"position": position, "orientation": _quaternion(odometry.quaternions_xyzw[i])}
        twist = {"linear": _vector(np.zeros(3)), "angular": _vector(np.zeros(3))}
        content = {
            "child_frame_id": "sensor",
            "pose": dict(pose=pose, covariance=np.zeros(36)),
            "twist": dict(twist=twist, covariance=np.zeros(36)),
        }
        entries.append(Entry(float(time), Topics().odometry, "nav_msgs/msg/Odometry", content))
    return entries


def _vector(values: NDArray[np.float64], kind: str = "Vector3") -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))


def _quaternion(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyzw", values.tolist(), strict=True))
