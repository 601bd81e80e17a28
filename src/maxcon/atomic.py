# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Outputs are written beside their place and renamed, so that nothing is ever half written (D10)."""

import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maxcon.errors import FileError

__all__ = ["atomic_file", "atomic_folder", "make_folder"]


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


def _beside(path: Path) -> Path:
    """Return a name in the same folder (same file system) that nobody else uses."""
    return path.with_name(f".{path.name}.partial-{uuid.uuid4().hex[:8]}")


def _remove(path: Path) -> None:
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
        raise FileError(
            f"Expected to be able to write {target}, got: {error.strerror or error}."
            " Check the folder, its permissions and the free disk space; nothing was written."
        ) from error
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
    if target.exists() and not overwrite:
        raise FileError(
            f"Expected {target} not to exist yet, but it does. Remove it, or allow overwriting it."
        )
    partial = _beside(target)
    try:
        partial.mkdir()
        yield partial
        _exchange(partial, target)
    except OSError as error:
        raise FileError(
            f"Expected to be able to write {target}, got: {error.strerror or error}."
            " Check the folder, its permissions and the free disk space; nothing was written."
        ) from error
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
