# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Outputs are written beside their place and renamed, so that nothing is ever half written (D10, decision 25)."""

import json
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path

from maxcon._system.exchange import swapped
from maxcon._system.partials import check_name, old_place, partial_folder, partials_of, put_back, remove, sweep
from maxcon._system.regular_file import special_kind
from maxcon.errors import FileError

__all__ = [
    "atomic_file",
    "atomic_folder",
    "check_folder",
    "check_replaceable",
    "check_writable",
    "make_folder",
    "remove_partials",
    "write_json",
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

    What killed processes left of it beside it is removed.

    Raises
    ------
    FileError
        If it is a folder or no file at all (a device, a FIFO), or its own folder does not exist or takes no files.
    """
    target = _output_file(path)
    try:
        with partial_folder(target) as folder:
            (folder / target.name).touch()
        sweep(target)
    except OSError as error:
        raise _cannot_write(path, error) from error


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a folder for outputs that cannot be made, before the work whose outcome it shall hold.

    Raises
    ------
    FileError
        If it, or what it shall be in, is no folder, or its name is none.
    """
    try:
        there = next(place for place in (Path(path), *Path(path).absolute().parents) if place.exists())
        is_folder = there.is_dir()
    except OSError as error:
        raise _cannot_write(path, error) from error
    if not is_folder:
        raise FileError(f"Expected a folder to write into, {path}, got the file {there}. Name another.")


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
    known = frozenset(names)  # thousands of files, where they are many
    others = [name for name in there if name not in known and not any(fnmatchcase(name, pattern) for pattern in names)]
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


def _output_file(path: str | os.PathLike[str]) -> Path:
    """Return the file to write where `path` says: behind symbolic links, which stay; nothing but files is replaced.

    Raises
    ------
    FileError
        If a folder stands there, a device, a FIFO or a socket, or links that lead nowhere.
    """
    target = _behind_links(Path(path))
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return target
    except OSError as error:
        raise _cannot_write(path, error) from error
    if stat.S_ISDIR(mode):
        raise FileError(f"Expected a file to write, got the folder {path}. Name a file in it.")
    if not stat.S_ISREG(mode):
        raise FileError(
            f"Expected a file to write, got {path}, a {special_kind(mode)}: it would be replaced. Name a file."
        )
    return target


def _behind_links(path: Path) -> Path:
    """Return where a symbolic link leads, which need not exist; any other path as it is."""
    try:
        return Path(os.path.realpath(path)) if path.is_symlink() else path
    except OSError:  # too long a name: told by what comes next
        return path


@contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path to write to; it replaces `path` when the block ends well and vanishes otherwise.

    Raises
    ------
    FileError
        If the folder does not exist, the file cannot be written (full disk, no permission), or something other than a
        file stands there.
    """
    target = _output_file(path)
    try:
        with partial_folder(target) as folder:
            partial = folder / target.name
            yield partial
            partial.replace(_output_file(target))
    except OSError as error:
        raise _cannot_write(target, error) from error


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write a value as JSON, in a step; errors as of `atomic_file`."""
    with atomic_file(path) as partial:
        partial.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8", newline="\n")


def remove_partials(path: str | os.PathLike[str]) -> None:
    """Remove what killed processes left of a file that they were writing; nobody else may be writing it now."""
    for left in partials_of(Path(path)):
        remove(left)


@contextmanager
def atomic_folder(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Path]:
    """Yield an empty folder to fill; it becomes `path` when the block ends well and vanishes otherwise.

    Folders that a killed process left half filled for the same `path` are removed; one that it had moved aside, to
    replace it, returns.

    Raises
    ------
    FileError
        If `path` exists and `overwrite` is False, or the folder cannot be written.
    """
    target = _behind_links(Path(path))
    check_name(target)
    try:
        put_back(target)
        if target.exists() and not overwrite:
            raise FileError(
                f"Expected {target} not to exist yet, but it does."
                " Name another, remove it, or allow overwriting it (--overwrite)."
            )
        if target.exists() and not target.is_dir():
            raise FileError(f"Expected a folder to overwrite, got the file {target}. Name another.")
        sweep(target)
        with partial_folder(target) as partial:
            yield partial
            _exchange(partial, target)
    except OSError as error:
        raise _cannot_write(target, error) from error


def _exchange(partial: Path, target: Path) -> None:
    """Put `partial` where `target` is; the old folder goes only once the new one stands."""
    if not target.exists():
        partial.replace(target)
        return
    if swapped(partial, target):
        return  # the old one is where `partial` was, and is removed there
    old = old_place(target)
    try:
        target.replace(old)
        partial.replace(target)
    except BaseException:  # a signal, too
        if old.exists() and not target.exists():
            old.replace(target)
        raise
    remove(old)
