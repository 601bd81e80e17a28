# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Nothing is ever half written: files and folders appear whole, or not at all (D10, decision 25)."""

import errno
import fcntl
import os
import signal
import socket
import stat

import pytest

from maxcon._system.atomic import atomic_file, atomic_folder, check_writable, make_folder
from maxcon._system.partials import sweep_folder
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
        assert partial.parent.parent == target.parent  # the same file system, so that renaming is one step
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
        pytest.raises(FileError, match=r"able to write .*poses\.csv, got: No space left on device\..*nothing was"),
        atomic_file(target) as partial,
    ):
        partial.write_text("half")
        raise full_disk()
    assert names(tmp_path) == []


def test_a_file_in_no_folder_or_over_a_folder(tmp_path):
    with pytest.raises(FileError, match="No such file or directory"), atomic_file(tmp_path / "no" / "a") as partial:
        partial.write_text("x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError, match="got the folder"), atomic_file(tmp_path / "folder") as partial:
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


@pytest.mark.parametrize("has_swap", [True, False])
@pytest.mark.parametrize("after", range(4))
def test_a_signal_anywhere_in_the_exchange_loses_neither_folder(tmp_path, monkeypatch, has_swap, after):
    """Stop before the first step, after the first, and so on: the old folder, or the new one, stands there, whole."""
    target = tmp_path / "city.map"
    target.mkdir()
    (target / "old").write_text("old")
    cls, rename = type(target), type(target).replace
    if not has_swap:
        monkeypatch.setattr("maxcon._system.atomic.swapped", lambda one, other: False)
    steps_left = [after]

    def replace(self, other):
        if steps_left == [0]:
            steps_left.clear()
            raise Interrupted
        rename(self, other)
        if steps_left == [1]:
            steps_left.clear()
            raise Interrupted
        steps_left[:] = [n - 1 for n in steps_left]
        return other

    monkeypatch.setattr(cls, "replace", replace)
    try:
        with atomic_folder(target, overwrite=True) as partial:
            (partial / "new").write_text("new")
    except Interrupted:
        pass
    assert names(target) in (["old"], ["new"])
    assert names(tmp_path) == ["city.map"] or names(target) == ["new"]


def test_overwriting_is_one_step_here(tmp_path, monkeypatch):
    """On Linux no rename of Python's is needed: a kill in between leaves one of the two where it was asked for."""
    target = tmp_path / "city.map"
    target.mkdir()
    monkeypatch.setattr(type(target), "replace", None)
    with atomic_folder(target, overwrite=True) as partial:
        (partial / "new").write_text("new")
    assert names(target) == ["new"]
    assert names(tmp_path) == ["city.map"]


def test_what_a_killed_process_left_is_swept_up(tmp_path):
    target = tmp_path / "city.map"
    child = os.fork()
    if child == 0:
        with atomic_folder(target) as partial:
            (partial / "half").write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert len(names(tmp_path)) == 1
    (tmp_path / ".other.map.partial-12345678").mkdir()
    with atomic_folder(target):
        pass
    assert names(tmp_path) == [".other.map.partial-12345678", "city.map"]


def _killed_while_writing(target):
    child = os.fork()
    if child == 0:
        with atomic_file(target) as partial:
            partial.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)


def test_what_a_killed_process_left_of_a_file_is_swept_up(tmp_path):
    target = tmp_path / "poses.laz"
    _killed_while_writing(target)
    assert len(names(tmp_path)) == 1 and not target.exists()
    _killed_while_writing(tmp_path / "other.laz")
    with atomic_file(target) as at_work:
        at_work.write_text("whole")
        check_writable(target)
    assert target.read_text() == "whole"
    assert len(names(tmp_path)) == 2
    sweep_folder(tmp_path)
    assert names(tmp_path) == ["poses.laz"]


@pytest.mark.parametrize("overwrite", [True, False])
def test_a_folder_that_a_killed_process_moved_aside_returns(tmp_path, overwrite):
    """Where two folders cannot change places in one step, a kill may fall between the two renames."""
    old, target = tmp_path / ".city.map.old-12345678", tmp_path / "city.map"
    old.mkdir()
    (old / "old").touch()
    error = ValueError if overwrite else FileError
    with pytest.raises(error), atomic_folder(target, overwrite=overwrite):
        raise ValueError
    assert names(tmp_path) == ["city.map"]
    assert names(target) == ["old"]
    old.mkdir()  # a kill before it was removed
    with atomic_folder(target, overwrite=True) as partial:
        (partial / "new").touch()
    assert names(tmp_path) == ["city.map"]
    assert names(target) == ["new"]


def test_the_folder_of_a_process_at_work_is_left_alone(tmp_path):
    target = tmp_path / "city.map"
    with atomic_folder(target, overwrite=True) as one:
        with atomic_folder(target, overwrite=True) as other:
            assert one.exists()
            (other / "other").touch()
        (one / "one").touch()
    assert names(target) == ["one"]
    assert names(tmp_path) == ["city.map"]


def test_a_folder_whose_lock_is_held_is_nobody_elses(tmp_path):
    left = tmp_path / ".city.map.partial-12345678"
    left.mkdir()
    descriptor = os.open(left, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with atomic_folder(tmp_path / "city.map"):
        pass
    assert left.exists()
    os.close(descriptor)
    with atomic_folder(tmp_path / "city.map", overwrite=True):
        pass
    assert not left.exists()


@pytest.fixture(params=["FIFO", "socket"])
def special(request, tmp_path):
    """Something that is neither file nor folder; a device would need other rights, and is refused alike."""
    path = tmp_path / "special"
    if request.param == "FIFO":
        os.mkfifo(path)
        yield path, request.param
    else:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(str(path))
            yield path, request.param


def test_nothing_but_a_file_is_replaced(tmp_path, special):
    path, kind = special
    before = path.stat().st_mode
    link = tmp_path / "link"
    link.symlink_to(path)
    for name in (path, link):
        with pytest.raises(FileError, match=f"special|link.*{kind}.*Name a file"):
            check_writable(name)
        with pytest.raises(FileError, match=kind), atomic_file(name) as partial:
            partial.write_text("x")
    assert path.stat().st_mode == before
    assert names(tmp_path) == ["link", "special"]


def test_what_became_special_while_it_was_written_is_not_replaced(tmp_path):
    path = tmp_path / "poses.csv"
    with pytest.raises(FileError, match="FIFO"), atomic_file(path) as partial:
        partial.write_text("x")
        os.mkfifo(path)
    assert stat.S_ISFIFO(path.stat().st_mode)


@pytest.mark.parametrize("exists", [True, False])
def test_a_file_behind_a_link_is_written_there(tmp_path, exists):
    (tmp_path / "there").mkdir()
    file, link = tmp_path / "there" / "poses.csv", tmp_path / "link.csv"
    link.symlink_to(file)
    if exists:
        file.write_text("old")
    check_writable(link)
    with atomic_file(link) as partial:
        partial.write_text("new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert names(tmp_path / "there") == ["poses.csv"]


def test_links_in_a_circle(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(FileError, match="able to write"):
        check_writable(tmp_path / "a")
    assert names(tmp_path) == ["a", "b"]


def test_a_folder_behind_a_link_is_overwritten_there(tmp_path):
    folder, link = tmp_path / "disk" / "city.map", tmp_path / "link.map"
    folder.mkdir(parents=True)
    link.symlink_to(folder)
    with atomic_folder(link, overwrite=True) as partial:
        (partial / "new").touch()
    assert link.is_symlink()
    assert names(folder) == ["new"]
    assert names(tmp_path / "disk") == ["city.map"]


def test_a_file_is_no_folder_to_overwrite(tmp_path):
    (tmp_path / "file").write_text("old")
    with pytest.raises(FileError, match="got the file"), atomic_folder(tmp_path / "file", overwrite=True):
        pass
    assert (tmp_path / "file").read_text() == "old"


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
    monkeypatch.setattr("maxcon._system.atomic.swapped", lambda one, other: False)
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
    with pytest.raises(FileError, match="No space left"), atomic_folder(target, overwrite=True) as partial:
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
