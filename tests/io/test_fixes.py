"""Fixes of receivers in the coordinates of a map: headings, covariances, heights, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pyproj
import pytest
from scipy.spatial.transform import Rotation

from maxcon.errors import CrsError, TrajectoryError
from maxcon.geometry.pose import angles_from_quaternions, quaternions_from_angles
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Orientations, ReceiverLog, place_fixes
from maxcon.scan.trajectory import Trajectory
from recorded_drives import bend

UTM = "EPSG:25832"
FRAME = GeographicFrame(UTM)


def _fixes(way, sigma=math.nan):
    covariance = np.full((2, 2), math.nan) if math.isnan(sigma) else np.diag([sigma**2, (2 * sigma) ** 2])
    return ReceiverLog(way.times, FRAME.to_geographic(way.positions), np.tile(covariance, (len(way), 1, 1)))


def _imu(way, off=0.0, sigma=math.nan, as_bearings=False):
    """Orientations towards true north, wrong by `off` (rad), at other times than the fixes."""
    turned = FRAME.quaternions_to_map(FRAME.to_geographic(way.positions), way.quaternions_xyzw, inverse=True)
    wrong = (Rotation.from_rotvec([0.0, 0.0, off]) * Rotation.from_quat(turned)).as_quat()
    if as_bearings:
        roll, pitch, heading = angles_from_quaternions(turned).T
        wrong = quaternions_from_angles(roll, pitch, math.pi / 2 - heading)
    times = np.append(way.times - 0.03, way.times[-1] + 0.07)
    turns = wrong[[*range(len(way)), len(way) - 1]]
    return Orientations("/imu", Trajectory(times, np.zeros((len(times), 3)), turns), np.full(len(times), sigma))


def _placed(fixes, orientations=None):
    log = replace(fixes, orientations=orientations, words="a log")
    placed = place_fixes(log, FRAME, None, "log.csv")
    return placed.trajectory, placed.words


def test_geographic_coordinates_and_back_and_north_as_the_projection_says():
    positions = np.random.default_rng(0).uniform([300_000, 5_300_000, -50], [700_000, 6_000_000, 3000], (50, 3))
    places = FRAME.to_geographic(positions)
    assert (places[:, 0] > 47).all() and (places[:, 0] < 55).all() and (places[:, 1] < 13).all()
    np.testing.assert_allclose(FRAME.to_map(places), positions, atol=1e-6)
    np.testing.assert_allclose(FRAME.to_map(places, geoid_height=46.5)[:, 2], positions[:, 2] - 46.5, atol=1e-9)
    places = np.array([[52.0, 12.0, 0.0], [52.0, 9.0, 0.0], [48.0, 6.5, 0.0]])
    factors = pyproj.Proj(UTM).get_factors(places[:, 1], places[:, 0])
    np.testing.assert_allclose(FRAME.convergence(places), np.radians(factors.meridian_convergence), atol=1e-6)
    assert abs(GeographicFrame("EPSG:2053").convergence(np.array([[-26.0, 28.0, 0.0]]))[0]) > 3.1  # x west, y south


def test_orientations_of_an_imu_are_those_of_thebend():
    way = bend(turn=0.02)
    poses, words = _placed(_fixes(way, 0.4), _imu(way, sigma=0.01))
    np.testing.assert_allclose(poses.positions, way.positions, atol=1e-6)
    difference = poses.angles - way.angles
    assert np.abs(difference).max() < 0.02  # 30 ms of turning, and the last one held
    assert np.median(np.abs(difference[:, 2])) == pytest.approx(0.006, abs=0.001)
    np.testing.assert_allclose(poses.covariances[3], np.diag([0.16, 0.64, 1e-4]), atol=1e-12)
    assert words.startswith("a log; orientations of /imu; heights: ")
    poses, words = _placed(_fixes(way, 0.4), _imu(way))  # an IMU that states no sigma gets one
    assert math.sqrt(poses.covariances[0, 2, 2]) == pytest.approx(math.radians(2.0))
    assert "2 degrees assumed" in words
    assert _placed(_fixes(way), _imu(way))[0].covariances is None  # a receiver that states none does not


def test_an_imu_that_does_not_know_north_gives_roll_and_pitch_and_bearings_are_named():
    way = bend(turn=0.01)
    poses, words = _placed(_fixes(way, 0.2), _imu(way, off=1.5))
    assert np.abs(poses.angles - way.angles)[8:-8].max() < 0.01
    assert "86 degrees off" in words and "roll and pitch of the latter" in words
    assert math.sqrt(poses.covariances[0, 2, 2]) == pytest.approx(math.sqrt(2.0) * 0.4 / 5.0)
    way = bend(turn=0.05)
    poses, words = _placed(_fixes(way), _imu(way, as_bearings=True))
    assert "degrees off it (but " in words and "mixed up: bearings count clockwise from north" in words
    np.testing.assert_allclose(poses.angles[:, 2], way.angles[:, 2], atol=0.4)  # the course


def test_without_orientations_the_course_over_ground_is_the_heading():
    way = bend(turn=0.01)
    poses, words = _placed(_fixes(way))
    assert np.abs(poses.angles[8:-8, 2] - way.angles[8:-8, 2]).max() < 0.01
    assert np.abs(poses.angles[:, 2] - way.angles[:, 2]).max() < 0.08  # at both ends it is held
    assert not poses.angles[:, :2].any() and "course over ground; roll and pitch 0" in words


def test_a_vehicle_that_stands_keeps_its_heading_whatever_its_receiver_does():
    way = bend(30)
    standing = np.tile(way.positions[-1], (300, 1)) + np.random.default_rng(2).normal(0.0, 0.4, (300, 3))
    positions = np.concatenate([way.positions, standing])
    times = 100.0 + 0.1 * np.arange(len(positions))
    fixes = ReceiverLog(times, FRAME.to_geographic(positions), np.full((len(times), 2, 2), np.nan))
    assert np.abs(_placed(fixes)[0].angles[:, 2] - 0.8).max() < 0.1


@pytest.mark.parametrize(("places", "words"), [
    (FRAME.to_geographic(bend(3).positions), "got neither"),
    (np.array([[0.0, -81.0, 0.0], [90.0, 99.0, 0.0]]), "log.csv"),  # where the projection does not reach
    (FRAME.to_geographic(bend().positions)[:, [1, 0, 2]], r"latitude 9\.7.*, longitude 52\.3.*Are the two swapped"),
])  # fmt: skip
def test_positions_that_cannot_be_placed(places, words):
    fixes = ReceiverLog(np.arange(float(len(places))), places, np.full((len(places), 2, 2), np.nan))
    with pytest.raises(TrajectoryError, match=words):
        _placed(fixes)


def test_a_prior_that_was_moved_into_another_datum_is_as_uncertain_as_that():
    """What is in the map's datum but for its name is not."""
    way = bend()
    for crs, moves in (("EPSG:31467", True), (UTM, False)):
        frame = GeographicFrame(crs)
        placed = place_fixes(replace(_fixes(way, 0.1), words="a log"), frame, None, "log.csv")
        assert f"; {frame.operation.words}" in placed.words and "exact to" in placed.words
        more = frame.operation.accuracy**2 if moves else 0.0
        np.testing.assert_allclose(placed.trajectory.covariances[:, 0, 0], 0.01 + more)


def test_heights_above_a_geoid_that_is_not_there_are_not_made_up():
    """Heights of DHHN2016 need a grid, which is not installed with pyproj."""
    frame = GeographicFrame("EPSG:25832+7837")
    places = FRAME.to_geographic(bend(2).positions)
    assert frame.has_heights
    try:
        heights = frame.to_map(places)[:, 2]
    except CrsError as error:
        assert "--geoid-height" in str(error) and "\n" not in str(error)
    else:  # the grid is there after all
        assert (np.abs(heights - places[:, 2]) > 30.0).all()
    np.testing.assert_allclose(frame.to_map(places, geoid_height=45.0)[:, 2], 61.0 - 45.0, atol=1e-9)
