# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The real drive: map, scans and trajectories fit together."""

import numpy as np
import pyproj
import pytest

from maxcon.io.clouds import open_cloud
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory


@pytest.fixture(scope="module")
def drive(real_data):
    return real_data("kitti-0013")


def test_the_map(drive):
    trajectory = read_trajectory(drive / "map" / "trajectory.txt")
    for path in sorted((drive / "map").glob("*.laz")):
        with open_cloud(path) as reader:
            header, chunk = reader.header, next(reader.chunks(100_000))
        assert pyproj.CRS.from_wkt(header.crs).to_epsg() == 25832
        assert (header.has_classes, header.has_times, header.has_normals) == (True, True, False)
        assert header.n_points > 3_000_000
        assert chunk.points.shape == (100_000, 3)
        assert set(np.unique(chunk.classes)) <= {1, 2}
        sensors = trajectory.positions_at(chunk.times)
        assert np.isfinite(sensors).all()
        assert np.linalg.norm(chunk.points - sensors, axis=1).max() < 130.0


def test_the_scans_and_their_poses(drive):
    scans = open_scans(drive / "scans")
    assert len(scans) == 70
    for name in ("reference.txt", "prior_gnss.txt", "prior_perturbed.txt"):
        trajectory = read_trajectory(drive / name)
        assert len(trajectory) == 70
        np.testing.assert_allclose(trajectory.times, scans.times, atol=1e-6)
    raw = scans.read(0)
    assert raw.name == "000010.bin"
    assert 25_000 < len(raw.points) <= raw.n_returns < 32_000
    heights = np.percentile(raw.points[:, 2], [5, 30])
    np.testing.assert_allclose(heights, -1.73, atol=0.3)
