# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What grows in a suburb: hedges, bushes, trees and ivy; on another day, a part of their leaves hangs elsewhere.

Each plant stands with its foot at the origin, z up, m. What stays from day to day (stems, outlines) is drawn
from `rng`, what the wind moves (leaves) from `day`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import OCTAGON, Patch, grid_faces, join, prism, quads, triangles

__all__ = ["draw_bush", "draw_garden_tree", "draw_hedge_row", "draw_ivy", "leaves_at", "survey_class"]

HEDGE_STEP = 0.1
"""Spacing of the points of a hedge's surface, m."""
BUMPS, TWIGS = 0.1, 0.09
"""Standard deviations of a hedge's surface, m: smooth bumps of its cut, and twigs that stand out or are missing."""
GAPS = 0.3
"""Share of a hedge's surface that is open: light goes on to the twigs inside, or through the hedge."""
MOVING = 0.5
"""Share of the leaves, and of the roughness of twigs, that differs from day to day."""


def survey_class(las_class: LasClass, share: float, rng: np.random.Generator) -> LasClass:
    """Return the class that a survey gives to a plant: the right one, or none, drawn at random.

    las_class: the right class.
    share: share of such plants that the survey classifies, 0 to 1.
    rng: draws whether it does.
    """
    return las_class if rng.random() < share else LasClass.UNCLASSIFIED


def leaves_at(centers: NDArray[np.float64], size: float, las_class: LasClass, day: np.random.Generator) -> Patch:
    """Return a random triangle of about `size` (m) at each of `centers`, shape (n, 3), m."""
    return triangles(centers[:, None] + day.normal(0.0, size, (len(centers), 3, 3)), las_class)


def draw_hedge_row(length: float, height: float, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return a hedge of `length` along x and `height` (m): a bumpy surface of twigs, with leaves standing out."""
    las_class = survey_class(LasClass.MEDIUM_VEGETATION, 0.3, rng)
    half = rng.uniform(0.25, 0.45)
    x = np.linspace(0.0, length, max(2, round(length / HEDGE_STEP)))
    outline = np.array([[half, 0.0], [half, height - 0.1], [half - 0.1, height]])
    outline = np.concatenate([outline, outline[::-1] * np.array([-1.0, 1.0])])
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    around = np.linspace(0.0, reach[-1], round(reach[-1] / HEDGE_STEP))
    y, z = (np.interp(around, reach, column) for column in outline.T)
    middle = 0.5 * height
    outward = np.column_stack([np.sign(y) * (np.abs(z - middle) < middle - 0.12), z > height - 0.12])
    bulge = BUMPS * _bumps(x, around, rng)
    bulge += TWIGS * (MOVING * day.standard_normal(bulge.shape) + (1.0 - MOVING) * rng.standard_normal(bulge.shape))
    grid = np.empty((len(x), len(around), 3))
    grid[..., 0] = x[:, None]
    grid[..., 1:] = np.column_stack([y, z]) + bulge[..., None] * outward
    core = grid[::2, ::2] * np.array([1.0, 0.4, 0.9])
    sheets = [_sheet(grid, las_class, rng, day), _sheet(core, las_class, rng, day)]
    n_leaves = int(90 * length * height)
    rows, columns = day.integers(0, len(x), n_leaves), day.integers(0, len(around), n_leaves)
    away = np.zeros((n_leaves, 3))
    away[:, 1:] = outward[columns] * day.exponential(0.1, (n_leaves, 1))
    ends = day.uniform([0.0, -half, 0.0], [0.0, half, height], (int(150 * height), 3))
    ends[::2, 0] = length
    leaves = leaves_at(np.concatenate([grid[rows, columns] + away, ends]), 0.05, las_class, day)
    return join([*sheets, leaves])


def draw_bush(rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return a bush, 0.5 to 2.2 m high."""
    las_class = survey_class(LasClass.MEDIUM_VEGETATION, 0.3, rng)
    height = rng.uniform(0.5, 2.2)
    half = np.array([*(height * rng.uniform(0.35, 0.6, 2)), 0.5 * height])
    n_leaves = int(320 * height)
    return leaves_at(np.array([0.0, 0.0, half[2]]) + half * _in_ball(n_leaves, rng, day), 0.07, las_class, day)


def draw_garden_tree(rng: np.random.Generator, day: np.random.Generator, height: float) -> Patch:
    """Return a tree of `height` (m): broad-leaved, or a conifer with branches down to the ground."""
    las_class = survey_class(LasClass.HIGH_VEGETATION, 0.6, rng)
    is_conifer = rng.random() < 0.3
    trunk = 0.1 * height if is_conifer else rng.uniform(0.2, 0.3) * height
    radius = 0.012 * height + 0.05
    stem = prism(radius * OCTAGON, -0.3, 0.8 * height, las_class)
    parts = [stem]
    for k in range(5):
        part = (k + 0.5) / 5.0
        spread = (1.0 - part) * 0.22 if is_conifer else 0.26 * math.sin(math.pi * (0.25 + 0.65 * part))
        center = np.array([*rng.normal(0.0, 0.05 * height, 2), trunk + part * (height - trunk)])
        half = np.array([spread * height, spread * height, 0.15 * height])
        blob = center + half * _in_ball(int(70 * height), rng, day)
        parts.append(leaves_at(blob, 0.11, las_class, day))
    return join(parts)


def draw_ivy(width: float, height: float, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return ivy on the wall y = 0, `width` along x and up to `height` (m), denser below."""
    las_class = survey_class(LasClass.HIGH_VEGETATION, 0.2, rng)
    n_leaves = int(120 * width * height)
    x, z = day.uniform(0.0, width, n_leaves), height * (1.0 - np.sqrt(day.random(n_leaves)))
    out = np.abs(day.normal(0.0, 0.1, n_leaves))
    return leaves_at(np.column_stack([x, out, z]), 0.07, las_class, day)


def _in_ball(n: int, rng: np.random.Generator, day: np.random.Generator) -> NDArray[np.float64]:
    """Places in the unit ball, shape (n, 3), denser towards its hull, as leaves are; some differ from day to day."""
    n_moving = round(MOVING * n)
    draws = ((rng, n - n_moving), (day, n_moving))
    directions = np.concatenate([source.normal(size=(k, 3)) for source, k in draws])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.concatenate([source.random((k, 1)) for source, k in draws])
    return np.asarray(directions * radii**0.3)


def _bumps(x: NDArray[np.float64], y: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Smooth bumps over a grid, shape (len(x), len(y)), with wavelengths of 0.5 to 2 m and standard deviation 1."""
    waves = 2.0 * math.pi / rng.uniform(0.5, 2.0, 6)
    ways, phases = rng.uniform(0.0, math.pi, 6), rng.uniform(0.0, 2.0 * math.pi, 6)
    total = np.zeros((len(x), len(y)))
    for wave, way, phase in zip(waves, ways, phases, strict=True):
        total += np.sin(wave * (math.cos(way) * x[:, None] + math.sin(way) * y) + phase)
    return total / math.sqrt(3.0)


def _sheet(grid: NDArray[np.float64], las_class: LasClass, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Surface through a grid of points, shape (n, m, 3), m, with gaps, some of which differ from day to day."""
    faces = grid_faces(grid)
    is_moving = day.random(len(faces)) < MOVING
    is_gap = np.where(is_moving, day.random(len(faces)), rng.random(len(faces))) < GAPS
    return quads(faces[~is_gap], las_class)
