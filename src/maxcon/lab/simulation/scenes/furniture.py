# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What stands in a street: parked cars, trees, hedges, lamp poles and signs.

Each thing stands with its foot at the origin, z up, m; cars and hedges are long in x.
"""

import math

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import OCTAGON, Patch, boxes, extruded, join, prism, triangles

__all__ = ["draw_car", "draw_hedge", "draw_sign", "draw_tree", "lamp_pole"]

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
