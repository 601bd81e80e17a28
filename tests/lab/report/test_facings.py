# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Walls by facing: a map of which one wall is off shows it, in the direction of that wall, with its sign."""

import numpy as np
import pytest

import maxcon
from maxcon.lab.report.drive_page import facings


def walls(off):
    """Points on two walls, normals at 15 and at 105 degrees from +x, the second off along that by so much; normals."""
    rng, turn = np.random.default_rng(0), np.radians(15.0)
    flat = np.column_stack([rng.uniform(-8.0, 8.0, 40_000), rng.uniform(0.0, 4.0, 40_000)])
    first = np.column_stack([np.full(40_000, 10.0), flat])
    second = np.column_stack([flat[:, 0], np.full(40_000, -6.0 + off), flat[:, 1]])
    normals = np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 40_000, axis=0)
    axes = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([first, second]) @ axes.T, normals @ axes.T


def test_a_wall_that_is_off_is_shown_in_its_direction():
    point_map = maxcon.PointMap.from_points(*walls(0.04))
    points, normals = (part[::20] for part in walls(0.0))
    pose = maxcon.Pose(1.0, 0.5, 1.8, 0.0, 0.0, 0.7)
    scan = maxcon.Scan(pose.inverse.apply(points), normals @ pose.rotation)
    first, second = facings([(scan, pose), (scan, pose)], point_map)
    assert (first.first_deg, first.last_deg, second.first_deg, second.last_deg) == (0.0, 30.0, 90.0, 120.0)
    assert min(first.n_points, second.n_points) > 800 and min(first.found, second.found) > 0.95
    assert (first.offset, second.offset) == (pytest.approx(0.0, abs=0.004), pytest.approx(0.04, abs=0.004))
    assert second.p95 < 0.06


def test_no_scan_has_no_facing():
    assert facings([], maxcon.PointMap.from_points(*walls(0.0))) == []
