"""COPC: of a rectangle the nodes of the octree that meet it are read, and an octree that does not fit is refused."""

import struct

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from maxcon.errors import FileError
from maxcon.io.clouds import Bounds
from maxcon.mapping.build import Area, MapOptions, build_map
from read_clouds import read_cloud
from written_copc import SIDE, write_copc
from written_las import write_las

N_POINTS = 3000
EVERYWHERE = Bounds(-1e6, -1e6, 1e6, 1e6)


def points_of(path, bounds=None, max_points=1_000_000):
    return read_cloud(path, max_points, bounds).points


def within(points, bounds):
    x, y = points[:, 0], points[:, 1]
    inside = (x >= bounds.x_min) & (x <= bounds.x_max) & (y >= bounds.y_min) & (y <= bounds.y_max)
    return sorted(map(tuple, np.round(points[inside], 3).tolist()))


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    points = np.round(np.random.default_rng(2).uniform(0, SIDE, (N_POINTS, 3)), 3)
    return write_copc(tmp_path_factory.mktemp("copc") / "a.copc.laz", points), points


@given(
    corner=st.tuples(st.floats(-20, 80), st.floats(-20, 80)),
    sides=st.tuples(st.floats(0, 60), st.floats(0, 60)),
    max_points=st.sampled_from([300, 1000, 1_000_000]),
)
@example(corner=(-20, -20), sides=(200, 200), max_points=300)
def test_of_a_rectangle_no_point_is_missing(cloud, corner, sides, max_points):
    path, points = cloud
    bounds = Bounds(*corner, corner[0] + sides[0], corner[1] + sides[1])
    assert within(points_of(path, bounds, max_points), bounds) == within(points, bounds)


def test_it_is_a_laz_file_and_parts_outside_a_rectangle_are_not_read(cloud):
    path, points = cloud
    assert within(points_of(path), EVERYWHERE) == within(points, EVERYWHERE)
    quarter = points_of(path, Bounds(1.0, 1.0, 15.0, 15.0))
    assert (quarter[:, :2] <= 16.0).all() and 0 < len(quarter) < N_POINTS / 8
    assert len(points_of(path, Bounds(100.0, 100.0, 200.0, 200.0))) == 0


def test_a_map_of_an_area_is_that_of_a_file_without_an_octree(cloud, tmp_path):
    path, points = cloud
    write_las(tmp_path / "plain.laz", points)
    options = MapOptions(crs="EPSG:25832", area=Area(3.0, 5.0, 20.0, 30.0), cell=0.5)
    one, other = (build_map([file], tmp_path / f"{file.name}.map", options) for file in (path, tmp_path / "plain.laz"))
    for name in ("n_points", "n_kept", "n_outside"):
        assert one.build["sources"][0][name] == other.build["sources"][0][name] > 0
    assert one.n_voxels == other.n_voxels


def _other(position, value):
    def twist(entries):
        changed = list(entries[3])
        changed[position] = value
        return [*entries[:3], tuple(changed), *entries[4:]]

    return twist


@pytest.mark.parametrize("twist", [
    _other(4, 10), _other(4, 2**40), _other(5, 7), _other(6, 1), _other(0, 31), _other(0, -1),
    lambda entries: entries[1:], lambda entries: [*entries, entries[0]],
    lambda entries: [*entries[:-1], (0, 0, 0, 0, 2**62, 32, -1)],
    lambda entries: [*entries, (0, 0, 0, 0, entries[0][4], -32, -1)],
])  # fmt: skip
def test_an_octree_that_does_not_fit_is_refused(tmp_path, cloud, twist):
    path = write_copc(tmp_path / "b.copc.laz", cloud[1], twist=twist)
    assert len(points_of(path)) == N_POINTS  # without an area it is not looked at
    with pytest.raises(FileError, match="octree"):
        points_of(path, EVERYWHERE)
    data = bytearray(write_copc(path, cloud[1]).read_bytes())  # a page that leads to itself
    page, length = struct.unpack_from("<2Q", data, 375 + 54 + 40)
    struct.pack_into("<4iQ2i", data, page, 0, 0, 0, 0, page, length, -1)
    path.write_bytes(data)
    with pytest.raises(FileError, match="octree"):
        points_of(path, EVERYWHERE)


def test_real_files(real_data):
    for path in sorted(real_data("recorders/copc").rglob("*.copc.laz")):
        points = points_of(path)
        bounds = Bounds(*np.percentile(points[:, :2], [40, 60], axis=0).ravel())
        assert within(points_of(path, bounds), bounds) == within(points, bounds)
        assert len(points_of(path, Bounds(*points[:, :2].min(axis=0), *points[:, :2].max(axis=0)))) == len(points)
