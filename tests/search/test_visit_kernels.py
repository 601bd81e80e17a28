# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Visits hold each group at each heading once, in the box of its points; and stop where there are voxels to meet."""

import itertools

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from searches import SEEDS

from maxcon import PointMap
from maxcon.map import PATCH_VOXELS
from maxcon.search import visit_kernels
from maxcon.search.visit_kernels import RIM


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


GROUPS = {
    "seed": SEEDS,
    "n_groups": st.integers(0, 20),
    "n_headings": st.integers(1, 9),
    "drift": st.sampled_from([0, 2, 10, 60]),
}


@given(**GROUPS, spread=st.sampled_from([1, 1000, 2**29]))
def test_visits_are_the_runs_within_the_rim(seed, n_groups, n_headings, drift, spread):
    starts, columns = random_groups(seed, n_groups, n_headings, drift, spread)
    wanted = planned_plainly(starts, columns)
    event(f"parted: {len(wanted) > n_groups}")
    assert visit_kernels.plan_visits(starts, columns).tolist() == wanted


@given(
    **GROUPS, window=st.sampled_from([(0, 0, 0, 0), (-3, 2, 5, 5), (-600, 599, -2, 40)]), edge_bits=st.integers(4, 9)
)
def test_tiles_get_the_visits_that_meet_them(seed, n_groups, n_headings, drift, window, edge_bits):
    visits = visit_kernels.plan_visits(*random_groups(seed, n_groups, n_headings, drift, 1500))
    corner, (ny, nx), edge = (-2, -1), (3, 4), 2**edge_bits
    starts, numbers, rectangles = visit_kernels.visits_of_tiles(visits, window, edge_bits, corner, (ny, nx))
    x_first, x_last, y_first, y_last = window
    for tile in range(ny * nx):
        x, y = (corner[0] + tile % nx) * edge, (corner[1] + tile // nx) * edge
        is_met = (visits[:, 3] + x_first < x + edge) & (visits[:, 4] + x_last >= x)
        is_met &= (visits[:, 5] + y_first < y + edge) & (visits[:, 6] + y_last >= y)
        assert numbers[starts[tile] : starts[tile + 1]].tolist() == np.flatnonzero(is_met).tolist()
        lows = np.maximum(visits[is_met][:, [3, 5]] + [x_first, y_first] - [x, y], 0)
        highs = np.minimum(visits[is_met][:, [4, 6]] + [x_last, y_last] - [x, y], edge - 1)
        mine = rectangles[starts[tile] : starts[tile + 1]]
        assert (mine == np.column_stack([lows, highs])[:, [0, 2, 1, 3]]).all()


@given(**GROUPS, n_voxels=st.sampled_from([1, 30, 3000]), spread=st.sampled_from([8, 60, 512]))
def test_runs_hold_the_voxels_of_the_patches_that_a_visit_meets(seed, n_groups, n_headings, drift, n_voxels, spread):
    rng = np.random.default_rng(seed)
    low = rng.integers(0, 513 - spread)
    points = np.column_stack([low + rng.integers(0, spread, (n_voxels, 2)), rng.integers(0, 5, n_voxels)]) + 0.5
    tile = PointMap.from_points(points, np.tile([1.0, 0.0, 0.0], (n_voxels, 1)), 1.0).tile((0, 0))
    starts, columns = random_groups(seed, n_groups, n_headings, drift, 600)
    visits = visit_kernels.plan_visits(starts, columns)
    middles, layers = starts[1:] - rng.integers(0, 2, n_groups), rng.integers(-1, 7, n_groups)
    firsts, numbers, rectangles = visit_kernels.visits_of_tiles(visits, (-3, 9, -40, 2), 9, (0, 0), (1, 1))
    stops, runs = visit_kernels.stops_in_tile(
        visits, numbers, rectangles, starts, middles, layers, int(tile.index.layers[0]), tile.layer_numbers,
        tile.index.patch_starts, tile.n_patches,
    )  # fmt: skip
    patches = tile.columns // PATCH_VOXELS
    wanted = []
    for number, rectangle in zip(numbers, rectangles, strict=True):
        group, since, until = visits[number, :3]
        x_first, x_last, y_first, y_last = rectangle // PATCH_VOXELS
        is_met = (tile.layers == layers[group]) & (patches[:, 0] >= x_first) & (patches[:, 0] <= x_last)
        met = np.flatnonzero(is_met & (patches[:, 1] >= y_first) & (patches[:, 1] <= y_last)).tolist()
        if met:
            points = [starts[group], middles[group], starts[group + 1]]
            wanted.append(([*points, since, until, *rectangle], met))
    event(f"stops: {min(len(wanted), 2)}")
    assert len(stops) == len(wanted) and firsts.tolist() == [0, len(numbers)]
    for stop, (beginning, met) in zip(stops, wanted, strict=True):
        assert stop[:9].tolist() == beginning
        assert [k for first, end in runs[stop[9] : stop[10]] for k in range(first, end)] == met
