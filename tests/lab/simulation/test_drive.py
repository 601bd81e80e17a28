# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Lines through a grid of streets, and speeds, waits and poses along them."""

import math

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import (
    CAMPAIGN_GRID,
    RoundDriver,
    StreetGrid,
    circuit_through,
    drive_along,
    drive_round,
    route_over_crossing,
)

ROUTE = route_over_crossing(0.5, 60.0, 40.0)
LEVEL = {"height": 2.0, "start_time": 0.0}


@pytest.fixture(scope="module")
def circuit():
    """In the frame of its grid."""
    return circuit_through(street_angle=0.0)


def _headings(circuit):
    return np.unwrap(np.arctan2(circuit.directions[:, 1], circuit.directions[:, 0]))


def test_a_circuit_around_one_block_is_a_square_with_round_corners():
    grid = StreetGrid(u_lines=(0.0, 100.0), v_lines=(0.0, 100.0))
    circuit = circuit_through(((0, 0), (1, 0), (1, 1), (0, 1)), grid, 0.0, lane=1.0)
    radius = 9.0 - 0.5 / 9.0  # a moving mean over 1 m draws an arc in by half of that squared over its radius
    straight, quarter = 102.0 - 2 * 9.0, 0.5 * np.pi * radius  # the right lane is the outer one
    assert circuit.length == pytest.approx(4 * (straight + quarter), abs=0.05)
    np.testing.assert_allclose(circuit.points.min(axis=0), [-1.0, -1.0], atol=0.01)
    np.testing.assert_allclose(circuit.points.max(axis=0), [101.0, 101.0], atol=0.01)
    assert len(circuit.crossings) == 0
    assert np.ptp(_headings(circuit)[[0, -1]]) == pytest.approx(2 * np.pi)


def test_the_circuit_is_closed_and_its_right_turns_are_narrower(circuit):
    np.testing.assert_array_equal(circuit.points[0], circuit.points[-1])
    assert 1100.0 < circuit.length < 1400.0
    assert np.ptp(_headings(circuit)[[0, -1]]) == pytest.approx(2 * np.pi)
    assert len(circuit.crossings) == 6
    lengths = np.diff(circuit.turns, axis=1).ravel()
    turned = np.diff(_headings(circuit)[np.searchsorted(circuit.distances, circuit.turns)], axis=1).ravel()
    assert ((turned > 0.0).sum(), (turned < 0.0).sum()) == (7, 3)
    np.testing.assert_allclose(lengths, np.where(turned > 0.0, 9.0, 6.0) * 0.5 * np.pi, atol=0.2)


def test_heading_and_curvature_of_the_circuit_are_continuous(circuit):
    step = circuit.distances[1]
    np.testing.assert_allclose(np.linalg.norm(np.diff(circuit.points, axis=0), axis=1), step, rtol=1e-3)
    turn = np.diff(_headings(circuit))  # around the whole ring, the seam among them
    curvature = np.append(turn, turn[0]) / step
    assert np.abs(curvature).max() < 1.1 / 6.0
    assert np.abs(np.diff(curvature)).max() < 0.01


def test_the_circuit_keeps_right_and_on_the_carriageway(circuit):
    distances, points, ways = circuit.distances[:, None], circuit.points, circuit.directions
    in_turn = ((distances > circuit.turns[:, 0] - 4.0) & (distances < circuit.turns[:, 1] + 4.0)).any(axis=1)
    along_u = np.abs(ways[:, 0]) > 0.9
    for axis, lines, to_right in ((0, CAMPAIGN_GRID.v_lines, -1.0), (1, CAMPAIGN_GRID.u_lines, 1.0)):
        rows = (along_u == (axis == 0)) & ~in_turn
        offsets = points[rows, 1 - axis][:, None] - np.array(lines)
        nearest = offsets[np.arange(len(offsets)), np.abs(offsets).argmin(axis=1)]
        np.testing.assert_allclose(nearest * to_right * np.sign(ways[rows, axis]), 0.9, atol=1e-3)
    for block in CAMPAIGN_GRID.blocks(CAMPAIGN_GRID.carriageway):
        u_gap = np.maximum(block.u_low - points[:, 0], points[:, 0] - block.u_high)
        v_gap = np.maximum(block.v_low - points[:, 1], points[:, 1] - block.v_high)
        assert np.maximum(u_gap, v_gap).min() > 1.0  # half a car


def test_a_route_turns_left_over_the_crossing():
    route = route_over_crossing(0.0, 60.0, 40.0, lane=1.5)
    np.testing.assert_allclose(route.points[0], [-60.0, -1.5])
    np.testing.assert_allclose(route.points[-1], [1.5, 40.0], atol=0.06)
    assert np.diff(route.distances).max() < 0.11
    for before, after in ((5.0, 50.0), (50.0, 7.0)):
        with pytest.raises(OptionError, match=r"Expected a route of more than 7\.5 m"):
            route_over_crossing(0.0, before, after)


def test_a_drive_slows_down_at_the_crossing():
    drive = drive_along(ROUTE, 1, slowest=0.2)
    speeds = np.diff(ROUTE.distances) / np.diff(drive.times)
    slowest = np.argmin(speeds)
    assert abs(ROUTE.distances[slowest] - ROUTE.stop_at) < 3.0
    assert speeds[slowest] < 2.0
    assert 6.0 < np.median(speeds[ROUTE.distances[1:] < ROUTE.stop_at - 20.0]) < 10.0


def test_a_drive_is_seeded_level_and_on_its_route():
    drive, again = drive_along(ROUTE, 1), drive_along(ROUTE, 1)
    np.testing.assert_array_equal(drive.angles, again.angles)
    assert np.abs(drive.positions[:, 2] - 2.0).max() <= 0.02
    assert 0.0 < np.degrees(np.abs(drive.angles[:, :2])).max() <= 0.8
    np.testing.assert_allclose(drive.angles[[0, -1], 2], [0.5, 0.5 + np.pi / 2.0], atol=1e-6)
    (pose,) = drive.poses([drive.times[100]])
    np.testing.assert_allclose(pose.position, drive.positions[100])
    np.testing.assert_array_equal(drive.positions[:, :2], ROUTE.points)


def test_a_vehicle_waits_where_it_has_slowed_down():
    through, waiting = drive_along(ROUTE, 4), drive_along(ROUTE, 4, wait=10.0)
    assert waiting.times[-1] == pytest.approx(through.times[-1] + 10.0)
    stop = through.times[np.searchsorted(ROUTE.distances, ROUTE.stop_at)]
    there, _ = waiting.at(stop + np.linspace(0.0, 10.0, 5))
    np.testing.assert_allclose(there, np.tile(there[0], (5, 1)))
    for one, other in ((stop - 1.0, stop - 1.0), (stop + 1.0, stop + 11.0)):
        np.testing.assert_allclose(through.at([one]), waiting.at([other]))
    for wrong in (-1.0, math.nan, math.inf):
        with pytest.raises(OptionError, match="wait"):
            drive_along(ROUTE, 4, wait=wrong)


def test_a_round_slows_down_for_turns_and_brakes_gently(circuit):
    drive = drive_round(circuit, RoundDriver(10.0, turn_speed=3.0), 1, height=2.0, start_time=5.0)
    middles = np.searchsorted(circuit.distances, circuit.turns.mean(axis=1))
    speeds = np.linalg.norm(np.diff(drive.positions[:, :2], axis=0), axis=1) / np.diff(drive.times)
    assert (np.abs(speeds[middles] - 3.0) < 0.7).all()
    assert 7.0 < speeds.max() < 12.5
    assert drive.times[0] == 5.0
    assert (np.diff(drive.times) > 0.0).all()
    drive = drive_round(circuit, RoundDriver(10.0, acceleration=2.0, n_stops=3), 2, **LEVEL)
    positions, _ = drive.at(np.arange(drive.times[0], drive.times[-1], 0.1))
    speeds = np.linalg.norm(np.diff(positions[:, :2], axis=0), axis=1) / 0.1
    assert np.percentile(np.abs(np.diff(speeds)) / 0.1, 99) < 3.0


def test_a_round_waits_as_often_as_told_and_lasts_as_long_as_asked(circuit):
    drive = drive_round(circuit, RoundDriver(6.0, n_stops=3), 4, height=2.0, start_time=1000.0, duration=300.0)
    free = drive_round(circuit, RoundDriver(6.0, n_stops=3), 4, height=2.0, start_time=1000.0)
    assert drive.times[-1] - drive.times[0] == pytest.approx(300.0, abs=1e-9)
    stands = np.flatnonzero(np.all(np.diff(drive.positions, axis=0) == 0.0, axis=1))
    assert len(stands) == 3
    waits = np.diff(drive.times)[stands]
    assert ((waits >= 4.0) & (waits <= 15.0)).all()
    np.testing.assert_allclose(np.diff(free.times)[stands], waits)  # speeds are scaled, waits are not


def test_a_round_is_seeded_wanders_by_decimetres_and_looks_where_it_goes(circuit):
    drive, again, other = (drive_round(circuit, RoundDriver(10.0), seed, **LEVEL) for seed in (5, 5, 6))
    np.testing.assert_array_equal(drive.times, again.times)
    assert drive.times[-1] != other.times[-1]
    offsets = np.linalg.norm(drive.positions[:, :2] - circuit.points, axis=1)
    assert 0.1 < offsets.max() <= 0.3 + 1e-9
    ways = np.gradient(drive.positions[:, :2], axis=0)
    np.testing.assert_allclose(np.cos(np.arctan2(ways[:, 1], ways[:, 0]) - drive.angles[:, 2]), 1.0, atol=1e-6)
    assert np.abs(np.diff(drive.angles[:, 2])).max() < 0.02
