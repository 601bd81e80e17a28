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

from maxcon.simulation.las_classes import LasClass
from maxcon.simulation.patches import Patch, boxes, join, quads

__all__ = ["KERB_HEIGHT", "SIDEWALK", "Block", "Frontage", "blocks", "centre_lines", "frontages", "ground"]

CARRIAGEWAY = 5.0
"""From a street's centre line to its kerb, m: a lane and a row of parked cars."""
SIDEWALK = 2.75
"""From the kerb to the building line, m."""
KERB_HEIGHT = 0.12

U_LINES = (-150.0, 0.0, 110.0)
V_LINES = (-95.0, 0.0, 100.0)
"""Where streets cross the main street and the cross street, m: far apart, so that a street looks endless."""
MARGIN = 45.0
"""How far the city goes on behind the outer streets, m."""


@dataclass(frozen=True, slots=True)
class Block:
    """Ground between building lines, in the frame of the grid, m."""

    u_low: float
    u_high: float
    v_low: float
    v_high: float


@dataclass(frozen=True, slots=True)
class Frontage:
    """One side of a block that lies at a street: x runs along it and y out to the street, m.

    Parameters
    ----------
    u, v : float
        Where x = y = 0 on the building line, in the frame of the grid, m.
    heading : float
        Direction of x in the frame of the grid, rad.
    length : float
        m.
    """

    u: float
    v: float
    heading: float
    length: float

    def placed(self, patch: Patch, along: float, out: float, z: float = KERB_HEIGHT) -> Patch:
        """Return `patch` with its origin `along` (m) the frontage and `out` (m) towards the street."""
        u, v = self.point(along, out)
        return patch.placed(u, v, z, self.heading)

    def point(self, along: float, out: float) -> tuple[float, float]:
        """Return (u, v) of a point of the frontage, m."""
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        return self.u + along * cosine - out * sine, self.v + along * sine + out * cosine


def centre_lines() -> NDArray[np.float64]:
    """Start and end of each street, shape (k, 2, 2), frame of the grid, m; the main street is the first."""
    u_ends = (U_LINES[0] - MARGIN, U_LINES[-1] + MARGIN)
    v_ends = (V_LINES[0] - MARGIN, V_LINES[-1] + MARGIN)
    along_u = [[[u_ends[0], v], [u_ends[1], v]] for v in sorted(V_LINES, key=abs)]
    along_v = [[[u, v_ends[0]], [u, v_ends[1]]] for u in sorted(U_LINES, key=abs)]
    return np.array([along_u[0], along_v[0], *along_u[1:], *along_v[1:]])


def _intervals(lines: tuple[float, ...], gap: float) -> list[tuple[float, float]]:
    """Return what the streets leave between them, out to the margin of the city."""
    starts = [lines[0] - MARGIN, *(line + gap for line in lines)]
    ends = [*(line - gap for line in lines), lines[-1] + MARGIN]
    return list(zip(starts, ends, strict=True))


def blocks(gap: float = CARRIAGEWAY + SIDEWALK) -> list[Block]:
    """Return all blocks, each `gap` (m) away from the centre lines of the streets around it."""
    return [Block(*u, *v) for u in _intervals(U_LINES, gap) for v in _intervals(V_LINES, gap)]


def frontages(block: Block) -> list[Frontage]:
    """Return the sides of `block` that lie at a street; houses along u stand at the corners."""
    along_u, along_v = block.u_high - block.u_low, block.v_high - block.v_low
    sides = []
    if block.v_low > V_LINES[0]:
        sides.append(Frontage(block.u_high, block.v_low, math.pi, along_u))
    if block.v_high < V_LINES[-1]:
        sides.append(Frontage(block.u_low, block.v_high, 0.0, along_u))
    if block.u_low > U_LINES[0]:
        sides.append(Frontage(block.u_low, block.v_low, 0.5 * math.pi, along_v))
    if block.u_high < U_LINES[-1]:
        sides.append(Frontage(block.u_high, block.v_high, -0.5 * math.pi, along_v))
    return sides


def ground() -> Patch:
    """Carriageways at z = 0, and blocks with their sidewalks one kerb higher."""
    u0, u1 = U_LINES[0] - MARGIN, U_LINES[-1] + MARGIN
    v0, v1 = V_LINES[0] - MARGIN, V_LINES[-1] + MARGIN
    carriageway = quads([[[u0, v0, 0.0], [u1, v0, 0.0], [u1, v1, 0.0], [u0, v1, 0.0]]], LasClass.GROUND)
    raised = blocks(CARRIAGEWAY)
    lows = [[block.u_low, block.v_low, -0.1] for block in raised]
    highs = [[block.u_high, block.v_high, KERB_HEIGHT] for block in raised]
    return join([carriageway, boxes(lows, highs, LasClass.GROUND)])
