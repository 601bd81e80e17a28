"""Scenes of few planes, and passes of them as LAZ files, each displaced by what is known."""

import numpy as np
import pytest

import written_las
from maxcon.geometry import rotation_matrices

ORIGIN = np.array([550_000.0, 5_802_000.0, 60.0])
CRS = "EPSG:25832"
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


@pytest.fixture(scope="session")
def scene():
    """Points on planes, and how to move them."""

    class Scene:
        corner, corridor = CORNER, CORRIDOR
        points_on = staticmethod(points_on)
        moved = staticmethod(moved)
        origin = ORIGIN

    return Scene


@pytest.fixture(scope="session")
def write_las():
    """Write points, m about the origin, with times, to a file with a CRS, intensities and an extra field."""

    def write(path, points, times, *, source_ids=0, **header):
        las = written_las.write_las(path, points + ORIGIN, times=times, crs=CRS, extra=["ring"], **header)
        las.intensity = np.arange(len(points)) % 60_000
        las.ring = np.arange(len(points)) % 64
        las.point_source_id[:] = source_ids
        las.write(path)
        return path

    return write


@pytest.fixture(scope="session")
def three_passes(tmp_path_factory, write_las):
    """Three passes of the corner in two tiles, with the twists of the passes about the origin."""
    folder = tmp_path_factory.mktemp("passes")
    rng = np.random.default_rng(0)
    twists = np.column_stack([rng.normal(0.0, 0.06, (3, 3)), rng.normal(0.0, np.radians(0.1), (3, 3))])
    parts, times = [], []
    for number, twist in enumerate(twists):
        points = points_on(CORNER, 60, 0.01, rng)
        parts.append(moved(points, twist))
        times.append(300_000.0 + 100.0 * number + np.sort(rng.uniform(0.0, 8.0, len(points))))
    points, times = np.concatenate(parts), np.concatenate(times)
    is_west = points[:, 0] < 0.0
    clouds = [
        write_las(folder / name, points[rows], times[rows])
        for name, rows in (("west.laz", is_west), ("east.las", ~is_west))
    ]
    return clouds, twists
