"""The slips of new users: each works, or is met with a message that names its cause."""

import math

import numpy as np
import pytest

from maxcon import PointMap
from maxcon.geometry import Pose
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory


@pytest.fixture
def localized(localize, drive, tmp_path):
    """Localize the drive with rows of a prior as CSV, or with other scans."""

    def run(rows=None, header="time,x,y,z,roll,pitch,heading", scans=drive.dataset.scans, name="prior.csv", options=()):
        prior = drive.dataset.prior
        if rows is not None:
            prior = tmp_path / name
            lines = [header] if name.endswith(".csv") else []
            prior.write_text("\n".join([*lines, *rows]) + "\n")
        narrow = ("--half-width", "2.6", "--heading-half-width-deg", "3", "--wider", "0", "--overwrite")
        return localize(*narrow, *options, prior=prior, scans=scans)

    return run


@pytest.fixture
def priors(drive):
    trajectory = read_trajectory(drive.dataset.prior)
    return list(zip(trajectory.times.tolist(), trajectory.poses(), strict=True))


def rows_of(priors, meant=lambda pose: pose, scale=1.0):
    poses = [(time, meant(pose)) for time, pose in priors]
    return [
        ",".join(map(repr, (time, pose.x, pose.y, pose.z, *(scale * turn for turn in pose.values[3:].tolist()))))
        for time, pose in poses
    ]


def turned(roll, heading):
    turn = Pose(0.0, 0.0, 0.0, roll, 0.0, heading)
    return lambda pose: pose @ turn.inverse


@pytest.mark.parametrize(("meant", "words"), [
    (turned(0.0, math.pi / 2), "the sensor turned by 90 degrees to the left: give a --mounting file"),
    (
        lambda pose: Pose(*pose.position, pose.roll, pose.pitch, math.pi / 2 - pose.heading),
        "the headings of the prior those of a compass: a heading is 90 degrees less a bearing",
    ),
    (None, "the quaternions of the prior qw qx qy qz: write them as qx qy qz qw"),
], ids=["left", "compass", "scalar first"])  # fmt: skip
def test_what_would_fit_is_said_where_nothing_does(localized, priors, prior_rows, meant, words):
    if meant is None:
        ended = localized([" ".join([*row[:4], row[7], *row[4:7]]) for row in prior_rows], name="prior.txt")
    else:
        ended = localized(rows_of(priors, meant))
    assert ended.code == 1
    assert meant is not None or "the angles of the prior in" not in ended.out  # quaternions have no unit
    assert "0 of 4 epochs localized" in ended.out and f"1 of 1 tried would be localized were {words}" in ended.out


def test_what_is_said_of_a_turned_sensor_mends_it_and_radians_are_told(localized, priors, tmp_path):
    (mounting := tmp_path / "mounting.toml").write_text("[sensor]\nheading_deg = 90.0\n")
    assert localized(rows_of(priors, turned(0.0, math.pi / 2)), options=("--mounting", mounting)).code == 0
    ended = localized(rows_of(priors), header="time,x,y,z,roll_deg,pitch_deg,heading_deg")
    assert "the angles of the prior in radians: name their columns roll, pitch, heading" in ended.out


def test_how_high_a_prior_lies_is_always_said_and_what_is_wrong_with_it(localized, priors):
    assert "the prior lies 2.0 m above the map's ground\n" in localized(rows_of(priors, lambda pose: pose)).out
    ended = localized(rows_of(priors, lambda pose: pose.translated([0.0, 0.0, 9.0])))
    assert "4 of 4 epochs localized" not in ended.out and "the prior lies 11.0 m above the map's ground\n" in ended.out
    assert "were the prior some 9 m lower: is its z that of another point, or another height reference?" in ended.out


@pytest.fixture
def rescanned(drive, tmp_path):
    """Write the scans of the drive anew, points as a function makes them of theirs and of the true pose."""

    def write(meant):
        scans, folder = open_scans(drive.dataset.scans), tmp_path / "rescanned"
        folder.mkdir(exist_ok=True)
        for number, pose in enumerate(drive.reference.poses()):
            np.savez(folder / f"{number}.npz", points=meant(scans.read(number).points, pose))
        (folder / "times.txt").write_text("\n".join(f"{time:.9f}" for time in scans.times) + "\n")
        return folder

    return write


@pytest.mark.parametrize("frame", ["global coordinates", "the map's local frame"])
def test_scans_that_are_in_the_map_already(localized, drive, rescanned, frame):
    origin = np.array(PointMap.open(drive.city).frame.origin) * (frame != "global coordinates")
    ended = localized(scans=rescanned(lambda points, pose: pose.apply(points) - origin))
    assert ended.code == 1, ended
    assert f"would be localized were the scans in {frame}: write them in the sensor's frame" in ended.out


def test_scans_of_a_sensor_that_hangs_upside_down_are_told(localized, rescanned, monkeypatch):
    monkeypatch.setattr("maxcon.drive.diagnosis.MOST_TRIED", 3)
    ended = localized(scans=rescanned(lambda points, pose: points * [1.0, -1.0, -1.0]))
    words = "the sensor upside down: give a --mounting file with roll_deg = 180 under [sensor]"
    assert "0 of 4 epochs localized" in ended.out and f"3 of 3 tried would be localized were {words}" in ended.out


def test_scans_that_are_mirrored_or_in_feet_or_millimetres_are_told(localized, rescanned, drive, maxcon):
    ended = localized(scans=rescanned(lambda points, pose: points * [1.0, -1.0, 1.0]))
    assert "were the scans not mirrored: turn the sign of their y" in ended.out  # where one fits by chance, too
    ended = localized(scans=rescanned(lambda points, pose: points / 0.3048))
    assert "would be localized were the scans in feet: multiply their coordinates by 0.3048" in ended.out
    ended = localized(scans=(folder := rescanned(lambda points, pose: points * 1000.0)))
    assert "would be localized were the scans in millimetres: divide their coordinates by 1000" in ended.out
    assert "--max-range, in metres" in ended.out
    assert "--max-range, in metres" in maxcon("relocalize", drive.city, folder).out
    assert "are these millimetres?" in maxcon("scans", "info", folder).out
    assert "millimetres" not in maxcon("scans", "info", drive.dataset.scans).out


def test_degrees_as_coordinates_are_told(localized, priors, refused):
    rows = [f"{time},52.3,9.7,50,0,0,0" for time, _ in priors]
    refused(localized(rows), "Are both in the same CRS? Degrees belong into a CSV that names them", "latitude")
    rows = [f"{time},{pose.y},{pose.x},{pose.z},0,0,0" for time, pose in priors]
    refused(localized(rows), "Are x and y swapped?")


def test_where_nothing_fits_that_is_said(localized, priors):
    far = [(time, pose.translated([14.0, 9.0, 0.0])) for time, pose in priors]
    ended = localized(rows_of(far))
    assert ended.code == 1
    assert "meant otherwise (axes, angles, frames) they are not localized either" in ended.out


def test_times_in_another_zone_are_told_and_mended_by_an_offset(localize, drive, priors, tmp_path):
    late = tmp_path / "late.csv"
    late.write_text("\n".join(["time,x,y,z,roll,pitch,heading", *rows_of((t + 3600.0, pose) for t, pose in priors)]))
    assert "about +1 h: a time zone" in localize(prior=late).err
    ended = localize("--time-offset", "-3600", prior=late)
    assert (ended.code, ended.err) == (0, "")
