# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map in memory, and the same on disk."""

import shutil

import numpy as np
import pytest

from maxcon import PointMap
from written_maps import write


@pytest.fixture(scope="session")
def in_memory():
    """Three thousand points with normals, scattered over 80 m x 80 m; voxels of 6 cm."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-40.0, 40.0, (3000, 3)) * [1, 1, 0.05]
    return PointMap.from_points(points, normals, 0.06)


@pytest.fixture(scope="session")
def whole(tmp_path_factory, in_memory):
    """The folder of that map; nobody changes it."""
    folder = tmp_path_factory.mktemp("maps") / "whole.map"
    write(folder, in_memory)
    return folder


@pytest.fixture
def copy(tmp_path, whole):
    """A folder of that map for a test to break."""
    return shutil.copytree(whole, tmp_path / "copy.map")
