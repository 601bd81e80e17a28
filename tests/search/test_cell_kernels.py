# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Single cells have, to the last bit, the moments of the exhaustive search."""

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, unit_vectors

from maxcon import PointMap, Pose, Scan, SearchSpace
from maxcon.search import Multiplicity, Weighting, exhaustive
from maxcon.search.prepared_scan import PreparedScan

CELL, ONCE = 0.1, Multiplicity.OCCUPIED
TILE = 512 * CELL
SPACE = SearchSpace(1.5, CELL, 2.0, 1.0)


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


def some_cells(rng, n):
    cells = rng.integers(0, SPACE.shape, (n, 3))
    cells[:2] = [[0, 0, 0], np.array(SPACE.shape) - 1]
    return cells


CORNERS = st.sampled_from([(0.0, 0.0), (1.0, -1.0), (0.5, 3.0), (-2.5, -0.5), (-30000.0, 20000.0)])


@given(seed=SEEDS, corner=CORNERS, n_points=st.sampled_from([1, 50, 3000]), is_signed=st.booleans(), options=OPTIONS)
def test_moments_are_those_of_the_exhaustive_search(seed, corner, n_points, is_signed, options):
    wanted, prepared = scene(seed, corner, n_points, is_signed, **options)
    cells = some_cells(np.random.default_rng(seed), 30)
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
