# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A point is in the consensus set if its own voxel is in the map, whatever else is around."""

import itertools

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from searches import SEEDS

from maxcon import PointMap, Pose, Scan, SearchSpace
from maxcon.map import TILE_VOXELS
from maxcon.search import consensus_set

CELL = 0.0625
SPACE = SearchSpace(5 * CELL, CELL, 1.0, 0.5)
EDGES = st.sampled_from([0, -3, -TILE_VOXELS, 3 * TILE_VOXELS])


@given(
    seed=SEEDS,
    size=st.tuples(*3 * [st.integers(1, 6)]),
    edge=st.tuples(EDGES, EDGES, st.just(-2)),
    offset=st.tuples(*2 * [st.integers(-5, 4)]),
    n_points=st.integers(0, 60),
)
def test_points_match_where_their_own_voxel_is_in_the_map(seed, size, edge, offset, n_points):
    rng = np.random.default_rng(seed)
    block = np.array(list(itertools.product(*(range(-1, n + 1) for n in size))))  # all around the scan too
    held = block[rng.random(len(block)) < 0.5] + edge
    point_map = PointMap.from_points((held + 0.5) * CELL, np.tile([1.0, 0.0, 0.0], (len(held), 1)), CELL)
    voxels = rng.integers(0, size, (n_points, 3)) + edge
    prior = Pose(*(np.array(edge) + rng.uniform(-3.0, 3.0, 3)) * CELL, 0.0, 0.0, 0.0)
    shift = np.array([*offset, 0]) * CELL
    points = (voxels + rng.uniform(0.1, 0.9, (n_points, 3))) * CELL - shift - prior.position
    matched = consensus_set(
        Scan(points, np.zeros_like(points)), point_map, prior, SPACE, (2, 5 + offset[1], 5 + offset[0])
    )
    in_map = {*map(tuple, held.tolist())}
    assert matched.dtype == bool
    assert matched.tolist() == [tuple(voxel) in in_map for voxel in voxels.tolist()]
    event(f"some do: {matched.any()}, some do not: {not matched.all()}")


def test_the_prior_and_the_heading_of_the_cell_turn_the_scan():
    prior = Pose(3.0, -2.0, 1.0, 0.1, -0.05, 0.7)
    pose = SPACE.pose((4, 7, 1), prior)
    places = (np.array([[40, 3, 20], [-25, 30, 2], [7, -60, 12]]) + 0.5) * CELL
    point_map = PointMap.from_points(places, np.tile([1.0, 0.0, 0.0], (3, 1)), CELL)
    points = np.concatenate([places, places + [CELL, 0.0, 0.0]])
    scan = Scan((points - pose.position) @ pose.rotation, np.zeros_like(points))
    matched = consensus_set(scan, point_map, prior, SPACE, (4, 7, 1))
    assert matched.tolist() == [True, True, True, False, False, False]
    one = Scan(np.zeros((1, 3)), np.zeros((1, 3)))  # an open space is given the cells of the map
    at_point = Pose(*places[0], 0.0, 0.0, 0.0)
    assert consensus_set(one, point_map, at_point, SearchSpace(0.0), (20, 0, 0)).tolist() == [True]
