# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Nothing is ever half written: files and folders appear whole, or not at all (D10)."""

import errno
import os

import pytest

from maxcon.atomic import atomic_file, atomic_folder, make_folder
from maxcon.errors import FileError, MaxconError


class Interrupted(BaseException):
    """As KeyboardInterrupt: no Exception."""


def full_disk():
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_whole(tmp_path):
    target = tmp_path / "poses.csv"
    with atomic_file(target) as partial:
        partial.write_text("half")
        assert not target.exists()
        assert partial.parent == target.parent  # the same file system, so that renaming is one step
        partial.write_text("whole")
    assert target.read_text() == "whole"
    assert names(tmp_path) == ["poses.csv"]


def test_a_file_is_replaced_at_the_end_only(tmp_path):
    target = tmp_path / "poses.csv"
    target.write_text("old")
    with atomic_file(str(target)) as partial:
        partial.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt(), Interrupted()])
def test_an_exception_inside_leaves_the_old_file(tmp_path, error):
    target = tmp_path / "poses.csv"
    target.write_text("old")
    with pytest.raises(type(error)), atomic_file(target) as partial:
        partial.write_text("half")
        raise error
    assert target.read_text() == "old"
    assert names(tmp_path) == ["poses.csv"]


def test_a_full_disk_while_writing_a_file(tmp_path):
    target = tmp_path / "poses.csv"
    with (
        pytest.raises(
            FileError, match=r"able to write .*poses\.csv, got: No space left on device\..*nothing was"
        ),
        atomic_file(target) as partial,
    ):
        partial.write_text("half")
        raise full_disk()
    assert names(tmp_path) == []


def test_a_file_in_no_folder_or_over_a_folder(tmp_path):
    with (
        pytest.raises(FileError, match="No such file or directory"),
        atomic_file(tmp_path / "no" / "a") as partial,
    ):
        partial.write_text("x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError, match="able to write"), atomic_file(tmp_path / "folder") as partial:
        partial.write_text("x")
    assert names(tmp_path) == ["folder"]


def test_a_block_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(FileError, match="able to write"), atomic_file(tmp_path / "a"):
        pass
    assert names(tmp_path) == []


def test_errors_of_our_own_pass_unchanged(tmp_path):
    for context in (atomic_file(tmp_path / "a"), atomic_folder(tmp_path / "b")):
        with pytest.raises(MaxconError, match=r"^exactly this$"), context:
            raise MaxconError("exactly this")
    assert names(tmp_path) == []


def test_a_folder_appears_whole(tmp_path):
    target = tmp_path / "city.map"
    with atomic_folder(target) as partial:
        (partial / "a").write_text("1")
        assert not target.exists()
    assert names(target) == ["a"]
    assert names(tmp_path) == ["city.map"]


def test_a_folder_that_exists_is_refused_before_the_work(tmp_path):
    target = tmp_path / "city.map"
    target.mkdir()
    was_entered = False
    with pytest.raises(FileError, match=r"city\.map not to exist yet, but it does\."), atomic_folder(target):
        was_entered = True
    assert not was_entered
    assert names(tmp_path) == ["city.map"]


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt(), full_disk()])
def test_overwriting_keeps_the_old_folder_when_the_new_one_fails(tmp_path, error):
    target = tmp_path / "city.map"
    target.mkdir()
    (target / "old").write_text("old")
    expected = FileError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected), atomic_folder(target, overwrite=True) as partial:
        (partial / "new").write_text("half")
        raise error
    assert (target / "old").read_text() == "old"
    assert names(tmp_path) == ["city.map"]


def test_overwriting_replaces_the_whole_folder(tmp_path):
    target = tmp_path / "city.map"
    target.mkdir()
    (target / "old").write_text("old")
    with atomic_folder(target, overwrite=True) as partial:
        (partial / "new").write_text("new")
        assert (target / "old").exists()
    assert names(target) == ["new"]
    assert names(tmp_path) == ["city.map"]


def test_the_old_folder_comes_back_when_the_exchange_fails(tmp_path, monkeypatch):
    """The second of two renames fails: the first is taken back."""
    target = tmp_path / "city.map"
    target.mkdir()
    (target / "old").write_text("old")
    cls = type(target)
    rename = cls.replace

    def replace(self, other):
        if ".partial-" in self.name and other == target and (self / "new").exists():
            raise full_disk()
        return rename(self, other)

    monkeypatch.setattr(cls, "replace", replace)
    with (
        pytest.raises(FileError, match="No space left"),
        atomic_folder(target, overwrite=True) as partial,
    ):
        (partial / "new").write_text("new")
    assert (target / "old").read_text() == "old"
    assert names(tmp_path) == ["city.map"]


def test_two_writers_do_not_meet(tmp_path):
    with atomic_file(tmp_path / "a") as one, atomic_file(tmp_path / "a") as other:
        assert one != other
        one.write_text("1")
        other.write_text("2")
    assert (tmp_path / "a").read_text() == "1"  # the last to end
    assert names(tmp_path) == ["a"]


def test_make_folder(tmp_path):
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileError, match=r"able to make the folder .*file.*, got: .*Choose another"):
        make_folder(tmp_path / "file" / "b")
