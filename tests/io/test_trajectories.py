"""Trajectories in TUM and CSV files: round trips, and every way a file can be wrong."""

import math

import numpy as np
import pytest

from maxcon.errors import FileError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.trajectories import read_prior, read_trajectory, write_csv, write_tum
from maxcon.scan.trajectory import Trajectory

TUM_LINE = "47452.193478 458888.4217 5429081.5413 115.0739 0 0 0.6 0.8\n"
HEADER = "time,x,y,z,roll,pitch,heading\n"
SIGMAS = HEADER.strip() + ",sigma_x,sigma_y,sigma_heading_deg\n"
COVARIANCES = HEADER.strip() + ",cov_x_x,cov_x_y,cov_x_heading,cov_y_y,cov_y_heading,cov_heading_heading,cov_z_z\n"


def sample(n=5, covariances=None):
    rng = np.random.default_rng(4)
    angles = rng.uniform(-1.5, 1.5, (n, 3)) * [0.1, 0.1, 2.0]
    times = 1.7e9 + np.cumsum(rng.uniform(0.01, 0.2, n))
    return Trajectory(times, rng.uniform(4e5, 6e6, (n, 3)), quaternions_from_angles(*angles.T), covariances)


def write(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(("name", "save"), [("a.txt", write_tum), ("a.TUM", write_tum), ("a.csv", write_csv)])
def test_what_is_written_reads_back(tmp_path, name, save):
    factors = np.random.default_rng(2).normal(size=(5, 3, 3)) * [[1.0], [2.0], [0.01]]
    covariances = factors @ factors.transpose(0, 2, 1)
    covariances = 0.5 * (covariances + covariances.transpose(0, 2, 1))
    covariances[1] = np.nan
    wanted = sample(covariances=covariances)
    save(tmp_path / name, wanted)
    got = read_trajectory(tmp_path / name)
    np.testing.assert_array_equal(got.times, wanted.times)
    np.testing.assert_array_equal(got.positions, wanted.positions)
    for one, other in zip(got.poses(), wanted.poses(), strict=True):
        np.testing.assert_allclose(one.rotation, other.rotation, atol=1e-14)
    if save is write_csv:
        np.testing.assert_array_equal(got.covariances, wanted.covariances)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_tum_takes_and_writes_comments_and_takes_any_blanks_and_line_ends(tmp_path):
    write_tum(tmp_path / "a.txt", sample(1), comment="T_map_sensor\nEPSG:25832")
    lines = (tmp_path / "a.txt").read_text().splitlines()
    assert lines[:2] == ["# T_map_sensor", "# EPSG:25832"] and len(lines) == 4
    content = "\ufeff# a comment\r\n\r\n 1\t2  3 4 0 0 0 1 # here too\r\n2 2 3 4 0 0 0 1"
    got = read_trajectory(write(tmp_path, "a.txt", content))
    np.testing.assert_array_equal(got.times, [1.0, 2.0])
    assert got.pose(0) == Pose(2, 3, 4, 0, 0, 0)


def test_csv_takes_extra_columns_any_order_and_leaves_out_epochs_not_localized(tmp_path):
    content = (
        "# a comment, with a comma\ntime,status,x,y,z,heading_deg,pitch,roll,score,ms\n"
        "1.0,ok,458888.5,5429081.25,115.0,-179,0.02,0.01,33.1,60\n"
        "2.0,not determined,,,,,,,,61\n"
        '3.0,"ok, but near the boundary",458889.5,5429081.25,115.0,30,0.02,0.01,33.1,60\n'
    )
    got = read_trajectory(write(tmp_path, "POSES.csv", content))
    np.testing.assert_array_equal(got.times, [1.0, 3.0])
    np.testing.assert_array_equal(got.positions[0], [458888.5, 5429081.25, 115.0])
    np.testing.assert_allclose(got.angles, [[0.01, 0.02, np.radians(-179)], [0.01, 0.02, np.radians(30)]], atol=1e-15)


def test_csv_takes_standard_deviations_covariances_in_any_order_and_rows_without(tmp_path):
    content = SIGMAS + "1,2,3,4,0,0,0,0.5,2,180\n2,2,3,4,0,0,0,,,\n"
    got = read_trajectory(write(tmp_path, "a.csv", content))
    np.testing.assert_allclose(got.covariance_at(1.0), np.diag([0.25, 4.0, math.pi**2]))
    assert got.covariance_at(2.0) is None
    in_radians = content.replace("heading_deg", "heading").replace("180", "0.1")
    assert read_trajectory(write(tmp_path, "b.csv", in_radians)).covariances[0, 2, 2] == pytest.approx(0.01)
    content = COVARIANCES + "1,2,3,4,0,0,0,1,0.1,0.01,2,0.02,0.1,77\n"
    turned = "".join(",".join(line.split(",")[::-1]) + "\n" for line in content.split())
    wanted = [[1.0, 0.1, 0.01], [0.1, 2.0, 0.02], [0.01, 0.02, 0.1]]
    for text in (content, turned):
        np.testing.assert_array_equal(read_trajectory(write(tmp_path, "c.csv", text)).covariances[0], wanted)


@pytest.mark.parametrize(("name", "content", "words"), [
    ("a.txt", TUM_LINE + "1 2 3\n", r"line 2: Expected 8 columns 'time,x,y,z,qx,qy,qz,qw', got 3"),
    ("a.txt", "1,2,3,4,0,0,0,1\n", r"line 1: Expected 8 columns .*got 1.*name the file .csv"),
    ("a.txt", "# c\n\n1 2 3 four 0 0 0 1\n", r"line 3: Expected finite numbers as 'z', got 'four'.*remove"),
    ("a.txt", "1 2 3 1e999 0 0 0 1\n", r"line 1: Expected finite numbers .*got '1e999'"),
    ("a.txt", "# c\n" + TUM_LINE + TUM_LINE, r"line 3: Expected times that increase, got 47452\.193478.*Sort"),
    ("a.txt", "1 2 3 4 0 0 0 0\n", r"line 1: Expected a unit quaternion .*got length 0"),
    ("a.txt", "# only a comment\n", r"a\.txt: Expected at least one pose, got none"),
    ("a.txt", b"\xff\xfe\x80" * 50, r"a\.txt, after line 0: Expected a trajectory as UTF-8 text"),
    ("a.txt", b"\0" * 20_000, r"line 1: Expected a trajectory in lines of text, got one of over 10000"),
    ("a.csv", HEADER + "1,,,,,,\n", "Expected at least one pose"),
    ("a.csv", "time,x,y,z\n1,2,3,4\n", r"a\.csv, line 1: Expected a header with time,x,.*got no 'roll'"),
    ("a.csv", "time;x;y;z;roll;pitch;heading\n", r"got no 'time' in .*separated by commas"),
    ("a.csv", "time,x,y,z,roll,pitch,heading,heading_deg\n", r"got more than one 'heading'"),
    ("a.csv", HEADER + '1,"2,3,4,0,0,0\n', r"line 2: Expected comma-separated values"),
    ("a.csv", SIGMAS.replace(",sigma_y", ""), r"line 1: Expected either cov_x_x,.*got no 'sigma_y'\. Give all"),
    ("a.csv", SIGMAS.strip() + ",cov_x_x\n", "line 1: Expected either cov_x_x,.*got both"),
    ("a.csv", SIGMAS + "1,2,3,4,0,0,0,1,1,1\n2,2,3,4,0,0,0,1,-1,1\n", r"line 3: Expected 'sigma_y' >= 0, got -1"),
    ("a.csv", SIGMAS + "1,2,3,4,0,0,0,1,nan,1\n", r"line 2: Expected finite numbers as 'sigma_y', got 'nan'"),
    ("a.csv", SIGMAS + "1,2,3,4,0,0,0,1,,1\n", r"line 2: Expected finite numbers as 'sigma_x,.*got ''"),
    ("a.csv", SIGMAS + "1,2,3,4,0,0,0,1,1e200,1\n", r"line 2: Expected a covariance .*got .*inf"),
    ("a.csv", COVARIANCES + "1,2,3,4,0,0,0,1,5,0,2,0,1,0\n", r"line 2: Expected a covariance .*semidefinite"),
])  # fmt: skip
def test_a_malformed_file_is_refused_with_file_and_line(tmp_path, name, content, words):
    path = write(tmp_path, name, content)
    with pytest.raises((TrajectoryError, FileError), match=words) as caught:
        read_trajectory(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_another_suffix_and_no_folder_to_write_to(tmp_path):
    with pytest.raises(FileError, match=r"suffix \.txt, \.tum or"):
        read_trajectory(tmp_path / "a.xyz")
    for save in (write_tum, write_csv):
        with pytest.raises(FileError, match="able to write"):
            save(tmp_path / "missing" / "a.txt", sample())


def test_only_a_prior_may_do_without_roll_and_pitch(tmp_path):
    path = write(tmp_path, "prior.csv", "time,x,y,z,heading_deg\n1,2,3,4,90\n")
    (pose,) = read_prior(path).trajectory.poses()
    np.testing.assert_allclose(pose.values, [2, 3, 4, 0, 0, np.pi / 2])
    with pytest.raises(TrajectoryError, match="no 'roll'"):
        read_trajectory(path)
    with pytest.raises(TrajectoryError, match="no 'pitch'"):
        read_prior(write(tmp_path, "prior.csv", "time,x,y,z,heading_deg,roll_deg\n1,2,3,4,90,1\n"))


@pytest.mark.parametrize(("name", "good", "bad"), [
    ("a.txt", [TUM_LINE, "47453.0 1 2 3 0 0 0 1\n"], ["1 2", "3 1 2 3 0 0 0 9"]),
    ("a.csv", [HEADER, "1,2,3,4,0,0,0\n", "3,2,3,4,0,0,0\n"], ["2,2,3", "2,2,x,4,0,0,0", "2,2,3,4,0,0,90"]),
])  # fmt: skip
def test_a_prior_is_read_without_its_bad_rows_unless_most_are(tmp_path, name, good, bad):
    for row in bad:
        prior = read_prior(write(tmp_path, name, "".join([*good[:-1], row + "\n", good[-1]])))
        assert len(prior.trajectory) == 2
        assert len(prior.left_out) == 1 and f"{name}, line {len(good)}: Expected" in prior.left_out[0]
    with pytest.raises(TrajectoryError, match="Expected"):
        read_prior(write(tmp_path, name, "".join([*good, *[f"{row}\n" for row in bad * 3]])))
