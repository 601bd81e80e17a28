# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Visits hold each group at each heading once, in the box of its points."""

import itertools

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from searches import SEEDS

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
    "seed": SEEDS, "n_groups": st.integers(0, 20), "n_headings": st.integers(1, 9),
    "drift": st.sampled_from([0, 2, 10, 60]),
}  # fmt: skip


@given(**GROUPS, spread=st.sampled_from([1, 1000, 2**29]))
def test_visits_are_the_runs_within_the_rim(seed, n_groups, n_headings, drift, spread):
    starts, columns = random_groups(seed, n_groups, n_headings, drift, spread)
    wanted = planned_plainly(starts, columns)
    event(f"parted: {len(wanted) > n_groups}")
    assert visit_kernels.plan_visits(starts, columns).tolist() == wanted
