# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PeriodicCity: facades that repeat every 3 m, and irregular items before them, some of which are removed later."""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from maxcon.lab.simulation.scenes.city import City, city_of, pavement
from maxcon.lab.simulation.scenes.facades import balcony, rain_pipe, relief, steps
from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import Patch, join, quads
from maxcon.lab.simulation.scenes.street_grid import CAMPAIGN_GRID, Frontage, StreetGrid
from maxcon.lab.simulation.seed import Seed

__all__ = ["PERIOD", "Item", "PeriodicCity", "build_periodic_city", "periodic_front"]

PERIOD = 3.0
"""Of all facades, m."""
PILASTER, PILASTER_DEPTH = 0.5, 0.2
"""Width and how far it stands out, m: a pilaster on each border of a period, from the ground to the eaves."""
WINDOW, REVEAL = 1.2, 0.18
"""Width and depth behind the wall, m: a column of windows in the middle of each period."""
FLOORS = (3.7, 7.0, 10.3)
"""Heights of the upper floors, m."""
HEIGHT = 13.8
"""Of the eaves, m."""
ROOF_DEPTH, ROOF_RISE, EAVES = 6.0, 4.2, 0.35
ITEM_SPACING = 14.0
"""Mean distance along a frontage from one balcony to the next, m; the same for steps and for rain pipes."""


class Item(NamedTuple):
    """Something that breaks the period: its number, and its triangles in the frame of the grid."""

    number: int
    patch: Patch


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicCity:
    """A city whose facades repeat, so that only the items before them tell where along a street one is.

    grid: its streets.
    street_angle: direction of the main street, rad, counter-clockwise from +x.
    fabric: ground and facades, in the frame of the grid.
    items: balconies, steps, rain pipes, lamp poles, signs, trees and tubs.
    """

    grid: StreetGrid
    street_angle: float
    fabric: Patch
    items: tuple[Item, ...]

    def city(self, gone: Collection[int] = ()) -> City:
        """Return the city without the items whose numbers are `gone`, and without parked cars."""
        stay = [item.patch for item in self.items if item.number not in gone]
        return city_of([self.fabric, *stay], self.grid, self.street_angle)

    def draw_gone(self, seed: Seed, share: float = 0.25) -> frozenset[int]:
        """Draw a `share` (0 to 1) of the items, rounded to whole ones; return their numbers."""
        numbers = [item.number for item in self.items]
        rng = np.random.default_rng(seed)
        return frozenset(rng.choice(numbers, round(share * len(numbers)), replace=False).tolist())


def build_periodic_city(
    seed: Seed, *, street_angle_deg: float = 31.0, grid: StreetGrid = CAMPAIGN_GRID
) -> PeriodicCity:
    """Return a city of periodic facades.

    seed: of the items; facades are the same for every seed.
    street_angle_deg: direction of the main street, degrees, counter-clockwise from +x.
    grid: the streets. If centre lines and building lines lie at multiples of 3 m, as in `CAMPAIGN_GRID`, the period
        continues beyond crossings.
    """
    rng = np.random.default_rng(seed)
    parts = [grid.ground()]
    patches: list[Patch] = []
    for side in grid.all_frontages():
        parts.append(side.placed(periodic_front(side.length), 0.0, 0.0))
        patches += [*_fittings(side, rng), *pavement(side, grid.sidewalk, rng)]
    items = tuple(Item(number, patch) for number, patch in enumerate(patches))
    return PeriodicCity(grid, math.radians(street_angle_deg), join(parts), items)


def periodic_front(length: float) -> Patch:
    """Front of `length` (m) with its roof: pilasters and columns of windows every 3 m, from x = 0 on.

    One front from corner to corner of a block, without borders between houses. Its last period is cut off
    where `length` is no multiple of 3 m.
    """
    half, window = 0.5 * PILASTER, 0.5 * (PERIOD - WINDOW)
    in_period = np.array([0.0, half, window, PERIOD - window, PERIOD - half])
    n_periods = math.ceil(length / PERIOD - 1e-9)
    columns = (PERIOD * np.arange(n_periods)[:, None] + in_period).ravel()
    depths = np.tile([-PILASTER_DEPTH, 0.0, REVEAL, 0.0, -PILASTER_DEPTH], n_periods)
    is_before_end = columns < length - 1e-9
    x_edges = np.append(columns[is_before_end], length)
    rows = [0.0, 1.1, 2.6]
    for floor in FLOORS:
        rows += [floor + 0.85, floor + 2.5]
    z_edges = np.array([*rows, HEIGHT])
    is_window_row = np.arange(len(rows)) % 2 == 1
    column_depths = depths[is_before_end]
    grid = np.where(
        (column_depths[:, None] > 0.0) & ~is_window_row, 0.0, np.repeat(column_depths[:, None], len(rows), 1)
    )
    ridge = HEIGHT + ROOF_RISE
    eave_z = HEIGHT - EAVES * ROOF_RISE / ROOF_DEPTH
    roof = [
        [-EAVES, EAVES, eave_z],
        [length + EAVES, EAVES, eave_z],
        [length - ROOF_DEPTH, -ROOF_DEPTH, ridge],
        [ROOF_DEPTH, -ROOF_DEPTH, ridge],
    ]
    return join([relief(x_edges, z_edges, grid), quads([roof], LasClass.BUILDING)])


def _fittings(side: Frontage, rng: np.random.Generator) -> Iterator[Patch]:
    """Yield balconies, steps and rain pipes at random places, which keep no period, one by one."""
    n_each = round(side.length / ITEM_SPACING)
    for x in rng.uniform(3.0, side.length - 3.0, n_each):
        yield side.placed(balcony(0.0, rng.uniform(1.0, 1.5), rng.uniform(0.9, 1.3), rng.choice(FLOORS)), x, 0.0)
    for x in rng.uniform(3.0, side.length - 3.0, n_each):
        yield side.placed(steps(0.0), x, 0.0)
    for x in rng.uniform(0.5 * PILASTER, PERIOD - 0.5 * PILASTER, n_each):
        period = PERIOD * rng.integers(0, int(side.length / PERIOD))
        yield side.placed(rain_pipe(0.0, HEIGHT), period + x, 0.0)
