"""Poses, R = Rz(heading) Ry(pitch) Rx(roll) (D2), and those between; the local frame of a map (D1), voxels (D4)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.geometry.arrays import as_points

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

INDEX_LIMIT = 2**30  # indices stay in int32 with room for a search space on every side: at 6 cm that is 64,000 km
Angle = TypeVar("Angle", float, NDArray[np.float64])


def wrap_angle(angle: Angle) -> Angle:
    """Return an angle, or an array of them, wrapped to [-pi, pi), rad."""
    wrapped = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return wrapped - (wrapped >= math.pi) * 2.0 * math.pi  # a tiny negative angle is rounded up to pi


def rotation_matrices(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrices Rz(heading) Ry(pitch) Rx(roll), (..., 3, 3), sensor to map axes, of angles (...), rad (D2)."""
    if isinstance(roll, float) and isinstance(pitch, float) and isinstance(heading, float):
        return np.array(_rows(math.cos, math.sin, roll, pitch, heading))  # ten times as fast
    roll, pitch, heading = np.broadcast_arrays(
        *(np.asarray(angle, dtype=np.float64) for angle in (roll, pitch, heading))
    )
    rows = np.array(_rows(np.cos, np.sin, roll, pitch, heading))
    return np.ascontiguousarray(np.moveaxis(rows, (0, 1), (-2, -1)))


def _rows(cos: Callable[..., Any], sin: Callable[..., Any], roll: Any, pitch: Any, heading: Any) -> Any:
    """Rows of `rotation_matrices`, by the cosine and sine of numbers or of arrays."""
    cr, sr, cp, sp, ch, sh = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(heading), sin(heading)
    return (
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (-sp, cp * sr, cp * cr),
    )


@dataclass(frozen=True, slots=True)
class Pose:
    """T_map_sensor: position and orientation of the sensor in the map.

    `T_a_b` maps from b to a, so `pose.apply(points_sensor)` are the points in the map's frame. Poses of a map or an
    `Estimate` are in the map's local frame, those of a `Trajectory` in global coordinates; see `LocalFrame`.

    Parameters
    ----------
    x, y, z : float
        Position of the sensor, m. z is up.
    roll, pitch, heading : float
        Orientation, rad: R = Rz(heading) Ry(pitch) Rx(roll). Heading is counter-clockwise from +x and is kept in
        [-pi, pi).

    Raises
    ------
    ArrayError
        If a value is not a finite number.
    """

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    heading: float

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = float(getattr(self, name))
            if not math.isfinite(value):
                raise ArrayError(f"Expected a finite number for `{name}` of a Pose, got {value}. Leave this pose out.")
            object.__setattr__(self, name, value)
        object.__setattr__(self, "heading", wrap_angle(self.heading))

    @property
    def position(self) -> NDArray[np.float64]:
        """x, y, z in m, shape (3,)."""
        return np.array([self.x, self.y, self.z])

    @property
    def values(self) -> NDArray[np.float64]:
        """x, y, z in m and roll, pitch, heading in rad, shape (6,)."""
        return np.array([self.x, self.y, self.z, self.roll, self.pitch, self.heading])

    @property
    def rotation(self) -> NDArray[np.float64]:
        """R_map_sensor, shape (3, 3)."""
        return rotation_matrices(self.roll, self.pitch, self.heading)

    def apply(self, points_sensor: ArrayLike) -> NDArray[np.float64]:
        """Points in the map's frame, shape (n, 3), m, from points in the sensor frame."""
        points = as_points(points_sensor, "points_sensor")
        return points @ self.rotation.T + self.position

    def translated(self, offset: ArrayLike) -> Pose:
        """Return the same orientation at a position moved by `offset`, shape (3,), m."""
        x, y, z = self.position + np.asarray(offset, dtype=np.float64)
        return Pose(x, y, z, self.roll, self.pitch, self.heading)

    def less(self, other: Pose) -> NDArray[np.float64]:
        """Return the values less those of another pose, shape (6,), m and rad, turns within [-pi, pi)."""
        difference = self.values - other.values
        difference[3:] = wrap_angle(difference[3:])
        return difference

    def with_height_and_tilt_of(self, other: Pose) -> Pose:
        """Return the pose at this x, y and heading with the z, roll and pitch of another."""
        return Pose(self.x, self.y, other.z, other.roll, other.pitch, self.heading)

    @classmethod
    def from_rotation(cls, position: ArrayLike, rotation: NDArray[np.float64]) -> Pose:
        """Return the pose of a position, shape (3,), m, and a rotation matrix, shape (3, 3)."""
        x, y, z = np.asarray(position, dtype=np.float64).tolist()
        roll = math.atan2(rotation[2, 1], rotation[2, 2])
        pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[2, 1], rotation[2, 2]))
        return cls(x, y, z, roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0]))

    def __matmul__(self, other: Pose) -> Pose:
        """T_a_c from T_a_b (this one) and T_b_c: the pose after a motion given in this pose's own axes."""
        return Pose.from_rotation(self.apply(other.position[None])[0], self.rotation @ other.rotation)

    @property
    def inverse(self) -> Pose:
        """T_b_a of this T_a_b."""
        return Pose.from_rotation(-self.rotation.T @ self.position, self.rotation.T)


def interpolate_poses(
    times: NDArray[np.float64], positions: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64], wanted: ArrayLike
) -> tuple[NDArray[np.float64], Rotation]:
    """Positions (n, 3) and n rotations at wanted times, between poses at increasing times (m,), s.

    Positions are linear, turns take the shortest arc; beyond the ends both go on as between the two poses there. One
    pose stands at all times.
    """
    from scipy.spatial.transform import Rotation

    at = np.asarray(wanted, dtype=np.float64)
    if len(times) == 1:
        return np.repeat(positions, len(at), axis=0), Rotation.from_quat(np.repeat(quaternions_xyzw, len(at), axis=0))
    earlier = (np.searchsorted(times, at, side="right") - 1).clip(0, len(times) - 2)
    parts = ((at - times[earlier]) / (times[earlier + 1] - times[earlier]))[:, None]
    first = Rotation.from_quat(quaternions_xyzw[earlier])
    arcs = (first.inv() * Rotation.from_quat(quaternions_xyzw[earlier + 1])).as_rotvec()
    rotations = first * Rotation.from_rotvec(parts * arcs)
    return (1.0 - parts) * positions[earlier] + parts * positions[earlier + 1], rotations


def quaternions_from_angles(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> NDArray[np.float64]:
    """Return unit quaternions (x, y, z, w), shape (..., 4), of Rz(heading) Ry(pitch) Rx(roll), angles in rad (D2)."""
    from scipy.spatial.transform import Rotation

    angles = np.stack(np.broadcast_arrays(heading, pitch, roll), axis=-1)
    quaternions = Rotation.from_euler("ZYX", angles.reshape(-1, 3)).as_quat()
    return np.asarray(quaternions.reshape(*angles.shape[:-1], 4), dtype=np.float64)


def angles_from_quaternions(quaternions_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Roll, pitch and heading, (..., 3), rad, of unit quaternions (x, y, z, w); roll is 0 where pitch is +-pi/2."""
    from scipy.spatial.transform import Rotation

    quaternions = np.asarray(quaternions_xyzw, dtype=np.float64)
    R = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()
    level = np.hypot(R[:, 0, 0], R[:, 1, 0])
    is_vertical = level < 1e-9
    roll = np.where(is_vertical, 0.0, np.arctan2(R[:, 2, 1], R[:, 2, 2]))
    heading = np.where(is_vertical, np.arctan2(-R[:, 0, 1], R[:, 1, 1]), np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    angles = np.stack([roll, np.arctan2(-R[:, 2, 0], level), heading], axis=-1)
    return np.asarray(angles.reshape(*quaternions.shape[:-1], 3), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The frame everything inside a map is expressed in: metres about a float64 origin, with a CRS.

    - origin: global coordinates of the local (0, 0, 0), m, float64: a float32 northing of 5.8e6 m has steps of 0.5 m.
    - crs: WKT of the global coordinate reference system; None where it is not known.
    """

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    crs: str | None = None

    def __repr__(self) -> str:
        return f"LocalFrame({', '.join(f'{value:.12g}' for value in self.origin)}, {self.crs_words})"

    @property
    def crs_words(self) -> str:
        """EPSG:25832 or the like, the name where the WKT has no code, or "no CRS"."""
        crs = self.crs or "no CRS"
        code = re.search(r'ID\["(\w+)",(\d+)\]\]\s*$', crs)
        return ":".join(code.groups()) if code else crs.split('"')[1] if '"' in crs else crs

    def __post_init__(self) -> None:
        origin = tuple(float(value) for value in self.origin)
        if len(origin) != 3 or not np.isfinite(origin).all():
            raise ArrayError(f"Expected three finite numbers as the origin of a LocalFrame, got {self.origin}.")
        object.__setattr__(self, "origin", origin)

    def to_local(self, points_global: ArrayLike) -> NDArray[np.float64]:
        """Local coordinates, shape (n, 3), m, of global ones."""
        return np.subtract(as_points(points_global, "points_global"), self.origin)

    def to_global(self, points_local: ArrayLike) -> NDArray[np.float64]:
        """Global coordinates, shape (n, 3), m, of local ones."""
        return np.add(as_points(points_local, "points_local"), self.origin)

    def pose_to_local(self, pose_global: Pose) -> Pose:
        """Return the same pose with its position in this frame."""
        return pose_global.translated(-np.array(self.origin))

    def pose_to_global(self, pose_local: Pose) -> Pose:
        """Return the same pose with its position in global coordinates."""
        return pose_local.translated(self.origin)


def voxel_indices(points: NDArray[np.float64], cell: float) -> NDArray[np.int32]:
    """Index floor(coordinate / cell) of each point's voxel, (n, 3); ArrayError beyond 2^30 (64,000 km at 6 cm)."""
    scaled = np.floor(points / cell)
    if scaled.size and max(scaled.max(), -scaled.min()) >= INDEX_LIMIT:
        raise ArrayError(
            f"Expected points within {INDEX_LIMIT * cell:.3g} m of the local origin, got"
            f" {np.abs(points).max():.3g} m. Express them in a local frame."
        )
    return scaled.astype(np.int32)


def voxel_centers(indices: NDArray[np.int32], cell: float) -> NDArray[np.float64]:
    """Centre of each voxel, shape (n, 3), local frame, m."""
    return (indices.astype(np.float64) + 0.5) * cell
