"""What is read is a file, and never a FIFO; a folder of work is one process's at a time, its table grows by parts."""

import os
from pathlib import Path

import pyarrow
import pytest

from maxcon._system.regular_file import open_regular
from maxcon._system.resumable import ResumableTable, work_folder
from maxcon.errors import FileError, MaxconError
from maxcon.io.clouds import CLOUD_SUFFIXES, open_cloud
from maxcon.io.geographic_priors import read_nmea
from maxcon.io.scans import open_scans
from maxcon.io.text import SCAN_SUFFIXES
from maxcon.io.trajectories import read_prior, read_trajectory


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_folder_that_is_not_there_is_made_and_may_be_left_at_any_moment(tmp_path):
    root = tmp_path / "a" / "work"
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt), work_folder(root, "work", "record.json"):
            raise KeyboardInterrupt
    assert names(root) == []


def test_what_a_killed_process_left_half_written_is_removed_and_nothing_else(tmp_path):
    (tmp_path / ".record.json.partial-12345678").mkdir()
    (tmp_path / ".lock").touch()
    with work_folder(tmp_path, "work", "record.json"):
        (tmp_path / "record.json").touch()
        (tmp_path / "part").touch()
    (tmp_path / ".table.parquet.partial-12345678").mkdir()
    with work_folder(tmp_path, "work", "record.json"):
        assert names(tmp_path) == [".lock", "part", "record.json"]


def test_somebody_elses_folder_a_file_and_two_at_a_time_are_refused(tmp_path):
    (tmp_path / "letter.txt").touch()
    holds = pytest.raises(FileError, match=r"Expected work or an empty folder in .*, but it holds letter\.txt")
    with holds, work_folder(tmp_path, "work", "record.json"):
        pass
    file = pytest.raises(FileError, match="Expected a folder to write into")
    with file, work_folder(tmp_path / "letter.txt", "work", "record.json"):
        pass
    assert names(tmp_path) == ["letter.txt"]
    at_work = pytest.raises(FileError, match="another process is at work on it")
    with work_folder(tmp_path / "a", "work", "r"), at_work, work_folder(tmp_path / "a", "work", "r"):
        pass


@pytest.fixture
def table(tmp_path):
    schema = pyarrow.schema([("name", pyarrow.string()), ("epoch", pyarrow.int32()), ("x", pyarrow.float64())])
    return ResumableTable(tmp_path / "out" / "t.parquet", tmp_path / "parts", schema, ("name", "epoch"), "a table")


def row(name, epoch, x):
    return {"name": name, "epoch": epoch, "x": x}


def test_a_table_grows_by_parts_and_each_key_counts_once(table):
    assert table.read().num_rows == 0
    table.add([row("b", 1, 1.0), row("a", 7, 2.0)])
    table.add([row("a", 7, 2.0), {"name": "a", "epoch": 3}])
    wanted = [row("a", 3, None), row("a", 7, 2.0), row("b", 1, 1.0)]
    assert table.read().to_pylist() == wanted
    (table.parts / ".killed.parquet.partial-12345678").mkdir()
    assert table.merge().to_pylist() == wanted == table.read().to_pylist()
    assert names(table.path.parent) == ["t.parquet"] and not table.parts.exists()
    table.add([row("b", 1, 9.0), row("c", 0, 0.0)])  # what was merged counts
    assert table.merge().to_pylist() == [*wanted, row("c", 0, 0.0)]
    assert table.read_file(table.path, ["epoch"]).to_pylist() == [{"epoch": epoch} for epoch in (3, 7, 1, 0)]


@pytest.mark.parametrize("content", [b"", b"PAR1 and more that is no table"])
def test_a_broken_file_is_told(table, content):
    table.add([row("a", 1, 1.0)])
    table.part_paths()[0].write_bytes(content)
    with pytest.raises(FileError, match=r"Expected a table in .*parquet, got: .*remove it: the same command"):
        table.read()


def test_a_file_is_opened_and_nothing_else(tmp_path):
    (tmp_path / "a").write_bytes(b"content")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    for name in ("a", "link"):
        with open_regular(tmp_path / name) as file:
            assert file.read() == b"content"
    os.mkfifo(tmp_path / "fifo")
    for path, words in ((tmp_path, "directory"), (tmp_path / "missing", "No such"), (tmp_path / "fifo", "a FIFO, no")):
        with pytest.raises(OSError, match=words):
            open_regular(path)


def read_times(path):
    (path.parent / "scans").mkdir()
    (path.parent / "scans" / "1.bin").write_bytes(bytes(16))
    open_scans(path.parent / "scans", path)


@pytest.mark.parametrize(("read", "suffix"), [
    *((open_cloud, suffix) for suffix in CLOUD_SUFFIXES),
    *((lambda path: open_scans(path).read(0), suffix) for suffix in SCAN_SUFFIXES), (read_nmea, ".nmea"),
    *((read, suffix) for read in (read_prior, read_trajectory, read_times) for suffix in (".txt", ".tum", ".csv")),
])  # fmt: skip
@pytest.mark.parametrize(("make", "words"), [
    (os.mkfifo, "a FIFO"), (Path.mkdir, "is a directory|scans of one kind"), (lambda path: None, "no such file"),
], ids=["fifo", "folder", "nothing"])  # fmt: skip
def test_what_is_no_file_as_cloud_scan_trajectory_or_times(tmp_path, read, suffix, make, words):
    make(tmp_path / f"1{suffix}")
    with pytest.raises(MaxconError, match=f"(?i){words}"):
        read(tmp_path / f"1{suffix}")
