# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Patch: triangles with a class each, and the basic shapes that everything is built of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.lab.simulation.scenes.las_classes import LasClass

__all__ = ["OCTAGON", "Patch", "boxes", "extruded", "grid_faces", "join", "prism", "quads", "triangles"]

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
