# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The route of the demo: along the main street, and to the left at the crossing."""

import math

import numpy as np

from maxcon.errors import OptionError
from maxcon.lab.simulation.drive import Route
from maxcon.lab.simulation.scenes.street_grid import in_city

__all__ = ["route_over_crossing"]

STEP = 0.05
"""Between two points of a route, m."""
TURN_RADIUS = 9.0


def route_over_crossing(street_angle: float, before: float, after: float, lane: float = 1.5) -> Route:
    """Return a route that comes along the main street and turns left at the crossing.

    street_angle: direction of the main street, rad.
    before, after: distance from the middle of the crossing at which it begins and ends, m.
    lane: distance of the route to the right of the centre line, m.
    """
    reach = TURN_RADIUS - lane
    if not (before > reach and after > reach):
        raise OptionError(
            f"Expected a route of more than {reach:g} m before and after the crossing, got {before} m and"
            f" {after} m. Take 75 m and 50 m?"
        )
    u = np.arange(-before, -reach, STEP)
    turn = np.arange(0.0, 0.5 * math.pi, STEP / TURN_RADIUS)
    v = np.arange(reach, after, STEP)
    arc = np.column_stack([TURN_RADIUS * np.sin(turn) - reach, -TURN_RADIUS * np.cos(turn) + reach])
    grid = np.concatenate(
        [np.column_stack([u, np.full(len(u), -lane)]), arc, np.column_stack([np.full(len(v), lane), v])]
    )
    return Route(in_city(grid, street_angle), stop_at=before - reach)
