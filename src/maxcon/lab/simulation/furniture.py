# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Patches of triangles, and what stands in streets: cars, trees, signs, lamps, hedges; classes of LAS."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray


class LasClass(IntEnum):
    """Classes of LAS 1.4 (ASPRS); 64 and above are free for users."""

    UNCLASSIFIED = 1
    """In a suburb: fences, garden walls, bins, and the many plants that surveys leave unclassified."""
    GROUND = 2
    """Carriageway, kerbs, sidewalks and yards."""
    LOW_VEGETATION = 3
    """Grass and flower beds, below 0.5 m."""
    MEDIUM_VEGETATION = 4
    """Hedges, 0.5 to 2 m."""
    HIGH_VEGETATION = 5
    """Trees, trunk and canopy."""
    BUILDING = 6
    """Facades with their balconies, steps and rain pipes; roofs."""
    VEHICLE = 64
    """Parked cars; in the scans of a hard campaign also moving vehicles and pedestrians."""
    POLE = 65
    """Lamp poles and traffic signs."""


REFLECTANCES: dict[LasClass, float] = {
    LasClass.UNCLASSIFIED: 0.45,
    LasClass.GROUND: 0.25,
    LasClass.LOW_VEGETATION: 0.5,
    LasClass.MEDIUM_VEGETATION: 0.45,
    LasClass.HIGH_VEGETATION: 0.4,
    LasClass.BUILDING: 0.6,
    LasClass.VEHICLE: 0.35,
    LasClass.POLE: 0.7,
}
"""Part of the light that comes back from a surface hit at a right angle, 0 to 1."""


_ANGLES = (np.arange(8) + 0.5) * math.pi / 4.0
OCTAGON = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Corners of an octagon around the origin, 1 m from it, shape (8, 2); its sides lie along and across the axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A piece of a simulated world.

    corners: shape (t, 3, 3); corners of each triangle, m. Triangles are seen from both sides.
    classes: shape (t,), uint8; LasClass of each triangle.
    """

    corners: NDArray[np.float64]
    classes: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.corners)

    def placed(self, x: float, y: float, z: float = 0.0, heading: float = 0.0) -> "Patch":
        """Return the patch turned by `heading` (rad) about the z axis, then moved by (x, y, z) (m)."""
        cosine, sine = math.cos(heading), math.sin(heading)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return Patch(self.corners @ turn.T + np.array([x, y, z]), self.classes)


def join(patches: Sequence[Patch]) -> Patch:
    """Return one patch with the triangles of all patches, in their order."""
    if not patches:
        return Patch(np.empty((0, 3, 3)), np.empty(0, dtype=np.uint8))
    return Patch(
        np.concatenate([patch.corners for patch in patches]), np.concatenate([patch.classes for patch in patches])
    )


def triangles(corners: ArrayLike, las_class: LasClass) -> Patch:
    """Triangles of one class from their corners, shape (t, 3, 3), m."""
    array = np.asarray(corners, dtype=np.float64).reshape(-1, 3, 3)
    return Patch(array, np.full(len(array), las_class, dtype=np.uint8))


def quads(corners: ArrayLike, las_class: LasClass) -> Patch:
    """Flat four-cornered faces from their corners in order around, shape (n, 4, 3), m."""
    array = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 3)
    return triangles(array[:, [[0, 1, 2], [0, 2, 3]]], las_class)


def grid_faces(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Four-cornered faces of the surface through a grid of points, shape (n, m, 3), for `quads`: ((n-1)(m-1), 4, 3)."""
    around = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    return np.stack([corner.reshape(-1, 3) for corner in around], axis=1)


def boxes(lows: ArrayLike, highs: ArrayLike, las_class: LasClass) -> Patch:
    """Boxes parallel to the axes from their lowest and highest corners, shape (n, 3) each, m."""
    low, high = (np.asarray(corner, dtype=np.float64).reshape(-1, 3) for corner in (lows, highs))
    outline = np.stack(
        [low[:, :2], np.stack([high[:, 0], low[:, 1]], 1), high[:, :2], np.stack([low[:, 0], high[:, 1]], 1)], 1
    )
    return join([prism(outline[i], float(low[i, 2]), float(high[i, 2]), las_class) for i in range(len(low))])


def prism(outline: ArrayLike, bottom: float, top: float, las_class: LasClass) -> Patch:
    """Upright prism over a convex outline, shape (k, 2), m, closed at bottom and top."""
    base = np.asarray(outline, dtype=np.float64)
    return _between(
        np.column_stack([base, np.full(len(base), bottom)]), np.column_stack([base, np.full(len(base), top)]), las_class
    )


def extruded(profile: ArrayLike, half_width: float, las_class: LasClass) -> Patch:
    """Convex profile in (x, z), shape (k, 2), m, extruded along y from -half_width to +half_width, m."""
    shape = np.asarray(profile, dtype=np.float64)
    side = np.full(len(shape), half_width)
    return _between(
        np.column_stack([shape[:, 0], -side, shape[:, 1]]), np.column_stack([shape[:, 0], side, shape[:, 1]]), las_class
    )


def _between(first: NDArray[np.float64], second: NDArray[np.float64], las_class: LasClass) -> Patch:
    """Solid between two convex outlines with equally many corners, shape (k, 3) each, m."""
    sides = np.stack([first, np.roll(first, -1, axis=0), np.roll(second, -1, axis=0), second], axis=1)
    fans = [
        np.stack([np.broadcast_to(face[0], (len(face) - 2, 3)), face[1:-1], face[2:]], axis=1)
        for face in (first, second)
    ]
    return join([quads(sides, las_class), triangles(np.concatenate(fans), las_class)])


LEAF = 0.16
"""Typical side of a triangle, m, which stands for a twig with its leaves."""


def draw_car(rng: np.random.Generator) -> tuple[Patch, float]:
    """Return a car and its length, m: a small car, a long one or a van."""
    kind = rng.choice(3, p=[0.45, 0.4, 0.15])
    length = (3.8, 4.6, 5.2)[kind] + rng.uniform(-0.2, 0.2)
    height = (1.48, 1.46, 2.1)[kind] + rng.uniform(-0.06, 0.06)
    half_width = (0.85, 0.9, 0.98)[kind] + rng.uniform(-0.03, 0.03)
    bonnet = (0.95, 0.95, 1.15)[kind]
    front, back = 0.5 * length, -0.5 * length
    body = [
        [back, 0.3],
        [back + 0.3, 0.18],
        [front - 0.3, 0.18],
        [front, 0.3],
        [front - 0.05, 0.75],
        [front - 0.4, bonnet],
    ]
    body += [[back + 0.15, bonnet], [back, 0.8]]
    screen = 0.55 if kind == 2 else 0.27 * length
    tail = 0.1 if kind == 2 else 0.35
    cabin = [[back + 0.12, bonnet], [front - screen, bonnet], [front - screen - 0.55, height], [back + tail, height]]
    wheels = [
        extruded(0.3 * OCTAGON + [x, 0.3], half_width - 0.02, LasClass.VEHICLE) for x in (back + 0.75, front - 0.8)
    ]
    parts = [extruded(body, half_width, LasClass.VEHICLE), extruded(cabin, half_width - 0.1, LasClass.VEHICLE)]
    return join(parts + wheels), length


def draw_tree(rng: np.random.Generator) -> Patch:
    """Return a street tree: a trunk, and a canopy of loose leaves that light goes through."""
    trunk = rng.uniform(2.6, 3.4)
    radius = rng.uniform(0.1, 0.18)
    canopy = rng.uniform(1.2, 1.7)
    centers = np.column_stack([rng.normal(0.0, 0.35, (4, 2)), trunk + canopy * np.array([0.6, 1.1, 1.6, 2.1])])
    sizes = canopy * np.array([[0.8], [1.0], [0.9], [0.6]]) * np.array([1.0, 1.0, 0.8])
    blobs = [
        _leaves(center, size, 260, LasClass.HIGH_VEGETATION, rng) for center, size in zip(centers, sizes, strict=True)
    ]
    stem = prism(radius * OCTAGON, 0.0, trunk + canopy, LasClass.HIGH_VEGETATION)
    return join([stem, *blobs])


def draw_hedge(length: float, rng: np.random.Generator) -> Patch:
    """Return a hedge of `length` (m) with a strip of flowers before it (+y)."""
    height = rng.uniform(0.8, 1.3)
    middle = np.array([0.0, 0.0, 0.5 * height])
    hedge = _leaves(
        middle,
        np.array([0.5 * length, 0.25, 0.5 * height]),
        int(120 * length),
        LasClass.MEDIUM_VEGETATION,
        rng,
        square=True,
    )
    flowers = _leaves(
        np.array([0.0, 0.4, 0.1]),
        np.array([0.5 * length, 0.15, 0.1]),
        int(40 * length),
        LasClass.LOW_VEGETATION,
        rng,
        square=True,
    )
    return join([hedge, flowers])


def lamp_pole() -> Patch:
    """Return a pole of 7 m with an arm of 1.5 m over the carriageway (+y)."""
    pole = prism(0.07 * OCTAGON, 0.0, 7.0, LasClass.POLE)
    arm = boxes([[-0.03, 0.0, 6.9], [-0.15, 1.2, 6.85]], [[0.03, 1.3, 6.98], [0.15, 1.8, 7.0]], LasClass.POLE)
    return join([pole, arm])


def draw_sign(rng: np.random.Generator) -> Patch:
    """Return a traffic sign on a pole, its plate across the x axis up to a few degrees."""
    height = rng.uniform(2.1, 2.5)
    pole = prism(0.03 * OCTAGON, 0.0, height + 0.6, LasClass.POLE)
    plate = boxes([[-0.05, -0.3, height]], [[-0.03, 0.3, height + 0.6]], LasClass.POLE)
    return join([pole, plate]).placed(0.0, 0.0, heading=rng.normal(0.0, math.radians(5.0)))


def _leaves(
    center: NDArray[np.float64],
    half_axes: NDArray[np.float64],
    n_leaves: int,
    las_class: LasClass,
    rng: np.random.Generator,
    *,
    square: bool = False,
) -> Patch:
    """Loose triangles in an ellipsoid, denser towards its hull, or in a box if `square`."""
    places = rng.uniform(-1.0, 1.0, (n_leaves, 3))
    if not square:
        directions = rng.normal(size=(n_leaves, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        places = directions * rng.random((n_leaves, 1)) ** 0.25
    return triangles((center + places * half_axes)[:, None] + rng.normal(0.0, LEAF, (n_leaves, 3, 3)), las_class)
