"""Patches of triangles, and what stands in streets: cars, trees, signs, lamps, hedges; classes of LAS."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

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


_ANGLES = (np.arange(8) + 0.5) * math.pi / 4.0
OCTAGON = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Corners of an octagon around the origin, 1 m from it, shape (8, 2); its sides lie along and across the axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A piece of a simulated world."""

    corners: NDArray[np.float64]  # (t, 3, 3): corners of each triangle, m. Triangles are seen from both sides.
    classes: NDArray[np.uint8]  # (t,): LasClass of each triangle

    def __len__(self) -> int:
        return len(self.corners)

    def placed(self, x: float, y: float, z: float = 0.0, heading: float = 0.0) -> "Patch":
        """Return the patch turned by `heading` (rad) about the z axis, then moved by (x, y, z) (m)."""
        cosine, sine = math.cos(heading), math.sin(heading)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return Patch(self.corners @ turn.T + np.array([x, y, z]), self.classes)


def join(patches: Sequence[Patch]) -> Patch:
    """Return one patch with the triangles of all patches, of which there is at least one, in their order."""
    return Patch(np.concatenate([each.corners for each in patches]), np.concatenate([each.classes for each in patches]))


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
    (x0, y0, z0), (x1, y1, z1) = (np.reshape(np.asarray(ends, np.float64), (-1, 3)).T for ends in (lows, highs))
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    corners = np.array([(x, y, z) for z in (z0, z1) for x, y in outline])
    return triangles(corners.transpose(2, 0, 1)[:, _triangles_of_solid(4)], las_class)


def prism(outline: ArrayLike, bottom: float, top: float, las_class: LasClass) -> Patch:
    """Upright prism over a convex outline, shape (k, 2), m, closed at bottom and top."""
    x, y = np.asarray(outline, dtype=np.float64).T
    first, second = (np.column_stack([x, y, np.full(len(x), z)]) for z in (bottom, top))
    return _between(first, second, las_class)


def extruded(profile: ArrayLike, half_width: float, las_class: LasClass) -> Patch:
    """Convex profile in (x, z), shape (k, 2), m, extruded along y from -half_width to +half_width, m."""
    x, z = np.asarray(profile, dtype=np.float64).T
    first, second = (np.column_stack([x, np.full(len(x), y), z]) for y in (-half_width, half_width))
    return _between(first, second, las_class)


def _between(first: NDArray[np.float64], second: NDArray[np.float64], las_class: LasClass) -> Patch:
    """Solid between two convex outlines with equally many corners, shape (k, 3) each, m."""
    return triangles(np.concatenate([first, second])[_triangles_of_solid(len(first))], las_class)


@cache
def _triangles_of_solid(k: int) -> NDArray[np.int64]:
    """Corners of the triangles, (t, 3), of a solid between two outlines of k corners each: its sides, then its ends."""
    sides = [((i, j, k + j), (i, k + j, k + i)) for i, j in zip(range(k), [*range(1, k), 0], strict=True)]
    ends = [(face, face + i, face + i + 1) for face in (0, k) for i in range(1, k - 1)]
    return np.array([triangle for pair in sides for triangle in pair] + ends)


LEAF = 0.16  # typical side of a triangle, m, which stands for a twig with its leaves


def draw_car(rng: np.random.Generator) -> tuple[Patch, float]:
    """Return a car and its length, m: a small car, a long one or a van."""
    kind = rng.choice(3, p=[0.45, 0.4, 0.15])
    length = (3.8, 4.6, 5.2)[kind] + rng.uniform(-0.2, 0.2)
    height = (1.48, 1.46, 2.1)[kind] + rng.uniform(-0.06, 0.06)
    half_width = (0.85, 0.9, 0.98)[kind] + rng.uniform(-0.03, 0.03)
    bonnet = (0.95, 0.95, 1.15)[kind]
    screen, tail = (0.55, 0.1) if kind == 2 else (0.27 * length, 0.35)
    front, back = 0.5 * length, -0.5 * length
    body = [
        [back, 0.3], [back + 0.3, 0.18], [front - 0.3, 0.18], [front, 0.3],
        [front - 0.05, 0.75], [front - 0.4, bonnet], [back + 0.15, bonnet], [back, 0.8],
    ]  # fmt: skip
    cabin = [[back + 0.12, bonnet], [front - screen, bonnet], [front - screen - 0.55, height], [back + tail, height]]
    wheels = [0.3 * OCTAGON + [x, 0.3] for x in (back + 0.75, front - 0.8)]
    solids = [extruded(body, half_width, LasClass.VEHICLE), extruded(cabin, half_width - 0.1, LasClass.VEHICLE)]
    return join(solids + [extruded(wheel, half_width - 0.02, LasClass.VEHICLE) for wheel in wheels]), length


def draw_tree(rng: np.random.Generator) -> Patch:
    """Return a street tree: a trunk, and a canopy of loose leaves that light goes through."""
    trunk, radius, canopy = rng.uniform(2.6, 3.4), rng.uniform(0.1, 0.18), rng.uniform(1.2, 1.7)
    centers = np.column_stack([rng.normal(0.0, 0.35, (4, 2)), trunk + canopy * np.array([0.6, 1.1, 1.6, 2.1])])
    sizes = canopy * np.array([[0.8], [1.0], [0.9], [0.6]]) * np.array([1.0, 1.0, 0.8])
    parts = [prism(radius * OCTAGON, 0.0, trunk + canopy, LasClass.HIGH_VEGETATION)]
    for center, half_axes in zip(centers, sizes, strict=True):
        rng.uniform(-1.0, 1.0, (260, 3))  # drawn and not used: the same seed gives the same trees as ever
        directions = rng.normal(size=(260, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        places = directions * rng.random((260, 1)) ** 0.25  # denser towards the hull
        parts.append(leaves_at(center + places * half_axes, LEAF, LasClass.HIGH_VEGETATION, rng))
    return join(parts)


def draw_hedge(length: float, rng: np.random.Generator) -> Patch:
    """Return a hedge of `length` (m) with a strip of flowers before it (+y)."""
    half_height = 0.5 * rng.uniform(0.8, 1.3)
    parts = []
    for las_class, per_metre, y, half_depth, half in (
        (LasClass.MEDIUM_VEGETATION, 120, 0.0, 0.25, half_height),
        (LasClass.LOW_VEGETATION, 40, 0.4, 0.15, 0.1),
    ):
        places = rng.uniform(-1.0, 1.0, (int(per_metre * length), 3)) * np.array([0.5 * length, half_depth, half])
        parts.append(leaves_at(np.array([0.0, y, half]) + places, LEAF, las_class, rng))
    return join(parts)


def leaves_at(centers: NDArray[np.float64], size: float, las_class: LasClass, rng: np.random.Generator) -> Patch:
    """Return a random triangle of about `size` (m) at each of `centers`, shape (n, 3), m."""
    return triangles(centers[:, None] + rng.normal(0.0, size, (len(centers), 3, 3)), las_class)


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
