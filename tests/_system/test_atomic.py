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


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def write(partial, text):
    """Fill a file, or a folder with a file."""
    (partial / "a" if partial.is_dir() else partial).write_text(text)


def written(target):
    return {path.name: path.read_text() for path in (target.iterdir() if target.is_dir() else [target])}


@pytest.fixture(params=["file", "folder", "file there", "folder there"])
def output(request, tmp_path):
    """How something is written, to where, and what is there before."""
    kind, _, is_there = request.param.partition(" ")
    target = tmp_path / "city.map"
    if is_there:
        (target.mkdir if kind == "folder" else target.touch)()
        (target / "old" if kind == "folder" else target).write_text("old")
    context = (lambda: atomic_file(str(target))) if kind == "file" else lambda: atomic_folder(target, overwrite=True)
    return target, context, written(target) if is_there else None


def is_as_before(target, before):
    return names(target.parent) == ([target.name] if before else []) and (not before or written(target) == before)


def test_what_is_written_appears_whole_in_the_end_only(output):
    target, context, before = output
    with context() as partial:
        assert partial.is_relative_to(target.parent)  # the same file system, so that renaming is one step
        write(partial, "half")
        assert target.exists() == (before is not None) and (not before or written(target) == before)
        write(partial, "whole")
    assert list(written(target).values()) == ["whole"]
    assert names(target.parent) == [target.name]


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt(), Interrupted(), MaxconError("exactly this")])
def test_an_exception_inside_passes_unchanged_and_leaves_what_was_there(output, error):
    target, context, before = output
    with pytest.raises(type(error)) as caught, context() as partial:
        write(partial, "half")
        raise error
    assert caught.value is error
    assert is_as_before(target, before)


def test_a_full_disk_leaves_what_was_there(output):
    target, context, before = output
    with (
        pytest.raises(FileError, match=r"able to write .*city\.map, got: No space left on device\..*nothing was"),
        context() as partial,
    ):
        write(partial, "half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert is_as_before(target, before)


def test_a_file_in_no_folder_or_over_a_folder(tmp_path):
    with pytest.raises(FileError, match="No such file or directory"), atomic_file(tmp_path / "no" / "a") as partial:
        partial.write_text("x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError, match="got the folder"), atomic_file(tmp_path / "folder") as partial:
        partial.write_text("x")
    with pytest.raises(FileError, match="able to write"), atomic_file(tmp_path / "nothing"):
        pass
    assert names(tmp_path) == ["folder"]


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


def killed_while_writing(context):
    child = os.fork()
    if child == 0:
        with context as partial:
            write(partial, "half")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)


@pytest.mark.kills
@pytest.mark.parametrize("context", [atomic_file, atomic_folder])
def test_what_a_killed_process_left_is_swept_up(tmp_path, context):
    for name in ("city.map", "other.map"):
        killed_while_writing(context(tmp_path / name))
    assert len(names(tmp_path)) == 2 and not (tmp_path / "city.map").exists()
    with context(tmp_path / "city.map") as at_work:
        write(at_work, "whole")
        if context is atomic_file:
            check_writable(tmp_path / "city.map")
    assert len(names(tmp_path)) == 2  # the other's is left to it
    sweep(tmp_path)
    assert names(tmp_path) == ["city.map"]


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


def test_two_writers_do_not_meet_and_the_last_to_end_counts(output):
    target, context, _ = output
    with context() as one:
        with context() as other:
            assert one != other and one.parent.exists()
            write(other, "other")
        write(one, "one")
    assert list(written(target).values()) == ["one"]
    assert names(target.parent) == [target.name]


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


def test_behind_a_link_the_target_is_written(output):
    target, _, _ = output
    link = target.parent / "link"
    link.symlink_to(target)
    is_folder = target.is_dir()
    if not is_folder:
        check_writable(link)
    with atomic_folder(link, overwrite=True) if is_folder else atomic_file(link) as partial:
        write(partial, "new")
    assert link.is_symlink() and list(written(target).values()) == ["new"]
    assert names(target.parent) == ["city.map", "link"]


def test_links_in_a_circle(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(FileError, match="able to write"):
        check_writable(tmp_path / "a")
    assert names(tmp_path) == ["a", "b"]


def test_a_file_is_no_folder_to_overwrite(tmp_path):
    (tmp_path / "file").write_text("old")
    with pytest.raises(FileError, match="got the file"), atomic_folder(tmp_path / "file", overwrite=True):
        pass
    assert (tmp_path / "file").read_text() == "old"


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
