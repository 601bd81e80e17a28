"""Ground, vegetation and temporary objects of hand-made scenes without classes, and where the ground grid is from."""

import numpy as np
import pytest
from built_maps import files_of, height_of_ground, sheet, wall

from maxcon import PointMap
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.found_classes import OBSERVATION, describe_found, observation_records, pass_of
from maxcon.mapping.build.ground import ground_among, ground_heights, lowest_heights
from maxcon.mapping.build.tile_points import POINT, TileBuckets, VoxelMoments, point_records
from maxcon.mapping.build.tiles import TileJob, TileMaker

CELL = 0.06
ORIGIN = np.array([458_800.0, 5_429_000.0, 100.0])
STANDING, GROUND, TEMPORARY = 1, 2, 22
BUILDING = np.full(200_000, 6)
NOISE = np.where(np.arange(200_000) < 100, 7, 1)


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
    """Class of each point, shape (n,), and why none is temporary; points (n, 3) taken in an `order`, in parts."""
    folder.mkdir()
    buckets, seen = TileBuckets(folder, POINT, "points"), TileBuckets(folder, OBSERVATION, "seen")
    for rows in np.array_split(np.arange(len(points)) if order is None else order, n_parts):
        buckets.add(*point_records(points[rows], np.zeros((len(rows), 3), np.float32), CELL))
        if times is not None:
            seen.add(*observation_records(points[rows], times[rows], CELL))
    maker = TileMaker(TileJob(folder, CELL, has_normals=False, is_signed=False, drop=frozenset()), buckets, seen)
    for key in buckets.keys:
        maker.gather(key)
    indices, classes = voxel_indices(points, CELL), np.zeros(len(points), np.uint8)
    found = [maker.find_classes(key) for key in buckets.keys]
    for key in buckets.keys:
        rows = np.flatnonzero((indices[:, :2] // TILE_VOXELS == key).all(axis=1))
        voxels, wanted = (
            numbers % [TILE_VOXELS, TILE_VOXELS, 2**31] @ [1, TILE_VOXELS, TILE_VOXELS**2]
            for numbers in (maker.moments(key).indices.astype(np.int64), indices[rows].astype(np.int64))
        )
        order = np.argsort(voxels)
        classes[rows] = maker.classes(key)[order][np.searchsorted(voxels[order], wanted)]
    return classes, describe_found(found, frozenset(), has_times=bool(seen.keys))["temporary"]


def share(classes, *wanted):
    return np.isin(classes, wanted).mean()


def split(classes, parts):
    """Classes of the parts that a scene was put together from."""
    return np.split(classes, np.cumsum([len(part) for part in parts])[:-1])


def is_under(points, half=(2.2, 0.9)):
    """Whether points lie under the car of these scenes."""
    return (np.abs(points[:, :2] - [8.2, 4.9]) < half).all(axis=1)


FLAT, SLOPE = sheet((0.0, 20.0), (0.0, 12.0), flat), sheet((0.0, 20.0), (0.0, 12.0), slope)
STANDS, IS_GROUND = (STANDING,), (GROUND,)


def above(height):
    return lambda points: points[:, 2] > height


@pytest.mark.parametrize(("parts", "wanted"), [
    # Of which part, of which of its points, at least how many are of which classes.
    pytest.param(
        [SLOPE, wall((2.0, 18.0), 8.0, slope, 4.0)],
        [(0, None, 0.98, IS_GROUND), (1, None, 0.93, STANDS),
         (1, lambda points: points[:, 2] > slope(points[:, 0], 0.0) + 0.3, 0.995, STANDS)],
        id="a wall on a slope",
    ),
    pytest.param(
        [SLOPE[~is_under(SLOPE)], box([6.0, 4.0, 2.2], [10.4, 5.8, 3.6])],
        [(0, None, 0.98, IS_GROUND), (1, above(3.0), 1.0, set(range(256)) - {GROUND})],
        id="a car, and no ground below",
    ),
    pytest.param(
        [FLAT, wall((2.0, 18.0), 9.0, flat, 5.0), bush([3.0, 4.0, 0.5], [15.0, 5.0, 1.9], 40_000)],
        [(0, None, 0.98, IS_GROUND), (1, None, 0.93, STANDS), (2, above(0.75), 0.97, (3, 4)),
         (2, above(1.1), 0.97, (4,))],  # 0.5 to 2 m: of medium height
        id="a hedge before a house",
    ),
    pytest.param(
        [FLAT, sheet((6.0, 14.0), (0.0, 12.0), lambda x, y: flat(x, y) + 5.0), wall((6.0, 14.0), 2.0, flat, 5.0)],
        [(0, None, 0.98, IS_GROUND), (1, None, 0.98, STANDS), (2, None, 0.9, STANDS)],
        id="a bridge over a road",
    ),
    pytest.param(
        [FLAT, sheet((5.0, 5.2), (5.0, 5.2), lambda x, y: flat(x, y) - 3.0)], [(0, None, 0.98, IS_GROUND)],
        id="reflections below the ground",
    ),
])  # fmt: skip
def test_ground_walls_and_vegetation_of_scenes(tmp_path, parts, wanted):
    classes = split(found_in(tmp_path / "a", np.concatenate(parts))[0], parts)
    for part, chosen, least, of_classes in wanted:
        rows = slice(None) if chosen is None else chosen(parts[part])
        assert share(classes[part][rows], *of_classes) >= least


@pytest.fixture
def two_passes():
    """A street seen twice: a car and the hole in the ground under it in the first pass only; a bin in both."""
    ground, house, car = FLAT, wall((2.0, 18.0), 10.0, flat, 4.0), box([6.0, 4.0, 0.5], [10.4, 5.8, 2.0])
    bin_ = box([14.0, 5.0, 0.5], [14.8, 5.6, 1.7])
    parts = [ground[~is_under(ground)], house, car, bin_, ground, house, bin_]
    times = [np.linspace(10.0, 20.0, len(part)) for part in parts[:4]]
    times += [np.linspace(400.0, 410.0, len(part)) for part in parts[4:]]
    return parts, np.concatenate(times)


def test_what_one_of_two_passes_saw_is_temporary_and_nothing_else_is(tmp_path, two_passes):
    parts, times = two_passes
    classes, reason = found_in(tmp_path / "a", np.concatenate(parts), times)
    ground, house, car, bin_, *_ = split(classes, parts)
    assert share(car[parts[2][:, 2] > 0.8], TEMPORARY) > 0.95 and share(house, TEMPORARY) == 0.0
    assert share(bin_, TEMPORARY) == 0.0 and share(ground, GROUND) > 0.97
    assert reason == ""
    for name, of_points, reason in (
        ("light", np.minimum(times, 60.0), "one pass only"),  # 40 s apart: a red light
        ("none", None, "the clouds have no times to tell passes apart by"),
    ):
        classes, said = found_in(tmp_path / name, np.concatenate(parts), of_points)
        assert share(classes, TEMPORARY) == 0.0 and said == reason


def test_the_order_of_the_points_and_their_parts_change_nothing(tmp_path, two_passes):
    parts, times = two_passes
    points = np.concatenate([*parts, bush([2.0, 7.0, 0.5], [5.0, 8.0, 2.0], 8000)]) + [15.0, 20.0, 0.0]
    times = np.concatenate([times, np.tile([15.0, 405.0], 4000)])
    expected, _ = found_in(tmp_path / "a", points, times)
    assert set(np.unique(expected).tolist()) >= {STANDING, GROUND, 4, TEMPORARY}
    order = np.random.default_rng(1).permutation(len(points))
    np.testing.assert_array_equal(found_in(tmp_path / "b", points, times, order, n_parts=7)[0], expected)


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


@pytest.mark.parametrize(("classes", "options", "left_out"), [
    (BUILDING, {"classify": "auto"}, None),
    (BUILDING, {"classify": "off"}, None),
    (0 * NOISE, {"classify": "auto", "cell": 0.5}, None),  # shapes cannot be told in large voxels
    (BUILDING, {"classify": "always"}, ("2", "22")),
    (NOISE, {"classify": "auto"}, ("2", "22")),  # noise is no classification
    (0 * NOISE, {"classify": "auto", "drop": ("temporal-exclusion",)}, ("22",)),
    (0 * NOISE, {"classify": "always", "drop": ()}, ()),
])  # fmt: skip
def test_when_classes_are_found_and_which_are_dropped(tmp_path, cloud_files, two_passes, classes, options, left_out):
    parts, times = two_passes
    points, times = ORIGIN + np.concatenate(parts)[::2], times[::2]
    cloud = cloud_files.las(tmp_path / "a.laz", points, classes[: len(points)], times)
    manifest = build_map([cloud], tmp_path / "a.map", MapOptions(**options))
    n_read = len(points) - (100 if classes is NOISE else 0)
    if left_out is None:
        assert "found" not in manifest.build and manifest.n_points == n_read
        return
    found = manifest.build["found"]["n_points"]
    assert sum(found.values()) == n_read and found["22"] > 100
    assert manifest.n_points == n_read - sum(found[number] for number in left_out)
    assert manifest.build["ground"] == "found by a morphological filter"
    assert abs(height_of_ground(tmp_path / "a.map", ORIGIN + [8.0, 5.0, 0.0])[0] - 0.5) < 0.03


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


def test_without_classes_the_ground_is_the_lowest_of_level_surfaces(tmp_path, cloud_files):
    """Of a sloping road with a kerb, a car on it, a hedge's top and a facade."""
    paved = surface((1.0, 14.0), (1.0, 9.0), lambda x, y: road(x, y) + 0.12 * (y > 7.0))
    car = surface((5.0, 9.0), (3.0, 4.7), lambda x, y: road(x, y) + 1.5, seed=1)
    hedge = surface((1.0, 14.0), (8.0, 9.0), lambda x, y: road(x, y) + 1.2, seed=2)
    street = np.concatenate([paved, car, hedge, facade(9.5)])
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
