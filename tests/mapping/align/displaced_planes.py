"""Scenes of few planes, and points of them that are displaced."""

import numpy as np

from maxcon.geometry import rotation_matrices

ORIGIN = np.array([550_000.0, 5_802_000.0, 60.0])
# Corner and two sides, m.
FLOOR = ((-11.0, -11.0, 0.0), (22.0, 0.0, 0.0), (0.0, 22.0, 0.0))
WALL_ALONG = ((-11.0, 7.03, 0.0), (22.0, 0.0, 0.0), (0.0, 0.0, 5.0))
WALL_ACROSS = ((8.04, -11.0, 0.0), (0.0, 18.0, 0.0), (0.0, 0.0, 5.0))
OTHER_WALL_ALONG = ((-11.0, -6.02, 0.0), (22.0, 0.0, 0.0), (0.0, 0.0, 5.0))
CORNER = (FLOOR, WALL_ALONG, WALL_ACROSS)
CORRIDOR = (FLOOR, WALL_ALONG, OTHER_WALL_ALONG)


def points_on(planes, n_per_square_metre, noise, rng):
    """Noisy points on rectangles, shuffled."""
    parts = []
    for corner, one, other in planes:
        one, other = np.array(one), np.array(other)
        normal = np.cross(one, other)
        area = np.linalg.norm(normal)
        n = int(area * n_per_square_metre)
        on = rng.random((n, 1)) * one + rng.random((n, 1)) * other + corner
        parts.append(on + rng.normal(0.0, noise, (n, 1)) * normal / area)
    return rng.permutation(np.concatenate(parts))


def moved(points, twist, about=(0.0, 0.0, 0.0)):
    """Points turned about a place by roll, pitch and heading (the last three) and shifted."""
    return (points - about) @ rotation_matrices(*twist[3:]).T + about + twist[:3]
