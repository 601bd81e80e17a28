"""Several scanners in one epoch: matched by time, in the vehicle's frame, deskewed, each with normals of its own."""

import math

import numpy as np
import pytest

from maxcon.errors import FileError
from maxcon.geometry import Pose
from maxcon.io.raw_scan import DeskewedScans, MergedScans
from maxcon.io.scans import RawScan, Scans
from maxcon.lab.simulation.scanners import RotatingScanner
from maxcon.scan import Scan
from maxcon.scan.scan import estimate_scan_normals
from maxcon.scan.trajectory import Trajectory

FRONT = Pose(1.8, 0.1, 0.4, 0.02, 0.05, 0.1)
REAR = Pose(-2.1, -0.3, 1.1, -0.03, 0.4, 2.9)
LOW, HIGH = np.array([-25.0, -12.0, -1.7]), np.array([60.0, 14.0, 7.0])
SPEED, TURN = 15.0, math.radians(30.0)


def vehicle(time):
    """T_room_vehicle: 15 m/s on a bend of 30 degrees/s."""
    heading = TURN * time
    return Pose(SPEED / TURN * math.sin(heading), SPEED / TURN * (1 - math.cos(heading)), 0.0, 0.01, -0.02, heading)


class InARoom(Scans):
    """What a scanner measures in a box, at its own times, while the vehicle moves or stands."""

    def __init__(self, mount, times, *, moves=True, has_times=True):
        self.mount, self.times = mount, np.array(times)
        self.moves, self.has_times = moves, has_times

    def name(self, i):
        return str(i)

    def read(self, i, min_range=1.0, max_range=120.0):
        rays = RotatingScanner(azimuth_step_deg=1.0).directions
        offsets = np.repeat(np.linspace(-0.05, 0.05, 360), 16) * self.moves
        points = []
        for column in range(360):
            T = vehicle(self.times[i] + offsets[16 * column]) @ self.mount
            some = rays[16 * column : 16 * column + 16] @ T.rotation.T
            with np.errstate(divide="ignore"):
                ranges = np.where(some > 0, (HIGH - T.position) / some, (LOW - T.position) / some).min(axis=1)
            points.append(rays[16 * column : 16 * column + 16] * ranges[:, None])
        points = np.concatenate(points)
        name = f"{self.times[i]}"
        times = offsets if self.has_times else None
        return RawScan(points, float(self.times[i]), name, len(points), 0, 0, 0, times)


def off_the_walls(points):
    return np.minimum(np.abs(points - LOW), np.abs(points - HIGH)).min(axis=1)


def merged(front, rear):
    return MergedScans([front, rear], [FRONT, REAR], ["front", "rear"])


def test_points_are_in_the_vehicle_and_normals_those_of_each_scanner():
    front, rear = (InARoom(mount, [0.3], moves=False, has_times=False) for mount in (FRONT, REAR))
    raw = merged(front, rear).read(0)
    assert len(raw.points) == 2 * 5760 and raw.point_times is None
    assert off_the_walls(vehicle(0.3).apply(raw.points)).max() < 1e-9
    scan = Scan(raw.points, time=raw.time, viewpoints=raw.viewpoints)
    alone = [estimate_scan_normals(scans.read(0).points) @ scans.mount.rotation.T for scans in (front, rear)]
    # Frames are turned back and forth, so that points at the edge of a window change sides.
    is_same = np.abs(scan.normals - np.concatenate(alone)).max(axis=1) < 1e-6
    assert is_same.mean() > 0.999
    in_room = scan.normals[scan.normals.any(axis=1)] @ vehicle(0.3).rotation.T
    assert (np.abs(in_room).max(axis=1) > 0.99).mean() > 0.95  # but for corners
    mixed = Scan(raw.points).normals  # as if one scanner had measured all: rings cross, and windows hold both
    assert np.abs(mixed - scan.normals).max() > 0.5


def test_epochs_are_matched_by_time():
    front = InARoom(FRONT, [0.0, 0.1, 0.2, 0.3, 0.4])
    rear = InARoom(REAR, [0.07, 0.21, 0.33, 0.46])
    scans = merged(front, rear)
    np.testing.assert_array_equal(scans._rows, [[0, -1], [1, 0], [2, 1], [3, 2], [4, -1]])
    assert len(scans) == 5
    words = "front in 5 epochs, up to 0.0 ms off; rear in 3 epochs, up to 30.0 ms off"
    assert scans.words == f"scans of 2 scanners: {words}"
    assert len(scans.read(0).points) == 5760 and len(scans.read(1).points) == 2 * 5760


def test_deskewed_at_15_metres_and_30_degrees_a_second():
    times = np.arange(-0.2, 1.0, 0.01)
    motion = Trajectory.from_poses(times, [vehicle(time) for time in times])
    scans = merged(InARoom(FRONT, [0.3, 0.4]), InARoom(REAR, [0.34, 0.44]))
    skewed, still = scans.read(0), DeskewedScans(scans, motion).read(0)
    assert np.percentile(off_the_walls(vehicle(0.3).apply(skewed.points)), 90) > 0.1
    assert off_the_walls(vehicle(0.3).apply(still.points)).max() < 0.01
    assert Scan(still.points, viewpoints=still.viewpoints).normals.any(axis=1).mean() > 0.5
    # A scan without times of points counts as of its own time.
    front, rear = (InARoom(m, [at], moves=False, has_times=False) for m, at in ((FRONT, 0.3), (REAR, 0.34)))
    scans = merged(front, rear)
    assert off_the_walls(vehicle(0.3).apply(scans.read(0).points)).max() > 0.3
    assert off_the_walls(vehicle(0.3).apply(DeskewedScans(scans, motion).read(0).points)).max() < 0.01


def test_scanners_on_other_clocks_are_refused():
    with pytest.raises(FileError, match=r"scans of the scanner rear within 0\.050 s of those of front, got none"):
        _ = merged(InARoom(FRONT, [0.0, 0.1]), InARoom(REAR, [1000.0, 1000.1])).words
