"""Files and folders that appear whole or not at all: written in a temporary sibling, then renamed (D10)."""

import json
import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from glob import escape
from pathlib import Path
from tempfile import mkdtemp

from maxcon.errors import FileError

MARK = ".partial-"  # in the names of temporary siblings: `.city.map.partial-x1y2z3w4`
LOCK, NEW, OLD = ".lock", "new", "old"  # in such a sibling: held during work; the folder to fill; what it replaces


@contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path to write to; it replaces `path`, or what a link leads to, when the block ends well."""
    target = _output_file(path)
    with _writing(target), _temporary_sibling(target) as folder:
        partial = folder / target.name
        yield partial
        partial.replace(_output_file(target))


@contextmanager
def atomic_folder(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Path]:
    """Yield an empty folder to fill; it becomes `path` when the block ends well and vanishes otherwise."""
    target = _behind_links(Path(path))
    with _writing(path):
        sweep(target.parent, target.name)
        if target.exists() and not overwrite:
            raise FileError(
                f"Expected {target} not to exist yet, but it does."
                " Name another, remove it, or allow overwriting it (--overwrite)."
            )
        if target.exists() and not target.is_dir():
            raise FileError(f"Expected a folder to overwrite, got the file {target}. Name another.")
        with _temporary_sibling(target) as folder:
            new = folder / NEW
            new.mkdir()
            yield new
            if target.exists():
                target.replace(folder / OLD)  # it returns if the next step is not reached
            new.replace(target)


def lift(folder: Path) -> None:
    """Move what is in a folder beside it, and remove it."""
    for each in folder.iterdir():
        each.replace(folder.parent / each.name)
    folder.rmdir()


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write a value as a JSON file; errors as of `atomic_file`."""
    with atomic_file(path) as partial:
        partial.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8", newline="\n")


def sweep(folder: Path, name: str | None = None) -> None:
    """Remove what killed processes left beside an output of this name, or any; what they had moved aside returns."""
    from filelock import FileLock, Timeout

    for left in folder.glob(f".{'*' if name is None else escape(name)}{MARK}*"):
        with suppress(Timeout, OSError, NotImplementedError), FileLock(left / LOCK, timeout=0):
            _remove(left)


@contextmanager
def locked(path: str | os.PathLike[str], what: str) -> Iterator[None]:
    """Hold a lock file while the block runs, and remove it; the system lets go of it when the process is killed."""
    from filelock import FileLock, Timeout

    lock = FileLock(path)
    with _writing(path):
        try:
            lock.acquire(timeout=0)
        except Timeout as error:
            raise FileError(
                f"Expected {what} to be left alone, but another process is at work on it. Wait for it, or stop it."
            ) from error
        except NotImplementedError as error:  # a file system without locks
            raise OSError(error) from error
    try:
        yield
    finally:
        with suppress(OSError):
            Path(path).unlink()  # before it is free: the next one makes its own
        lock.release()


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder for outputs, if it is not there; FileError if it cannot be made."""
    with _writing(path):
        Path(path).mkdir(parents=True, exist_ok=True)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse a file that cannot be written, before the work whose outcome it shall hold; sweep beside it."""
    target = _output_file(path)
    with _writing(path):
        with _temporary_sibling(target) as folder:
            (folder / target.name).touch()
        sweep(target.parent, target.name)


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a folder for outputs that is a file, or is in one; FileError if so."""
    with _writing(path):
        there = next(place for place in (Path(path), *Path(path).absolute().parents) if place.exists())
    if not there.is_dir():
        raise FileError(f"Expected a folder to write into, {path}, got the file {there}. Name another.")


def check_replaceable(path: str | os.PathLike[str], what: str, names: Sequence[str]) -> None:
    """Refuse to overwrite anything but a folder of `what`: all in it has one of the names, the first is there."""
    there: list[str] = []
    with _writing(path), suppress(FileNotFoundError):
        there = sorted(child.name for child in Path(path).iterdir())
    known = frozenset(names)  # thousands of files, where they are many
    others = [name for name in there if name not in known and not any(fnmatchcase(name, pattern) for pattern in names)]
    if others or (there and names[0] not in there):
        raise FileError(
            f"Expected {path} to be {what}, to overwrite it, but it holds {others[0] if others else f'no {names[0]}'}."
            " Move that away, or name another folder."
        )


@contextmanager
def _temporary_sibling(target: Path) -> Iterator[Path]:
    """Yield an empty folder beside `target`, locked, so that nobody sweeps it away; it is removed in the end."""
    from filelock import FileLock

    if target.name in ("", ".."):
        raise FileError(f"Expected the name of what to write, got '{target}'. Put a name behind it.")
    folder = Path(mkdtemp(prefix=f".{target.name}{MARK}", dir=target.parent))
    lock = FileLock(folder / LOCK)
    try:
        with suppress(NotImplementedError):  # a file system without locks: nothing is swept there
            lock.acquire(timeout=0)
        yield folder
    finally:
        lock.release()
        _remove(folder)


def _remove(sibling: Path) -> None:
    """Remove a temporary sibling; the folder that was moved aside into it returns, if nothing stands in its place."""
    old, place = sibling / OLD, sibling.with_name(sibling.name[1:].rpartition(MARK)[0])
    with suppress(OSError):  # an error that is on its way says more than one of cleaning up
        if old.is_dir() and not place.exists():
            old.replace(place)
        shutil.rmtree(sibling)


def _output_file(path: str | os.PathLike[str]) -> Path:
    """Return the file to write, behind symbolic links; FileError if a folder, a device or a FIFO stands there."""
    target = _behind_links(Path(path))
    with _writing(path), suppress(FileNotFoundError):
        mode = target.stat().st_mode
        if not stat.S_ISREG(mode):
            kind = "the folder" if stat.S_ISDIR(mode) else "a FIFO, socket or device:"
            raise FileError(f"Expected a file to write, got {kind} {path}. Name a file.")
    return target


def _behind_links(path: Path) -> Path:
    """Return where a symbolic link leads, which need not exist; any other path as it is."""
    try:
        return Path(os.path.realpath(path)) if path.is_symlink() else path
    except OSError:  # too long a name: told by what comes next
        return path


@contextmanager
def _writing(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn errors of the operating system into FileError."""
    try:
        yield
    except OSError as error:
        raise FileError(
            f"Expected to be able to write {path}, got: {getattr(error, 'strerror', None) or error}."
            " Check the folder, its permissions and the free disk space; nothing was written."
        ) from error
