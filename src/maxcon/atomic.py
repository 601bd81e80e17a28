# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Outputs are written beside their place and renamed, so that nothing is ever half written (D10)."""

import os
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path

from maxcon.errors import FileError

__all__ = [
    "atomic_file",
    "atomic_folder",
    "check_folder",
    "check_replaceable",
    "check_writable",
    "locked",
    "make_folder",
]


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder for outputs, if it is not there.

    Raises
    ------
    FileError
        If it cannot be made.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"Expected to be able to make the folder {path}, got: {error.strerror or error}. Choose another."
        ) from error


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse a file that cannot be written, before the work whose outcome it shall hold.

    Raises
    ------
    FileError
        If it is a folder, or its own folder does not exist or takes no files.
    """
    partial = _beside(Path(path))
    try:
        if Path(path).is_dir():
            raise FileError(f"Expected a file to write, got the folder {path}. Name a file in it.")
        partial.touch()
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        _remove(partial)


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a folder for outputs that is a file, before the work whose outcome it shall hold.

    Raises
    ------
    FileError
        If it is a file, or no name of a folder.
    """
    try:
        is_file = Path(path).is_file()
    except OSError as error:
        raise _cannot_write(path, error) from error
    if is_file:
        raise FileError(f"Expected a folder to write into, got the file {path}. Name another.")


def check_replaceable(path: str | os.PathLike[str], what: str, names: Sequence[str]) -> None:
    """Refuse to overwrite anything but a folder of the kind that is to be written.

    Parameters
    ----------
    path : path
        May be missing.
    what : str
        The kind, for the message, e.g. "a map".
    names : sequence of str
        Names and patterns (`poses-*.csv`) of all that such a folder may hold; the first it must hold, if it
        is not empty.

    Raises
    ------
    FileError
        If it is a file, or a folder that holds something else.
    """
    folder = Path(path)
    try:
        there = sorted(child.name for child in folder.iterdir())
    except FileNotFoundError:
        return
    except OSError as error:
        raise FileError(
            f"Expected {folder} to be {what}, to overwrite it, got: {error.strerror}. Name another folder."
        ) from error
    others = [name for name in there if not any(fnmatchcase(name, pattern) for pattern in names)]
    if others:
        raise FileError(
            f"Expected {folder} to be {what}, to overwrite it, but it holds {others[0]}."
            " Move that away, or name another folder."
        )
    if there and names[0] not in there:
        raise FileError(
            f"Expected {folder} to be {what}, to overwrite it, but it holds no {names[0]}."
            " Remove it yourself, or name another folder."
        )


def _cannot_write(path: str | os.PathLike[str], error: OSError) -> FileError:
    return FileError(
        f"Expected to be able to write {path}, got: {error.strerror or error}."
        " Check the folder, its permissions and the free disk space; nothing was written."
    )


def _beside(path: Path) -> Path:
    """Return a name in the same folder (same file system) that nobody else uses."""
    if path.name in ("", ".."):
        raise FileError(f"Expected the name of what to write, got '{path}'. Put a name behind it.")
    return path.with_name(f".{path.name}.partial-{uuid.uuid4().hex[:8]}")


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it can be: an error that is on its way says more than one of cleaning up."""
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


@contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path to write to; it replaces `path` when the block ends well and vanishes otherwise.

    Raises
    ------
    FileError
        If the folder does not exist or the file cannot be written (full disk, no permission).
    """
    target = Path(path)
    partial = _beside(target)
    try:
        yield partial
        partial.replace(target)
    except OSError as error:
        raise _cannot_write(target, error) from error
    finally:
        _remove(partial)


@contextmanager
def atomic_folder(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Path]:
    """Yield an empty folder to fill; it becomes `path` when the block ends well and vanishes otherwise.

    Raises
    ------
    FileError
        If `path` exists and `overwrite` is False, or the folder cannot be written.
    """
    target = Path(path)
    partial = _beside(target)
    try:
        if target.exists() and not overwrite:
            raise FileError(
                f"Expected {target} not to exist yet, but it does."
                " Name another, remove it, or allow overwriting it (--overwrite)."
            )
        partial.mkdir()
        yield partial
        _exchange(partial, target)
    except OSError as error:
        raise _cannot_write(target, error) from error
    finally:
        _remove(partial)


def _exchange(partial: Path, target: Path) -> None:
    """Put `partial` where `target` is; the old folder goes only once the new one stands."""
    if not target.exists():
        partial.replace(target)
        return
    old = _beside(target)
    target.replace(old)
    try:
        partial.replace(target)
    except OSError:
        old.replace(target)
        raise
    _remove(old)


@contextmanager
def locked(path: str | os.PathLike[str], what: str) -> Iterator[None]:
    """Hold the lock of a file while the block runs; the system lets go of it when the process ends, however.

    Parameters
    ----------
    path : path
        Made if it is not there; it stays, empty.
    what : str
        What must not be done twice at once, for the message.

    Raises
    ------
    FileError
        If another process holds it, or the file cannot be made.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(Path(path).open("ab"))
        except OSError as error:
            raise _cannot_write(path, error) from error
        if not _try_lock(file.fileno()):
            raise FileError(
                f"Expected {what} to be left alone, but another process is at work on it. Wait for it, or stop it."
            )
        yield


def _try_lock(descriptor: int) -> bool:
    """Take the lock of an open file, if nobody else has it."""
    if os.name == "nt":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
