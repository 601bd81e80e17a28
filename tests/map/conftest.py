"""A map in memory, and the same on disk."""

import shutil

import numpy as np
import pytest

from maxcon import PointMap
from written_maps import write


@pytest.fixture(scope="session")
def in_memory():
    """Three thousand points with normals, scattered over 80 m x 80 m, all of them ground too; voxels of 6 cm."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-40.0, 40.0, (3000, 3)) * [1, 1, 0.05]
    return PointMap.from_points(points, normals, 0.06, ground=points)


@pytest.fixture(scope="session")
def whole(built_once, in_memory):
    """The folder of that map; nobody changes it."""
    return built_once("whole", lambda folder: write(folder / "whole.map", in_memory)) / "whole.map"


@pytest.fixture(scope="session")
def shards(built_once, in_memory):
    """The same in several shards."""
    return built_once("shards", lambda folder: write(folder / "s.map", in_memory, shard_bytes=30_000)) / "s.map"


@pytest.fixture
def copy(tmp_path, whole):
    """A folder of that map for a test to break."""
    return shutil.copytree(whole, tmp_path / "copy.map")
