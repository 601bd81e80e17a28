# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Priors in latitude, longitude and height on the command line: localized as those in the map's coordinates are."""

import numpy as np
import pytest

from localized_poses import localized_poses
from maxcon.geometry import Pose
from maxcon.io.crs import GeographicFrame
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.simulation.dataset_files import CRS
from maxcon.scan.trajectory import Trajectory
from nmea_sentences import clock, gga, sentence, zda

FRAME = GeographicFrame(CRS)


@pytest.fixture(scope="module")
def geographic(drive):
    """Times, places and true orientations of the drive's prior."""
    prior = read_trajectory(drive.dataset.prior)
    places = FRAME.to_geographic(prior.positions)
    true = type(prior)(prior.times, prior.positions, FRAME.quaternions_to_enu(places, prior.quaternions_xyzw))
    return prior.times, places, np.degrees(true.angles)


@pytest.fixture
def table(geographic, tmp_path):
    """The prior as a table, its heights by `name`, lifted."""

    def write(name="ellipsoidal_height", lifted=0.0):
        lines = [f"time,latitude,longitude,{name},roll_deg,pitch_deg,azimuth_deg"]
        for time, (latitude, longitude, height), (roll, pitch, heading) in zip(*geographic, strict=True):
            lines.append(
                f"{time:.6f},{latitude:.11f},{longitude:.11f},{height + lifted:.5f},{roll},{pitch},{90.0 - heading}"
            )
        path = tmp_path / "gnss.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


@pytest.fixture
def localize(maxcon, drive, tmp_path):
    def run(prior, *options):
        return maxcon(
            "localize", drive.city, drive.dataset.scans, "--prior", prior, "-o", tmp_path / "poses.csv", "-q", *options
        )

    return run


@pytest.fixture
def reference(maxcon, drive, tmp_path):
    """The poses with the drive's own prior."""
    path = tmp_path / "reference.csv"
    assert (
        maxcon("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", path, "-q").code == 0
    )
    return localized_poses(path)


def test_a_table_in_latitude_and_longitude(localize, table, reference, tmp_path):
    ended = localize(table())
    assert (ended.code, ended.err) == (0, "")
    assert "prior: positions from gnss.csv; orientations of gnss.csv" in ended.out
    assert "(ellipsoidal) as they are" in ended.out
    np.testing.assert_allclose(localized_poses(tmp_path / "poses.csv"), reference, atol=1e-4)


def test_heights_are_told_apart(localize, refused, table, reference, tmp_path):
    refused(localize(table(lifted=46.0)), "ellipsoidal heights", "--geoid-height, about 46")
    refused(localize(table("orthometric_height", 46.0)), "heights above the geoid", "Are the map's heights ellipsoidal")
    refused(localize(table("orthometric_height"), "--geoid-height", "46"), "Leave it out")
    refused(localize(table("altitude")), "'altitude', which may be either")
    refused(localize(table(), "--prior-topic", "/fix"), "--prior-topic with priors of a recording")
    assert not (tmp_path / "poses.csv").exists()
    ended = localize(table(lifted=46.0), "--geoid-height", "46")
    assert (ended.code, ended.err) == (0, "") and "less 46 m" in ended.out
    np.testing.assert_allclose(localized_poses(tmp_path / "poses.csv"), reference, atol=1e-4)


def test_a_receiver_s_log(localize, geographic, reference, tmp_path):
    lines = []
    for time, (latitude, longitude, height), (roll, pitch, heading) in zip(*geographic, strict=True):
        now = clock(time)[0]
        lines += [
            zda(time),
            gga(time, latitude, longitude, f"{height - 40.0:.5f}", 40.0, hdop=10.0),
            sentence("PASHR", now, (90.0 - heading) % 360.0, "T", roll, -pitch, 0, 0.1, 0.1, 1.0, 1, 1),
        ]
    path = tmp_path / "gnss.nmea"
    path.write_text("\r\n".join(["# a log", *lines]) + "\r\n")
    ended = localize(path)
    assert (ended.code, ended.err) == (0, "")
    assert "(NMEA); times: UTC; sigmas: 0 of GST" in ended.out and "orientations of PASHR" in ended.out
    assert "windows from the prior's covariances" in ended.out
    np.testing.assert_allclose(localized_poses(tmp_path / "poses.csv"), reference, atol=2e-3)


def test_priors_of_an_antenna_become_the_scanner_s(localize, refused, drive, reference, tmp_path):
    """The antenna is 6 m behind the scanner and turned by 90 degrees: too far to be found without a mounting."""
    prior = read_trajectory(drive.dataset.prior)
    T_sensor_prior = Pose(-6.0, 0.5, -0.3, 0.0, 0.0, np.pi / 2.0)
    antenna = Trajectory.from_poses(prior.times, [pose @ T_sensor_prior for pose in prior.poses()])
    path, mounting = tmp_path / "antenna.txt", tmp_path / "mounting.toml"
    write_tum(path, antenna)
    mounting.write_text("[prior]\nposition = [-6.0, 0.5, -0.3]\nheading_deg = 90.0\n")
    ended = localize(path, "--mounting", mounting)
    assert (ended.code, ended.err) == (0, "")
    np.testing.assert_allclose(localized_poses(tmp_path / "poses.csv"), reference, atol=1e-4)
    mounting.write_text("[antenna]\n")
    refused(localize(path, "--mounting", mounting, "--overwrite"), "got antenna", mounting)
