"""Streets of the simulated city, and lines through them: the circuit of the campaign, the small city's crossing."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.lab.simulation.drive import Circuit, Route, distances_along, interpolated
from maxcon.lab.simulation.furniture import LasClass, Patch, boxes, join, quads

KERB_HEIGHT = 0.12  # height of blocks and sidewalks above the carriageway, m


class Block(NamedTuple):
    """A rectangle of ground between streets, in the frame of the grid, m."""

    u_low: float
    u_high: float
    v_low: float
    v_high: float


class Frontage(NamedTuple):
    """A side of a block: x runs along the building line and y out to the street, m."""

    u: float  # of the origin on the building line, frame of the grid, m
    v: float
    heading: float  # of x in the frame of the grid, rad
    length: float  # m

    def placed(self, patch: Patch, along: float, out: float) -> Patch:
        """Return `patch`, turned with the frontage, its origin at x = `along`, y = `out` (m), in the grid's frame."""
        return patch.placed(*self.point(along, out), KERB_HEIGHT, self.heading)

    def local(self, patch: Patch) -> Patch:
        """Return `patch`, in the grid's frame, in that of the frontage."""
        return patch.placed(-self.u, -self.v, -KERB_HEIGHT).placed(0.0, 0.0, heading=-self.heading)

    def point(self, along: float, out: float) -> tuple[float, float]:
        """Return (u, v) of the point x = `along`, y = `out` of the frontage, m."""
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        return self.u + along * cosine - out * sine, self.v + along * sine + out * cosine


class StreetGrid(NamedTuple):
    """Straight streets that cross at right angles; lengths in m."""

    u_lines: tuple[float, ...]  # where streets cross the main street, rising; contains 0
    v_lines: tuple[float, ...]  # where streets cross the cross street, rising; contains 0
    carriageway: float = 5.0  # from a centre line to its kerb: a lane and a row of parked cars
    sidewalk: float = 2.75  # from the kerb to the building line
    no_parking: float = 9.0  # from the corner of a block to its first parked car
    margin: float = 45.0  # how far the city continues beyond the outermost streets

    @property
    def half_width(self) -> float:
        """From a street's centre line to the building line, m."""
        return self.carriageway + self.sidewalk

    def ends(self, lines: tuple[float, ...]) -> tuple[float, float]:
        """Where the city ends before and behind the streets at `lines`, m."""
        return lines[0] - self.margin, lines[-1] + self.margin

    def blocks(self, gap: float | None = None) -> list[Block]:
        """Return all blocks, `gap` (m) from the centre lines of the streets around; if None, up to building lines."""
        away = self.half_width if gap is None else gap
        return [Block(*u, *v) for u in self._intervals(self.u_lines, away) for v in self._intervals(self.v_lines, away)]

    def frontages(self) -> list[Frontage]:
        """Return the sides of all blocks along streets; houses at corners belong to the sides along u."""
        sides = []
        for u_low, u_high, v_low, v_high in self.blocks():
            along_u, along_v = u_high - u_low, v_high - v_low
            if v_low > self.v_lines[0]:
                sides.append(Frontage(u_high, v_low, math.pi, along_u))
            if v_high < self.v_lines[-1]:
                sides.append(Frontage(u_low, v_high, 0.0, along_u))
            if u_low > self.u_lines[0]:
                sides.append(Frontage(u_low, v_low, 0.5 * math.pi, along_v))
            if u_high < self.u_lines[-1]:
                sides.append(Frontage(u_high, v_high, -0.5 * math.pi, along_v))
        return sides

    def ground(self) -> Patch:
        """Return carriageways at z = 0, and blocks with their sidewalks one kerb higher."""
        (u0, u1), (v0, v1) = self.ends(self.u_lines), self.ends(self.v_lines)
        carriageway = quads([[[u0, v0, 0.0], [u1, v0, 0.0], [u1, v1, 0.0], [u0, v1, 0.0]]], LasClass.GROUND)
        raised = self.blocks(self.carriageway)
        lows = [[block.u_low, block.v_low, -0.1] for block in raised]
        highs = [[block.u_high, block.v_high, KERB_HEIGHT] for block in raised]
        return join([carriageway, boxes(lows, highs, LasClass.GROUND)])

    def _intervals(self, lines: tuple[float, ...], gap: float) -> list[tuple[float, float]]:
        """Return the intervals between streets, from margin to margin of the city, `gap` from each centre line, m."""
        begin, end = self.ends(lines)
        starts, ends = [begin, *(line + gap for line in lines)], [*(line - gap for line in lines), end]
        return list(zip(starts, ends, strict=True))


def in_city(places: NDArray[np.float64], street_angle: float) -> NDArray[np.float64]:
    """Return places (u, v) in the frame of a grid, shape (..., 2), as (x, y) in that of its city, m."""
    cosine, sine = math.cos(street_angle), math.sin(street_angle)
    return np.asarray(places @ np.array([[cosine, sine], [-sine, cosine]]))


STREET_ANGLE = math.radians(31.0)
"""Direction of the main street of a city, rad, counter-clockwise from +x: nothing is parallel to an axis."""
DEMO_GRID = StreetGrid(u_lines=(-150.0, 0.0, 110.0), v_lines=(-95.0, 0.0, 100.0))
"""Streets so far apart that they look endless."""
CAMPAIGN_GRID = StreetGrid(
    u_lines=(-150.0, -66.0, 0.0, 81.0, 156.0), v_lines=(-144.0, -81.0, 0.0, 69.0, 147.0), carriageway=4.2, sidewalk=1.8,
    no_parking=7.0, margin=60.0,
)  # fmt: skip
"""Dense blocks and narrow streets; centre lines and building lines lie at multiples of 3 m."""
LANE = 0.9  # distance of the circuit to the right of the centre line, m
CAMPAIGN_CORNERS = (
    (0, 0), (3, 0), (3, 1), (4, 1), (4, 3), (2, 3), (2, 4), (1, 4), (1, 2), (0, 2),
)  # fmt: skip
"""Where the campaign turns: crossings of `CAMPAIGN_GRID`, as indices into its u_lines and v_lines."""
STEP = 0.05  # between two points of a route or a circuit, m
LEFT_RADIUS, RIGHT_RADIUS = 9.0, 6.0
"""Radii of turns, m: traffic keeps to the right, so that a right turn is the narrow one."""
EASING = 1.0  # standard deviation, m, of the Gaussian that smooths the line, so that curvature comes and goes gradually
START = 42.0  # how far behind its first corner a circuit begins, m


def circuit_through(street_angle: float = STREET_ANGLE) -> Circuit:
    """Return the circuit of the campaign, driven in the right lane, with its main street in this direction, rad."""
    grid = CAMPAIGN_GRID
    places = np.array([[grid.u_lines[i], grid.v_lines[j]] for i, j in CAMPAIGN_CORNERS])
    ways = np.roll(places, -1, axis=0) - places
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways_before = np.roll(ways, 1, axis=0)
    to_right = np.array([[0.0, -1.0], [1.0, 0.0]])
    vertices = places + LANE * (ways @ to_right + ways_before @ to_right)
    arcs = [_arc(*of_corner) for of_corner in zip(vertices, ways_before, ways, strict=True)]
    points = _eased(_evenly(np.concatenate([*arcs, arcs[0][:1]])))
    first = np.argmin(np.linalg.norm(points - (vertices[0] + START * ways[0]), axis=1))
    points = np.roll(points[:-1], -first, axis=0)
    points = np.concatenate([points, points[:1]])
    turns = np.array([_nearest(points, arc[[0, -1]]) for arc in arcs])
    crossings = np.sort(_nearest(points, _straight_over(CAMPAIGN_CORNERS, grid)))
    return Circuit(in_city(points, street_angle), turns[np.argsort(turns[:, 0])], crossings)


def _arc(vertex: NDArray[np.float64], way_in: NDArray[np.float64], way_out: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quarter of a circle that leaves one street before `vertex` and meets the other behind it."""
    is_left = way_in[0] * way_out[1] - way_in[1] * way_out[0] > 0.0
    radius = LEFT_RADIUS if is_left else RIGHT_RADIUS
    angles = np.linspace(0.0, 0.5 * math.pi, 1 + math.ceil(0.5 * math.pi * radius / STEP))
    center = vertex + radius * (way_out - way_in)
    return np.asarray(center + radius * (np.outer(np.sin(angles), way_in) - np.outer(np.cos(angles), way_out)))


def _evenly(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same closed line, shape (k, 2), with points spaced evenly by about `STEP`."""
    distances = distances_along(outline)
    return interpolated(np.linspace(0.0, distances[-1], 1 + round(distances[-1] / STEP)), distances, outline)


def _eased(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a closed line smoothed by a Gaussian, so that its curvature has no steps."""
    reach = round(4.0 * EASING / STEP)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP / EASING) ** 2)
    weights /= weights.sum()
    around = np.pad(points[:-1], ((reach, reach), (0, 0)), mode="wrap")
    eased = np.stack([np.convolve(column, weights, mode="valid") for column in around.T], axis=1)
    return _evenly(np.concatenate([eased, eased[:1]]))


def _nearest(points: NDArray[np.float64], places: ArrayLike) -> NDArray[np.float64]:
    """Distance along the line of `points`, m, of the point nearest to each place."""
    step = float(np.linalg.norm(points[1] - points[0]))
    rows = [np.argmin(np.linalg.norm(points[:-1] - place, axis=1)) for place in np.asarray(places)]
    return np.asarray(rows, dtype=np.float64) * step


def _straight_over(corners: Sequence[tuple[int, int]], grid: StreetGrid) -> list[tuple[float, float]]:
    """Crossings (u, v) passed between successive corners, frame of the grid, m."""
    found = []
    for (i0, j0), (i1, j1) in pairwise([*corners, corners[0]]):
        n_steps = abs(i1 - i0) + abs(j1 - j0)
        for k in range(1, n_steps):
            i, j = i0 + k * (i1 - i0) // n_steps, j0 + k * (j1 - j0) // n_steps
            found.append((grid.u_lines[i], grid.v_lines[j]))
    return found


def route_over_crossing(street_angle: float, before: float, after: float, lane: float = 1.5) -> Route:
    """Return a route that turns left from the main street, `before` to `after` (m) of the crossing's middle."""
    reach = LEFT_RADIUS - lane
    if not (before > reach and after > reach):
        raise OptionError(
            f"Expected a route of more than {reach:g} m before and after the crossing, got {before} m and"
            f" {after} m. Take 75 m and 50 m?"
        )
    u = np.arange(-before, -reach, STEP)
    turn = np.arange(0.0, 0.5 * math.pi, STEP / LEFT_RADIUS)
    v = np.arange(reach, after, STEP)
    arc = np.column_stack([LEFT_RADIUS * np.sin(turn) - reach, -LEFT_RADIUS * np.cos(turn) + reach])
    there, on = np.column_stack([u, np.full(len(u), -lane)]), np.column_stack([np.full(len(v), lane), v])
    return Route(in_city(np.concatenate([there, arc, on]), street_angle), stop_at=before - reach)
