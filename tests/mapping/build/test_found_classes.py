# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Ground, vegetation and temporary objects of hand-made scenes without classes."""

import numpy as np
import pytest

from maxcon import PointMap
from maxcon.errors import OptionError
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.bucketing import POINT, TileBuckets, point_records
from maxcon.mapping.build.found_classes import OBSERVATION, FoundClasses, observation_records, pass_of
from maxcon.mapping.build.ground import ground_heights, lowest_heights
from maxcon.mapping.build.tiles import TileJob, TileMaker
from maxcon.mapping.build.voxel_moments import VoxelMoments

CELL = 0.06
ORIGIN = np.array([458_800.0, 5_429_000.0, 100.0])
STANDING, GROUND, TEMPORARY = 1, 2, 22


def sheet(x, y, height, spacing=0.04, seed=0):
    """Points on a surface of height(x, y) over ranges x and y, with 5 mm of noise."""
    at_x, at_y = (at.ravel() for at in np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing)))
    noise = np.random.default_rng(seed).normal(0.0, 0.005, at_x.size)
    return np.column_stack([at_x, at_y, height(at_x, at_y) + noise])


def wall(x, y, bottom, top, spacing=0.04):
    """Points on an upright wall at `y` from bottom(x, y) on, `top` m high."""
    at_x, above = (at.ravel() for at in np.meshgrid(np.arange(*x, spacing), np.arange(0.0, top, spacing)))
    at_y = np.full(at_x.size, y)
    return np.column_stack([at_x, at_y, bottom(at_x, at_y) + above])


def box(low, high, spacing=0.05):
    """Points on the sides and the top of a box."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    x, y, z = (np.arange(a, b, spacing) for a, b in zip(low, high, strict=True))
    sides = [np.array(np.meshgrid(at_x, y, z)).reshape(3, -1).T for at_x in ([low[0]], [high[0]])]
    sides += [np.array(np.meshgrid(x, at_y, z)).reshape(3, -1).T for at_y in ([low[1]], [high[1]])]
    return np.concatenate([*sides, np.array(np.meshgrid(x, y, [high[2]])).reshape(3, -1).T])


def bush(low, high, n, seed=0):
    """Leaves: points anywhere in a box."""
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


def flat(x, y):
    return np.zeros(np.shape(x)) + 0.5


def slope(x, y):
    return 0.2 * x + 0.5


def found_in(folder, points, times=None, order=None, n_parts=1):
    """Class of each point, shape (n,), and what was found; points (n, 3) taken in an `order`, in parts."""
    folder.mkdir()
    buckets, seen = TileBuckets(folder, POINT, "points"), TileBuckets(folder, OBSERVATION, "seen")
    for rows in np.array_split(np.arange(len(points)) if order is None else order, n_parts):
        buckets.add(*point_records(points[rows], np.zeros((len(rows), 3), np.float32), CELL))
        if times is not None:
            seen.add(*observation_records(points[rows], times[rows], CELL))
    maker = TileMaker(TileJob(folder, CELL, has_normals=False, is_signed=False, drop=frozenset()), buckets, seen)
    found = FoundClasses(has_times=bool(seen.n_tiles))
    for key in buckets.keys:
        maker.gather(key)
    indices, classes = voxel_indices(points, CELL), np.zeros(len(points), np.uint8)
    for key in buckets.keys:
        found.add(maker.find_classes(key))
        corner = np.array([key[0] * TILE_VOXELS, key[1] * TILE_VOXELS, 0])
        voxels = maker.moments(key).indices + corner
        class_of = dict(zip(map(tuple, voxels.tolist()), maker.finder.classes(key).tolist(), strict=True))
        for row in np.flatnonzero((indices[:, :2] // TILE_VOXELS == key).all(axis=1)):
            classes[row] = class_of[tuple(indices[row].tolist())]
    return classes, found


def share(classes, *wanted):
    return np.isin(classes, wanted).mean()


def split(classes, *parts):
    """Classes of the parts that a scene was put together from."""
    return np.split(classes, np.cumsum([len(part) for part in parts])[:-1])


def test_a_wall_on_a_slope_stands_and_the_slope_is_ground(tmp_path):
    ground, house = sheet((0.0, 20.0), (0.0, 12.0), slope), wall((2.0, 18.0), 8.0, slope, 4.0)
    on_ground, on_wall = split(found_in(tmp_path / "a", np.concatenate([ground, house]))[0], ground, house)
    assert share(on_ground, GROUND) > 0.98
    assert share(on_wall, STANDING) > 0.93
    assert share(on_wall[house[:, 2] > slope(house[:, 0], 0.0) + 0.3], STANDING) > 0.995


def test_a_car_hides_the_ground_below_and_is_none(tmp_path):
    ground, car = sheet((0.0, 20.0), (0.0, 12.0), slope), box([6.0, 4.0, 2.2], [10.4, 5.8, 3.6])
    under = (np.abs(ground[:, :2] - [8.2, 4.9]) < [2.2, 0.9]).all(axis=1)
    scene = np.concatenate([ground[~under], car])
    on_ground, on_car = split(found_in(tmp_path / "a", scene)[0], ground[~under], car)
    assert share(on_ground, GROUND) > 0.98
    assert share(on_car[car[:, 2] > 3.0], GROUND) == 0.0


def test_a_hedge_is_vegetation_and_the_house_behind_it_is_not(tmp_path):
    ground, house = sheet((0.0, 20.0), (0.0, 12.0), flat), wall((2.0, 18.0), 9.0, flat, 5.0)
    hedge = bush([3.0, 4.0, 0.5], [15.0, 5.0, 1.9], 40_000)
    scene = np.concatenate([ground, house, hedge])
    on_ground, on_house, on_hedge = split(found_in(tmp_path / "a", scene)[0], ground, house, hedge)
    assert share(on_ground, GROUND) > 0.98
    assert share(on_house, STANDING) > 0.93
    above = hedge[:, 2] > 0.75
    assert share(on_hedge[above], 3, 4) > 0.97
    assert share(on_hedge[hedge[:, 2] > 1.1], 4) > 0.97  # 0.5 to 2 m: of medium height


def test_a_road_below_a_bridge_is_ground_and_the_bridge_stands(tmp_path):
    ground = sheet((0.0, 24.0), (0.0, 12.0), flat)
    deck = sheet((8.0, 16.0), (0.0, 12.0), lambda x, y: flat(x, y) + 5.0)
    pier = wall((8.0, 16.0), 2.0, flat, 5.0)
    scene = np.concatenate([ground, deck, pier])
    on_ground, on_deck, on_pier = split(found_in(tmp_path / "a", scene)[0], ground, deck, pier)
    assert share(on_ground, GROUND) > 0.98
    assert share(on_deck, STANDING) > 0.98
    assert share(on_pier, STANDING) > 0.9


def test_reflections_below_the_ground_do_not_pull_it_down(tmp_path):
    ground = sheet((0.0, 12.0), (0.0, 12.0), flat)
    pit = sheet((5.0, 5.2), (5.0, 5.2), lambda x, y: flat(x, y) - 3.0)
    on_ground, _ = split(found_in(tmp_path / "a", np.concatenate([ground, pit]))[0], ground, pit)
    assert share(on_ground, GROUND) > 0.98


@pytest.fixture
def two_passes():
    """A street seen twice: a car and the hole in the ground under it in the first pass only; a bin in both."""
    ground = sheet((0.0, 20.0), (0.0, 12.0), flat)
    house, car = wall((2.0, 18.0), 10.0, flat, 4.0), box([6.0, 4.0, 0.5], [10.4, 5.8, 2.0])
    bin_ = box([14.0, 5.0, 0.5], [14.8, 5.6, 1.7])
    is_hidden = (np.abs(ground[:, :2] - [8.2, 4.9]) < [2.2, 0.9]).all(axis=1)
    parts = [ground[~is_hidden], house, car, bin_, ground, house, bin_]
    times = [np.linspace(10.0, 20.0, len(part)) for part in parts[:4]]
    times += [np.linspace(400.0, 410.0, len(part)) for part in parts[4:]]
    return parts, np.concatenate(times)


def test_a_car_that_one_of_two_passes_saw_is_temporary(tmp_path, two_passes):
    parts, times = two_passes
    classes, found = found_in(tmp_path / "a", np.concatenate(parts), times)
    ground, house, car, bin_, *_ = split(classes, *parts)
    assert share(car[parts[2][:, 2] > 0.8], TEMPORARY) > 0.95
    assert share(house, TEMPORARY) == 0.0
    assert share(bin_, TEMPORARY) == 0.0
    assert share(ground, GROUND) > 0.97
    assert found.describe()["temporary"] == ""


def test_with_one_pass_or_no_times_nothing_is_called_temporary(tmp_path, two_passes):
    parts, times = two_passes
    points = np.concatenate(parts)
    for name, of_points, reason in (
        ("one", np.zeros(len(points)) + 7.0, "one pass only"),
        ("light", np.minimum(times, 60.0), "one pass only"),  # 40 s apart: a red light
        ("none", None, "the clouds have no times to tell passes apart by"),
    ):
        classes, found = found_in(tmp_path / name, points, of_points)
        assert share(classes, TEMPORARY) == 0.0
        assert found.describe()["temporary"] == reason


def test_the_order_of_the_points_and_their_parts_change_nothing(tmp_path, two_passes):
    parts, times = two_passes
    points = np.concatenate([*parts, bush([2.0, 7.0, 0.5], [5.0, 8.0, 2.0], 8000)]) + [15.0, 20.0, 0.0]
    times = np.concatenate([times, np.tile([15.0, 405.0], 4000)])
    expected, _ = found_in(tmp_path / "a", points, times)
    assert set(np.unique(expected).tolist()) >= {STANDING, GROUND, 4, TEMPORARY}
    for seed in range(3):
        rng = np.random.default_rng(seed)
        got, _ = found_in(tmp_path / f"b{seed}", points, times, rng.permutation(len(points)), 1 + 3 * seed)
        np.testing.assert_array_equal(got, expected)


def test_passes_are_told_apart_by_pauses_longer_than_a_red_light():
    assert pass_of(np.array([0.0, 5.0, 60.0, 300.0, 5.0, 305.0])).tolist() == [0, 0, 0, 1, 0, 1]
    assert pass_of(np.empty(0)).tolist() == []


def test_the_ground_is_the_same_from_the_tile_beside(tmp_path):
    """What a tile knows of the ground around it is what its neighbour finds there."""
    points = sheet((0.0, 61.0), (0.0, 20.0), slope, 0.1)
    points = np.concatenate([points, box([28.0, 5.0, 0.5], [33.0, 8.0, 9.0])])
    buckets = TileBuckets(tmp_path, POINT, "points")
    buckets.add(*point_records(points, np.zeros((len(points), 3), np.float32), CELL))
    lowest = {key: lowest_heights(VoxelMoments.from_records(buckets.records(key)), CELL) for key in buckets.keys}
    left, right = (ground_heights(lowest.get, key, CELL, 4) for key in ((0, 0), (1, 0)))
    np.testing.assert_allclose(left[:, -8:], right[:, :8], atol=1e-9)
    assert np.isfinite(left[4:30]).all()


def write_street(tmp_path, cloud_files, two_passes, name="a.laz", classes=None):
    parts, times = two_passes
    points = ORIGIN + np.concatenate(parts)
    return cloud_files.las(tmp_path / name, points, classes, times), points


def test_ground_and_temporary_objects_are_left_out_of_the_map(tmp_path, cloud_files, two_passes):
    cloud, points = write_street(tmp_path, cloud_files, two_passes)
    manifest = build_map([cloud], tmp_path / "a.map", MapOptions(classify="auto"))
    found = manifest.build["found"]
    assert sum(found["n_points"].values()) == len(points)
    assert manifest.n_points == sum(n for number, n in found["n_points"].items() if number not in ("2", "22"))
    assert manifest.build["ground"] == "found by a morphological filter"
    point_map = PointMap.open(tmp_path / "a.map")
    local = point_map.frame.to_local([ORIGIN + [8.0, 5.0, 0.0]])[0]
    assert abs(point_map.ground_around(local[0], local[1], 0.0).heights[0, 0, 0] - local[2] - 0.5) < 0.03


def test_when_classes_are_found_and_which_are_dropped(tmp_path, cloud_files, two_passes):
    n = len(two_passes[1])
    noise = np.where(np.arange(n) < 100, 7, 1)
    n_found = {}
    for name, classes, options, n_left_out in (
        ("given", np.full(n, 6), {"classify": "auto"}, None),
        ("off", np.full(n, 6), {"classify": "off"}, None),
        ("anew", np.full(n, 6), {"classify": "always"}, ("2", "22")),
        ("noise", noise, {"classify": "auto"}, ("2", "22")),  # noise alone is no classification
        ("by name", None, {"classify": "auto", "drop": ("temporal-exclusion",)}, ("22",)),
        ("kept", None, {"classify": "always", "drop": ()}, ()),
        ("large", None, {"classify": "auto", "cell": 0.5}, None),  # shapes cannot be told in large voxels
    ):
        cloud, _ = write_street(tmp_path, cloud_files, two_passes, f"{name}.laz", classes)
        manifest = build_map([cloud], tmp_path / f"{name}.map", MapOptions(**options))
        assert ("found" in manifest.build) == (n_left_out is not None), name
        n_read = n - 100 if name == "noise" else n
        if n_left_out is None:
            assert manifest.n_points == n_read, name
        else:
            n_found[name] = manifest.build["found"]["n_points"]
            assert sum(n_found[name].values()) == n_read
            assert manifest.n_points == n_read - sum(n_found[name][number] for number in n_left_out), name
    assert n_found["kept"] == n_found["by name"] == n_found["anew"]
    with pytest.raises(OptionError, match=r"at most 0.25 m .* got 0.5 m"):
        MapOptions(cell=0.5, classify="always")
    with pytest.raises(OptionError, match="auto, always or off, got 'yes'"):
        MapOptions(classify="yes")
