"""Tables of poses read back, only localized epochs have one, a dataset's drive appears whole; tables of drives."""

import csv
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from court_drive import POSE, START, made_epoch

from maxcon import Pose, Status
from maxcon.drive import poses_table
from maxcon.drive.many import DriveEntry, read_drives, tasks_of
from maxcon.errors import FileError, OptionError
from maxcon.io.trajectories import read_trajectory

SOME = np.random.default_rng(0).normal(0.0, 0.03, (9, 6))
UNREADABLE = Path("/proc/self/mem")


def sure_epoch(number, status=Status.LOCALIZED):
    """With a covariance, and a protection level that is known along the heading only."""
    made = made_epoch(number, status, covariance=SOME.T @ SOME, protection_level=(0.1234567, math.inf))
    return replace(made, reason="a\nreason")


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "poses.csv"


# --- POSES.csv ---
def test_the_localized_epochs_read_back_as_a_trajectory(path):
    turned = Pose(POSE.x + 10.0, POSE.y, POSE.z, -0.01, 0.02, -math.pi)
    epochs = [made_epoch(0), made_epoch(1, Status.NO_PRIOR), made_epoch(2, pose=turned), made_epoch(3, Status.AT_RIM)]
    poses_table.write_poses(path, epochs)
    for found in (read_trajectory(path), poses_table.localized_trajectory(epochs)):
        np.testing.assert_allclose(found.times, [START, START + 2], rtol=0, atol=1e-9)
        for read, written in zip(found.poses(), (POSE, turned), strict=True):
            np.testing.assert_allclose(read.position, written.position, rtol=0, atol=5e-5)
            np.testing.assert_allclose(read.rotation, written.rotation, rtol=0, atol=1e-8)
    assert poses_table.localized_trajectory(epochs[1:2]) is None


def test_columns_text_and_the_upper_triangle_of_the_covariance(path):
    poses_table.write_poses(path, [made_epoch(0)])
    header, row = path.read_text().splitlines()
    assert header.split(",") == list(poses_table.COLUMNS)
    assert header.startswith("time,epoch,scan,x,y,z,roll,pitch,heading,score,status,ms,shift_x,shift_y,shift_z,")
    assert header.endswith("cov_pitch_heading,cov_heading_heading,crs,reason")
    assert len(poses_table.COLUMNS) == 12 + 4 + 4 + 2 + 21 + 2
    assert row.startswith(
        "386400.123456789,0,000000.bin,549936.5193,5801960.0921,62.0056,"
        "0.001234568,-0.004494209,3.043043369,256.077,localized,12.35,"
    )
    assert row.endswith(33 * ",")
    epoch = made_epoch(0)
    epoch = replace(epoch, crs="EPSG:25832", prior=epoch.estimate.pose.translated([1.0, -2.0, 0.5]))
    sure = replace(epoch.estimate, covariance=np.diag([4.0, 9, 16, 1, 1, 0.25]))
    poses_table.write_poses(path, [replace(epoch, estimate=sure)])
    (found,) = rows_of(path)
    names = ("shift_x", "shift_y", "shift_z", "shift_heading_deg", "sigma_x", "sigma_y", "sigma_z", "sigma_heading_deg")
    assert [float(found[name]) for name in names] == [-1.0, 2.0, -0.5, 0.0, 2.0, 3.0, 4.0, 28.6479]
    assert found["crs"] == "EPSG:25832"
    half = np.triu(np.arange(36.0).reshape(6, 6) + 1.0)
    sure = replace(epoch.estimate, covariance=half + np.triu(half, 1).T, protection_level=(0.12345, math.inf))
    poses_table.write_poses(path, [replace(epoch, estimate=sure)])
    (row,) = rows_of(path)
    assert (row["protection_along"], row["protection_across"]) == ("0.1235", "")
    assert (row["cov_x_x"], row["cov_x_y"], row["cov_y_y"], row["cov_heading_heading"]) == ("1", "2", "8", "36")
    assert [float(row[name]) for name in poses_table.COVARIANCES] == half[np.triu_indices(6)].tolist()


def test_only_localized_epochs_have_a_pose(path):
    poses_table.write_poses(path, [made_epoch(number, status) for number, status in enumerate(Status)])
    for row, status in zip(rows_of(path), Status, strict=True):
        assert row["status"] == status.value
        assert {row[name] != "" for name in poses_table.COLUMNS[3:9]} == {status is Status.LOCALIZED}
        assert (row["score"] != "") == (status not in (Status.NO_PRIOR, Status.NO_POINTS, Status.OUTSIDE_MAP))


def test_a_reason_in_any_letters_and_lines_is_written_the_same_under_any_locale(path):
    script = (
        "from test_poses_table import made_epoch, poses_table, replace; import sys;"
        "poses_table.write_poses(sys.argv[1], [replace(made_epoch(0), reason='a \"scan\",\\nin Stra\\u00dfe\\udcdf')])"
    )
    plain = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "PYTHONPATH": str(Path(__file__).parent)}
    plain["PYTHONPATH"] += os.pathsep.join(["", str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    subprocess.run([sys.executable, "-c", script, path], env=os.environ | plain, check=True)
    assert [row["reason"] for row in rows_of(path)] == ['a "scan", in Straße?']
    assert poses_table.rows_there(path, np.array([START])).n_rows == 1


def test_another_process_at_the_same_table_is_refused(path):
    with poses_table.GrowingTable(path) as one, poses_table.GrowingTable(path) as other:
        one.add(made_epoch(0))
        with pytest.raises(FileError, match="another process is at work on it"):
            other.add(made_epoch(0))
    assert len(path.read_text().splitlines()) == 2
    assert [name.name for name in path.parent.iterdir()] == ["poses.csv"]


def test_rows_go_on_behind_those_that_are_whole(path):
    times = np.array([made_epoch(number).raw.time for number in range(3)])
    poses_table.write_poses(path, [made_epoch(number) for number in range(3)])
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])  # killed in the third row
    there = poses_table.rows_there(path, times)
    assert (there.n_rows, there.n_localized) == (2, 2)
    with poses_table.GrowingTable(path, there) as table:
        table.add(made_epoch(2))
    assert path.read_bytes() == whole


@pytest.mark.parametrize("what", ["another time", "more rows", "another column", "a column less", "bytes", "text"])
def test_tables_of_other_drives_are_not_gone_on_with(path, what):
    times = np.array([made_epoch(0).raw.time])
    poses_table.write_poses(path, [made_epoch(0)])
    header, row = path.read_bytes().splitlines(keepends=True)
    contents = {
        "another time": [header, b"9" + row], "more rows": [header, row, row],
        "another column": [header.replace(b"score", b"points"), row],
        "a column less": [header, row.partition(b",")[2]], "bytes": [header, b"\xff\xfe\x00\n"], "text": [b"notes"],
    }  # fmt: skip
    path.write_bytes(b"".join(contents[what]))
    with pytest.raises(FileError, match=r"poses\.csv to be a table of these scans.*--overwrite"):
        poses_table.rows_there(path, times)


# --- many drives ---
def test_rows_are_published_once_and_whole(tmp_path):
    dataset = poses_table.PosesDataset(tmp_path)
    assert not dataset.has_rows()
    dataset.add("a", [sure_epoch(2), sure_epoch(3, Status.AMBIGUOUS)])
    dataset.add("a", [sure_epoch(0), sure_epoch(1)])
    dataset.add("a", [sure_epoch(1)])  # done twice, as after a kill
    assert (dataset.has_rows("a"), dataset.is_done("a"), dataset.has_rows(), dataset.has_rows("b")) == (1, 0, 1, 0)
    waiting = dataset.table("a").read()
    assert waiting.column("epoch").to_pylist() == [0, 1, 2, 3]
    dataset.publish("a")
    assert dataset.is_done("a") and not (tmp_path / "_parts").exists()
    assert dataset.table("a").read().equals(waiting)
    assert waiting.schema.equals(poses_table.poses_schema())
    assert dataset.statuses("a") == ["localized", "localized", "localized", "ambiguous"]


def test_rows_are_those_of_the_table_of_poses_before_rounding(tmp_path, path):
    epochs = [sure_epoch(0), sure_epoch(1, Status.AMBIGUOUS)]
    dataset = poses_table.PosesDataset(tmp_path)
    dataset.add("a", epochs)
    poses_table.write_poses(path, epochs)
    found, rows = dataset.table("a").read().to_pylist(), rows_of(path)
    assert found[0]["x"] == POSE.x and rows[0]["x"] == "549936.5193"
    assert (found[0]["protection_along"], found[0]["protection_across"]) == (0.1234567, None)
    assert found[0][poses_table.COVARIANCES[0]] == (SOME.T @ SOME)[0, 0]
    assert found[1]["x"] is None and found[1]["score"] == 256.0771 and found[1]["reason"] == "a reason"
    for numbers, cells in zip(found, rows, strict=True):
        formats = poses_table.FORMATS
        rounded = {name: "" if value is None else format(value, formats[name]) for name, value in numbers.items()}
        assert rounded == cells


@pytest.mark.skipif(not UNREADABLE.exists(), reason="no file here that is there and cannot be read")
def test_a_prior_that_cannot_be_read_keeps_no_other_drive_from_its_own(tmp_path):
    sources = {name: {"map": tmp_path, "prior": prior} for name, prior in (("broken", UNREADABLE), ("whole", None))}
    for _ in range(2):
        poses_table.PosesDataset(tmp_path).check_sources(sources)
    assert '"broken"' in (tmp_path / "_drives.json").read_text()


@pytest.mark.parametrize(("name", "check"), [("_options.json", "check_options"), ("_drives.json", "check_sources")])
@pytest.mark.parametrize("content", [b"{", b"[]", b'{"a": 1}', b"\xff"])
def test_provenance_that_is_none_is_refused(tmp_path, name, check, content):
    dataset = poses_table.PosesDataset(tmp_path)
    dataset.add("a", [sure_epoch(0)])
    (tmp_path / name).write_bytes(content)
    with pytest.raises((FileError, OptionError), match=rf"{name}.*[Nn]ame another folder"):
        getattr(dataset, check)({})


def test_paths_are_relative_to_the_table_and_addresses_are_not(tmp_path):
    table = tmp_path / "drives.csv"
    table.write_text(
        '# two days\nname,scans,prior,map\nmonday,a/scans,,\n"tuesday",/b.mcap,"gnss, raw.csv",s3://bucket/city.map\n',
        encoding="utf-8-sig",
    )
    assert read_drives(table, Path("city.map")) == [
        DriveEntry("monday", tmp_path / "a" / "scans", Path("city.map")),
        DriveEntry("tuesday", Path("/b.mcap"), "s3://bucket/city.map", tmp_path / "gnss, raw.csv"),
    ]


def test_epochs_go_in_runs_of_neighbours_whatever_is_there_already():
    entry = DriveEntry("a", Path("scans"), Path("city.map"))
    runs = [(task.first, task.last) for task in tasks_of(entry, [*range(70), 80, 81, 90])]
    assert runs == [(0, 32), (32, 64), (64, 70), (80, 82), (90, 91)]
    assert [(task.first, task.last) for task in tasks_of(entry, range(70), is_track=True)] == [(0, 70)]
    assert list(tasks_of(entry, [])) == []


@pytest.mark.parametrize(("text", "words"), [
    ("", "`array` of length >= 1"), ("name,scans\n", "`array` of length >= 1"),
    ("name,scans,priors\na,b,c\n", "unknown field `priors`"), ("name,scans\na,scans\nA,scans\n", "got 'A' twice"),
    ("name,scans\n../a,scans\n", "a folder is named by it"),
    ("name,scans\na,scans,more\n", "line 2: Expected 2 columns .*, got 3"),
    ("name,scans\na,\n", r"`drive\[0\].scans`: expected `str` of length >= 1"),
    ('name,scans\n"a,b\n', "line 2: Expected comma-separated values"), ("\x00\xff", "Expected"),
])  # fmt: skip
def test_what_is_no_table_is_refused_in_a_line(tmp_path, text, words):
    (tmp_path / "drives.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(FileError, match=words) as refused:
        read_drives(tmp_path / "drives.csv", Path("city.map"))
    assert "\n" not in str(refused.value)
