# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Nothing is ever half written: files and folders appear whole, or not at all (D10)."""

import errno
import os
import signal
import socket
import stat
from contextlib import suppress

import pytest

from maxcon._system.atomic import atomic_file, atomic_folder, check_writable, locked, make_folder, sweep
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


@pytest.mark.parametrize("after", range(4))
def test_a_signal_anywhere_in_the_exchange_loses_neither_folder(tmp_path, monkeypatch, after):
    """Stop before the first step, after the first, and so on: the old folder, or the new one, stands there, whole."""
    target = tmp_path / "city.map"
    target.mkdir()
    (target / "old").write_text("old")
    rename, steps_left = type(target).replace, [after]

    def replace(self, other):
        if steps_left == [0]:
            steps_left.clear()
            raise Interrupted
        rename(self, other)
        if steps_left == [1]:
            steps_left.clear()
            raise Interrupted
        steps_left[:] = [n - 2 for n in steps_left]
        return other

    monkeypatch.setattr(type(target), "replace", replace)
    with suppress(Interrupted), atomic_folder(target, overwrite=True) as partial:
        (partial / "new").write_text("new")
    assert names(target) == (["new"] if after > 2 else ["old"])
    assert names(tmp_path) == ["city.map"]


@pytest.mark.kills
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


@pytest.mark.kills
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
    sweep(tmp_path)
    assert names(tmp_path) == ["poses.laz"]


@pytest.mark.parametrize("overwrite", [True, False])
def test_a_folder_that_a_killed_process_moved_aside_returns(tmp_path, overwrite):
    """A kill may fall between the two renames that replace a folder, or behind them."""
    left, target = tmp_path / ".city.map.partial-12345678", tmp_path / "city.map"
    (left / "old").mkdir(parents=True)
    (left / "old" / "a").touch()
    with pytest.raises(ValueError if overwrite else FileError), atomic_folder(target, overwrite=overwrite):
        raise ValueError
    assert names(tmp_path) == ["city.map"]
    assert names(target) == ["a"]
    (left / "old").mkdir(parents=True)
    sweep(tmp_path)
    assert names(tmp_path) == ["city.map"]
    assert names(target) == ["a"]


def test_the_folder_of_a_process_at_work_is_left_alone(tmp_path):
    target = tmp_path / "city.map"
    with atomic_folder(target, overwrite=True) as one:
        with atomic_folder(target, overwrite=True) as other:
            assert one.exists()
            (other / "other").touch()
        (one / "one").touch()
    assert names(target) == ["one"]
    assert names(tmp_path) == ["city.map"]


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


@pytest.mark.kills
def test_the_lock_of_a_killed_process_is_free(tmp_path):
    lock = tmp_path / ".lock"
    ready, told = os.pipe()
    child = os.fork()
    if child == 0:
        with locked(lock, "it"):
            os.write(told, b"!")
            signal.pause()
    os.read(ready, 1)
    with pytest.raises(FileError, match="it to be left alone, but another process"), locked(lock, "it"):
        pass
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with locked(lock, "it"):
        assert lock.exists()
    assert not lock.exists()


def test_a_file_system_without_locks_is_told(tmp_path, monkeypatch):
    def no_locks(self, *arguments, **options):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("filelock.FileLock.acquire", no_locks)
    with pytest.raises(FileError, match=r"able to lock .*Function not.*another file"), locked(tmp_path / "l", ""):
        pass
