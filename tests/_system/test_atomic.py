"""Nothing is ever half written: files and folders appear whole, or not at all (D10)."""

import errno
import os
import signal
import socket
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


def test_what_is_written_appears_whole_in_the_end_and_the_last_of_two_writers_counts(output):
    target, context, before = output
    with context() as partial:
        assert partial.is_relative_to(target.parent)  # the same file system, so that renaming is one step
        write(partial, "half")
        assert target.exists() == (before is not None) and (not before or written(target) == before)
        with context() as other:
            assert partial != other and partial.parent.exists()
            write(other, "other")
        write(partial, "whole")
    assert list(written(target).values()) == ["whole"] and names(target.parent) == [target.name]


@pytest.mark.parametrize("error", [
    ValueError("no"), KeyboardInterrupt(), Interrupted(), MaxconError("this"), OSError(errno.ENOSPC, "Disk full"),
])  # fmt: skip
def test_an_error_inside_leaves_what_was_there_and_a_full_disk_is_told(output, error):
    target, context, before = output
    with pytest.raises(BaseException) as caught, context() as partial:
        write(partial, "half")
        raise error
    assert caught.value is error or (isinstance(error, OSError) and isinstance(caught.value, FileError))
    if isinstance(error, OSError):
        assert "city.map, got: Disk full." in str(caught.value) and "nothing was written" in str(caught.value)
    assert names(target.parent) == ([target.name] if before else []) and (not before or written(target) == before)


def test_a_file_in_no_folder_or_over_a_folder(tmp_path):
    with pytest.raises(FileError, match="No such file or directory"), atomic_file(tmp_path / "no" / "a") as partial:
        partial.write_text("x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError, match="got the folder"), atomic_file(tmp_path / "folder") as partial:
        partial.write_text("x")
    with pytest.raises(FileError, match="able to write"), atomic_file(tmp_path / "nothing"):
        pass
    assert names(tmp_path) == ["folder"]
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    (tmp_path / "file").write_text("old")
    with pytest.raises(FileError, match=r"able to write .*file.*, got: "):
        make_folder(tmp_path / "file" / "b")
    with pytest.raises(FileError, match="got the file"), atomic_folder(tmp_path / "file", overwrite=True):
        pass
    assert (tmp_path / "file").read_text() == "old"


def test_a_folder_that_exists_is_refused_before_the_work(tmp_path):
    target = tmp_path / "city.map"
    target.mkdir()
    was_entered = False
    with pytest.raises(FileError, match=r"city\.map not to exist yet, but it does\."), atomic_folder(target):
        was_entered = True
    assert not was_entered and names(tmp_path) == ["city.map"]


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
    assert names(target) == (["new"] if after > 2 else ["old"]) and names(tmp_path) == ["city.map"]


@pytest.mark.kills
@pytest.mark.parametrize("context", [atomic_file, atomic_folder])
def test_what_a_killed_process_left_is_swept_up(tmp_path, context):
    for name in ("city.map", "other.map"):
        child = os.fork()
        if child == 0:
            with context(tmp_path / name) as partial:
                write(partial, "half")
                os.kill(os.getpid(), signal.SIGKILL)
        os.waitpid(child, 0)
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
    assert (names(tmp_path), names(target)) == (["city.map"], ["a"])
    (left / "old").mkdir(parents=True)
    sweep(tmp_path)
    assert (names(tmp_path), names(target)) == (["city.map"], ["a"])


@pytest.mark.parametrize("kind", ["FIFO", "socket", "circle"])
def test_nothing_but_a_file_is_replaced(tmp_path, kind):
    """A device would need other rights, and is refused alike; so is what became one while it was written."""
    path, link = tmp_path / "special", tmp_path / "link"
    link.symlink_to(path)
    words = "able to write" if kind == "circle" else "a FIFO, socket or device"
    with pytest.raises(FileError, match=words), atomic_file(path) as partial:
        partial.write_text("x")
        if kind == "FIFO":
            os.mkfifo(path)
        elif kind == "socket":
            with socket.socket(socket.AF_UNIX) as bound:
                bound.bind(str(path))
        else:
            path.symlink_to(link)
    before = path.lstat().st_mode
    for name in (path, link):
        with pytest.raises(FileError):
            check_writable(name)
    assert path.lstat().st_mode == before and names(tmp_path) == ["link", "special"]


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
    with pytest.raises(FileError, match=r"write .*l, got: Function not impl"), locked(tmp_path / "l", ""):
        pass
