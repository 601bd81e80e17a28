"""Sigma of a map: from a sample of places and passes of known offsets over known walls, given, or assumed."""

import json

import numpy as np
import pytest

from maxcon import PointMap
from maxcon.errors import FileError
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.point_statistics import PLACE_EDGE, PlaceSample, aligned_sigma, compare_passes

PAUSE = 300.0
"""Between passes, s."""


class Street:
    """Pieces of wall of all orientations, 1.5 m wide and 5 m apart, passed at 2 s each.

    errors: of each pass at each wall, (n_passes, n_walls, 3), m; density: points per pass and wall.
    """

    def __init__(self, errors, density=600, noise=0.005, seed=0):
        n_passes, n_walls, _ = errors.shape
        rng = np.random.default_rng(seed)
        axes = np.linalg.qr(rng.normal(size=(n_walls, 3, 3)))[0]
        normals, sides = axes[:, :, 0], axes[:, :, 1:]
        middles = np.column_stack([5.0 * np.arange(n_walls), *rng.uniform(-1.0, 1.0, (2, n_walls))])
        clouds, times = [], []
        for number, n_points in enumerate(np.broadcast_to(density, n_passes)):
            wall = np.repeat(np.arange(n_walls), n_points)
            on_wall = np.einsum("nij,nj->ni", sides[wall], rng.uniform(-0.75, 0.75, (len(wall), 2)))
            roughness = rng.normal(0.0, noise, (len(wall), 1)) * normals[wall]
            clouds.append(middles[wall] + on_wall + roughness + errors[number, wall])
            times.append(PAUSE * number + 2.0 * wall + rng.uniform(0.0, 0.5, len(wall)))
        self.points, self.times = np.concatenate(clouds), np.concatenate(times)
        self.across = np.einsum("wi,pwi->pw", normals, errors)

    @property
    def sigma_of_pass(self):
        """The standard deviation that the drawn errors have across the walls, m."""
        return float(np.sqrt(self.across.var(axis=0, ddof=1).mean()))

    def compared(self):
        sample = PlaceSample()
        order = np.random.default_rng(1).permutation(len(self.points))
        sample.add(self.points[order], self.times[order])
        return compare_passes(sample.records())


def drawn(n_passes, sigma, n_walls=100, seed=0):
    return np.random.default_rng(seed).normal(0.0, sigma, (n_passes, n_walls, 3))


@pytest.mark.parametrize(("n_passes", "sigma"), [(2, 0.005), (3, 0.02), (5, 0.04)])
def test_the_errors_of_passes_are_found(n_passes, sigma):
    street = Street(drawn(n_passes, sigma))
    found = street.compared()
    assert found.is_enough and found.n_passes == n_passes
    assert found.sigma_of_pass == pytest.approx(street.sigma_of_pass, rel=0.06)
    assert found.sigma_of_map == pytest.approx(found.sigma_of_pass / np.sqrt(n_passes), rel=0.03)


def test_offsets_count_across_the_walls_by_the_points_of_each_pass_and_noise_does_not():
    street = Street(drawn(2, 0.0))
    street.points[street.times > PAUSE] += [0.03, 0.0, 0.0]  # the same along the street, everywhere
    assert street.compared().sigma_of_pass == pytest.approx(0.03 / np.sqrt(3.0) / np.sqrt(2.0), rel=0.1)
    found = Street(drawn(3, 0.0), density=300, noise=0.02).compared()
    assert found.is_enough
    assert found.sigma_of_pass < 0.001  # a mean of 33 points is good to 0.0035 m
    found = Street(drawn(2, 0.02), density=(900, 100)).compared()
    assert found.n_passes == 2
    assert found.sigma_of_map == pytest.approx(found.sigma_of_pass * np.sqrt(0.9**2 + 0.1**2), rel=0.03)


def test_what_changed_between_passes_or_is_rough_is_left_out():
    errors = drawn(3, 0.02)
    street = Street(errors)
    wanted = street.compared()
    bush = np.random.default_rng(2).uniform(-3.0, 3.0, (60_000, 3)) + [250.0, 20.0, 0.0]
    street.points = np.concatenate([street.points, bush])
    street.times = np.concatenate([street.times, np.repeat(PAUSE * np.arange(3), 20_000)])
    assert street.compared() == wanted
    errors[1, ::8] += 0.12  # doors that stood open, and cars
    changed = Street(errors)
    assert changed.sigma_of_pass > 1.5 * wanted.sigma_of_pass
    assert changed.compared().sigma_of_pass == pytest.approx(wanted.sigma_of_pass, rel=0.15)


def test_passes_that_cannot_be_compared():
    one = Street(drawn(1, 0.02)).compared()
    assert (one.is_enough, one.n_passes, one.shortcoming) == (False, 1, "one pass only")
    waiting = Street(drawn(2, 0.02))
    waiting.times[waiting.times > PAUSE] -= PAUSE - 55.0  # a vehicle that waits makes no second pass
    assert waiting.compared().shortcoming == "one pass only"
    short = Street(drawn(2, 0.02, n_walls=14)).compared()  # 28 s each
    assert short.n_places > 0 and not short.is_enough
    assert "half minutes only" in short.shortcoming
    rng = np.random.default_rng(0)
    for n_points in (0, 1, 19, 1000):
        records = sampled(rng.uniform(0.0, 0.5, (n_points, 3)), rng.uniform(0.0, 1000.0, n_points), 10_000)
        assert not compare_passes(records).is_enough
        assert compare_passes(records).shortcoming == "no planes of points with times"


def points_and_times(n=20_000, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-10.0, 10.0, (n, 3)) * [1.0, 1.0, 0.1], rng.uniform(0.0, 1000.0, n)


def sampled(points, times, most_points, n_parts=1):
    sample = PlaceSample(most_points)
    for part in np.array_split(np.arange(len(points)), n_parts):
        sample.add(points[part], times[part])
    return sample.records()


def test_all_points_are_kept_while_they_are_few_by_place_and_time():
    points, times = points_and_times()
    times[::7] = np.nan  # they are left out
    is_timed = np.isfinite(times)
    records = sampled(points, times, len(points), n_parts=7)
    points, times = points[is_timed], times[is_timed]
    cubes = np.floor(points / PLACE_EDGE).astype(int)
    assert len(records) == len(points)
    assert len(np.unique(records["place"])) == len(np.unique(cubes, axis=0))
    inside = points - (cubes + 0.5) * PLACE_EDGE
    np.testing.assert_allclose(records["inside"][np.argsort(records["time"])], inside[np.argsort(times)], atol=1e-6)
    steps = np.diff(records["place"].astype(object))
    assert (steps >= 0).all() and (np.diff(records["time"])[steps == 0] >= 0.0).all()


@pytest.mark.parametrize("most_points", [12_000, 700])
def test_of_many_points_those_of_some_places_are_kept_whole_and_evenly_in_any_order(most_points):
    points, times = points_and_times()
    records = sampled(points, times, most_points)
    assert 0.3 * most_points < len(records) <= most_points
    everything = sampled(points, times, len(points))
    kept = np.isin(everything["place"], records["place"])
    np.testing.assert_array_equal(everything[kept], records)
    at = points[np.isin(times, records["time"])]
    assert abs(at[:, :2].mean(axis=0)).max() < 15.0 / np.sqrt(len(np.unique(records["place"])))
    order = np.random.default_rng(1).permutation(len(points))
    np.testing.assert_array_equal(sampled(points[order], times[order], most_points, n_parts=50), records)


def test_passes_say_how_well_a_map_is_known(tmp_path, cloud_files):
    street = Street(drawn(3, 0.02))
    manifest = build_map([cloud_files.las(tmp_path / "a.laz", street.points, times=street.times)], tmp_path / "a.map")
    known = manifest.build["sigma"]
    assert (known["from"], known["n_passes"]) == ("passes", 3) and known["n_places"] >= 50
    assert known["sigma_of_pass"] == pytest.approx(street.sigma_of_pass, rel=0.06)
    assert manifest.sigma == pytest.approx(known["sigma_of_pass"] / np.sqrt(3.0), rel=0.05)
    assert PointMap.open(tmp_path / "a.map").sigma == manifest.sigma


@pytest.mark.parametrize(("has_times", "sigma", "wanted", "said"), [
    (True, None, 0.02, {"from": "assumed", "reason": "one pass only"}),
    (False, None, 0.02, {"from": "assumed", "reason": "no planes of points with times"}),
    (True, 0, 0.0, {"from": "given"}),
])  # fmt: skip
def test_what_leaves_it_assumed_or_given(tmp_path, cloud_files, has_times, sigma, wanted, said):
    street = Street(drawn(1, 0.0, n_walls=10))
    path = cloud_files.npz(tmp_path / "a.npz", street.points, times=street.times if has_times else None)
    manifest = build_map([path], tmp_path / "a.map", MapOptions(sigma=sigma))
    assert (manifest.sigma, manifest.build["sigma"]) == (wanted, said)


def test_alignments_beside_the_clouds(tmp_path, cloud_files):
    street, file = Street(drawn(3, 0.02, n_walls=6)), tmp_path / "alignment.json"
    path = cloud_files.npz(tmp_path / "a.npz", street.points, times=street.times)
    cases = ((0.03, 60, 3, 0.03), (0.001, 60, 3, 0.001), (0.001, 60, 1, 0.02), (0, 9, 3, 0.02))
    for sigma, n_ties, n_passes, wanted in cases:
        file.write_text(json.dumps({"sigma": {"of_map": sigma}, "n_ties": n_ties, "n_passes": n_passes, "more": []}))
        assert aligned_sigma([path]) == wanted
    file.write_text(json.dumps({"sigma": {"of_map": 0.05}, "n_ties": 60, "n_passes": 3}))
    manifest = build_map([path], tmp_path / "a.map")
    assert (manifest.sigma, manifest.build["sigma"]) == (0.05, {"from": "alignment"})
    for content in ("{", "[]", '{"sigma": {"of_map": "a"}}', '{"sigma": {"of_map": -1.0}, "n_ties": 1, "n_passes": 1}'):
        file.write_text(content)
        with pytest.raises(FileError, match=r"alignment\.json.*--sigma"):
            aligned_sigma([path])
    file.unlink()
    assert aligned_sigma([path]) is None
