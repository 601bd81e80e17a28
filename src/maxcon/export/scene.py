"""What viewers show of a drive: its epochs with their scans, and the map around them, in a frame near it; as MCAP."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.localize import EpochEstimate, scan_of
from maxcon.drive.poses_table import FORMATS, SHIFTS, UNKNOWNS, pose_values
from maxcon.errors import needs_extra
from maxcon.estimate import Status
from maxcon.export.points import scan_of_row
from maxcon.export.pose_rows import PoseRow, covariance_of
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.crs import to_wgs84
from maxcon.io.recordings import recording as ros
from maxcon.io.scans import Scans
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.map.layout import TileKey
from maxcon.scan import Scan

ROUND = 100.0  # the frame's origin is a multiple of this, m
MAP_REACH, MAP_VOXEL = 40.0, 0.25  # tiles so near to a pose are shown, with a point for each voxel of this edge, m
MAP_POINTS, TILE_POINTS, SCAN_POINTS = 1_000_000, 10_000, 5_000  # most points at once
ELLIPSE = math.sqrt(5.991)  # semi-axes of an ellipse that holds 95 % of x and y, in standard deviations
RERUN_SUFFIX = ".rrd"
NO_POINTS: NDArray[np.float32] = np.empty((0, 3), np.float32)
CRS_FRAME, MAP_FRAME, SENSOR_FRAME = "crs", "map", "sensor"  # "map" is near the drive: viewers can draw in it
INFO, WARN = 20, 30  # levels of rcl_interfaces/msg/Log


@dataclass(frozen=True, eq=False)
class CellScores:
    """Scores of the cells of a search, at each place that of its best heading: what it saw from above."""

    places: NDArray[np.float64]  # shape (n, 3), of the sensor in the cells, global coordinates, m
    scores: NDArray[np.float64]  # shape (n,)
    edge: float  # of a cell, m

    @classmethod
    def searched(cls, method: MaximumConsensus, scan: Scan, point_map: PointMap, prior: Pose) -> "CellScores":
        """Search anew, exhaustively: a search by bounds does not know the score of every cell; prior: local frame."""
        found = method.accumulate(scan, point_map, prior)
        scores = found.score(method.cell_search.objective).max(axis=0)
        y, x = np.meshgrid(found.space.offsets, found.space.offsets, indexing="ij")
        places = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]) + found.prior.position
        return cls(point_map.frame.to_global(places), scores.ravel(), found.space.cell_edge)


@dataclass(frozen=True, eq=False)
class SceneEpoch:
    """An epoch of a drive; poses in global coordinates."""

    number: int  # of the scan in the drive, from 0
    row: PoseRow  # its answer; among the numbers is the `share`, where it is known
    points: NDArray[np.float32]  # of its scan, thinned, shape (n, 3), sensor frame, m
    prior: Pose | None = None
    cells: CellScores | None = None  # if asked for, and searched

    @classmethod
    def of_estimate(cls, epoch: EpochEstimate, frame: LocalFrame, cells: CellScores | None = None) -> "SceneEpoch":
        """Return an epoch as it was localized in a map of this frame."""
        values = pose_values(epoch)
        time, status, reason = (values.pop(name) for name in ("time", "status", "reason"))
        numbers = {name: float(value) for name, value in values.items() if FORMATS[name] and name not in UNKNOWNS}
        if epoch.estimate is not None:
            numbers["share"] = epoch.estimate.share
        row = PoseRow(time, epoch.pose_global, status, reason, numbers)
        prior = None if epoch.prior is None else frame.pose_to_global(epoch.prior)
        return cls(epoch.epoch, row, _thinned(epoch.scan.points, SCAN_POINTS), prior, cells)


def epochs_of_rows(
    rows: Sequence[PoseRow], scans: Scans | None, *ranges: float, scored_in: PointMap | None = None
) -> Iterator[SceneEpoch]:
    """Yield all rows, each with its scan within two ranges (m), and its cells, if there is a map to search them in."""
    numbers = [None if scans is None or row.pose is None else scan_of_row(row, scans) for row in rows]

    def shown(row: PoseRow, scan: int | None, number: int) -> SceneEpoch:
        prior, points, cells = _prior_of(row), NO_POINTS, None
        if scans is not None and scan is not None:
            raw = scans.read(scan, *ranges)
            points = _thinned(raw.points, SCAN_POINTS)
            if scored_in is not None and prior is not None:
                local = scored_in.frame.pose_to_local(prior)
                cells = CellScores.searched(MaximumConsensus(), scan_of(raw), scored_in, local)
        return SceneEpoch(int(row.numbers.get("epoch", number)), row, points, prior, cells)

    return map(shown, rows, numbers, range(len(rows)))


def _prior_of(row: PoseRow) -> Pose | None:
    """The prior by the shift from it to the answer, roll and pitch those of the answer; None if not in the row."""
    shift = [row.numbers.get(name) for name in SHIFTS]
    if row.pose is None or None in shift:
        return None
    x, y, z, turn = np.array(shift, np.float64)
    return Pose(*(row.pose.values - [x, y, z, 0.0, 0.0, math.radians(turn)]))


@dataclass(frozen=True, eq=False)
class Scene:
    """The frame that a drive is shown in: viewers draw with single precision, so that its origin is near."""

    origin: NDArray[np.float64]  # global coordinates of its (0, 0, 0), m
    crs: str | None  # of these
    point_map: PointMap | None

    @classmethod
    def near(cls, position: NDArray[np.float64], crs: str | None, point_map: PointMap | None) -> "Scene":
        """Return the scene whose origin is a round place near a position, global coordinates, m."""
        return cls(np.floor(position / ROUND) * ROUND, crs, point_map)

    def local(self, pose: Pose) -> Pose:
        """Return a pose in global coordinates in this frame."""
        return pose.translated(-self.origin)

    def tiles_around(self, poses: Iterable[Pose]) -> list[TileKey]:
        """Return the keys of the tiles around poses in global coordinates, in order; none without a map."""
        if self.point_map is None:
            return []
        local = [self.point_map.frame.pose_to_local(pose) for pose in poses]
        return sorted({key for pose in local for key in self.point_map.keys_within(pose.x, pose.y, MAP_REACH)})

    def map_points(self, keys: Sequence[TileKey], n_tiles: int = 0) -> NDArray[np.float32]:
        """Return points of some tiles, of so many shown in all, and of their ground in this frame, thinned."""
        if self.point_map is None or not keys:
            return NO_POINTS
        most = max(min(TILE_POINTS, MAP_POINTS // max(n_tiles, len(keys))), 1)
        level = self.point_map.nearest_level(MAP_VOXEL)
        edge, shift = level.tile_voxels * level.cell, self.point_map.frame.origin - self.origin
        found = []
        for key in keys:
            x, y = (np.array(key) + 0.5) * edge
            ground = self.point_map.ground_around(x, y, 0.49 * edge).points()
            found.append(_thinned(np.concatenate([level.tile(key).mean_points(level.cell), ground]) + shift, most))
        return np.concatenate(found)


def _thinned(points: NDArray[np.floating[Any]], most: int) -> NDArray[np.float32]:
    """At most so many of the points, evenly among them."""
    chosen = np.linspace(0, len(points) - 1, min(most, len(points))).astype(np.int64)
    return np.asarray(points[chosen], np.float32)


def with_rerun() -> Any:
    """Return the module `rerun_recording`; MissingExtraError without the extra `view`."""
    with needs_extra("rerun-sdk", "to show a drive", "view"):
        import rerun  # noqa: F401
    return import_module("maxcon.export.rerun_recording")


def write_mcap(path: Path, scene: Scene, rows: Sequence[PoseRow], epochs: Iterable[SceneEpoch]) -> None:
    """Write a drive, which has localized epochs, as topics of an MCAP file; each message has the time of its epoch."""
    ros.write_recording(path, ros.RecordingKind.MCAP, _entries(scene, rows, epochs))


def _entries(scene: Scene, rows: Sequence[PoseRow], epochs: Iterable[SceneEpoch]) -> Iterator[ros.Entry]:
    poses = [row.pose for row in rows if row.pose is not None]
    places = [(pose.x, pose.y) for pose in poses]
    lonlats = iter(() if scene.crs is None else to_wgs84(scene.crs, places))
    T_crs_map = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0).translated(scene.origin)
    yield _transform(rows[0].time, "/tf_static", CRS_FRAME, MAP_FRAME, T_crs_map)
    if len(points := scene.map_points(scene.tiles_around(poses))):
        yield _cloud(rows[0].time, "/map", MAP_FRAME, points)
    for epoch in epochs:
        row = epoch.row
        log = {"stamp": ros.header_of(row.time, "")["stamp"], "name": "maxcon", "msg": row.words}
        log |= {"level": INFO if row.status == Status.LOCALIZED else WARN, "file": "", "function": ""}
        yield ros.Entry(row.time, "/status", "rcl_interfaces/msg/Log", log)
        if row.pose is None:
            continue
        local = scene.local(row.pose)
        yield _pose(row, local)
        yield _transform(row.time, "/tf", MAP_FRAME, SENSOR_FRAME, local)
        if len(epoch.points):
            yield _cloud(row.time, "/scan", SENSOR_FRAME, epoch.points)
        if scene.crs is not None:
            yield _fix(row, row.pose.z, next(lonlats))


def _cloud(time: float, topic: str, frame: str, points: NDArray[np.float32]) -> ros.Entry:
    content = {"header": ros.header_of(time, frame), **ros.cloud_content(dict(zip("xyz", points.T, strict=True)))}
    return ros.Entry(time, topic, "sensor_msgs/msg/PointCloud2", content)


def _pose(row: PoseRow, pose: Pose) -> ros.Entry:
    place = {"pose": ros.position_and_turn(pose, ("position", "orientation")), "covariance": covariance_of(row).ravel()}
    content = {"header": ros.header_of(row.time, MAP_FRAME), "pose": place}
    return ros.Entry(row.time, "/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", content)


def _transform(time: float, topic: str, parent: str, child: str, pose: Pose) -> ros.Entry:
    place = ros.position_and_turn(pose, ("translation", "rotation"))
    content = {"header": ros.header_of(time, parent), "child_frame_id": child, "transform": place}
    return ros.Entry(time, topic, "tf2_msgs/msg/TFMessage", {"transforms": [content]})


def _fix(row: PoseRow, z: float, lonlat: list[float]) -> ros.Entry:
    covariance = covariance_of(row)[:3, :3]
    content = {
        "header": ros.header_of(row.time, SENSOR_FRAME), "status": dict(status=0, service=1), "latitude": lonlat[1],
        "longitude": lonlat[0], "altitude": z, "position_covariance": covariance.ravel(),
        "position_covariance_type": 3 if covariance.any() else 0,
    }  # fmt: skip
    return ros.Entry(row.time, "/fix", "sensor_msgs/msg/NavSatFix", content)
