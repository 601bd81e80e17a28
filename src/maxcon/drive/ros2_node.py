# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A node of ROS 2 around a live localizer: what its messages mean."""

import math
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.drive.live import LiveAnswer, LiveLocalizer
from maxcon.errors import FileError, MaxconError, OptionError
from maxcon.geometry import Pose
from maxcon.geometry.quaternions import angles_from_quaternions
from maxcon.io.clouds.base import as_file_error
from maxcon.io.crs import GeographicFrame, crs_name
from maxcon.io.fixes import is_place
from maxcon.io.point_records import decode_points, records_of_message
from maxcon.io.recordings.contents import cloud_content, position_and_turn
from maxcon.io.recordings.recording import frame_of, header_of, stamp_of
from maxcon.io.recordings.transforms import numbers_of
from maxcon.io.ros2_wire import Ros2Wire
from maxcon.scan.mounting import Mounting

CLOUD, ODOMETRY, FIX = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry", "sensor_msgs/msg/NavSatFix"
POSE, TRANSFORMS = "geometry_msgs/msg/PoseWithCovarianceStamped", "tf2_msgs/msg/TFMessage"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN, ERROR = 0, 1, 2  # levels of diagnostics
UNSTATED_SIGMA = 5.0  # m, of a receiver that states none
LISTEN = 0.1  # s between looks at whether the localizer still works


@dataclass(frozen=True, slots=True)
class NodeOptions:
    """What is listened to and published; as the options of `maxcon live`."""

    points: str = "/points"
    odometry: str = "/odom"
    fix: str = "/fix"
    at_stamp: bool = False
    deskew: bool = False
    map_frame: str = "map"
    map_spacing: float = 1.0
    tf_ahead: float = 0.2
    mounting: Mounting = field(default_factory=Mounting)

    def __post_init__(self) -> None:
        if self.mounting.scanners:
            raise OptionError(f"Expected one scanner, [sensor], got {len(self.mounting.scanners)} in --mounting.")


class Ros2Node:
    """Hands messages to a localizer, and publishes its answers; `say` is called with lines for the user."""

    def __init__(self, live: LiveLocalizer, wire: Ros2Wire, options: NodeOptions, say: Callable[[str], None]) -> None:
        self._live, self._wire, self._options, self._say = live, wire, options, say
        mounting, frame = options.mounting, live.map.frame
        odometry, sensor = mounting.T_vehicle_odometry, mounting.T_vehicle_sensor
        self._T_odometry_sensor = None if odometry is None else odometry.inverse @ sensor
        self._lever = float(np.linalg.norm((mounting.T_vehicle_prior.inverse @ sensor).position))
        self._geographic = None if frame.crs is None else GeographicFrame(frame.crs)
        origin = " ".join(f"{value:.3f}" for value in frame.origin)
        self._frame_words = {"map_origin": origin, "crs": crs_name(frame.crs)}
        self._odom_frame = "odom"
        self._publish_pose = wire.publisher("/maxcon/pose", POSE)
        self._publish_transforms = wire.publisher("/tf", TRANSFORMS)
        self._publish_diagnostics = wire.publisher("/diagnostics", DIAGNOSTICS)
        self._publish_map = wire.publisher("/maxcon/map", CLOUD, is_latched=True)

    def run(self) -> None:
        """Answer what comes until something is raised, by a signal for example."""
        options = self._options
        if options.map_spacing > 0.0:
            self._publish_map(self._thinned_map(options.map_spacing))
        topics = {options.points: (CLOUD, self.take_cloud), options.odometry: (ODOMETRY, self.take_odometry)}
        if self._geographic is not None:
            topics[options.fix] = (FIX, self.take_fix)
        for topic, (kind, take) in topics.items():
            self._wire.subscribe(topic, kind, take)
        self._say(f"listening to {', '.join(topics)}; the map's origin is {' in '.join(self._frame_words.values())}")
        told: set[str] = set()
        with self._live.working(self.publish) as thread:
            while thread.is_alive():
                try:
                    self._wire.listen(LISTEN)
                except FileError as error:  # a message that is broken: others may not be
                    if str(error) not in told:
                        told.add(str(error))
                        self._say(str(error))
        raise MaxconError("The thread of the localizer has ended, for the reason above. Start it again.")

    # --- in ---------------------------------------------------------------------------------------------------

    def take_cloud(self, message: Any) -> None:
        """Take a scan; FileError if it is broken."""
        stamp = stamp_of(message, 0)
        with as_file_error(Path(self._options.points), "a point cloud"):
            cloud = decode_points(records_of_message(message), stamp)
        middle = 0.0 if self._options.at_stamp else cloud.times.middle
        offsets = None if cloud.times.offsets is None or not self._options.deskew else cloud.times.offsets - middle
        self._live.add_scan(stamp / 1e9 + middle, cloud.points, offsets)

    def take_odometry(self, message: Any) -> None:
        """Take a pose of the odometry, as one of the scanner; none where it says nothing."""
        numbers = numbers_of(message.pose.pose.position, message.pose.pose.orientation)
        if not np.isfinite(numbers).all() or not any(numbers[3:]):
            return
        pose = Pose(*numbers[:3], *angles_from_quaternions(numbers[3:]).tolist())
        self._odom_frame = frame_of(message) or self._odom_frame
        pose = pose if self._T_odometry_sensor is None else pose @ self._T_odometry_sensor
        self._live.add_odometry(stamp_of(message, 0) / 1e9, pose)

    def take_fix(self, message: Any) -> None:
        """Take a position, if it is one; the scanner is as far from it as from the antenna."""
        place = [float(message.latitude), float(message.longitude), 0.0]
        if self._geographic is None or message.status.status < 0 or not is_place(place):
            return
        x, y, _ = self._geographic.to_map(np.array([place]), 0.0)[0].tolist()
        variance = max(float(message.position_covariance[k]) for k in (0, 4))
        sigma = math.sqrt(variance) if message.position_covariance_type > 0 and variance >= 0.0 else UNSTATED_SIGMA
        if math.isfinite(x + y + sigma):
            self._live.add_position(stamp_of(message, 0) / 1e9, x, y, sigma + self._lever)

    # --- out --------------------------------------------------------------------------------------------------

    def publish(self, answer: LiveAnswer) -> None:
        """Publish an answer: its pose only if it is localized."""
        epoch, time, frame = answer.epoch, answer.epoch.raw.time, self._options.map_frame
        if epoch.pose_global is not None and epoch.estimate is not None:
            pose = position_and_turn(epoch.estimate.pose, ("position", "orientation"))
            content = {"pose": pose, "covariance": epoch.estimate.covariance.ravel()}
            self._publish_pose({"header": header_of(time, frame), "pose": content})
        if answer.T_map_odom is not None:
            transform = position_and_turn(answer.T_map_odom, ("translation", "rotation"))
            header = header_of(time + self._options.tf_ahead, frame)
            content = {"header": header, "child_frame_id": self._odom_frame, "transform": transform}
            self._publish_transforms({"transforms": [content]})
        latency = {"latency_ms": f"{1e3 * (clock.time() - time):.1f}", "localizer_ms": f"{epoch.milliseconds:.1f}"}
        values = {**latency, **answer.counts._asdict(), **self._frame_words}
        status = {
            "level": ERROR if epoch.pose_global is None else WARN if epoch.reason else OK,
            "name": "maxcon: localization",
            "message": "; ".join(filter(None, [epoch.status.value, epoch.reason])),
            "hardware_id": "",
            "values": [dict(key=key, value=str(value)) for key, value in values.items()],
        }
        self._publish_diagnostics({"header": header_of(time, frame), "status": [status]})

    def _thinned_map(self, spacing: float) -> dict[str, Any]:
        """The map with one point per cube of an edge, m."""
        point_map = self._live.map
        kept = [np.empty((0, 3))]
        for key in sorted(point_map.tile_keys):
            points = point_map.tile(key).mean_points(point_map.cell)
            kept.append(points[np.unique(np.floor(points / spacing), axis=0, return_index=True)[1]])
        content = cloud_content(dict(zip("xyz", np.concatenate(kept).T, strict=True)))
        return {"header": header_of(clock.time(), self._options.map_frame), **content}
