"""Road users around the car: vehicles and pedestrians that are not in the map, drawn anew for each scan."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices
from maxcon.lab.simulation.drive import Seed
from maxcon.lab.simulation.furniture import OCTAGON, LasClass, Patch, boxes, draw_car, join, prism
from maxcon.lab.simulation.scanners import Caster, Hits, RayCaster, Scanner
from maxcon.lab.simulation.streets import KERB_HEIGHT, STREET_ANGLE, StreetGrid, in_city


class RoadUserShape:
    """The shape of a road user, made ready for casting rays; it stands on the origin and faces along x."""

    def __init__(self, patch: Patch) -> None:
        self.half_length, self.half_width, self.height = np.abs(patch.corners).max(axis=(0, 1)).tolist()
        self.patch = patch
        self.scene = RayCaster(patch)

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
        return rotation_matrices(0.0, 0.0, self.heading).astype(np.float32)

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> tuple[NDArray[np.int64], Hits]:
        """Return which rays, origins and directions of shape (n, 3), hit it: their rows, shape (k,), and the hits."""
        foot = np.array([self.x, self.y, self.z], np.float32)
        away = foot + np.array([0.0, 0.0, 0.5 * self.shape.height], np.float32) - origins
        # Rays that miss the ball around the shape are left out.
        tangent_squared = np.einsum("ij,ij->i", away, away) - self.shape.radius**2
        least_along = np.where(tangent_squared > 0.0, np.sqrt(np.maximum(tangent_squared, 0.0)), -np.inf)
        near = np.flatnonzero(np.einsum("ij,ij->i", directions, away) >= least_along)
        turn = self.rotation
        starts, ways = ((rays @ turn).astype(np.float32) for rays in (origins[near] - foot, directions[near]))
        hits = self.shape.scene.cast(starts, ways)
        is_hit = hits.triangles >= 0
        return near[is_hit], Hits(hits.ranges[is_hit], hits.triangles[is_hit])


class CrowdedCaster:
    """A city with road users in it, for one scan; their triangles follow those of the city, user after user."""

    def __init__(self, caster: Caster, road_users: Sequence[RoadUser]) -> None:
        self._caster = caster
        self._road_users = road_users
        turned = [user.shape.scene.normals @ user.rotation.T for user in road_users]
        self.normals: NDArray[np.float32] = np.concatenate([caster.normals, *turned])
        users = np.full(len(self.normals) - len(caster.normals), LasClass.VEHICLE, np.uint8)
        self.classes: NDArray[np.uint8] = np.concatenate([caster.classes, users])

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hit of each ray; origins and directions of shape (n, 3), city metres."""
        hits = self._caster.cast(origins, directions)
        ranges = np.where(hits.triangles >= 0, hits.ranges, np.float32(np.inf))
        triangles = hits.triangles.copy()
        first = len(self._caster.normals)
        for user in self._road_users:
            rows, met = user.cast(origins, directions)
            is_nearer = met.ranges < ranges[rows]
            ranges[rows[is_nearer]] = met.ranges[is_nearer]
            triangles[rows[is_nearer]] = first + met.triangles[is_nearer]
            first += len(user.shape.patch)
        return Hits(ranges, triangles)


def draw_vehicle(rng: np.random.Generator) -> Patch:
    """Return a car, a van or a lorry, drawn at random."""
    if rng.random() < 0.5:
        return draw_car(rng)[0]
    half, height, width = rng.uniform(2.6, 4.0), rng.uniform(2.6, 3.3), rng.uniform(1.0, 1.15)
    lows = [[-half, -width, 0.5], [half - 1.6, -width + 0.05, 0.4]]
    highs = [[half - 1.7, width, height], [half, width - 0.05, 2.4]]
    for x in (1.0 - half, half - 1.0):
        lows.append([x - 0.45, -width + 0.05, 0.0])
        highs.append([x + 0.45, width - 0.05, 0.5])
    return boxes(lows, highs, LasClass.VEHICLE)


def draw_pedestrian(rng: np.random.Generator) -> Patch:
    """Return a person of 1.5 to 1.95 m: legs and body, shoulders, head."""
    height = rng.uniform(1.5, 1.95)
    edges = (0.0, 0.5 * height, height - 0.27, height)
    halves = ([0.14, 0.2], [0.16, 0.26], [0.1, 0.09])
    parts = zip(halves, pairwise(edges), strict=True)
    return join([prism(OCTAGON * half, *between, LasClass.VEHICLE) for half, between in parts])


UNMAPPED_RATIO = 0.3  # ratio of the returns of a scan that are on vehicles, parked ones included, and pedestrians
MOST_TRIES = 400  # places tried before a scan is left with a smaller ratio: in the open, too few returns can be hidden
LEAST_SEEN = 0.002  # a road user is placed only if it hides at least this ratio of the rays: others would not be seen
CLEARANCE = 2.6  # from the middle of the car to the nearest part of a road user, m
GAP = 0.4  # between two road users, m
LANE = 0.9  # from the centre line of a street to the middle of its lanes, m
DRIVERS_REACH, WALKERS_REACH = 35.0, 12.0
"""How far from the car, along and across, vehicles and pedestrians are placed, m."""


class _Rectangle(NamedTuple):
    """Ground that a road user covers: middle and half sides along the axes of the grid, m."""

    u: float
    v: float
    half_u: float
    half_v: float

    def distance_to(self, u: float, v: float) -> float:
        return math.hypot(max(abs(u - self.u) - self.half_u, 0.0), max(abs(v - self.v) - self.half_v, 0.0))

    def meets(self, other: "_Rectangle") -> bool:
        return (
            abs(self.u - other.u) < self.half_u + other.half_u + GAP
            and abs(self.v - other.v) < self.half_v + other.half_v + GAP
        )


class Traffic:
    """Vehicles and pedestrians in the streets of a grid, drawn anew for each scan; the seed is of their shapes.

    Vehicles keep to their right lanes, pedestrians to the sidewalks and their prolongations over the crossings, so that
    they overlap neither houses nor parked cars.
    """

    def __init__(self, grid: StreetGrid, seed: Seed) -> None:
        rng = np.random.default_rng(seed)
        self._grid = grid
        self._vehicles = [RoadUserShape(draw_vehicle(rng)) for _ in range(40)]
        self._pedestrians = [RoadUserShape(draw_pedestrian(rng)) for _ in range(20)]

    def draw(self, caster: Caster, scanner: Scanner, pose: Pose, rng: np.random.Generator) -> list[RoadUser]:
        """Return road users for one scan from `pose` (T_city_sensor) in a city with parked cars.

        They are added one by one until 30 % of the returns, before dropouts, are on triangles of class VEHICLE:
        theirs, or those of parked cars. Where parked cars alone exceed it, none is added.
        """
        view = _View(caster, scanner, pose)
        found: list[RoadUser] = []
        taken: list[_Rectangle] = []
        ego_u, ego_v = in_city(pose.position[:2], -STREET_ANGLE).tolist()
        for _ in range(MOST_TRIES):
            if view.ratio >= UNMAPPED_RATIO:
                break
            user, place = self._candidate(ego_u, ego_v, rng)
            is_free = not any(place.meets(other) for other in taken)
            if is_free and place.distance_to(ego_u, ego_v) >= CLEARANCE and view.add(user):
                found.append(user)
                taken.append(place)
        return found

    def _candidate(self, u: float, v: float, rng: np.random.Generator) -> tuple[RoadUser, _Rectangle]:
        """Draw a vehicle in a lane or a pedestrian on a sidewalk near (u, v), m; return it and the ground it covers."""
        grid, is_vehicle = self._grid, rng.random() < 0.6
        shapes = self._vehicles if is_vehicle else self._pedestrians
        shape = shapes[rng.integers(len(shapes))]
        reach = DRIVERS_REACH if is_vehicle else WALKERS_REACH
        near_u, near_v = (
            [line for line in lines if abs(line - place) <= reach]
            for lines, place in ((grid.v_lines, v), (grid.u_lines, u))
        )
        # At least one street is in reach.
        runs_along_u = bool(rng.random() < 0.5) if near_u and near_v else bool(near_u)
        near, ends = (near_u, grid.ends(grid.u_lines)) if runs_along_u else (near_v, grid.ends(grid.v_lines))
        line = near[rng.integers(len(near))]
        # Near places are more likely, as road users there hide more.
        along = (u if runs_along_u else v) + reach * rng.uniform(-1.0, 1.0) * rng.random()
        place = min(max(along, ends[0]), ends[1])
        is_forward = bool(rng.random() < 0.5)
        # To the right of +u is -v, but to the right of +v is +u.
        to_right = -1.0 if is_forward == runs_along_u else 1.0
        side = LANE if is_vehicle else float(rng.uniform(grid.carriageway + 0.35, grid.half_width - 0.5))
        across = line + to_right * side
        at_u, at_v = (place, across) if runs_along_u else (across, place)
        heading = (0.0 if runs_along_u else 0.5 * math.pi) + (0.0 if is_forward else math.pi)
        x, y = in_city(np.array([at_u, at_v]), STREET_ANGLE).tolist()
        user = RoadUser(shape, x, y, 0.0 if is_vehicle else KERB_HEIGHT, heading + STREET_ANGLE)
        halves = (shape.half_length, shape.half_width)
        return user, _Rectangle(at_u, at_v, *(halves if runs_along_u else halves[::-1]))


class _View:
    """Ranges of a scan, and which returns are on vehicles or pedestrians, updated as road users are added."""

    def __init__(self, caster: Caster, scanner: Scanner, pose: Pose) -> None:
        self._scanner = scanner
        rays = scanner.rays(time=0.0)
        self._directions: NDArray[np.float32] = (rays.directions @ pose.rotation.T).astype(np.float32)
        self._origins: NDArray[np.float32] = pose.apply(rays.origins).astype(np.float32)
        hits = caster.cast(self._origins, self._directions)
        self._ranges = np.where(scanner.are_returns(hits), hits.ranges, np.float32(np.inf))
        self._is_unmapped = np.isfinite(self._ranges) & (caster.classes[hits.triangles] == LasClass.VEHICLE)

    @property
    def ratio(self) -> float:
        """Ratio of the returns that are on vehicles and pedestrians; 0 where nothing returns."""
        return float(self._is_unmapped.sum() / max(int(np.isfinite(self._ranges).sum()), 1))

    def add(self, user: RoadUser) -> bool:
        """Add `user` if it hides enough rays; return whether it was added."""
        rows, hits = user.cast(self._origins, self._directions)
        is_seen = self._scanner.are_returns(hits) & (hits.ranges < self._ranges[rows])
        if is_seen.sum() < LEAST_SEEN * len(self._ranges):
            return False
        self._ranges[rows[is_seen]] = hits.ranges[is_seen]
        self._is_unmapped[rows[is_seen]] = True
        return True
