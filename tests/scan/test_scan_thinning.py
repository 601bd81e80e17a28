"""Of the points in each cube one is kept, whatever their order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Scan
from maxcon.errors import OptionError
from maxcon.scan import one_per_cube
from maxcon.scan.thinning_kernels import ASKEW


def plainly(points, normals, edge):
    """The definition, a cube at a time."""
    cubes = {}
    for number, point in enumerate(points.tolist()):
        cubes.setdefault(tuple(np.floor(np.array(point) / edge)), []).append(number)
    kept = []
    for cube, numbers in cubes.items():

        def rank(i, cube=cube):
            x, y, z = points[i] / edge - cube - 0.5
            return (not normals[i].any(), x * x + y * y + z * z, *points[i], *normals[i])

        kept.append(min(numbers, key=rank))
    return sorted(kept)


def random_points(rng, n, spread):
    points = np.round(rng.uniform(-spread, spread, (n, 3)) * 16) / 16  # so that some are equally far, or the same
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[rng.random(n) < 0.6] = 0.0
    return points, normals


@given(
    seed=st.integers(0, 2**32), n=st.integers(1, 80) | st.just(1500), spread=st.sampled_from([0.0, 0.4, 2.0, 30.0]),
    edge=st.sampled_from([0.25, 0.3, 1.0, 100.0]),
)  # fmt: skip
def test_one_point_of_each_cube_is_kept(seed, n, spread, edge):
    points, normals = random_points(np.random.default_rng(seed), n, spread)
    assert one_per_cube(points, edge, normals).tolist() == plainly(points, normals, edge)


@given(seed=st.integers(0, 2**32), edge=st.sampled_from([0.25, 1.0]))
def test_which_points_are_kept_does_not_depend_on_their_order(seed, edge):
    rng = np.random.default_rng(seed)
    points, normals = random_points(rng, 200, 1.0)
    order = rng.permutation(len(points))
    here, there = Scan(points, normals).thinned(edge), Scan(points[order], normals[order]).thinned(edge)
    rows = [np.unique(np.hstack([scan.points, scan.normals]), axis=0) for scan in (here, there)]
    assert (rows[0] == rows[1]).all() and len(rows[0]) == len(here)


def test_a_thinned_scan_has_measured_points_with_the_normals_of_the_whole_scan():
    rng = np.random.default_rng(0)
    points, normals = random_points(rng, 400, 2.0)
    scan = Scan(points, normals, time=7.0)
    thinned = scan.thinned(0.5)
    assert thinned.time == 7.0 and 0 < len(thinned) < len(scan)
    measured = {(*point, *normal) for point, normal in zip(points.tolist(), normals.tolist(), strict=True)}
    kept = {(*p, *n) for p, n in zip(thinned.points.tolist(), thinned.normals.tolist(), strict=True)}
    assert kept <= measured
    again = thinned.thinned(0.5)  # nothing is left to thin
    assert (again.points == thinned.points).all() and (again.normals == thinned.normals).all()


def test_points_on_both_sides_and_far_away_and_edges_of_0_and_empty_scans():
    points = np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [1e300, 0.0, 0.0], [-1e18, 3.0, 0.0], [-1e18, 3.1, 0.0]])
    assert one_per_cube(points, 0.25).tolist() == [0, 1, 2, 4]  # 4 is nearer to the middle
    scan = Scan([[1.0, 2.0, 3.0]] * 3, np.zeros((3, 3)))
    assert scan.thinned(0.0) is scan
    empty = Scan(np.empty((0, 3)), np.empty((0, 3)))
    assert len(empty.thinned(0.25)) == 0


@pytest.mark.parametrize("edge", [-0.1, np.nan, np.inf])
def test_edges_that_are_none_are_refused(edge):
    with pytest.raises(OptionError, match="Expected `edge` of thinning >= 0 m"):
        Scan([[1.0, 2.0, 3.0]], [[1.0, 0.0, 0.0]]).thinned(edge)


def test_by_lot_one_point_of_each_cube_is_kept_whatever_their_order():
    rng = np.random.default_rng(0)
    points, normals = random_points(rng, 3000, 5.0)
    cubes = np.floor(points @ ASKEW.T / 0.4)
    kept = one_per_cube(points, 0.4, normals, by_lot=True)
    assert len(kept) == len(np.unique(cubes[kept], axis=0)) == len(np.unique(cubes, axis=0))
    with_normals = np.unique(cubes[normals.any(axis=1)], axis=0)
    assert normals[kept].any(axis=1).sum() == len(with_normals)
    some, order = one_per_cube(points, 0.4, normals, by_lot=True, most=500), rng.permutation(len(points))
    assert len(some) == 500 and np.isin(some, kept).all()
    for before, most in ((kept, None), (some, 500)):
        again = order[one_per_cube(points[order], 0.4, normals[order], by_lot=True, most=most)]
        rows = [np.unique(np.hstack([points[each], normals[each]]), axis=0) for each in (before, again)]
        assert (rows[0] == rows[1]).all()


def test_by_lot_the_middle_of_a_noisy_wall_stays_where_it_is():
    """Beside a side of the cubes the few points beyond it would be as many as all the rest."""
    rng = np.random.default_rng(0)
    off = []
    for distance in np.arange(4.0, 6.0, 0.04):
        x = distance + rng.normal(0.0, 0.02, 30_000)
        points = np.column_stack([x, rng.uniform(-9, 9, 30_000), rng.uniform(-1, 5, 30_000)])
        normals = np.tile([-1.0, 0.0, 0.0], (30_000, 1))
        off.append(x[one_per_cube(points, 0.4, normals, by_lot=True)].mean() - distance)
    assert np.abs(off).max() < 0.006 and abs(np.mean(off)) < 0.0005


def test_a_sample_has_the_normals_of_the_whole_scan_whatever_the_order_of_its_points():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(3.0, 12.0, 4000), np.full(4000, 5.0), rng.uniform(-1.0, 3.0, 4000)])
    points += rng.normal(0.0, 0.01, points.shape)
    scan, order = Scan(points), rng.permutation(len(points))
    rows = {tuple(point): normal for point, normal in zip(scan.points, scan.normals, strict=True)}
    sample, again = Scan(points).sample, Scan(points[order]).sample
    assert len(sample) == len(np.unique(sample.points, axis=0)) < 0.2 * len(points)
    assert all((rows[tuple(at)] == normal).all() for at, normal in zip(sample.points, sample.normals, strict=True))
    both = (np.lexsort(each.points.T) for each in (sample, again))
    assert all((a[k] == b[m]).all() for k, m in [tuple(both)] for a, b in [(sample.points, again.points)])
    given = Scan(points, scan.normals).sample
    assert (given.points == sample.points).all() and (given.normals == sample.normals).all()
