# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Circuit: a closed line through the streets of the campaign, straight over some crossings, with turns at others."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.lab.simulation.scenes.street_grid import CAMPAIGN_GRID, StreetGrid, in_city

__all__ = ["CAMPAIGN_CORNERS", "Circuit", "circuit_through"]

STEP = 0.05
"""Between two points of a circuit, m."""
LEFT_RADIUS, RIGHT_RADIUS = 9.0, 6.0
"""Radii of turns, m: traffic keeps to the right, so that a right turn is the narrow one."""
EASING = 1.0
"""Standard deviation, m, of the Gaussian that smooths the line, so that curvature comes and goes gradually."""
START = 42.0
"""How far behind its first corner a circuit begins, m."""

CAMPAIGN_CORNERS = (
    (0, 0), (3, 0), (3, 1), (4, 1), (4, 3), (2, 3), (2, 4), (1, 4), (1, 2), (0, 2),
)  # fmt: skip
"""Where the campaign turns: crossings of `CAMPAIGN_GRID`, as indices into its u_lines and v_lines."""


@dataclass(frozen=True, slots=True, eq=False)
class Circuit:
    """A closed line along streets; its last point equals the first.

    points: shape (k, 2); (x, y) evenly spaced, about 5 cm apart, city metres.
    turns: shape (n, 2); distance along the line at which each turn begins and ends, m, rising.
    crossings: shape (m,); distance along the line of each crossing that it passes straight over, m, rising.
    """

    points: NDArray[np.float64]
    turns: NDArray[np.float64]
    crossings: NDArray[np.float64]

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each point along the line, shape (k,), m."""
        return np.linspace(0.0, self.length, len(self.points))

    @property
    def length(self) -> float:
        """Length of one round, m."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vector of travel at each point, shape (k, 2); the last equals the first."""
        around = np.concatenate([self.points[-2:-1], self.points, self.points[1:2]])
        ways = around[2:] - around[:-2]
        return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))

    @property
    def headings(self) -> NDArray[np.float64]:
        """Direction of travel at each point, shape (k,), rad from +x, without jumps at pi."""
        return np.unwrap(np.arctan2(self.directions[:, 1], self.directions[:, 0]))


def circuit_through(
    corners: Sequence[tuple[int, int]] = CAMPAIGN_CORNERS,
    grid: StreetGrid = CAMPAIGN_GRID,
    street_angle: float = 0.0,
    lane: float = 0.9,
) -> Circuit:
    """Return the circuit that turns at `corners`, driven in the right lane.

    corners: indices into `grid.u_lines` and `grid.v_lines`; successive corners share one of the two.
    grid: the streets.
    street_angle: direction of the main street, rad, counter-clockwise from +x.
    lane: distance of the circuit to the right of the centre line, m.
    """
    places = np.array([[grid.u_lines[i], grid.v_lines[j]] for i, j in corners])
    ways = np.roll(places, -1, axis=0) - places
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways_before = np.roll(ways, 1, axis=0)
    to_right = np.array([[0.0, -1.0], [1.0, 0.0]])
    vertices = places + lane * (ways @ to_right + ways_before @ to_right)
    arcs = [_arc(*of_corner) for of_corner in zip(vertices, ways_before, ways, strict=True)]
    outline = np.concatenate([*arcs, arcs[0][:1]])
    points = _eased(_evenly(outline))
    first = np.argmin(np.linalg.norm(points - (vertices[0] + START * ways[0]), axis=1))
    points = np.roll(points[:-1], -first, axis=0)
    points = np.concatenate([points, points[:1]])
    turns = np.array([_nearest(points, arc[[0, -1]]) for arc in arcs])
    return Circuit(
        in_city(points, street_angle),
        turns[np.argsort(turns[:, 0])],
        np.sort(_nearest(points, _straight_over(corners, grid))),
    )


def _arc(vertex: NDArray[np.float64], way_in: NDArray[np.float64], way_out: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quarter of a circle that leaves one street before `vertex` and meets the other behind it."""
    is_left = way_in[0] * way_out[1] - way_in[1] * way_out[0] > 0.0
    radius = LEFT_RADIUS if is_left else RIGHT_RADIUS
    angles = np.linspace(0.0, 0.5 * math.pi, 1 + math.ceil(0.5 * math.pi * radius / STEP))
    center = vertex + radius * (way_out - way_in)
    return np.asarray(center + radius * (np.outer(np.sin(angles), way_in) - np.outer(np.cos(angles), way_out)))


def _evenly(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same closed line, shape (k, 2), with points spaced evenly by about `STEP`."""
    distances = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    even = np.linspace(0.0, distances[-1], 1 + round(distances[-1] / STEP))
    return np.stack([np.interp(even, distances, column) for column in outline.T], axis=1)


def _eased(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a closed line smoothed by a Gaussian, so that its curvature has no steps."""
    reach = round(4.0 * EASING / STEP)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP / EASING) ** 2)
    weights /= weights.sum()
    ring = points[:-1]
    around = np.concatenate([ring[-reach:], ring, ring[:reach]])
    eased = np.stack([np.convolve(column, weights, mode="valid") for column in around.T], axis=1)
    return _evenly(np.concatenate([eased, eased[:1]]))


def _nearest(points: NDArray[np.float64], places: ArrayLike) -> NDArray[np.float64]:
    """Distance along the line of `points`, m, of the point nearest to each place."""
    step = float(np.linalg.norm(points[1] - points[0]))
    rows = [np.argmin(np.linalg.norm(points[:-1] - place, axis=1)) for place in np.asarray(places)]
    return np.asarray(rows, dtype=np.float64) * step


def _straight_over(corners: Sequence[tuple[int, int]], grid: StreetGrid) -> NDArray[np.float64]:
    """Crossings passed between successive corners, shape (m, 2), frame of the grid, m."""
    found: list[tuple[float, float]] = []
    for (i0, j0), (i1, j1) in pairwise([*corners, corners[0]]):
        n_steps = abs(i1 - i0) + abs(j1 - j0)
        for k in range(1, n_steps):
            i, j = i0 + k * (i1 - i0) // n_steps, j0 + k * (j1 - j0) // n_steps
            found.append((grid.u_lines[i], grid.v_lines[j]))
    return np.array(found).reshape(-1, 2)
