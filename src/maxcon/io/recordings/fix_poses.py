# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Positions in latitude and longitude, and orientations of an IMU, as a recording holds them."""

import math
from pathlib import Path

import numpy as np

from maxcon.errors import TrajectoryError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.fixes import Fixes, Orientations, is_place
from maxcon.io.recordings.base import Recording, Topic, printable
from maxcon.io.recordings.messages import decode_message, frame_of, stamp_of
from maxcon.scan.trajectory import Trajectory

__all__ = ["read_fixes", "read_orientations"]

IMU = "sensor_msgs/msg/Imu"


def read_fixes(recording: Recording, topic: Topic) -> Fixes:
    """Return the positions of a topic of NavSatFix.

    Raises
    ------
    TrajectoryError
        If there is none.
    """
    rows: dict[float, list[float]] = {}
    n_left_out, frame = 0, ""
    label = Path(f"{recording.path}, {printable(topic.name)}")
    for message in recording.messages([topic.name]):
        with as_file_error(label, "messages of positions"):
            content = decode_message(message)
            time = stamp_of(content, message.recorded) / 1e9
            frame = frame_of(content)
            place = [float(content.latitude), float(content.longitude), float(content.altitude)]
            is_known = content.position_covariance_type > 0
            covariance = np.asarray(content.position_covariance, dtype=np.float64)[[0, 1, 3, 4]]
        if content.status.status < 0 or not is_place(place):
            n_left_out += 1
            continue
        rows.setdefault(time, place + (covariance.tolist() if is_known else [math.nan] * 4))
    if not rows:
        raise TrajectoryError(f"{label}: Expected at least one position, got none with a fix. Choose another topic.")
    values = np.array([rows[time] for time in sorted(rows)])
    return Fixes(np.array(sorted(rows)), values[:, :3], values[:, 3:].reshape(-1, 2, 2), n_left_out, frame=frame)


def read_orientations(recording: Recording) -> Orientations | None:
    """Return the orientations of the first topic of Imu that has any, or None."""
    for topic in recording.of_type(IMU):
        rows: dict[float, list[float]] = {}
        frame = ""
        label = Path(f"{recording.path}, {printable(topic.name)}")
        for message in recording.messages([topic.name]):
            with as_file_error(label, "messages of an IMU"):
                content = decode_message(message)
                time = stamp_of(content, message.recorded) / 1e9
                frame, turn = frame_of(content), content.orientation
                values = [float(value) for value in (turn.x, turn.y, turn.z, turn.w)]
                variances = np.asarray(content.orientation_covariance, dtype=np.float64)
            if variances[0] < 0.0 or abs(math.hypot(*values) - 1.0) > 0.01:  # -1: it knows none
                continue
            rows.setdefault(time, [*values, math.sqrt(variances[8]) if variances[8] > 0.0 else math.nan])
        if rows:
            times, table = np.array(sorted(rows)), np.array([rows[time] for time in sorted(rows)])
            turns = Trajectory(times, np.zeros((len(times), 3)), table[:, :4])
            return Orientations(printable(topic.name), turns, table[:, 4], frame)
    return None
