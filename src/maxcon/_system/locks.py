# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Locks of files: what must not be done twice at once; the system lets go of them when a process ends, however."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

from maxcon.errors import FileError

__all__ = ["locked", "try_lock"]


@contextmanager
def locked(path: str | os.PathLike[str], what: str) -> Iterator[BinaryIO]:
    """Hold the lock of a file, open to append to, while the block runs; it is let go when the process ends, however.

    Parameters
    ----------
    path : path
        Made, empty, if it is not there; it stays.
    what : str
        What must not be done twice at once, for the message.

    Raises
    ------
    FileError
        If another process holds it, the file cannot be made, or its file system knows no locks.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(Path(path).open("ab"))
        except OSError as error:
            raise FileError(
                f"Expected to be able to write {path}, got: {error.strerror}. Check the folder and its permissions."
            ) from error
        try:
            is_free = try_lock(file.fileno())
        except OSError as error:
            raise FileError(
                f"Expected to be able to lock {path}, got: {error.strerror or error}. Name a place on another file"
                " system."
            ) from error
        if not is_free:
            raise FileError(
                f"Expected {what} to be left alone, but another process is at work on it. Wait for it, or stop it."
            )
        yield file


def try_lock(descriptor: int) -> bool:
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
