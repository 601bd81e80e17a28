# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where the ground grid of a built map comes from: classified points, or else level surfaces."""

import numpy as np
import pytest
from built_maps import files_of, height_of_ground, sheet, wall

from maxcon import PointMap
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.ground import ground_among

ORIGIN = np.array([458_800.0, 5_429_000.0, 100.0])


def surface(x, y, z, seed=0):
    """Points at heights z(x, y) above the origin, over ranges x and y."""
    return ORIGIN + sheet(x, y, z, 0.03, seed)


def facade(y):
    return ORIGIN + wall((1.0, 14.0), y, lambda x, y: 0.3, 2.7, 0.03)


def heights_at(path, x, y):
    """Height above the origin of the cell at (x, y) from the origin, NaN for none; the lowest level."""
    return height_of_ground(path, ORIGIN + [x, y, 0.0])[0]


def road(x, y):
    return 0.08 * x - 0.02 * np.abs(y - 5.0)  # a slope, with a crown


def test_classified_ground_is_kept_whether_its_points_are_voxels_too_or_not(tmp_path, cloud_files):
    ground, walls = surface((1.0, 14.0), (1.0, 9.0), road), facade(9.5)
    points, classes = np.concatenate([ground, walls]), np.repeat([2, 6], [len(ground), len(walls)])
    cloud = cloud_files.las(tmp_path / "a.las", points, classes)
    without, with_it = (
        build_map([cloud], tmp_path / name, MapOptions(drop=drop)) for name, drop in (("a.map", None), ("b.map", ()))
    )
    assert without.n_points == len(walls) < with_it.n_points
    assert without.build["ground"] == "of its classes"
    assert files_of(tmp_path / "a.map" / "ground") == files_of(tmp_path / "b.map" / "ground")
    for x, y in ((3.0, 3.0), (8.0, 5.0), (13.0, 8.0)):
        assert abs(heights_at(tmp_path / "a.map", x, y) - road(x, y)) < 0.03
    assert np.isnan(heights_at(tmp_path / "a.map", 7.0, 12.0))


def test_a_bridge_is_another_level(tmp_path, cloud_files):
    below = surface((1.0, 6.0), (1.0, 6.0), lambda x, y: 0.0 * x)
    above = surface((1.0, 6.0), (1.0, 6.0), lambda x, y: 0.0 * x + 5.0)
    points = np.concatenate([below, above, facade(7.0)])
    classes = np.repeat([2, 17, 6], [len(below), len(above), len(points) - len(below) - len(above)])
    build_map([cloud_files.las(tmp_path / "a.las", points, classes)], tmp_path / "a.map")
    levels = height_of_ground(tmp_path / "a.map", ORIGIN + [3.0, 3.0, 0.0])
    np.testing.assert_allclose(levels, [0.0, 5.0], atol=0.02)


@pytest.fixture
def street():
    """Unclassified: a sloping road with a kerb, a car on it, a hedge's top and a roof."""
    return np.concatenate(
        [
            surface((1.0, 14.0), (1.0, 9.0), lambda x, y: road(x, y) + 0.12 * (y > 7.0)),
            surface((5.0, 9.0), (3.0, 4.7), lambda x, y: road(x, y) + 1.5, seed=1),
            surface((1.0, 14.0), (8.0, 9.0), lambda x, y: road(x, y) + 1.2, seed=2),
            facade(9.5),
        ]
    )


def test_without_classes_the_ground_is_the_lowest_of_level_surfaces(tmp_path, cloud_files, street):
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", street)], tmp_path / "a.map")
    assert manifest.build["ground"] == "of level surfaces"
    for x, y in ((3.0, 3.0), (12.0, 5.0), (7.0, 3.9), (4.0, 8.4)):
        wanted = road(x, y) + 0.12 * (y > 7.0)
        assert abs(heights_at(tmp_path / "a.map", x, y) - wanted) < 0.04
    build_map([cloud_files.npz(tmp_path / "c.npz", facade(3.0))], tmp_path / "c.map")
    assert not PointMap.open(tmp_path / "c.map").has_ground
    # A car's roof without ground below is no ground.
    relative = street - ORIGIN
    is_under = (np.abs(relative[:, :2] - [7.0, 3.85]) < [2.1, 0.95]).all(axis=1)
    is_low = relative[:, 2] < road(relative[:, 0], relative[:, 1]) + 0.3
    build_map([cloud_files.npz(tmp_path / "b.npz", street[~(is_under & is_low)])], tmp_path / "b.map")
    assert np.isnan(heights_at(tmp_path / "b.map", 7.0, 3.9))
    assert abs(heights_at(tmp_path / "b.map", 3.0, 3.0) - road(3.0, 3.0)) < 0.04


def test_roofs_at_a_tiles_border_are_told_by_the_ground_beyond():
    flat, roof = np.full((64, 64), np.nan, np.float32), np.full((64, 64), np.nan, np.float32)
    flat[:, 60:], roof[:, :2] = 0.0, 1.5
    assert np.isnan(ground_among({(0, 0): flat, (1, 0): roof}, (1, 0), 0.06).heights).all()
    assert ground_among({(1, 0): roof}, (1, 0), 0.06).n_heights == 128
    assert ground_among({(0, 0): flat, (1, 0): roof}, (0, 0), 0.06).n_heights == 256
