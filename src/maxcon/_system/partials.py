# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Folders beside an output, in which it is made: locked by who fills them, and swept up once nobody does."""

import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from glob import escape
from pathlib import Path

from maxcon._system.locks import try_lock
from maxcon.errors import FileError

__all__ = [
    "check_name",
    "old_place",
    "partial_folder",
    "partials_in",
    "partials_of",
    "put_back",
    "remove",
    "sweep",
    "sweep_folder",
]


@contextmanager
def partial_folder(target: Path) -> Iterator[Path]:
    """Yield an empty folder beside `target`, on the same file system; it is removed when the block ends.

    Raises
    ------
    FileError
        If `target` has no name.
    OSError
        If it cannot be made.
    """
    with ExitStack() as stack:
        yield _locked_folder(target, stack)


def check_name(target: Path) -> None:
    """Refuse a path that ends in no name.

    Raises
    ------
    FileError
        If it is such.
    """
    if target.name in ("", ".."):
        raise FileError(f"Expected the name of what to write, got '{target}'. Put a name behind it.")


def old_place(target: Path) -> Path:
    """Return where a folder is put that is replaced in two steps."""
    return _beside(target, "old")


def put_back(target: Path) -> None:
    """Let the folder return that a process was killed over, between two renames, before the new one stood there.

    Where `target` stands, what it has replaced is removed.

    Raises
    ------
    OSError
        If it cannot be renamed.
    """
    for old in sorted(target.parent.glob(f".{escape(target.name)}.old-*")):
        if target.exists():
            remove(old)
        else:
            old.replace(target)


def partials_of(target: Path) -> list[Path]:
    """Return what is beside `target` of those who are making it, or were killed over it."""
    return list(target.parent.glob(f".{escape(target.name)}.partial-*"))


def partials_in(folder: Path) -> list[Path]:
    """Return what is in a folder of those who are making something there, or were killed over it."""
    return list(folder.glob(".*.partial-*"))


def sweep(target: Path) -> None:
    """Remove what killed processes left beside `target` of what they were making: nobody holds its lock."""
    for partial in partials_of(target):
        _remove_if_left(partial)


def sweep_folder(folder: Path) -> None:
    """Remove what killed processes left in a folder, whatever they were making."""
    for partial in partials_in(folder):
        _remove_if_left(partial)


def remove(path: Path) -> None:
    """Remove a file or a folder, if it can be: an error that is on its way says more than one of cleaning up."""
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _beside(path: Path, what: str) -> Path:
    """Return a name in the same folder (same file system) that nobody else uses."""
    check_name(path)
    return path.with_name(f".{path.name}.{what}-{uuid.uuid4().hex[:8]}")


def _locked_folder(target: Path, stack: ExitStack) -> Path:
    """Make a folder beside `target` that is removed, and whose lock is held, until the stack is left."""
    while True:
        partial = _beside(target, "partial")
        stack.callback(remove, partial)
        partial.mkdir()
        descriptor = _open_folder(partial)
        if descriptor is None:
            if partial.exists():
                return partial
            continue  # it was swept away already
        stack.callback(os.close, descriptor)
        if _holds_lock(descriptor) is not False and partial.exists():
            return partial  # else it was swept away before it was locked


def _remove_if_left(left: Path) -> None:
    descriptor = _open_folder(left)
    if descriptor is None:
        return
    try:
        if _holds_lock(descriptor):
            remove(left)
    finally:
        os.close(descriptor)


def _open_folder(folder: Path) -> int | None:
    """Return a descriptor of a folder, to lock it; None if it is none, or of a system that opens no folders."""
    try:
        return os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    except OSError:
        return None


def _holds_lock(descriptor: int) -> bool | None:
    """Try to lock a folder; None where the file system knows no locks: what lies there is not swept away."""
    try:
        return try_lock(descriptor)
    except OSError:
        return None
