"""Lines through a grid of streets, speeds, waits and poses along them, and the errors with which poses are measured."""

import math
from itertools import pairwise

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.simulation import PriorErrors
from maxcon.lab.simulation.drive import (
    GNSS_BOUNDS,
    OdometryErrors,
    RoundDriver,
    draw_georeferencing_errors,
    draw_gnss_errors,
    drive_along,
    drive_round,
    walk_along,
)
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, circuit_through, route_over_crossing

ROUTE = route_over_crossing(0.5, 60.0, 40.0)
DRIVE = drive_along(route_over_crossing(0.3, 60.0, 40.0), 1, start_time=100.0)
TIMES = np.arange(100.0, DRIVE.times[-1], 0.1)
TRUE = DRIVE.poses(TIMES)


@pytest.fixture(scope="module")
def circuit():
    """In the frame of its grid."""
    return circuit_through(street_angle=0.0)


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


def test_a_drive_is_seeded_level_and_on_its_route():
    drive, again = drive_along(ROUTE, 1), drive_along(ROUTE, 1)
    np.testing.assert_array_equal(drive.angles, again.angles)
    assert np.abs(drive.positions[:, 2] - 2.0).max() <= 0.02
    assert 0.0 < np.degrees(np.abs(drive.angles[:, :2])).max() <= 0.8
    np.testing.assert_allclose(drive.angles[[0, -1], 2], [0.5, 0.5 + np.pi / 2.0], atol=1e-6)
    (pose,) = drive.poses([drive.times[100]])
    np.testing.assert_allclose(pose.position, drive.positions[100])
    np.testing.assert_array_equal(drive.positions[:, :2], ROUTE.points)


def test_who_walks_holds_the_scanner_high_and_low_and_tilts_it():
    walk, again = walk_along(ROUTE, 1), walk_along(ROUTE, 1)
    np.testing.assert_array_equal(walk.angles, again.angles)
    assert 1.0 <= walk.positions[:, 2].min() < 1.2 < 1.8 < walk.positions[:, 2].max() <= 2.0
    tilts = np.degrees(walk.angles[:, :2])
    assert (np.abs(tilts).max(axis=0) <= 20.0).all() and (tilts.std(axis=0) > 10.0).all()
    speeds = np.linalg.norm(np.diff(walk.positions[:, :2], axis=0), axis=1) / np.diff(walk.times)
    assert 1.1 < speeds.min() < speeds.max() < 1.7


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


def test_a_round_waits_as_often_as_told_and_lasts_as_long_as_asked(circuit):
    drive = drive_round(circuit, RoundDriver(6.0, n_stops=3), 4, height=2.0, start_time=1000.0, duration=300.0)
    free = drive_round(circuit, RoundDriver(6.0, n_stops=3), 4, height=2.0, start_time=1000.0)
    assert drive.times[-1] - drive.times[0] == pytest.approx(300.0, abs=1e-9)
    stands = np.flatnonzero(np.all(np.diff(drive.positions, axis=0) == 0.0, axis=1))
    assert len(stands) == 3
    waits = np.diff(drive.times)[stands]
    assert ((waits >= 4.0) & (waits <= 15.0)).all()
    np.testing.assert_allclose(np.diff(free.times)[stands], waits)  # speeds are scaled, waits are not


# --- poses as vehicles measure them ---
@pytest.fixture(scope="module")
def gnss_errors():
    return draw_gnss_errors(200_000, 0.1, 0)


def test_gnss_errors_have_their_spread_and_bounds(gnss_errors):
    x, y, z, roll, pitch, heading = gnss_errors.std(axis=0)
    np.testing.assert_allclose([x, y, z, np.degrees(heading)], [1.17, 1.17, 0.0146, 0.6], rtol=0.06)
    np.testing.assert_allclose(np.degrees([roll, pitch]), 0.05, rtol=0.06)
    worst = np.abs(gnss_errors).max(axis=0)
    assert ((worst <= GNSS_BOUNDS) & (worst > 0.95 * GNSS_BOUNDS)).all()
    assert worst[0] < 3.0  # the paper's search range
    assert np.abs(np.corrcoef(gnss_errors.T) - np.eye(6)).max() < 0.1


def test_gnss_errors_are_remembered_for_20_s(gnss_errors):
    heading = gnss_errors[:, 5]
    for wait in (1.0, 20.0, 40.0):
        lag = round(wait / 0.1)
        found = np.corrcoef(heading[:-lag], heading[lag:])[0, 1]
        assert found == pytest.approx(np.exp(-wait / 20.0), abs=0.06)
    assert np.abs(np.diff(gnss_errors[:, 0])).max() < 0.8  # no jumps, at the bounds neither


def test_priors_are_off_by_no_more_than_their_bounds():
    reference = Pose(10.0, 20.0, 2.0, 0.01, -0.01, 3.14)
    errors, rng = PriorErrors(), np.random.default_rng(0)
    off = np.array([errors.prior(reference, rng).values - reference.values for _ in range(500)])
    off[:, 3:] = np.degrees(wrap_angle(off[:, 3:]))
    bounds = np.array([2.5, 2.5, 0.01, 0.05, 0.05, 1.8])
    worst = np.abs(off).max(axis=0)
    assert ((worst > 0.9 * bounds) & (worst <= bounds + 1e-9)).all()


def _motions(poses):
    return [before.inverse @ after for before, after in pairwise(poses)]


def test_odometry_without_errors_measures_every_true_motion():
    odometry = OdometryErrors(0.0, 0.0, 0.0, 0.0, 0.0).draw(DRIVE, TIMES, 0)
    assert (odometry[0].x, odometry[0].y, odometry[0].z, odometry[0].heading) == (0.0, 0.0, 0.0, 0.0)
    for told, true in zip(_motions(odometry), _motions(TRUE), strict=True):
        np.testing.assert_allclose(told.position, true.position, atol=1e-9)
        np.testing.assert_allclose(told.rotation, true.rotation, atol=1e-9)


def test_scale_and_drift_of_odometry_are_as_large_as_said():
    scaled = OdometryErrors(0.01, 0.0, 0.0, 0.0, 0.0).draw(DRIVE, TIMES, 0)
    told, way = (sum(np.linalg.norm(motion.position) for motion in _motions(poses)) for poses in (scaled, TRUE))
    assert abs(told / way - 1.0) == pytest.approx(0.01, rel=1e-6)
    turned = OdometryErrors(0.0, 0.05, 0.0, 0.0, 0.0).draw(DRIVE, TIMES, 0)
    drift = math.remainder(turned[-1].heading - (TRUE[-1].heading - TRUE[0].heading), 2.0 * math.pi)
    assert abs(drift) == pytest.approx(math.radians(0.05) * (TIMES[-1] - TIMES[0]), rel=1e-6)


def test_georeferencing_errors_are_2_cm_smooth_and_forgotten_after_a_round():
    errors = draw_georeferencing_errors(1, 1000.0, 101_000.0)
    offsets = errors.at(np.arange(1000.0, 101_000.0, 10.0))
    np.testing.assert_allclose(offsets.std(axis=0), 0.02, rtol=0.08)
    np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=0.003)
    times = np.arange(1000.0, 100_000.0, 1.0)
    here, soon, late = (errors.at(times + wait).ravel() for wait in (0.0, 30.0, 170.0))
    assert np.abs(np.diff(errors.at(times), axis=0)).max() < 0.004
    assert abs(np.corrcoef(here, soon)[0, 1] - np.exp(-0.25)) < 0.05
    assert abs(np.corrcoef(here, late)[0, 1]) < 0.1
