# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""RoadUser: a vehicle or a pedestrian that stands at a place for one scan, and casting rays into a city with some."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.lab.simulation.scenes.furniture import draw_car
from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import OCTAGON, Patch, boxes, join, prism
from maxcon.lab.simulation.sensing.ray_caster import Caster, Hits, TriangleScene

__all__ = ["CrowdedCaster", "RoadUser", "RoadUserShape", "draw_pedestrian_shape", "draw_vehicle_shape"]


class RoadUserShape:
    """The shape of a road user, made ready for casting rays; it stands on the origin and faces along x.

    patch: its triangles, m; all are taken for class VEHICLE.
    """

    def __init__(self, patch: Patch) -> None:
        extent = np.abs(patch.corners).max(axis=(0, 1))
        self.half_length, self.half_width = float(extent[0]), float(extent[1])
        self.height = float(extent[2])
        self.patch = patch
        self.scene = TriangleScene(patch.corners)

    @property
    def radius(self) -> float:
        """Radius of a ball around the shape, centred at half its height, m."""
        return math.hypot(self.half_length, self.half_width, 0.5 * self.height)


class RoadUser(NamedTuple):
    """A shape at a place: x, y, z (m) of its foot and its heading (rad), in the city's frame."""

    shape: RoadUserShape
    x: float
    y: float
    z: float
    heading: float

    @property
    def rotation(self) -> NDArray[np.float32]:
        """R_city_user, shape (3, 3)."""
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]], np.float32)

    def cast(self, origin: NDArray[np.float32], directions: NDArray[np.float32]) -> tuple[NDArray[np.int64], Hits]:
        """Return which rays from `origin`, (3,), with `directions`, (n, 3), hit it: their rows, (k,), and the hits."""
        foot = np.array([self.x, self.y, self.z], np.float32)
        away = foot + np.array([0.0, 0.0, 0.5 * self.shape.height], np.float32) - origin
        # Rays that miss the ball around the shape are left out.
        tangent_squared = float(away @ away) - self.shape.radius**2
        least_along = math.sqrt(tangent_squared) if tangent_squared > 0.0 else -math.inf
        near = np.flatnonzero(directions @ away >= least_along)
        turn = self.rotation
        start = ((origin - foot) @ turn).astype(np.float32)
        ways = (directions[near] @ turn).astype(np.float32)
        hits = self.shape.scene.cast(np.broadcast_to(start, ways.shape), ways)
        is_hit = hits.triangles >= 0
        return near[is_hit], Hits(hits.ranges[is_hit], hits.triangles[is_hit])


class CrowdedCaster:
    """A city with road users in it, for one scan.

    caster: the city.
    road_users: those around the car; their triangles follow those of the city, one road user after the other.
    """

    def __init__(self, caster: Caster, road_users: Sequence[RoadUser]) -> None:
        self._caster = caster
        self._road_users = road_users
        turned = [user.shape.scene.normals @ user.rotation.T for user in road_users]
        self.normals: NDArray[np.float32] = np.concatenate([caster.normals, *turned])
        users = np.full(len(self.normals) - len(caster.normals), LasClass.VEHICLE, np.uint8)
        self.classes: NDArray[np.uint8] = np.concatenate([caster.classes, users])

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hit of each ray; origins, all the same, and directions of shape (n, 3), city metres."""
        if (origins != origins[:1]).any():
            raise ArrayError("Expected rays from one origin, got several. Cast those of one scan, or use a RayCaster.")
        hits = self._caster.cast(origins, directions)
        ranges = np.where(hits.triangles >= 0, hits.ranges, np.float32(np.inf))
        triangles = hits.triangles.copy()
        first = len(self._caster.normals)
        for user in self._road_users:
            rows, met = user.cast(origins[0], directions)
            is_nearer = met.ranges < ranges[rows]
            ranges[rows[is_nearer]] = met.ranges[is_nearer]
            triangles[rows[is_nearer]] = first + met.triangles[is_nearer]
            first += len(user.shape.patch)
        return Hits(ranges, triangles)


def draw_vehicle_shape(rng: np.random.Generator) -> RoadUserShape:
    """Return a car, a van or a lorry, drawn at random."""
    if rng.random() < 0.5:
        return RoadUserShape(draw_car(rng)[0])
    half, height = rng.uniform(2.6, 4.0), rng.uniform(2.6, 3.3)
    width = rng.uniform(1.0, 1.15)
    lows = [[-half, -width, 0.5], [half - 1.6, -width + 0.05, 0.4]]
    highs = [[half - 1.7, width, height], [half, width - 0.05, 2.4]]
    wheels = [[[x - 0.45, -width + 0.05, 0.0], [x + 0.45, width - 0.05, 0.5]] for x in (1.0 - half, half - 1.0)]
    lows += [wheel[0] for wheel in wheels]
    highs += [wheel[1] for wheel in wheels]
    return RoadUserShape(boxes(lows, highs, LasClass.VEHICLE))


def draw_pedestrian_shape(rng: np.random.Generator) -> RoadUserShape:
    """Return a person of 1.5 to 1.95 m: legs and body, shoulders, head."""
    height = rng.uniform(1.5, 1.95)
    parts = [
        _round(0.14, 0.2, 0.0, 0.5 * height),
        _round(0.16, 0.26, 0.5 * height, height - 0.27),
        _round(0.1, 0.09, height - 0.27, height),
    ]
    return RoadUserShape(join(parts))


def _round(half_depth: float, half_width: float, bottom: float, top: float) -> Patch:
    return prism(OCTAGON * [half_depth, half_width], bottom, top, LasClass.VEHICLE)
