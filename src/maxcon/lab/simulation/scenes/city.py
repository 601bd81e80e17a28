# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""City: a seeded inner city as triangles with classes; other cars are parked on other days."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.scenes.facades import HOUSE_DEPTH, draw_style, house
from maxcon.lab.simulation.scenes.furniture import draw_car, draw_hedge, draw_sign, draw_tree, lamp_pole
from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import Patch, join
from maxcon.lab.simulation.scenes.street_grid import Frontage, StreetGrid, in_city
from maxcon.lab.simulation.seed import Seed

__all__ = ["City", "build_city", "city_of", "pavement"]

HOUSE_WIDTH = 13.0
"""Typical width of a house along the street, m."""
CAR_SIDE = 1.05
"""From the kerb to the middle of a parked car, m."""


@dataclass(frozen=True, slots=True, eq=False)
class City:
    """Triangles with classes in city metres: z is up, the main crossing is the origin.

    vertices: shape (v, 3); m.
    triangles: shape (t, 3), int32; rows of `vertices`. Parked cars come last.
    classes: shape (t,), uint8; LasClass of each triangle.
    street_lines: shape (k, 2, 2); start and end (x, y) of each street's centre line, m; the main street is the first,
        the cross street the second.
    parking_lanes: shape (k, 2, 2); start and end (x, y) of each row of parked cars, m.
    street_angle: direction of the main street, rad, counter-clockwise from +x.
    car_numbers: shape (t,), int32; number of the parked car that each triangle belongs to, from 0; -1 for all that is
        no parked car.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    classes: NDArray[np.uint8]
    street_lines: NDArray[np.float64]
    parking_lanes: NDArray[np.float64]
    street_angle: float
    car_numbers: NDArray[np.int32]

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of each triangle, shape (t, 3, 3), m."""
        return self.vertices[self.triangles]

    def with_parked_cars(self, seed: Seed, occupancy: float = 0.7) -> "City":
        """Return the same city on another day: other cars stand at the kerbs.

        seed: the same seed gives the same cars.
        occupancy: approximate share of the parking lanes that is taken, 0 to 1.
        """
        rng = np.random.default_rng(seed)
        cars = [car for lane in self.parking_lanes for car in _cars_along(lane, occupancy, rng)]
        stays = self.classes != LasClass.VEHICLE
        return _city(Patch(self.corners[stays], self.classes[stays]), cars, self)


def build_city(seed: Seed, *, street_angle_deg: float = 31.0, grid: StreetGrid | None = None) -> City:
    """Return a city without parked cars.

    seed: the same seed gives the same city.
    street_angle_deg: direction of the main street, degrees, counter-clockwise from +x; by default nothing is parallel
        to an axis.
    grid: where its streets are; those of the demo if None.
    """
    streets = grid or StreetGrid()
    rng = np.random.default_rng(seed)
    parts = [streets.ground()]
    for side in streets.all_frontages():
        parts += [*_houses(side, rng), *pavement(side, streets.sidewalk, rng)]
    return city_of(parts, streets, math.radians(street_angle_deg))


def city_of(parts: Sequence[Patch], grid: StreetGrid, street_angle: float) -> City:
    """Return the city made of `parts`, without parked cars.

    parts: ground, houses and street furniture, in the frame of the grid.
    grid: its streets.
    street_angle: direction of the main street, rad, counter-clockwise from +x.
    """
    out = grid.sidewalk + CAR_SIDE
    lanes = np.array(
        [
            [side.point(x, out) for x in (grid.no_parking, side.length - grid.no_parking)]
            for side in grid.all_frontages()
        ]
    )
    whole = join(parts).placed(0.0, 0.0, heading=street_angle)
    bare = City(
        np.empty((0, 3)),
        np.empty((0, 3), np.int32),
        np.empty(0, np.uint8),
        in_city(grid.centre_lines(), street_angle),
        in_city(lanes, street_angle),
        street_angle,
        np.empty(0, np.int32),
    )
    return _city(whole, [], bare)


def _city(fixed: Patch, cars: Sequence[Patch], like: City) -> City:
    """Return the city of `fixed` parts and parked cars, with streets and parking lanes of `like`."""
    patch = join([fixed, *cars])
    numbers = np.repeat(np.arange(-1, len(cars), dtype=np.int32), [len(fixed), *map(len, cars)])
    vertices = patch.corners.reshape(-1, 3)
    triangles = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    return City(vertices, triangles, patch.classes, like.street_lines, like.parking_lanes, like.street_angle, numbers)


def _houses(side: Frontage, rng: np.random.Generator) -> Iterator[Patch]:
    """Yield a row of houses along a frontage: with different setbacks, a gap and sometimes a front garden."""
    runs_along_u = abs(math.sin(side.heading)) < 0.5
    start = 0.0 if runs_along_u else HOUSE_DEPTH
    length = side.length - 2.0 * start
    n_houses = max(2, round(length / HOUSE_WIDTH))
    shares = rng.uniform(0.7, 1.3, n_houses)
    edges = start + np.concatenate([[0.0], np.cumsum(shares)]) * length / shares.sum()
    gap_after, garden = rng.integers(1, n_houses - 1, 2) if n_houses > 3 else (-1, -1)
    has_garden = rng.random() < 0.4
    for i in range(n_houses):
        is_corner = runs_along_u and i in (0, n_houses - 1)
        setback = 0.0 if is_corner else _setback(rng, has_garden=has_garden and i == garden)
        width = edges[i + 1] - edges[i] - (3.2 if i == gap_after else 0.0)
        building = house(
            draw_style(width, rng),
            rng,
            shows_left=runs_along_u and i == 0,
            shows_right=runs_along_u and i == n_houses - 1,
        )
        yield side.placed(building, edges[i], -setback)
        if setback > 1.0:
            yield side.placed(draw_hedge(0.4 * width, rng), edges[i] + 0.25 * width, -0.6)


def _setback(rng: np.random.Generator, *, has_garden: bool) -> float:
    """How far a front stands behind the building line, m: mostly centimetres."""
    if has_garden:
        return float(rng.uniform(1.3, 2.0))
    return float(rng.uniform(0.0, 0.12) if rng.random() < 0.7 else rng.uniform(0.15, 0.6))


def pavement(side: Frontage, sidewalk: float, rng: np.random.Generator) -> Iterator[Patch]:
    """Yield lamp poles, trees and signs along the kerb and tubs with bushes along the houses, one by one.

    side: what they stand along.
    sidewalk: from the kerb to the building line, m.
    rng: draws places and sizes.
    """
    for x in np.arange(12.0 + rng.uniform(0.0, 8.0), side.length - 8.0, 28.0):
        yield side.placed(lamp_pole(), x, sidewalk - 0.4)
    for x in np.arange(18.0 + rng.uniform(0.0, 6.0), side.length - 12.0, 17.0):
        if rng.random() < 0.45:
            yield side.placed(draw_tree(rng), x + rng.uniform(-2.0, 2.0), sidewalk - 0.7)
    for x in rng.uniform(10.0, side.length - 10.0, int(side.length / 30.0)):
        yield side.placed(draw_hedge(1.2, rng), x, 0.5)
    for x in (3.0, side.length - 3.0, *rng.uniform(10.0, side.length - 10.0, int(side.length / 35.0))):
        yield side.placed(draw_sign(rng), x, sidewalk - 0.35)


def _cars_along(lane: NDArray[np.float64], occupancy: float, rng: np.random.Generator) -> Iterator[Patch]:
    """Yield parked cars along a lane, shape (2, 2), m, each a little off its line; one in four faces the other way."""
    (x0, y0), (x1, y1) = lane
    length, heading = math.hypot(x1 - x0, y1 - y0), math.atan2(y1 - y0, x1 - x0)
    along = rng.uniform(0.0, 3.0)
    while True:
        car, size = draw_car(rng)
        place = along + 0.5 * size
        along += size + rng.uniform(0.5, 1.3)
        if along > length:
            return
        if rng.random() > occupancy:
            continue
        out = rng.normal(0.0, 0.07)
        turn = heading + rng.normal(0.0, math.radians(1.0)) + (math.pi if rng.random() < 0.25 else 0.0)
        x = x0 + place * math.cos(heading) - out * math.sin(heading)
        y = y0 + place * math.sin(heading) + out * math.cos(heading)
        yield car.placed(x, y, heading=turn)
