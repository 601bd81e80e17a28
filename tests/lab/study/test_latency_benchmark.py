# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The benchmark of latency: what is timed as a stage, which methods meet in a window, and its table by hand."""

import csv
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


@pytest.fixture
def latency_table(latency):
    return importlib.import_module("latency_table")


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


def write_rows(latency, path):
    """Two epochs of two rounds: maxcon in 10 and 12, then 20 and 22 ms, half of it normals; a peer in 1 ms, wrong."""
    rows = []
    for epoch in (0, 1):
        for turn in (0, 1):
            ms = 10.0 + 10.0 * epoch + 2.0 * turn
            known = {"drive": "d", "offset": 12.0, "heading_deg": 10.0, "epoch": epoch, "round": turn}
            known |= {"n_points": 1000, "map": "standard", "was_widened": epoch == 1, "grown_mb": 5.0 + epoch}
            none = dict.fromkeys(latency.STAGES, 0.0)
            ours = none | {"normals": 0.5 * ms, "ms": ms, "is_good": True, "is_right": True}
            theirs = none | {"ms": 1.0, "is_good": True, "is_right": False}
            rows += [known | {"method": "maxcon"} | ours, known | {"method": "peer"} | theirs]
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def test_the_table_by_hand(latency, latency_table, tmp_path):
    write_rows(latency, tmp_path / latency.TABLE)
    found = latency_table.read_series(tmp_path)
    lines = latency_table.table("d", found["d"])
    assert lines[2].startswith("2 epochs of 1,000 points in the median, 2 rounds")
    assert lines[6:8] == [
        "| 12 m, 10° | **maxcon** | 16.0 | 20.5 | 20.9 | **2 of 2** | 2 | 0 | 6 |",
        "|  | peer | 1.0 | 1.0 | 1.0 | 0 of 2 | 2 | 2 | 6 |",
    ]
    assert "| normals | 8.0 / 10.2 / 10.4 |" in lines
    assert "| all else | 8.0 / 10.2 / 10.4 |" in lines
    assert "| in doubt, searched for once more | 1 of 2 |" in lines
