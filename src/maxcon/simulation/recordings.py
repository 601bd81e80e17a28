# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A dataset's drive as a recorder would have written it: a ROS 1 bag, a ROS 2 bag, or a bare MCAP file."""

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.atomic import atomic_file, atomic_folder
from maxcon.errors import MissingExtraError
from maxcon.io.geographic import GeographicFrame
from maxcon.io.scans import Scans
from maxcon.trajectory import Trajectory

__all__ = ["RecordingKind", "Topics", "record_drive"]

CHUNK_BYTES = 2**20


class RecordingKind(StrEnum):
    """What recorders write."""

    ROS1 = "bag"
    ROS2 = "ros2"
    MCAP = "mcap"


class Topics(NamedTuple):
    """Names of the topics of a recorded drive."""

    points: str = "/points"
    fix: str = "/gnss/fix"
    imu: str = "/imu/data"
    odometry: str = "/odometry"


class Entry(NamedTuple):
    """A message to be written."""

    time: float
    topic: str
    type: str
    content: dict[str, Any]


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
        What to write.
    scans : Scans
        All their returns are written, with the time of each point where it is known.
    prior : Trajectory
        T_map_sensor, written as NavSatFix and Imu.
    crs : str
        Of the prior's coordinates; its heights are taken for ellipsoidal ones, unless it says otherwise.
    sigma : float
        Standard deviation of the positions along each axis that the receiver states, m; 0: it states none.
    odometry : Trajectory, optional
        T_odometry_sensor, written as Odometry.
    overwrite : bool
        Whether the folder of a ROS 2 bag is replaced if it is there; a file always is.

    Raises
    ------
    MissingExtraError
        If the extra `recordings` is not installed.
    FileError
        If it cannot be written.
    """
    entries = _in_order(scans, prior, GeographicFrame(crs), sigma, odometry)
    with _writer(Path(path), kind, overwrite=overwrite) as writer:
        for entry in entries:
            writer.write(entry)


def _in_order(
    scans: Scans, prior: Trajectory, frame: GeographicFrame, sigma: float, odometry: Trajectory | None
) -> Iterator[Entry]:
    """Yield all messages by time; at equal times poses come before clouds."""
    poses = _fixes(prior, frame, sigma) + ([] if odometry is None else _odometry(odometry))
    poses.sort(key=lambda entry: entry.time)
    for i, time in enumerate(scans.times):
        while poses and poses[0].time <= time:
            yield poses.pop(0)
        yield _cloud(scans, i)
    yield from poses


def _cloud(scans: Scans, i: int) -> Entry:
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
    return Entry(raw.time, Topics().points, "sensor_msgs/msg/PointCloud2", content)


def _fixes(prior: Trajectory, frame: GeographicFrame, sigma: float) -> list[Entry]:
    """What a receiver and an IMU say of each pose: north and east of both are true ones, not those of the grid."""
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


class _Writer(ABC):
    """Writes messages with a package's writer."""

    def __init__(self, store: Any) -> None:
        self.store = store
        self._channels: dict[str, Any] = {}

    def write(self, entry: Entry) -> None:
        """Append one message."""
        if entry.topic not in self._channels:
            self._channels[entry.topic] = self._channel(entry)
        nanoseconds = round(entry.time * 1e9)
        header = {"stamp": dict(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), "frame_id": "sensor"}
        content = self._built(entry.type, {"header": header, **entry.content})
        self._append(self._channels[entry.topic], nanoseconds, entry.type, content)

    def _built(self, kind: str, values: dict[str, Any]) -> Any:
        """The message of nested values; what is not given is left at 0."""
        return _built(self.store, kind, values)

    @abstractmethod
    def _channel(self, entry: Entry) -> Any: ...

    @abstractmethod
    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None: ...


def _built(store: Any, kind: str, values: dict[str, Any]) -> Any:
    from rosbags.interfaces import Nodetype

    _, fields = store.fielddefs[kind]
    given: dict[str, Any] = {}
    for name, (node, what) in fields:
        value = values.get(name, 0)
        if node == Nodetype.NAME:
            value = _built(store, what, value)
        elif node == Nodetype.SEQUENCE and what[0][0] == Nodetype.NAME:
            value = [_built(store, what[0][1], item) for item in value]
        given[name] = value
    return store.types[kind](**given)


class _BagWriter(_Writer):
    """Into a bag of ROS 1 or ROS 2."""

    def __init__(self, store: Any, writer: Any, *, is_ros1: bool) -> None:
        super().__init__(store)
        self._writer = writer
        self._serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr

    def _channel(self, entry: Entry) -> Any:
        return self._writer.add_connection(entry.topic, entry.type, typestore=self.store)

    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None:
        self._writer.write(channel, nanoseconds, self._serialize(content, kind))


class _McapWriter(_Writer):
    """Into an MCAP file."""

    def __init__(self, store: Any, writer: Any) -> None:
        super().__init__(store)
        self._writer = writer

    def _channel(self, entry: Entry) -> Any:
        text, _ = self.store.generate_msgdef(entry.type, ros_version=2)
        schema = self._writer.register_schema(entry.type, "ros2msg", text.encode())
        return self._writer.register_channel(entry.topic, "cdr", schema)

    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None:
        data = bytes(self.store.serialize_cdr(content, kind))
        self._writer.add_message(channel, nanoseconds, data, nanoseconds)


def _writer(path: Path, kind: RecordingKind, *, overwrite: bool) -> AbstractContextManager[_Writer]:
    """Return what opens a writer and puts the recording in its place when it is whole."""
    try:
        import mcap.writer  # noqa: F401
        import rosbags.typesys  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the packages rosbags and mcap to write {path}, got none installed."
            " pip install 'maxcon[recordings]'"
        ) from error
    if kind is RecordingKind.ROS1:
        return _ros1_writer(path)
    return _mcap_writer(path) if kind is RecordingKind.MCAP else _ros2_writer(path, overwrite=overwrite)


@contextmanager
def _ros1_writer(path: Path) -> Iterator[_Writer]:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    with atomic_file(path) as partial, Writer(partial) as writer:
        yield _BagWriter(get_typestore(Stores.ROS1_NOETIC), writer, is_ros1=True)


@contextmanager
def _ros2_writer(path: Path, *, overwrite: bool) -> Iterator[_Writer]:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    with atomic_folder(path, overwrite=overwrite) as partial:
        folder = partial / path.name  # the writer makes its folder itself, and names its file like it
        with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            yield _BagWriter(get_typestore(Stores.ROS2_HUMBLE), writer, is_ros1=False)
        for file in folder.iterdir():
            file.rename(partial / file.name)
        folder.rmdir()


@contextmanager
def _mcap_writer(path: Path) -> Iterator[_Writer]:
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    with atomic_file(path) as partial, partial.open("wb") as stream:
        writer: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="maxcon")
        yield _McapWriter(get_typestore(Stores.ROS2_HUMBLE), writer)
        writer.finish()
