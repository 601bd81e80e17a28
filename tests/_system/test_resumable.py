# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A folder of work is one process's at a time, and never somebody else's; its table grows by whole parts."""

import pyarrow
import pytest

from maxcon._system.resumable import ResumableTable, differences, work_folder
from maxcon.errors import FileError


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


def test_differences_are_named():
    before = {"space": {"half_width": 3.0, "cell": 0.06}, "name": "a"}
    now = {"space": {"half_width": 3.6, "cell": 0.06}, "name": "a", "more": 1}
    assert differences(before, now) == "space.half_width 3.0, got 3.6; more None, got 1"


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
