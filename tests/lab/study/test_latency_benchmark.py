# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The benchmark of latency: what is timed as a stage."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from maxcon import MaximumConsensus, PointMap, Pose, Scan, SearchSpace

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture
def latency(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("latency")


def test_all_stages_of_a_search_are_seen(latency):
    rng = np.random.default_rng(0)
    along_x = np.column_stack([rng.uniform(0, 12, 6000), np.full(6000, 4.03), rng.uniform(0, 3, 6000)])
    along_y = np.column_stack([np.full(6000, 14.03), rng.uniform(-9, 3, 6000), rng.uniform(0, 3, 6000)])
    normals = np.repeat([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]], 6000, axis=0)
    points = np.concatenate([along_x, along_y])
    pose = Pose(5.0, -3.0, 1.5, 0.0, 0.0, 0.7)
    scan = Scan((points - pose.position) @ pose.rotation)
    point_map, stages = PointMap.from_points(points, normals, 0.06), latency.StageTimes()
    with stages.watching():
        MaximumConsensus(SearchSpace(3.0, heading_half_width_deg=2.0)).localize(scan, point_map, pose)
    assert set(stages.ms) == set(latency.STAGES)
