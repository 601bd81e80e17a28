"""Small point clouds, written to files of each kind."""

from types import SimpleNamespace

import numpy as np
import pytest

import written_las
from upright_walls import scattered


def write_npz(path, points, **arrays):
    np.savez(path, points=points, **{name: values for name, values in arrays.items() if values is not None})
    return path


def write_ply(path, points, normals=None):
    names, columns = "xyz", points.T
    if normals is not None:
        names, columns = ("x", "y", "z", "nx", "ny", "nz"), np.concatenate([columns, normals.T])
    header = [f"property double {name}" for name in names]
    text = "\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *header, "end_header"])
    path.write_bytes(text.encode() + b"\n" + columns.T.astype("<f8").tobytes())
    return path


def write_las(path, points, classes=0, times=0.0, **header):
    written_las.write_las(path, points, classes=classes, times=times, **header)
    return path


@pytest.fixture(scope="session")
def cloud_files():
    """Writers of points."""
    return SimpleNamespace(npz=write_npz, ply=write_ply, las=write_las)


class Surfaces:
    """Points on surfaces, in global coordinates near a UTM place; the frame's origin is (458800, 5429000, 100)."""

    origin = np.array([458_800.0, 5_429_000.0, 100.0])

    @classmethod
    def wall(cls, n, start, end, z=(1.0, 4.0), noise=0.0, seed=0):
        """Points on a wall from `start` to `end`, (x, y) from the origin; its normal is to the left of that way."""
        rng = np.random.default_rng(seed)
        points, normals = scattered(start, end, n, rng, z)
        return cls.origin + points + rng.normal(0.0, noise, (n, 1)) * normals, normals


@pytest.fixture(scope="session")
def surfaces():
    return Surfaces


@pytest.fixture
def scene(surfaces):
    """Points (n, 3), global, m: two walls across a tile's border, and a scatter of points."""
    one, _ = surfaces.wall(6000, (20, 25), (42, 36), noise=0.005)
    two, _ = surfaces.wall(3000, (30, 20), (31, 45), noise=0.005, seed=1)
    scatter = surfaces.origin + np.random.default_rng(2).uniform(0, 60, (300, 3)) * [1, 1, 0.1]
    return np.concatenate([one, two, scatter])


@pytest.fixture
def some_points(surfaces):
    """Two hundred points of a wall, (200, 3), global, m."""
    return surfaces.wall(200, (10, 20), (20, 20))[0]
