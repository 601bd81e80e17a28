"""Single cells have the moments of the exhaustive search, to the last bit; visits hold each group at each heading."""

import itertools

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, unit_vectors

from maxcon import PointMap, Pose, Scan, SearchSpace
from maxcon.search import Multiplicity, Weighting, exhaustive, visit_kernels
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.visit_kernels import RIM

CELL, ONCE = 0.1, Multiplicity.OCCUPIED
TILE = 512 * CELL
SPACE = SearchSpace(1.5, CELL, 2.0, 1.0)
CORNERS = st.sampled_from([(0.0, 0.0), (1.0, -1.0), (0.5, 3.0), (-2.5, -0.5), (-30000.0, 20000.0)])
GROUPS = {
    "seed": SEEDS, "n_groups": st.integers(0, 20), "n_headings": st.integers(1, 9),
    "drift": st.sampled_from([0, 2, 10, 60]),
}  # fmt: skip


def scene(seed, corner=(0.0, 0.0), n_points=3000, is_signed=True, *, multiplicity=ONCE, weighting=Weighting.COSINE):
    """A cloud about a point, given in tiles, of which it may be a corner: moments of all cells, and its scan."""
    rng = np.random.default_rng(seed)
    middle = np.array([*corner, 0.0]) * TILE
    spread = rng.choice([2.0, 12.0, 40.0])
    points = middle + rng.uniform(-1.0, 1.0, (6000, 3)) * [spread, spread, rng.choice([0.2, 8.0])]
    normals = unit_vectors(rng, len(points), 0.2)
    kept = (points[:, 0] < middle[0]) | (rng.random() < 0.7)  # or a map that ends in the middle
    point_map = PointMap.from_points(points[kept], normals[kept], CELL, is_signed=is_signed)
    prior = Pose(*(middle[:2] + rng.uniform(-0.5, 0.5, 2)), 0.3, 0.01, -0.02, rng.uniform(-4.0, 4.0))
    seen = rng.permutation(len(points))[:n_points]
    scan = Scan((points[seen] - prior.position) @ prior.rotation, normals[seen] @ prior.rotation)
    options = {"multiplicity": multiplicity, "weighting": weighting}
    moments = exhaustive(scan, point_map, prior, SPACE, **options).moments
    prepared = PreparedScan.prepare(scan, point_map, prior, SPACE, multiplicity, weighting)
    return moments, prepared


@given(seed=SEEDS, corner=CORNERS, n_points=st.sampled_from([1, 50, 3000]), is_signed=st.booleans(), options=OPTIONS)
def test_moments_are_those_of_the_exhaustive_search(seed, corner, n_points, is_signed, options):
    wanted, prepared = scene(seed, corner, n_points, is_signed, **options)
    cells = np.random.default_rng(seed).integers(0, SPACE.shape, (30, 3))
    cells[:2] = [[0, 0, 0], np.array(SPACE.shape) - 1]
    event(f"some match: {wanted.any()}")
    for heading in np.unique(cells[:, 0]):
        mine = cells[cells[:, 0] == heading]
        assert (prepared.moments_of_cells(heading, mine) == wanted[tuple(mine.T)]).all()


def test_a_scan_of_many_layers_far_from_the_map_matches_nothing():
    heights = np.arange(20_000.0)
    scan = Scan(np.column_stack([heights, heights, heights]), np.tile([1.0, 0.0, 0.0], (20_000, 1)))
    point_map = PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], CELL)
    prior = Pose(1e6, 1e6, 0.0, 0.0, 0.0, 0.0)
    prepared = PreparedScan.prepare(scan, point_map, prior, SPACE, Multiplicity.OCCUPIED, Weighting.COSINE)
    assert prepared.matches_nothing
    assert not prepared.moments_of_cells(0, np.zeros((3, 3), np.int64)).any()


def test_more_headings_than_are_kept(monkeypatch):
    monkeypatch.setattr("maxcon.search.prepared_scan.MOST_HEADINGS_KEPT", 2)
    wanted, prepared = scene(2)
    assert (np.count_nonzero(wanted, axis=(0, 1, 2)) > SPACE.n_cells // 4).all()
    cells = np.argwhere(np.ones(SPACE.shape[1:], bool))[:20]
    for heading in [*range(SPACE.shape[0]), 0, 1, 0]:
        of_heading = np.insert(cells, 0, heading, axis=1)
        assert (prepared.moments_of_cells(heading, of_heading) == wanted[tuple(of_heading.T)]).all()


def random_groups(seed, n_groups, n_headings, drift, spread):
    """First points of groups, and columns (h, 2, n) of points that drift from heading to heading."""
    rng = np.random.default_rng(seed)
    starts = np.concatenate([[0], np.cumsum(rng.integers(1, 6, n_groups))])
    centres = np.repeat(rng.integers(-spread, spread, (2, n_groups)), np.diff(starts), axis=1)
    places = centres + rng.integers(0, 16, (2, starts[-1]))
    drifts = np.repeat(rng.integers(-drift, drift + 1, (2, n_groups)), np.diff(starts), axis=1)
    return starts, (places + np.arange(n_headings)[:, None, None] * drifts).astype(np.int32)


def planned_plainly(starts, columns):
    """The visits, heading by heading: a new one where the box would become wider than RIM."""
    visits = []
    for group, (first, end) in enumerate(itertools.pairwise(starts)):
        since = 0
        for heading in range(1, len(columns) + 1):
            places = columns[since : heading + 1, :, first:end]
            if heading == len(columns) or np.ptp(places, axis=(0, 2)).max() > RIM:
                x, y = columns[since:heading, :, first:end].transpose(1, 0, 2).reshape(2, -1)
                visits.append([group, since, heading, x.min(), x.max(), y.min(), y.max()])
                since = heading
    return visits


@given(**GROUPS, spread=st.sampled_from([1, 1000, 2**29]))
def test_visits_are_the_runs_within_the_rim(seed, n_groups, n_headings, drift, spread):
    starts, columns = random_groups(seed, n_groups, n_headings, drift, spread)
    wanted = planned_plainly(starts, columns)
    event(f"parted: {len(wanted) > n_groups}")
    assert visit_kernels.plan_visits(starts, columns).tolist() == wanted
