"""Priors in latitude, longitude and height on the command line: localized as those in the map's coordinates are."""

import numpy as np
import pytest

from localized_poses import localized_poses
from maxcon.geometry import Pose
from maxcon.io.crs import GeographicFrame
from maxcon.io.poses_between_crs import poses_in_crs
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.simulation.datasets import CRS
from maxcon.scan.trajectory import Trajectory
from nmea_sentences import clock, gga, sentence, zda

FRAME = GeographicFrame(CRS)


@pytest.fixture(scope="module")
def geographic(drive):
    """Times, places and true orientations of the drive's prior."""
    prior = read_trajectory(drive.dataset.prior)
    places = FRAME.to_geographic(prior.positions)
    turns = FRAME.quaternions_to_map(places, prior.quaternions_xyzw, inverse=True)
    true = type(prior)(prior.times, prior.positions, turns)
    return prior.times, places, np.degrees(true.angles)


@pytest.fixture
def table(geographic, tmp_path):
    """The prior as a table, its heights by `name`, lifted."""

    def write(name="ellipsoidal_height", lifted=0.0):
        lines = [f"time,latitude,longitude,{name},roll_deg,pitch_deg,azimuth_deg"]
        for time, (latitude, longitude, height), (roll, pitch, heading) in zip(*geographic, strict=True):
            place = f"{latitude:.11f},{longitude:.11f},{height + lifted:.5f}"
            lines.append(f"{time:.6f},{place},{roll},{pitch},{90.0 - heading}")
        path = tmp_path / "gnss.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


@pytest.fixture
def assert_same(localize, poses, tmp_path):
    """Localize with a prior; check that the poses are those by the drive's own prior, and what is said."""

    def check(prior, *words, options=(), within=1e-4):
        ended = localize("--overwrite", *options, prior=prior)
        assert (ended.code, ended.err) == (0, "")
        assert all(word in ended.out for word in words), ended.out
        np.testing.assert_allclose(localized_poses(tmp_path / "poses.csv"), localized_poses(poses), atol=within)

    return check


def test_a_table_in_latitude_and_longitude(assert_same, table):
    assert_same(table(), "prior: positions from gnss.csv; orientations of gnss.csv", "(ellipsoidal) as they are")
    assert_same(table(lifted=46.0), "less 46 m", options=("--geoid-height", "46"))


def test_a_receiver_s_log_and_one_whose_heights_are_not_the_map_s(assert_same, localize, refused, geographic, tmp_path):
    for name, lifted in (("gnss.nmea", 0.0), ("off.nmea", 40.0)):
        lines = ["# a log"]
        for time, (latitude, longitude, height), (roll, pitch, heading) in zip(*geographic, strict=True):
            attitude = ((90.0 - heading) % 360.0, "T", roll, -pitch, 0, 0.1, 0.1, 1.0, 1, 1)
            lines += [
                zda(time),
                gga(time, latitude, longitude, f"{height - 40.0 + lifted:.5f}", 40.0, hdop=10.0),
                sentence("PASHR", clock(time)[0], *attitude),
            ]
        (tmp_path / name).write_text("\r\n".join(lines) + "\r\n")
    words = ("(NMEA); times: UTC; sigmas: 0 of GST", "orientations of PASHR", "windows from the prior's covariances")
    assert_same(tmp_path / "gnss.nmea", *words, within=2e-3)
    ended = localize("--overwrite", prior=tmp_path / "off.nmea")
    refused(ended, "--geoid-height", "geoid height of the log 40.00 m")


def test_priors_and_references_in_another_projected_crs(assert_same, localize, refused, drive, table, tmp_path):
    """In the next UTM zone, where headings are 4 degrees off; in a datum that is known to a metre."""
    options = ("--prior-crs", "EPSG:25833", "--sigma-position", "1", "--sigma-heading-deg", "1")
    prior, reference, elsewhere = (tmp_path / f"{name}.txt" for name in ("prior", "reference", "elsewhere"))
    for source, crs, path in (("prior", 25833, prior), ("reference", 25833, reference), ("reference", 3068, elsewhere)):
        own = read_trajectory(getattr(drive.dataset, source))
        write_tum(path, poses_in_crs(own, CRS, f"EPSG:{crs}", source)[0])
    true = ("--reference", reference, "--reference-crs", "EPSG:25833")
    said = (f"{name}: from ETRS89 / UTM zone 33N" for name in ("prior", "reference"))
    said = (*said, "4 localized scans, 0 farther")
    assert_same(prior, *said, options=(*options, *true))
    refused(localize("--overwrite", prior=prior), "--prior-crs")
    inexact = ("--reference", elsewhere, "--reference-crs", "EPSG:3068", "--overwrite")  # Soldner's of Berlin
    refused(localize(*inexact), "exact to a voxel", "--allow-inexact-crs")
    assert localize(*inexact, "--allow-inexact-crs").code == 0
    refused(localize("--prior-crs", CRS, "--overwrite", prior=table()), "--prior-crs with latitudes")
    refused(localize("--at", "1,2,3", "--prior-crs", CRS, prior=None), "--at", "--prior-crs")


def test_priors_of_an_antenna_become_the_scanner_s(assert_same, localize, refused, drive, tmp_path):
    """The antenna is 6 m behind the scanner and turned by 90 degrees: too far to be found without a mounting."""
    prior = read_trajectory(drive.dataset.prior)
    T_sensor_prior = Pose(-6.0, 0.5, -0.3, 0.0, 0.0, np.pi / 2.0)
    path, mounting = tmp_path / "antenna.txt", tmp_path / "mounting.toml"
    write_tum(path, Trajectory.from_poses(prior.times, [pose @ T_sensor_prior for pose in prior.poses()]))
    mounting.write_text("[prior]\nposition = [-6.0, 0.5, -0.3]\nheading_deg = 90.0\n")
    assert_same(path, options=("--mounting", mounting))
    mounting.write_text("[antenna]\n")
    refused(localize("--mounting", mounting, "--overwrite", prior=path), "antenna", mounting)
