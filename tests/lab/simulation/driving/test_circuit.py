# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The circuit: closed, smooth, in the right lane, and never through a house."""

import numpy as np
import pytest

from maxcon.lab.simulation import CAMPAIGN_GRID, StreetGrid, circuit_through

ANGLE = np.radians(31.0)


@pytest.fixture(scope="module")
def circuit():
    return circuit_through(street_angle=ANGLE)


def _in_grid(points):
    cosine, sine = np.cos(ANGLE), np.sin(ANGLE)
    return points @ np.array([[cosine, -sine], [sine, cosine]])


def test_around_one_block_it_is_a_square_with_round_corners():
    grid = StreetGrid(u_lines=(0.0, 100.0), v_lines=(0.0, 100.0))
    circuit = circuit_through(((0, 0), (1, 0), (1, 1), (0, 1)), grid, lane=1.0)
    radius = 9.0 - 0.5 / 9.0  # a moving mean over 1 m draws an arc in by half of that squared over its radius
    straight, quarter = 102.0 - 2 * 9.0, 0.5 * np.pi * radius  # the right lane is the outer one
    assert circuit.length == pytest.approx(4 * (straight + quarter), abs=0.05)
    np.testing.assert_allclose(circuit.points.min(axis=0), [-1.0, -1.0], atol=0.01)
    np.testing.assert_allclose(circuit.points.max(axis=0), [101.0, 101.0], atol=0.01)
    assert len(circuit.crossings) == 0
    assert circuit.headings[-1] - circuit.headings[0] == pytest.approx(2 * np.pi)


def test_right_turns_are_narrower_than_left_turns(circuit):
    lengths = np.diff(circuit.turns, axis=1).ravel()
    headings = circuit.headings[np.searchsorted(circuit.distances, circuit.turns)]
    is_left = np.diff(headings, axis=1).ravel() > 0.0
    assert (is_left.sum(), (~is_left).sum()) == (7, 3)
    np.testing.assert_allclose(lengths[is_left], 0.5 * np.pi * 9.0, atol=0.2)
    np.testing.assert_allclose(lengths[~is_left], 0.5 * np.pi * 6.0, atol=0.2)


def test_it_is_closed_and_as_long_as_a_campaign_s(circuit):
    np.testing.assert_array_equal(circuit.points[0], circuit.points[-1])
    assert 1100.0 < circuit.length < 1400.0
    assert circuit.headings[-1] - circuit.headings[0] == pytest.approx(2 * np.pi)
    assert len(circuit.crossings) == 6


def test_heading_and_curvature_are_continuous(circuit):
    step = circuit.distances[1]
    np.testing.assert_allclose(np.linalg.norm(np.diff(circuit.points, axis=0), axis=1), step, rtol=1e-3)
    turn = np.diff(circuit.headings)  # around the whole ring, the seam among them
    curvature = np.append(turn, turn[0]) / step
    assert np.abs(curvature).max() < 1.1 / 6.0
    assert np.abs(np.diff(curvature)).max() < 0.01


def test_it_keeps_right_of_the_centre_lines(circuit):
    points, ways = _in_grid(circuit.points), _in_grid(circuit.directions)
    distances = circuit.distances
    in_turn = ((distances[:, None] > circuit.turns[:, 0] - 4.0) & (distances[:, None] < circuit.turns[:, 1] + 4.0)).any(
        axis=1
    )
    along_u = np.abs(ways[:, 0]) > 0.9
    for is_u, lines, to_right in ((True, CAMPAIGN_GRID.v_lines, -1.0), (False, CAMPAIGN_GRID.u_lines, 1.0)):
        rows = (along_u == is_u) & ~in_turn
        across, forward = (points[rows, 1], ways[rows, 0]) if is_u else (points[rows, 0], ways[rows, 1])
        offsets = across[:, None] - np.array(lines)
        nearest = offsets[np.arange(len(offsets)), np.abs(offsets).argmin(axis=1)]
        np.testing.assert_allclose(nearest * to_right * np.sign(forward), 0.9, atol=1e-3)


def test_it_stays_on_the_carriageway(circuit):
    points = _in_grid(circuit.points)
    for block in CAMPAIGN_GRID.blocks(CAMPAIGN_GRID.carriageway):
        u_gap = np.maximum(block.u_low - points[:, 0], points[:, 0] - block.u_high)
        v_gap = np.maximum(block.v_low - points[:, 1], points[:, 1] - block.v_high)
        assert np.maximum(u_gap, v_gap).min() > 1.0  # half a car
