# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The street grid: centre lines, the blocks between them, and the frontages along the streets.

In the frame of the grid u runs along the main street, v along the cross street (counter-clockwise from u),
and their crossing is the origin, m.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.patches import Patch, boxes, join, quads

__all__ = ["CAMPAIGN_GRID", "KERB_HEIGHT", "Block", "Frontage", "StreetGrid", "in_city"]

KERB_HEIGHT = 0.12
"""Height of blocks and sidewalks above the carriageway, m."""


@dataclass(frozen=True, slots=True)
class Block:
    """A rectangle of ground between streets, in the frame of the grid, m."""

    u_low: float
    u_high: float
    v_low: float
    v_high: float


@dataclass(frozen=True, slots=True)
class Frontage:
    """A side of a block along a street, with a frame: x runs along the building line and y out to the street, m.

    u, v: its origin, on the building line, in the frame of the grid, m.
    heading: direction of x in the frame of the grid, rad.
    length: of the side, m.
    """

    u: float
    v: float
    heading: float
    length: float

    def placed(self, patch: Patch, along: float, out: float, z: float = KERB_HEIGHT) -> Patch:
        """Return `patch`, turned with the frontage, its origin at x = `along`, y = `out` (m), in the grid's frame."""
        u, v = self.point(along, out)
        return patch.placed(u, v, z, self.heading)

    def point(self, along: float, out: float) -> tuple[float, float]:
        """Return (u, v) of the point x = `along`, y = `out` of the frontage, m."""
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        return self.u + along * cosine - out * sine, self.v + along * sine + out * cosine


@dataclass(frozen=True, slots=True)
class StreetGrid:
    """Straight streets that cross at right angles; the default is the grid of the demo.

    u_lines, v_lines: where streets cross the main street and the cross street, m, rising; both contain 0. By default
        they are far apart, so that a street looks endless.
    carriageway: from a street's centre line to its kerb, m: a lane and a row of parked cars.
    sidewalk: from the kerb to the building line, m.
    no_parking: from the corner of a block to its first parked car, m.
    margin: how far the city continues beyond the outermost streets, m.
    """

    u_lines: tuple[float, ...] = (-150.0, 0.0, 110.0)
    v_lines: tuple[float, ...] = (-95.0, 0.0, 100.0)
    carriageway: float = 5.0
    sidewalk: float = 2.75
    no_parking: float = 9.0
    margin: float = 45.0

    @property
    def half_width(self) -> float:
        """From a street's centre line to the building line, m."""
        return self.carriageway + self.sidewalk

    @property
    def u_ends(self) -> tuple[float, float]:
        """Where the city ends along the main street, m."""
        return self.u_lines[0] - self.margin, self.u_lines[-1] + self.margin

    @property
    def v_ends(self) -> tuple[float, float]:
        """Where the city ends along the cross street, m."""
        return self.v_lines[0] - self.margin, self.v_lines[-1] + self.margin

    def centre_lines(self) -> NDArray[np.float64]:
        """Start and end of each street, shape (k, 2, 2), frame of the grid, m; the main street is the first."""
        u_ends, v_ends = self.u_ends, self.v_ends
        along_u = [[[u_ends[0], v], [u_ends[1], v]] for v in sorted(self.v_lines, key=abs)]
        along_v = [[[u, v_ends[0]], [u, v_ends[1]]] for u in sorted(self.u_lines, key=abs)]
        return np.array([along_u[0], along_v[0], *along_u[1:], *along_v[1:]])

    def blocks(self, gap: float | None = None) -> list[Block]:
        """Return all blocks.

        gap: distance of their sides from the centre lines of the streets around, m; up to the building lines if None.
        """
        away = self.half_width if gap is None else gap
        return [Block(*u, *v) for u in self._intervals(self.u_lines, away) for v in self._intervals(self.v_lines, away)]

    def frontages(self, block: Block) -> list[Frontage]:
        """Return the sides of `block` along streets; houses at its corners belong to the sides along u."""
        along_u, along_v = block.u_high - block.u_low, block.v_high - block.v_low
        sides = []
        if block.v_low > self.v_lines[0]:
            sides.append(Frontage(block.u_high, block.v_low, math.pi, along_u))
        if block.v_high < self.v_lines[-1]:
            sides.append(Frontage(block.u_low, block.v_high, 0.0, along_u))
        if block.u_low > self.u_lines[0]:
            sides.append(Frontage(block.u_low, block.v_low, 0.5 * math.pi, along_v))
        if block.u_high < self.u_lines[-1]:
            sides.append(Frontage(block.u_high, block.v_high, -0.5 * math.pi, along_v))
        return sides

    def all_frontages(self) -> list[Frontage]:
        """Return the frontages of all blocks."""
        return [side for block in self.blocks() for side in self.frontages(block)]

    def ground(self) -> Patch:
        """Return carriageways at z = 0, and blocks with their sidewalks one kerb higher."""
        (u0, u1), (v0, v1) = self.u_ends, self.v_ends
        carriageway = quads([[[u0, v0, 0.0], [u1, v0, 0.0], [u1, v1, 0.0], [u0, v1, 0.0]]], LasClass.GROUND)
        raised = self.blocks(self.carriageway)
        lows = [[block.u_low, block.v_low, -0.1] for block in raised]
        highs = [[block.u_high, block.v_high, KERB_HEIGHT] for block in raised]
        return join([carriageway, boxes(lows, highs, LasClass.GROUND)])

    def _intervals(self, lines: tuple[float, ...], gap: float) -> list[tuple[float, float]]:
        """Return the intervals between streets, from margin to margin of the city, `gap` from each centre line, m."""
        starts = [lines[0] - self.margin, *(line + gap for line in lines)]
        ends = [*(line - gap for line in lines), lines[-1] + self.margin]
        return list(zip(starts, ends, strict=True))


def in_city(places: NDArray[np.float64], street_angle: float) -> NDArray[np.float64]:
    """Return places (u, v) in the frame of a grid, shape (..., 2), as (x, y) in that of its city, m.

    street_angle : direction of the main street, rad, counter-clockwise from +x.
    """
    cosine, sine = math.cos(street_angle), math.sin(street_angle)
    return np.asarray(places @ np.array([[cosine, sine], [-sine, cosine]]))


CAMPAIGN_GRID = StreetGrid(
    u_lines=(-150.0, -66.0, 0.0, 81.0, 156.0),
    v_lines=(-144.0, -81.0, 0.0, 69.0, 147.0),
    carriageway=4.2,
    sidewalk=1.8,
    no_parking=7.0,
    margin=60.0,
)
"""Dense blocks and narrow streets; centre lines and building lines lie at multiples of 3 m."""
