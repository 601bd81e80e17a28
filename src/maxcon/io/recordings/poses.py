"""Poses in a recording: those of a GNSS receiver, with orientations, or of whatever writes poses."""

import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Orientations, ReceiverLog, RecordedPoses, checked_trajectory, is_place, place_fixes
from maxcon.io.recordings.opening import open_recording
from maxcon.io.recordings.recording import Recording, Topic, choose_topic, frame_name, frame_of
from maxcon.io.recordings.transforms import TRANSFORMS, TransformTree, contents, numbers_of
from maxcon.io.text import printable
from maxcon.scan.mounting import sensor_trajectory
from maxcon.scan.trajectory import Trajectory

FIX, IMU = "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
POSES: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    ODOMETRY: lambda content: (content.pose.pose, content.pose.covariance),
    "geometry_msgs/msg/PoseStamped": lambda content: (content.pose, np.zeros(36)),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda content: (content.pose.pose, content.pose.covariance),
}
X_Y_HEADING = (0, 1, 5)  # rows of x, y and the turn about z in a covariance of ROS
VEHICLE = "base_link"  # frame of a vehicle, by the convention of ROS: x forward


def read_recorded_poses(
    path: str | os.PathLike[str], topic: str | None = None, crs: str | None = None, geoid_height: float | None = None,
    *, is_odometry: bool = False, are_sure: bool = False, frames: tuple[str, str] | None = None, sensor_frame: str = "",
) -> RecordedPoses:  # fmt: skip
    """Return the poses in a recording.

    - path: the recording.
    - topic: of NavSatFix, Odometry, PoseStamped or PoseWithCovarianceStamped. Found if there is one only; one of
      NavSatFix comes before others.
    - crs: of the map, WKT or a code: for NavSatFix.
    - geoid_height: of the geoid above the ellipsoid, m: subtracted from the heights of NavSatFix.
    - is_odometry: whether a motion is wanted: a topic of Odometry comes before others then, and NavSatFix is not used.
    - are_sure: whether an IMU's orientations are used even if they disagree with the course over ground.
    - frames: take the poses of the second of these frames in the first from the recording's transforms (TF).
    - sensor_frame: name of the scanner's frame: if the recording's static transforms tell where it is on what the poses
      are of, the scanner's are returned.

    FileError if there are no poses, or several topics and none is asked for; OptionError if the topic asked for is not
    there, or holds no poses; TrajectoryError if they cannot be used; CrsError if positions in latitude and longitude
    come without the CRS of a map, or heights cannot be turned into its.
    """
    with open_recording(path) as recording:
        if frames is not None:
            trajectory, words = TransformTree(recording).trajectory(*frames)
            words = f"poses from /tf ({printable(words)})"
            poses = RecordedPoses(trajectory, words, position_frame=frames[1], orientation_frame=frames[1])
        else:
            chosen = _chosen(recording, topic, is_odometry=is_odometry)
            label = f"{recording.path}, {printable(chosen.name)}"
            if chosen.type == FIX:
                poses = _of_fixes(recording, chosen, label, crs, geoid_height, are_sure=are_sure)
            else:
                poses = _of_poses(recording, chosen, label)
        return _of_sensor(recording, poses, sensor_frame)


def _of_sensor(recording: Recording, poses: RecordedPoses, sensor_frame: str) -> RecordedPoses:
    """The scanner's poses, where static transforms tell how it is mounted; else the same."""
    if not (sensor_frame and poses.position_frame and poses.orientation_frame):
        return poses
    tree = TransformTree(recording, is_static_only=True)
    turned = tree.static_pose(poses.orientation_frame, sensor_frame)
    antenna = tree.static_pose(poses.orientation_frame, poses.position_frame)
    if turned is None or antenna is None:
        return poses
    # Positions are those of one frame, rotations those of another: the lever arm is in the axes of the latter.
    lever = turned.position - antenna.position
    if not lever.any() and np.array_equal(turned.rotation, np.eye(3)):
        return poses
    trajectory = sensor_trajectory(poses.trajectory, Pose.from_rotation(lever, turned.rotation))
    turns = " ".join(f"{np.degrees(angle):.2f}" for angle in (turned.roll, turned.pitch, turned.heading))
    words = (
        f"{poses.words}; moved from {printable(poses.position_frame)} to {printable(sensor_frame)} by /tf_static:"
        f" {' '.join(f'{value:.3f}' for value in lever)} m, {turns} degrees"
    )
    return replace(poses, trajectory=trajectory, words=words)


def _chosen(recording: Recording, name: str | None, *, is_odometry: bool) -> Topic:
    option = "--odometry" if is_odometry else "--prior"
    kinds, preferred = (tuple(POSES), ODOMETRY) if is_odometry else ((FIX, *POSES), FIX)

    def advice() -> str:
        frames = TransformTree(recording).frames if recording.of_type(*TRANSFORMS) else ()
        listed = printable(", ".join(frames[:12]))
        of_frames = f" Or choose two of the frames {listed}: {option}-frames FIXED:MOVING." if frames else ""
        return f"Give a file: {option}.{of_frames}"

    return choose_topic(recording, name, kinds, (preferred,), "poses", f"{option}-topic", advice)


def _rows(
    recording: Recording, topic: Topic, what: str, row_of: Callable[[Any], list[float] | None]
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, list[str]]:
    """Times (n,) and numbers (n, k) of messages, the first of a time; how many have none; frames, the last one last."""
    rows: dict[float, list[float]] = {}
    n_left_out, frames = 0, [""]
    for _, time, content in contents(recording, [topic], what):
        frames.append(frame_of(content))
        row = row_of(content)
        if row is None:
            n_left_out += 1
        else:
            rows.setdefault(time, row)
    times = sorted(rows)
    return np.array(times), np.array([rows[time] for time in times]), n_left_out, frames


def _of_fixes(
    recording: Recording, topic: Topic, label: str, crs: str | None, geoid_height: float | None, *, are_sure: bool
) -> RecordedPoses:
    """Poses from positions of NavSatFix, and from orientations of Imu if there are any."""
    if crs is None:
        raise CrsError(
            f"Expected a map with a CRS, to place {label}, which is in latitude and longitude; got one without. Build"
            " it with --crs, or choose poses in the map's coordinates with --prior-topic."
        )

    def row_of(content: Any) -> list[float] | None:
        place = [float(content.latitude), float(content.longitude), float(content.altitude)]
        if content.status.status < 0 or not is_place(place):
            return None
        stated = np.asarray(content.position_covariance, dtype=np.float64)[[0, 1, 3, 4]].tolist()
        return place + (stated if content.position_covariance_type > 0 else [math.nan] * 4)

    times, values, n_left_out, frames = _rows(recording, topic, "messages of positions", row_of)
    if not len(times):
        raise TrajectoryError(f"{label}: Expected at least one position, got none with a fix. Choose another topic.")
    orientations = _read_orientations(recording)
    words, covariances = f"poses from {printable(topic.name)} (NavSatFix)", values[:, 3:].reshape(-1, 2, 2)
    log = ReceiverLog(times, values[:, :3], covariances, n_left_out, orientations=orientations, words=words)
    placed = place_fixes(log, GeographicFrame(crs), geoid_height, label, are_sure=are_sure)
    turned = VEHICLE if orientations is None or not placed.has_orientations else orientations.frame
    return replace(placed, position_frame=frames[-1], orientation_frame=turned)


def _read_orientations(recording: Recording) -> Orientations | None:
    """The orientations of the first topic of Imu that has any."""

    def row_of(content: Any) -> list[float] | None:
        turn = content.orientation
        values = [float(value) for value in (turn.x, turn.y, turn.z, turn.w)]
        first, *_, last = np.asarray(content.orientation_covariance, dtype=np.float64)
        if first < 0.0 or abs(math.hypot(*values) - 1.0) > 0.01:  # -1: it knows none
            return None
        return [*values, math.sqrt(last) if last > 0.0 else math.nan]

    for topic in recording.of_type(IMU):
        times, table, _, frames = _rows(recording, topic, "messages of an IMU", row_of)
        if len(times):
            turns = Trajectory(times, np.zeros((len(times), 3)), table[:, :4])
            return Orientations(printable(topic.name), turns, table[:, 4], frames[-1])
    return None


def _of_poses(recording: Recording, topic: Topic, label: str) -> RecordedPoses:
    """Poses as they are written: in whatever frame their header names."""
    part = ""

    def row_of(content: Any) -> list[float] | None:
        nonlocal part
        part = frame_name(content.child_frame_id) if topic.type == ODOMETRY else ""
        pose, covariance = POSES[topic.type](content)
        numbers = numbers_of(pose.position, pose.orientation)
        if not np.isfinite(numbers).all() or not any(numbers[3:]):
            return None
        stated = np.asarray(covariance, dtype=np.float64).reshape(6, 6)[np.ix_(X_Y_HEADING, X_Y_HEADING)]
        return numbers + (stated if np.any(covariance) else np.full((3, 3), np.nan)).ravel().tolist()

    times, values, n_left_out, frames = _rows(recording, topic, "messages of poses", row_of)
    if not len(times):
        raise TrajectoryError(f"{label}: Expected at least one pose, got none. Choose another topic.")
    covariances = values[:, 7:].reshape(-1, 3, 3)
    known = None if np.isnan(covariances).all() else covariances
    trajectory = checked_trajectory(label, times, values[:, :3], values[:, 3:7], known)
    kind = topic.type.rpartition("/")[2]
    named = ", ".join(sorted({printable(frame)[:40] for frame in frames[1:]})) or "without a name"
    left = f"; {n_left_out} messages without a pose left out" if n_left_out else ""
    stated_words = "" if known is None else ", with covariances"
    words = f"poses from {printable(topic.name)} ({kind}{stated_words}) in the frame {named}{left}"
    return RecordedPoses(trajectory, words, position_frame=part, orientation_frame=part)
