"""A drive as a recorder would have written it: clouds, positions of a GNSS receiver, orientations, odometry."""

from collections.abc import Iterator
from heapq import merge
from pathlib import Path

import numpy as np

from maxcon.io.crs import GeographicFrame
from maxcon.io.recordings.recording import Entry, RecordingKind, cloud_content, write_recording
from maxcon.io.scans import Scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation.datasets import CRS
from maxcon.scan.trajectory import Trajectory

POINTS, FIX, IMU, ODOMETRY = "/points", "/gnss/fix", "/imu/data", "/odometry"  # topics of a recorded drive
ZERO = {"x": 0.0, "y": 0.0, "z": 0.0}


def record_dataset(dataset: Dataset, kind: RecordingKind) -> Path:
    """Record scans, first prior and odometry of a dataset in its folder (extra `recordings`); return the path."""
    path = dataset.folder / f"drive.{kind.value}"
    odometry = None if dataset.odometry is None else read_trajectory(dataset.odometry)
    scans, prior = dataset.open_scans(), read_trajectory(dataset.prior)
    write_recording(path, kind, drive_messages(scans, prior, dataset.crs or CRS, odometry=odometry))
    return path


def drive_messages(
    scans: Scans, prior: Trajectory, crs: str, *, sigma: float = 0.0, odometry: Trajectory | None = None
) -> Iterator[Entry]:
    """Yield a drive's messages by time: the prior as NavSatFix (with a sigma, m, above 0) and Imu, Odometry, clouds."""
    poses = _fixes(prior, GeographicFrame(crs), sigma) + ([] if odometry is None else _odometry(odometry))
    poses.sort(key=lambda entry: entry.time)
    clouds = (cloud_message(scans, i) for i in range(len(scans.times)))
    return merge(poses, clouds, key=lambda entry: entry.time)


def cloud_message(scans: Scans, i: int, topic: str = POINTS) -> Entry:
    """Return scan number `i` as a PointCloud2 message: all its returns, with the time of each where it is known."""
    raw = scans.read(i, 0.0, np.inf)
    columns = dict(zip("xyz", raw.points.T, strict=True))
    if raw.point_times is not None:
        columns["t"] = raw.point_times
    return Entry(raw.time, topic, "sensor_msgs/msg/PointCloud2", cloud_content(columns))


def _fixes(prior: Trajectory, frame: GeographicFrame, sigma: float) -> list[Entry]:
    """Messages of a GNSS receiver and an IMU for each pose; both refer to true north, not to that of the map grid."""
    places = frame.to_geographic(prior.positions)
    turns = frame.quaternions_to_map(places, prior.quaternions_xyzw, inverse=True)
    covariance = np.diag([sigma**2] * 3).ravel()
    entries = []
    for time, (latitude, longitude, height), turn in zip(prior.times.tolist(), places.tolist(), turns, strict=True):
        fix = {
            "status": dict(status=0, service=1), "latitude": latitude, "longitude": longitude, "altitude": height,
            "position_covariance": covariance, "position_covariance_type": 2 if sigma > 0.0 else 0,
        }  # fmt: skip
        imu = {
            "orientation": dict(zip("xyzw", turn.tolist(), strict=True)),
            "orientation_covariance": np.zeros(9),
            "angular_velocity": ZERO,
            "angular_velocity_covariance": np.zeros(9),
            "linear_acceleration": ZERO,
            "linear_acceleration_covariance": np.zeros(9),
        }
        entries.append(Entry(time, FIX, "sensor_msgs/msg/NavSatFix", fix))
        entries.append(Entry(time, IMU, "sensor_msgs/msg/Imu", imu))
    return entries


def _odometry(odometry: Trajectory) -> list[Entry]:
    entries = []
    poses = zip(odometry.times.tolist(), odometry.positions, odometry.quaternions_xyzw, strict=True)
    for time, position, turn in poses:
        pose = {
            "position": dict(zip("xyz", position.tolist(), strict=True)),
            "orientation": dict(zip("xyzw", turn.tolist(), strict=True)),
        }
        content = {
            "child_frame_id": "sensor",
            "pose": dict(pose=pose, covariance=np.zeros(36)),
            "twist": dict(twist=dict(linear=ZERO, angular=ZERO), covariance=np.zeros(36)),
        }
        entries.append(Entry(time, ODOMETRY, "nav_msgs/msg/Odometry", content))
    return entries
