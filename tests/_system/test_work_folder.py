# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A folder of work is one process's at a time, and never somebody else's."""

import pytest

from maxcon._system.work_folder import LOCK, work_folder
from maxcon.errors import FileError


def test_a_folder_that_is_not_there_is_made_and_may_be_left_at_any_moment(tmp_path):
    root = tmp_path / "a" / "work"
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt), work_folder(root, "work", "record.json"):
            raise KeyboardInterrupt
    assert [path.name for path in root.iterdir()] == [LOCK]


def test_what_a_killed_process_left_half_written_is_removed_and_nothing_else(tmp_path):
    (tmp_path / ".record.json.partial-12345678").write_text("{")
    with work_folder(tmp_path, "work", "record.json"):
        (tmp_path / "record.json").touch()
        (tmp_path / "part").touch()
    (tmp_path / ".table.parquet.partial-12345678").mkdir()
    with work_folder(tmp_path, "work", "record.json"):
        assert sorted(path.name for path in tmp_path.iterdir()) == [LOCK, "part", "record.json"]


def test_somebody_elses_files_are_left_alone(tmp_path):
    (tmp_path / "letter.txt").touch()
    with (
        pytest.raises(FileError, match=r"Expected work or an empty folder in .*, but it holds letter\.txt"),
        work_folder(tmp_path, "work", "record.json"),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_two_at_a_time_are_refused(tmp_path):
    with (
        work_folder(tmp_path, "work", "record.json"),
        pytest.raises(FileError, match="another process is at work on it"),
        work_folder(tmp_path, "work", "record.json"),
    ):
        pass


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "work").touch()
    with pytest.raises(FileError, match="Expected a folder to write into"), work_folder(tmp_path / "work", "work", "r"):
        pass


def test_a_file_system_without_locks_is_told(tmp_path, monkeypatch):
    def no_locks(descriptor):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr("maxcon._system.locks.try_lock", no_locks)
    with (
        pytest.raises(FileError, match=r"able to lock .*Function not implemented.*another file system"),
        work_folder(tmp_path / "work", "work", "record.json"),
    ):
        pass
