"""Suburb: a winding road with houses, gardens and hedges on a slope."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation import suburb_buildings
from maxcon.lab.simulation.furniture import Patch, draw_car, join, lamp_pole
from maxcon.lab.simulation.suburb_ground import (
    BEYOND,
    GARDEN_LEFT,
    GARDEN_RIGHT,
    ResidentialRoad,
    draw_bush,
    draw_garden_tree,
    draw_hedge_row,
)

PLOT_WIDTH = (15.0, 26.0)
DRIVEWAY = 3.4  # width of the opening in a garden's boundary, m
EDGES = {"hedge": 0.55, "picket": 0.1, "wire": 0.1, "wall": 0.15, "open": 0.1}
"""Kinds of a garden's boundary to the road, and how often each occurs."""
LIKE_NEIGHBOUR = 0.5
"""How often a garden has the boundary of the one before it, which makes long hedges and open stretches."""
PARKED_LEFT, PARKED_RIGHT = 2.2, -4.0
"""Where cars stand, m to the left of the centre line: at the left kerb, and on the verge on the right."""
BAY, TREE_EVERY = 6.5, 3  # length of a parking bay, m; every third bay on the verge has a tree instead
PARKED_RATIO = 0.2  # ratio of the parking bays that is taken


def suburb_on_day(road: ResidentialRoad, scene: Sequence[int], day_seed: Sequence[int]) -> Patch:
    """Return all surfaces along `road`, city metres; the day's seed is of leaves, twigs, cars and bins."""
    day = np.random.default_rng(day_seed)
    left, right = _Side(road, GARDEN_LEFT, 1.0, math.pi), _Side(road, GARDEN_RIGHT, -1.0, 0.0)
    parts = [road.ground([*scene, 0])]
    for side, number in ((left, 2), (right, 1)):
        parts += _plots(side, np.random.default_rng([*scene, number]), day)
        parts += _back_row(side, np.random.default_rng([*scene, 2 + number]), day)
    parts += _along_kerbs(left, right, np.random.default_rng([*scene, 5]), day)
    parts += _cars(road, day)
    return join(parts)


class _Side(NamedTuple):
    """One side of the road: places are given along the road and by their distance inside the garden's border, m."""

    road: ResidentialRoad
    border: float  # where gardens begin, m to the left of the centre line
    outward: float  # 1 on the left, -1 on the right
    turn: float  # of patches whose y axis is towards the road, rad: seen along it, the left side has it on its right

    def laid(self, patch: Patch, along: float, inside: float, heading: float = 0.0) -> Patch:
        """Return `patch` bent to follow road and ground: see `ResidentialRoad.laid`."""
        return self.road.laid(patch, along, self.border + self.outward * inside, heading)

    def stood(self, patch: Patch, along: float, inside: float, turn: float = 0.0) -> Patch:
        """Return `patch` rigid and upright, its y axis towards the road, turned further by `turn` (rad)."""
        return self.road.stood(patch, along, self.border + self.outward * inside, self.turn + turn)


def _plots(side: _Side, rng: np.random.Generator, day: np.random.Generator) -> Iterator[Patch]:
    """Yield the plots on one side of the road, one after the other."""
    begin, edge = -BEYOND + rng.uniform(1.0, 8.0), "hedge"
    while begin < side.road.length + BEYOND - PLOT_WIDTH[1]:
        width = rng.uniform(*PLOT_WIDTH)
        if rng.random() > LIKE_NEIGHBOUR:
            edge = str(rng.choice(list(EDGES), p=list(EDGES.values())))
        yield from _plot(side, begin, width, edge, rng, day)
        begin += width


def _plot(
    side: _Side, begin: float, width: float, edge: str, rng: np.random.Generator, day: np.random.Generator
) -> Iterator[Patch]:
    """Yield a garden with its boundary, house, sheds, plants, car and bin."""
    driveway = begin + (0.6 if rng.random() < 0.5 else width - DRIVEWAY - 0.6)
    for start, end in ((begin, driveway), (driveway + DRIVEWAY, begin + width)):
        if end - start > 1.0 and edge != "open":
            yield side.laid(_bound(edge, end - start, rng, day), start, 0.35)
            yield side.laid(suburb_buildings.draw_weeds(end - start, day), start, 0.1)
    yield side.laid(suburb_buildings.draw_mail_box(rng), driveway - 0.3, 0.2)
    yield from _between_gardens(side, begin, rng, day)
    setback = rng.uniform(5.0, 13.0)
    house, house_width, depth = suburb_buildings.draw_house(rng, day)
    turn = rng.normal(0.0, math.radians(9.0)) + (0.5 * math.pi if rng.random() < 0.12 else 0.0)
    middle = begin + 0.5 * width + rng.uniform(-1.5, 1.5)
    yield side.stood(house.placed(-0.5 * house_width, 0.0), middle, setback, turn)
    if rng.random() < 0.55:
        garage = suburb_buildings.draw_shed(rng, is_garage=True).placed(-1.6, 0.0)
        yield side.stood(garage, driveway + 0.5 * DRIVEWAY, rng.uniform(3.0, 9.0), rng.normal(0.0, 0.03))
    if rng.random() < 0.4:
        shed = suburb_buildings.draw_shed(rng, is_garage=False)
        yield side.stood(shed, begin + rng.uniform(1.0, width - 3.0), setback + depth + rng.uniform(3.0, 8.0), turn)
    for _ in range(int(rng.integers(4, 12))):
        yield side.laid(draw_bush(rng, day), begin + rng.uniform(0.8, width - 0.8), rng.uniform(0.9, setback))
    for _ in range(int(rng.integers(1, 5))):
        tree = draw_garden_tree(rng, day, rng.uniform(3.0, 8.0))
        yield side.laid(tree, begin + rng.uniform(1.0, width - 1.0), rng.uniform(1.2, setback))
    if day.random() < 0.3:
        yield side.laid(draw_car(day)[0], driveway + 0.5 * DRIVEWAY, 3.0, 0.5 * math.pi)
    if day.random() < 0.5:
        yield side.laid(suburb_buildings.draw_bin(day), driveway + day.uniform(0.0, 0.8), day.uniform(-0.5, 1.5))


def _bound(edge: str, length: float, rng: np.random.Generator, day: np.random.Generator) -> Patch:
    """Return a garden's boundary to the road, of kind `edge` and of `length` (m) along x."""
    if edge == "picket":
        return suburb_buildings.draw_picket_fence(length, rng)
    if edge == "wire":
        bushes = [draw_bush(rng, day).placed(x, 0.0) for x in np.arange(0.5, length, rng.uniform(1.2, 3.0))]
        return join([suburb_buildings.draw_wire_fence(length, rng), *bushes])
    if edge == "wall":
        wall = suburb_buildings.draw_garden_wall(length, rng)
        return wall if rng.random() < 0.4 else join([wall, draw_hedge_row(length, rng.uniform(0.9, 1.6), rng, day)])
    return draw_hedge_row(length, rng.uniform(1.3, 2.4), rng, day)


def _between_gardens(side: _Side, along: float, rng: np.random.Generator, day: np.random.Generator) -> Iterator[Patch]:
    """Yield a hedge or a fence, or neither, between two gardens, which runs away from the road and hides houses."""
    kind, length = rng.random(), rng.uniform(8.0, 20.0)
    away = 0.5 * math.pi * side.outward
    if kind < 0.55:
        yield side.laid(draw_hedge_row(length, rng.uniform(1.2, 2.3), rng, day), along, 0.5, away)
    elif kind < 0.8:
        yield side.laid(suburb_buildings.draw_picket_fence(length, rng), along, 0.5, away)


def _back_row(side: _Side, rng: np.random.Generator, day: np.random.Generator) -> Iterator[Patch]:
    """Yield trees in the gardens behind the houses, and houses of the next road."""
    length = side.road.length
    for along in np.arange(-BEYOND, length + BEYOND, 9.0):
        tree = draw_garden_tree(rng, day, rng.uniform(5.0, 12.0))
        yield side.laid(tree, along + rng.uniform(-4.0, 4.0), rng.uniform(22.0, 36.0))
    for along in np.arange(-BEYOND + 15.0, length + BEYOND - 15.0, 34.0):
        house, _, _ = suburb_buildings.draw_house(rng, day)
        yield side.stood(house, along + rng.uniform(-6.0, 6.0), rng.uniform(26.0, 30.0), rng.normal(0.0, 0.2))


def _along_kerbs(left: _Side, right: _Side, rng: np.random.Generator, day: np.random.Generator) -> Iterator[Patch]:
    """Yield lamp posts on the left, and trees on the verge on the right."""
    for along in np.arange(-BEYOND + rng.uniform(3.0, 20.0), left.road.length + BEYOND, 38.0):
        yield left.stood(lamp_pole(), along, -0.25)
    for along in _bays(left.road)[TREE_EVERY - 1 :: TREE_EVERY]:
        if rng.random() < 0.7:
            yield right.stood(draw_garden_tree(rng, day, rng.uniform(4.0, 8.0)), along, -2.4)


def _bays(road: ResidentialRoad) -> NDArray[np.float64]:
    """Distance along the road of the middle of each parking bay, m."""
    return np.arange(-BEYOND + 5.0, road.length + BEYOND - 5.0, BAY)


def _cars(road: ResidentialRoad, day: np.random.Generator) -> Iterator[Patch]:
    """Yield the parked cars of a day; one in four faces the other way."""
    for left in (PARKED_LEFT, PARKED_RIGHT):
        for number, along in enumerate(_bays(road)):
            car, _ = draw_car(day)
            turn = day.normal(0.0, math.radians(1.5)) + (math.pi if day.random() < 0.25 else 0.0)
            place = along + day.uniform(-0.6, 0.6), left + day.normal(0.0, 0.1)
            is_for_tree = left == PARKED_RIGHT and number % TREE_EVERY == TREE_EVERY - 1
            if day.random() < PARKED_RATIO and not is_for_tree:
                yield road.laid(car, *place, turn)
