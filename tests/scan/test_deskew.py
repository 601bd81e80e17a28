"""Deskewing: a simulated sensor in motion sees what it saw standing; real scans become the published ones."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxcon.errors import ArrayError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.scan.deskew import deskew
from maxcon.scan.trajectory import Trajectory

SPEED, RATE = 15.0, math.radians(30.0)  # m/s, rad/s
TURN = 0.1  # s


def _pose(time):
    """A car in a bend of 28.6 m radius, on a carriageway that makes it roll and pitch."""
    heading = 0.4 + RATE * time
    radius = SPEED / RATE
    x, y = radius * (math.sin(heading) - math.sin(0.4)), radius * (math.cos(0.4) - math.cos(heading))
    return Pose(x, y, 0.3 * time, 0.02 * math.sin(9.0 * time), 0.03 * math.cos(7.0 * time), heading)


def _motion(step=0.02, start=-0.1, end=0.3):
    times = np.arange(round((end - start) / step) + 1) * step + start
    return Trajectory.from_poses(times, [_pose(time) for time in times])


def _scene(n=4000):
    rng = np.random.default_rng(3)
    places = rng.uniform([-40.0, -40.0, -2.0], [40.0, 40.0, 12.0], (n, 3))
    return places[np.hypot(*places[:, :2].T) > 5.0]


def _seen(places, times):
    """Where the moving sensor sees each place at its own time."""
    return np.concatenate([_pose(t).inverse.apply(p[None]) for p, t in zip(places, times.tolist(), strict=True)])


@pytest.mark.parametrize("reference", [0.0, 0.05, 0.1], ids=["first point", "middle", "last point"])
def test_a_scan_at_15_m_s_and_30_degrees_s_is_that_of_a_sensor_that_stands(reference):
    places = _scene()
    times = np.linspace(0.0, TURN, len(places))
    seen, still = _seen(places, times), _pose(reference).inverse.apply(places)
    assert np.median(np.linalg.norm(seen - still, axis=1)) > 0.4
    errors = np.linalg.norm(deskew(seen, times, _motion(), reference) - still, axis=1)
    assert errors.max() < 0.01


def test_poses_ten_times_a_second_are_enough_also_a_little_beyond_them():
    for n_places, motion, largest in ((4000, _motion(step=0.1), 0.08), (500, _motion(start=0.02, end=0.08), 0.03)):
        places = _scene(n_places)
        times = np.linspace(0.0, TURN, len(places))
        errors = deskew(_seen(places, times), times, motion, 0.05) - _pose(0.05).inverse.apply(places)
        assert np.linalg.norm(errors, axis=1).max() < largest
        assert np.median(np.linalg.norm(errors, axis=1)) < 0.03


def test_a_sensor_that_stands_sees_what_it_sees():
    points = _scene(100)
    still = Trajectory.from_poses([0.0, 1.0], [Pose(3, 4, 5, 0.1, 0.2, 3.0)] * 2)
    np.testing.assert_allclose(deskew(points, np.linspace(0, 1, len(points)), still, 0.3, 1.0), points, atol=1e-12)


def test_motions_and_times_that_do_not_fit_the_scan_are_refused():
    points, times = np.ones((2, 3)), [0.0, 0.1]
    for motion, words in (
        (_motion(start=0.4, end=0.5), "over the scan"),
        (Trajectory.from_poses([0.05], [_pose(0.05)]), "over the scan"),
        (_motion(step=0.8, start=-0.4, end=0.4), "a gap of 0.800000 s"),
    ):
        with pytest.raises(TrajectoryError, match=words):
            deskew(points, times, motion, 0.05)
    for times in ([0.0], [0.0, math.nan], [[0.0, 0.1]]):
        with pytest.raises(ArrayError, match="one per point"):
            deskew(np.ones((2, 3)), times, _motion(), 0.0)
    assert deskew(np.empty((0, 3)), [], _motion(), 0.0).shape == (0, 3)


def _rigid(before, after):
    """Rotation and shift that take points to others best."""
    centre, centre_after = before.mean(axis=0), after.mean(axis=0)
    turn, _ = Rotation.align_vectors(after - centre_after, before - centre)
    return turn, centre_after - turn.apply(centre)


@pytest.mark.parametrize("number", range(3))
def test_points_deskewed_are_the_published_ones(real_data, number):
    """The motion is found from slices of 2 ms of every other point; the rest of the points is what is compared.

    The published points lie in the frame of the IMU at the time of the first point: that frame is the motion's first.
    """
    folder = real_data("recorders/drives/gtsam_points/newer_06")
    files = (folder / f"{name}_0{number}.bin" for name in ("raw", "deskewed", "times"))
    raw, published, times = (np.fromfile(file, "<f4").astype(np.float64) for file in files)
    raw, published = raw.reshape(-1, 3) * [-1.0, -1.0, 1.0], published.reshape(-1, 3)  # in the same axes
    known, rest = np.arange(0, len(raw), 2), np.arange(1, len(raw), 2)
    moments, quaternions, shifts = [], [], []
    for begin in np.arange(0.0, times.max(), 0.005):
        rows = known[(times[known] >= begin) & (times[known] < begin + 0.002)]
        if len(rows) >= 30:
            turn, shift = _rigid(raw[rows], published[rows])
            moments.append(times[rows].mean())
            quaternions.append(turn.as_quat())
            shifts.append(shift)
    motion = Trajectory(moments, shifts, quaternions)
    begin = motion.times[0]
    deskewed = motion.pose(0).apply(deskew(raw[rest], times[rest], motion, begin))
    before = np.median(np.linalg.norm(raw[rest] - published[rest], axis=1))
    after = np.linalg.norm(deskewed - published[rest], axis=1)
    assert before > 0.35 and np.median(after) < 0.02
