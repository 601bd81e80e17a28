"""A node of ROS 2 around a live localizer: what its messages mean."""

import math
import threading
import time as clock
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.cli.options import Outputs, Topics
from maxcon.cli.terminal import warn
from maxcon.drive.live import LiveAnswer, LiveLocalizer
from maxcon.errors import ArrayError, FileError, MaxconError, OptionError
from maxcon.geometry import Pose
from maxcon.geometry.pose import angles_from_quaternions
from maxcon.io.clouds.base import as_file_error
from maxcon.io.crs import GeographicFrame, crs_name
from maxcon.io.fixes import is_place
from maxcon.io.point_records import decode_points, records_of_message
from maxcon.io.recordings.recording import cloud_content, frame_of, header_of, position_and_turn, stamp_of
from maxcon.io.recordings.transforms import numbers_of
from maxcon.io.ros2_wire import Ros2Wire
from maxcon.scan import one_per_cube
from maxcon.scan.mounting import Mounting, read_mounting

CLOUD, ODOMETRY, FIX = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry", "sensor_msgs/msg/NavSatFix"
POSE, TRANSFORMS = "geometry_msgs/msg/PoseWithCovarianceStamped", "tf2_msgs/msg/TFMessage"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN, ERROR = 0, 1, 2  # levels of diagnostics
DEPTHS = {CLOUD: 5, ODOMETRY: 100, FIX: 5}  # odometry is small and often, and all of it is needed
UNSTATED_SIGMA = 5.0  # m, of a receiver that states none
MOST_WARNINGS = 20  # of broken messages
SILENCE = 10.0  # s without a scan, after which that is said
LISTEN = 0.1  # s between looks at whether the localizer still works


class Ros2Node:
    """Hands messages to a localizer, and publishes its answers."""

    def __init__(self, live: LiveLocalizer, wire: Ros2Wire, topics: Topics, outputs: Outputs) -> None:
        self._live, self._wire, self._topics, self._outputs = live, wire, topics, outputs
        mounting = Mounting() if topics.mounting is None else read_mounting(topics.mounting)
        if mounting.scanners:
            raise OptionError(f"Expected one scanner, [sensor], in {topics.mounting}, got {len(mounting.scanners)}.")
        frame = live.map.frame
        odometry, sensor = mounting.T_vehicle_odometry, mounting.T_vehicle_sensor
        self._T_odometry_sensor = None if odometry is None else odometry.inverse @ sensor
        self._lever = float(np.linalg.norm((mounting.T_vehicle_prior.inverse @ sensor).position))
        self._geographic = None if frame.crs is None else GeographicFrame(frame.crs)
        origin = " ".join(f"{value:.3f}" for value in frame.origin)
        self._frame_words = {"map_origin": origin, "crs": crs_name(frame.crs)}
        self._odom_frame, self._heard = "odom", clock.monotonic()
        self._publish_pose = wire.publisher("/maxcon/pose", POSE)
        self._publish_transforms = wire.publisher("/tf", TRANSFORMS)
        self._publish_diagnostics = wire.publisher("/diagnostics", DIAGNOSTICS)
        self._publish_map = wire.publisher("/maxcon/map", CLOUD, is_latched=True)

    def run(self) -> None:
        """Answer what comes until something is raised, by a signal for example."""
        if self._outputs.map_spacing > 0.0:
            threading.Thread(target=self._publish_thinned_map, daemon=True).start()
        self._live.rehearse()
        names = self._topics
        topics = {names.points: (CLOUD, self._take_cloud), names.odometry: (ODOMETRY, self._take_odometry)}
        if self._geographic is not None:
            topics[names.fix] = (FIX, self._take_fix)
        for topic, (kind, take) in topics.items():
            self._wire.subscribe(topic, kind, take, depth=DEPTHS[kind])
        warn(f"listening to {', '.join(topics)}; the map's origin is {' in '.join(self._frame_words.values())}")
        told: set[str] = set()
        with self._live.working(self._publish) as thread:
            while thread.is_alive():
                try:
                    self._wire.listen(LISTEN)
                    if clock.monotonic() > self._heard + SILENCE:
                        warn(f"no scan on {names.points} for {SILENCE:.0f} s: is it sent there, in the same domain?")
                        self._heard = math.inf
                except (ArrayError, FileError) as error:  # a message that is broken: others may not be
                    if str(error) not in told and len(told) < MOST_WARNINGS:
                        told.add(str(error))
                        warn(str(error))
        raise MaxconError("The thread of the localizer has ended, for the reason above. Start it again.")

    # --- in ---------------------------------------------------------------------------------------------------

    def _take_cloud(self, message: Any) -> None:
        """Take a scan; FileError if it is broken."""
        self._heard = clock.monotonic()
        stamp = stamp_of(message, clock.time_ns())
        with as_file_error(Path(self._topics.points), "a point cloud"):
            cloud = decode_points(records_of_message(message), stamp)
        middle = 0.0 if self._topics.at_stamp else cloud.times.middle
        offsets = None if cloud.times.offsets is None or not self._topics.deskew else cloud.times.offsets - middle
        self._live.add_scan(stamp / 1e9 + middle, cloud.points, offsets)

    def _take_odometry(self, message: Any) -> None:
        """Take a pose of the odometry, as one of the scanner; none where it says nothing."""
        numbers = numbers_of(message.pose.pose.position, message.pose.pose.orientation)
        if not 0.5 < np.linalg.norm(numbers[3:]) < 2.0:  # more than rounded: none
            return
        pose = Pose(*numbers[:3], *angles_from_quaternions(numbers[3:]).tolist())
        self._odom_frame = frame_of(message) or self._odom_frame
        pose = pose if self._T_odometry_sensor is None else pose @ self._T_odometry_sensor
        self._live.add_odometry(stamp_of(message, clock.time_ns()) / 1e9, pose)

    def _take_fix(self, message: Any) -> None:
        """Take a position, if it is one; the scanner is as far from it as from the antenna."""
        place = [float(message.latitude), float(message.longitude), 0.0]
        if self._geographic is None or message.status.status < 0 or not is_place(place):
            return
        is_first = self._geographic.operation is None
        x, y, _ = self._geographic.to_map(np.array([place]), 0.0)[0].tolist()
        if is_first and (operation := self._geographic.operation) and not operation.is_exact:
            warn(f"positions come into the map's CRS {operation.words}")
        variance = max(float(message.position_covariance[k]) for k in (0, 4))
        sigma = math.sqrt(variance) if message.position_covariance_type > 0 and variance >= 0.0 else UNSTATED_SIGMA
        sigma += self._lever + self._geographic.shift_sigma
        if math.isfinite(x + y + sigma):
            self._live.add_position(stamp_of(message, clock.time_ns()) / 1e9, x, y, sigma)

    # --- out --------------------------------------------------------------------------------------------------

    def _publish(self, answer: LiveAnswer) -> None:
        """Publish an answer: its pose only if it is localized."""
        epoch, time, frame = answer.epoch, answer.epoch.raw.time, self._outputs.map_frame
        if epoch.pose_global is not None and epoch.estimate is not None:
            pose = position_and_turn(epoch.estimate.pose, ("position", "orientation"))
            content = {"pose": pose, "covariance": epoch.estimate.covariance.ravel()}
            self._publish_pose({"header": header_of(time, frame), "pose": content})
        if answer.T_map_odom is not None:
            transform = position_and_turn(answer.T_map_odom, ("translation", "rotation"))
            header = header_of(time + self._outputs.tf_ahead, frame)
            content = {"header": header, "child_frame_id": self._odom_frame, "transform": transform}
            self._publish_transforms({"transforms": [content]})
        latency = {"latency_ms": f"{1e3 * (clock.time() - time):.1f}", "localizer_ms": f"{epoch.milliseconds:.1f}"}
        effort = {name: f"{value:.4g}" for name, value in answer.effort._asdict().items()}
        values = {**latency, **effort, **answer.counts._asdict(), **self._frame_words}
        status = {
            "level": ERROR if epoch.pose_global is None else WARN if epoch.reason else OK,
            "name": "maxcon: localization",
            "message": "; ".join(filter(None, [epoch.status.value, epoch.reason])),
            "hardware_id": "",
            "values": [dict(key=key, value=str(value)) for key, value in values.items()],
        }
        self._publish_diagnostics({"header": header_of(time, frame), "status": [status]})

    def _publish_thinned_map(self) -> None:
        """Publish the map with one point per cube; it may take minutes to read."""
        point_map, spacing = self._live.map, self._outputs.map_spacing
        kept = [np.empty((0, 3))]
        try:
            for key in sorted(point_map.tile_keys):
                began = clock.perf_counter()
                points = point_map.tile(key).mean_points(point_map.cell)
                kept.append(points[one_per_cube(points, spacing)])
                clock.sleep(clock.perf_counter() - began)  # scans come first
        except MaxconError as error:
            warn(f"no map is published: {error}")
            return
        content = cloud_content(dict(zip("xyz", np.concatenate(kept).T, strict=True)))
        self._publish_map({"header": header_of(clock.time(), self._outputs.map_frame), **content})
