"""City: a grid of streets with houses, furniture and parked cars, as triangles; and a strictly periodic one."""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation import furniture
from maxcon.lab.simulation.drive import Seed
from maxcon.lab.simulation.facades import HOUSE_DEPTH, balcony, draw_town_house, rain_pipe, relief, steps
from maxcon.lab.simulation.months import Months
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, DEMO_GRID, STREET_ANGLE, Frontage, StreetGrid, in_city

HOUSE_WIDTH = 13.0  # typical width of a house along the street, m
CAR_SIDE = 1.05  # from the kerb to the middle of a parked car, m


@dataclass(frozen=True, slots=True, eq=False)
class City(furniture.Patch):
    """Triangles with classes in city metres: z is up, the main crossing is the origin. Parked cars come last."""

    parking_lanes: NDArray[np.float64]  # (k, 2, 2): start and end (x, y) of each row of parked cars, m

    def with_parked_cars(self, seed: Seed, occupancy: float = 0.7) -> "City":
        """Return the same city on another day: other cars take about `occupancy`, 0 to 1, of the parking lanes."""
        rng = np.random.default_rng(seed)
        cars = [car for lane in self.parking_lanes for car in _cars_along(lane, occupancy, rng)]
        stays = self.classes != furniture.LasClass.VEHICLE
        fixed = furniture.Patch(self.corners[stays], self.classes[stays])
        patch = furniture.join([fixed, *cars])
        return City(patch.corners, patch.classes, self.parking_lanes)


def build_city(seed: Seed, grid: StreetGrid = DEMO_GRID, months: Months | None = None) -> City:
    """Return a city without parked cars; the same seed gives the same city. `months` may have changed it since."""
    rng = np.random.default_rng(seed)
    parts = [grid.ground()]
    for side in grid.frontages():
        built = [*_houses(side, rng), *_pavement(side, grid.sidewalk, rng)]
        parts += built if months is None else months.along(side, built, grid)
    return _city_of(parts, grid)


def _city_of(parts: Sequence[furniture.Patch], grid: StreetGrid) -> City:
    """Return the city made of `parts`, in the frame of the grid, without parked cars."""
    out = grid.sidewalk + CAR_SIDE
    lanes = np.array(
        [[side.point(x, out) for x in (grid.no_parking, side.length - grid.no_parking)] for side in grid.frontages()]
    )
    whole = furniture.join(parts).placed(0.0, 0.0, heading=STREET_ANGLE)
    return City(whole.corners, whole.classes, in_city(lanes, STREET_ANGLE))


def _houses(side: Frontage, rng: np.random.Generator) -> Iterator[furniture.Patch]:
    """Yield a row of houses along a frontage: with different setbacks, a gap and sometimes a front garden."""
    runs_along_u = abs(math.sin(side.heading)) < 0.5
    start = 0.0 if runs_along_u else HOUSE_DEPTH
    length = side.length - 2.0 * start
    n_houses = max(2, round(length / HOUSE_WIDTH))
    parts = rng.uniform(0.7, 1.3, n_houses)
    edges = start + np.concatenate([[0.0], np.cumsum(parts)]) * length / parts.sum()
    gap_after, garden = rng.integers(1, n_houses - 1, 2) if n_houses > 3 else (-1, -1)
    has_garden = rng.random() < 0.4
    for i in range(n_houses):
        is_first, is_last = runs_along_u and i == 0, runs_along_u and i == n_houses - 1
        setback = 0.0 if is_first or is_last else _setback(rng, has_garden=has_garden and i == garden)
        width = edges[i + 1] - edges[i] - (3.2 if i == gap_after else 0.0)
        house = draw_town_house(width, rng, shows_left=is_first, shows_right=is_last)
        yield side.placed(house, edges[i], -setback)
        if setback > 1.0:
            yield side.placed(furniture.draw_hedge(0.4 * width, rng), edges[i] + 0.25 * width, -0.6)


def _setback(rng: np.random.Generator, *, has_garden: bool) -> float:
    """How far a front stands behind the building line, m: mostly centimetres."""
    if has_garden:
        return float(rng.uniform(1.3, 2.0))
    return float(rng.uniform(0.0, 0.12) if rng.random() < 0.7 else rng.uniform(0.15, 0.6))


def _pavement(side: Frontage, sidewalk: float, rng: np.random.Generator) -> Iterator[furniture.Patch]:
    """Yield lamp poles, trees and signs along the kerb and tubs with bushes along the houses, one by one."""
    for x in np.arange(12.0 + rng.uniform(0.0, 8.0), side.length - 8.0, 28.0):
        yield side.placed(furniture.lamp_pole(), x, sidewalk - 0.4)
    for x in np.arange(18.0 + rng.uniform(0.0, 6.0), side.length - 12.0, 17.0):
        if rng.random() < 0.45:
            yield side.placed(furniture.draw_tree(rng), x + rng.uniform(-2.0, 2.0), sidewalk - 0.7)
    for x in rng.uniform(10.0, side.length - 10.0, int(side.length / 30.0)):
        yield side.placed(furniture.draw_hedge(1.2, rng), x, 0.5)
    for x in (3.0, side.length - 3.0, *rng.uniform(10.0, side.length - 10.0, int(side.length / 35.0))):
        yield side.placed(furniture.draw_sign(rng), x, sidewalk - 0.35)


def _cars_along(lane: NDArray[np.float64], occupancy: float, rng: np.random.Generator) -> Iterator[furniture.Patch]:
    """Yield parked cars along a lane, shape (2, 2), m, each a little off its line; one in four faces the other way."""
    (x0, y0), (x1, y1) = lane
    length, heading = math.hypot(x1 - x0, y1 - y0), math.atan2(y1 - y0, x1 - x0)
    side = Frontage(x0, y0, heading, length)
    along = rng.uniform(0.0, 3.0)
    while True:
        car, size = furniture.draw_car(rng)
        place = along + 0.5 * size
        along += size + rng.uniform(0.5, 1.3)
        if along > length:
            return
        if rng.random() <= occupancy:
            x, y = side.point(place, rng.normal(0.0, 0.07))
            turn = heading + rng.normal(0.0, math.radians(1.0)) + (math.pi if rng.random() < 0.25 else 0.0)
            yield car.placed(x, y, heading=turn)


PERIOD = 3.0  # of all facades, m
PILASTER, PILASTER_DEPTH = 0.5, 0.2
"""Width and how far it stands out, m: a pilaster on each border of a period, from the ground to the eaves."""
WINDOW, REVEAL = 1.2, 0.18  # width and depth behind the wall, m: a column of windows in the middle of each period
FLOORS = (3.7, 7.0, 10.3)  # heights of the upper floors, m
HEIGHT = 13.8  # of the eaves, m
ROOF_DEPTH, ROOF_RISE, EAVES = 6.0, 4.2, 0.35
ITEM_SPACING = 14.0
"""Mean distance along a frontage from one balcony to the next, m; the same for steps and for rain pipes."""
GONE = 0.25  # ratio of the items that is removed from one day to the other


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicCity:
    """A city whose facades repeat, so that only the items before them tell where along a street one is."""

    grid: StreetGrid  # its streets
    fabric: furniture.Patch  # ground and facades, in the frame of the grid
    # Balconies, steps, rain pipes, lamp poles, signs, trees and tubs, in the frame of the grid
    items: tuple[furniture.Patch, ...]

    def city(self, gone: Collection[int] = ()) -> City:
        """Return the city without the items whose numbers are `gone`, and without parked cars."""
        stay = [item for number, item in enumerate(self.items) if number not in gone]
        return _city_of([self.fabric, *stay], self.grid)

    def draw_gone(self, seed: Seed) -> frozenset[int]:
        """Draw a quarter of the items; return their numbers."""
        n_items = len(self.items)
        return frozenset(np.random.default_rng(seed).choice(n_items, round(GONE * n_items), replace=False).tolist())


def build_periodic_city(seed: Seed, grid: StreetGrid = CAMPAIGN_GRID) -> PeriodicCity:
    """Return a city of periodic facades, the same for every seed; its items are drawn."""
    # The period continues beyond crossings if, as here, all lines of the grid lie at multiples of 3 m.
    rng = np.random.default_rng(seed)
    parts = [grid.ground()]
    items: list[furniture.Patch] = []
    for side in grid.frontages():
        parts.append(side.placed(periodic_front(side.length), 0.0, 0.0))
        items += [*_fittings(side, rng), *_pavement(side, grid.sidewalk, rng)]
    return PeriodicCity(grid, furniture.join(parts), tuple(items))


def periodic_front(length: float) -> furniture.Patch:
    """Front of `length` (m) with its roof: pilasters and columns of windows every 3 m, from x = 0 on.

    One front from corner to corner of a block, without borders between houses. Its last period is cut off
    where `length` is no multiple of 3 m.
    """
    half, window = 0.5 * PILASTER, 0.5 * (PERIOD - WINDOW)
    in_period = np.array([0.0, half, window, PERIOD - window, PERIOD - half])
    n_periods = math.ceil(length / PERIOD - 1e-9)
    columns = (PERIOD * np.arange(n_periods)[:, None] + in_period).ravel()
    is_before_end = columns < length - 1e-9
    x_edges = np.append(columns[is_before_end], length)
    rows = [0.0, 1.1, 2.6, *(floor + edge for floor in FLOORS for edge in (0.85, 2.5))]
    depths = np.tile([-PILASTER_DEPTH, 0.0, REVEAL, 0.0, -PILASTER_DEPTH], n_periods)[is_before_end, None]
    is_window_row = np.arange(len(rows)) % 2 == 1
    grid = np.where((depths > 0.0) & ~is_window_row, 0.0, depths)
    ridge, eave_z = HEIGHT + ROOF_RISE, HEIGHT - EAVES * ROOF_RISE / ROOF_DEPTH
    roof = [
        [-EAVES, EAVES, eave_z],
        [length + EAVES, EAVES, eave_z],
        [length - ROOF_DEPTH, -ROOF_DEPTH, ridge],
        [ROOF_DEPTH, -ROOF_DEPTH, ridge],
    ]
    return furniture.join(
        [relief(x_edges, np.array([*rows, HEIGHT]), grid), furniture.quads([roof], furniture.LasClass.BUILDING)]
    )


def _fittings(side: Frontage, rng: np.random.Generator) -> Iterator[furniture.Patch]:
    """Yield balconies, steps and rain pipes at random places, which keep no period, one by one."""
    n_each = round(side.length / ITEM_SPACING)
    for x in rng.uniform(3.0, side.length - 3.0, n_each):
        yield side.placed(balcony(0.0, rng.uniform(1.0, 1.5), rng.uniform(0.9, 1.3), rng.choice(FLOORS)), x, 0.0)
    for x in rng.uniform(3.0, side.length - 3.0, n_each):
        yield side.placed(steps(0.0), x, 0.0)
    for x in rng.uniform(0.5 * PILASTER, PERIOD - 0.5 * PILASTER, n_each):
        period = PERIOD * rng.integers(0, int(side.length / PERIOD))
        yield side.placed(rain_pipe(0.0, HEIGHT), period + x, 0.0)
