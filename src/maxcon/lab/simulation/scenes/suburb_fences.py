# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Boundaries of gardens other than hedges: picket fences, wire fences, low walls; and mail boxes and bins.

Fences run along x from the origin, z up, m; they are built of short pieces, to follow slopes.
"""

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import Patch, boxes, join
from maxcon.lab.simulation.scenes.suburb_plants import leaves_at

__all__ = ["draw_bin", "draw_garden_wall", "draw_mail_box", "draw_picket_fence", "draw_weeds", "draw_wire_fence"]

PIECE = 0.5
"""Length of the pieces of rails, m: short, so that a fence can follow the road and its slopes."""


def draw_picket_fence(length: float, rng: np.random.Generator) -> Patch:
    """Return pickets with gaps between them, on two rails; some stand askew."""
    height, pitch = rng.uniform(0.8, 1.3), rng.uniform(0.11, 0.17)
    x = np.arange(0.0, length - 0.08, pitch)
    tops = height + rng.normal(0.0, 0.015, len(x))
    y = rng.normal(0.0, 0.01, len(x))
    pickets = _boxes(x, x + rng.uniform(0.06, 0.09), y, y + 0.02, np.full(len(x), 0.05), tops)
    return join([pickets, _rail(length, 0.3), _rail(length, height - 0.25)])


def draw_wire_fence(length: float, rng: np.random.Generator) -> Patch:
    """Return posts and wires, through which nearly all light goes."""
    height = rng.uniform(1.0, 1.4)
    posts = np.arange(0.0, length, 2.2)
    width = np.full(len(posts), 0.05)
    bodies = _boxes(posts, posts + width, -0.5 * width, 0.5 * width, 0.0 * width, 0.0 * width + height)
    wires = [_rail(length, z, thickness=0.006) for z in np.linspace(0.15, height, 8)]
    return join([bodies, *wires])


def draw_garden_wall(length: float, rng: np.random.Generator) -> Patch:
    """Return a low wall of stones that stand out of it by some centimetres."""
    height, n_courses = rng.uniform(0.4, 1.1), 4
    stones = []
    for course in range(n_courses):
        edges = np.unique(np.clip(np.cumsum(rng.uniform(0.2, 0.5, 2 + int(length / 0.2))), 0.0, length))
        edges = np.concatenate([[0.0], edges])
        out = 0.12 + rng.normal(0.0, 0.015, (2, len(edges) - 1))
        low = np.full(len(edges) - 1, course * height / n_courses - (0.3 if course == 0 else 0.0))
        top = np.full(len(edges) - 1, (course + 1) * height / n_courses)
        stones.append(_boxes(edges[:-1], edges[1:], -out[0], out[1], low, top))
    return join(stones)


def draw_mail_box(rng: np.random.Generator) -> Patch:
    """Return a box on a post."""
    half, z = rng.uniform(0.12, 0.22), rng.uniform(0.9, 1.2)
    lows, highs = (
        [[-0.03, -0.03, 0.0], [-half, -0.15, z]],
        [[0.03, 0.03, z], [half, 0.15, z + rng.uniform(0.25, 0.4)]],
    )
    return boxes(lows, highs, LasClass.UNCLASSIFIED)


def draw_bin(rng: np.random.Generator) -> Patch:
    """Return a bin on wheels, which stands elsewhere on another day."""
    half = rng.uniform(0.24, 0.34)
    return boxes([[-half, -half, 0.05]], [[half, half, rng.uniform(0.95, 1.15)]], LasClass.UNCLASSIFIED)


def draw_weeds(length: float, day: np.random.Generator) -> Patch:
    """Return high grass and flowers along x, at the foot of something of `length` (m); others every `day`."""
    n = int(25 * length)
    places = np.column_stack([day.uniform(0.0, length, n), day.normal(0.0, 0.15, n), day.exponential(0.12, n)])
    return leaves_at(places, 0.06, LasClass.LOW_VEGETATION, day)


def _rail(length: float, z: float, thickness: float = 0.04) -> Patch:
    """A rail at the height `z` (m)."""
    x = np.linspace(0.0, length, 1 + max(1, round(length / PIECE)))
    none = np.zeros(len(x) - 1)
    half = 0.5 * thickness
    return _boxes(x[:-1], x[1:], none - half, none + half, none + z - half, none + z + half)


def _boxes(
    x0: NDArray[np.float64],
    x1: NDArray[np.float64] | float,
    y0: NDArray[np.float64],
    y1: NDArray[np.float64],
    z0: NDArray[np.float64],
    z1: NDArray[np.float64],
) -> Patch:
    """Return unclassified boxes from x0 to x1, y0 to y1 and z0 to z1, shape (n,) each, m."""
    lows, highs = np.column_stack([x0, y0, z0]), np.column_stack([np.broadcast_to(x1, x0.shape), y1, z1])
    return boxes(lows, highs, LasClass.UNCLASSIFIED)
