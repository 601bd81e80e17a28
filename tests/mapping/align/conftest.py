"""Passes of few planes as LAZ files, each displaced by what is known."""

import numpy as np
import pytest
from displaced_planes import CORNER, ORIGIN, moved, points_on

import written_las

CRS = "EPSG:25832"


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
