# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Folders of work that may be stopped at any moment and gone on with later."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maxcon._system.atomic import check_folder, make_folder
from maxcon._system.locks import locked
from maxcon._system.partials import partials_in, partials_of, remove
from maxcon.errors import FileError

__all__ = ["LOCK", "work_folder"]

LOCK = ".lock"


@contextmanager
def work_folder(folder: str | os.PathLike[str], what: str, record: str) -> Iterator[None]:
    """Hold a folder of work, made if it is not there, while the block runs.

    Parameters
    ----------
    folder : path
        Of this work alone.
    what : str
        The work, for messages, e.g. "a study".
    record : str
        Name of the file that says what the work is. The block writes it before any other file, so that a
        folder with others and without it is somebody else's.

    Raises
    ------
    FileError
        If the folder cannot be written, holds something else, or another process is at work on it.
    """
    root, lock = Path(folder), Path(folder) / LOCK
    check_folder(root)
    ours = {lock, *partials_of(root / record)}
    others = sorted(path.name for path in root.iterdir() if path not in ours) if root.exists() else []
    if others and record not in others:
        raise FileError(f"Expected {what} or an empty folder in {root}, but it holds {others[0]}. Name another folder.")
    make_folder(root)
    with locked(lock, str(root)):
        for left in partials_in(root):  # by processes that were killed: this one alone is at work
            remove(left)
        yield
