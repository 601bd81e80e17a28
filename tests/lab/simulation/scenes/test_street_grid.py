# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Streets and blocks, counted and measured by hand."""

import math

import numpy as np
import pytest

from maxcon.lab.simulation import CAMPAIGN_GRID, StreetGrid

CROSS = StreetGrid(u_lines=(0.0,), v_lines=(0.0,), carriageway=4.0, sidewalk=2.0, margin=30.0)


def test_one_crossing_has_four_blocks_with_two_frontages_each():
    blocks = CROSS.blocks()
    assert len(blocks) == 4
    assert {(block.u_low, block.u_high) for block in blocks} == {(-30.0, -6.0), (6.0, 30.0)}
    sides = CROSS.all_frontages()
    assert len(sides) == 8
    assert {side.length for side in sides} == {24.0}


def test_frontages_look_at_their_streets():
    for side in CROSS.all_frontages():
        (u, v), (to_u, to_v) = side.point(12.0, 0.0), side.point(12.0, 6.0)
        assert min(abs(u), abs(v)) == pytest.approx(6.0)
        assert min(abs(to_u), abs(to_v)) == pytest.approx(0.0, abs=1e-9)


def test_sidewalks_are_a_kerb_high():
    corners = CROSS.ground().corners.reshape(-1, 3)
    is_raised = corners[:, 2] == 0.12
    assert np.abs(corners[is_raised, :2]).min() == 4.0
    assert np.abs(corners[:, :2]).max() == 30.0
    assert set(corners[:, 2]) == {-0.1, 0.0, 0.12}


def test_streets_of_the_campaign_are_narrower_and_its_blocks_denser_than_the_demo_s():
    demo = StreetGrid()
    assert CAMPAIGN_GRID.half_width < demo.half_width
    assert np.diff(CAMPAIGN_GRID.u_lines).max() < np.diff(demo.u_lines).min()
    assert len(np.unique(np.diff(CAMPAIGN_GRID.u_lines))) == 4


def test_all_building_lines_of_the_campaign_fit_a_period_of_3_m():
    for side in CAMPAIGN_GRID.all_frontages():
        for length in (side.u, side.v, side.length):
            assert math.isclose(length / 3.0, round(length / 3.0), abs_tol=1e-9)
