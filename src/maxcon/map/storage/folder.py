# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A folder of this machine: files are copied into private memory, so that later changes do no harm (decision 25)."""

import errno
import mmap
import os
from collections.abc import Sequence
from contextlib import suppress
from io import BufferedReader
from pathlib import Path

from maxcon._system.regular_file import open_regular
from maxcon.map.storage.record_place import RecordPlace

__all__ = ["Folder"]

LARGE_PAGE = 2**21
"""Bytes of a large page, asked for from this size on."""


class Folder:
    """The files of a map in a folder.

    Parameters
    ----------
    path : path
        The folder; nothing is opened until it is read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)

    @property
    def remedy(self) -> str:
        """What helps where a file cannot be read, for messages."""
        return "Build the map again with `maxcon map build`."

    def where(self, name: str) -> str:
        """Return the file's path."""
        return str(self._path / name)

    def what_is_there(self, name: str, error: OSError) -> str:
        """Return what there is instead of a file that was not found, in words for a message."""
        if self._path.is_dir():
            return f"no {name} in it"
        return "a file" if self._path.is_file() else "no such folder"

    def read(self, name: str, most_bytes: int) -> memoryview:
        """Return all of a file, in memory of its own.

        Raises
        ------
        OSError
            If it cannot be read, is no file, or is larger than `most_bytes`.
        """
        with open_regular(self._path / name) as file:
            size = os.fstat(file.fileno()).st_size
            if size > most_bytes:
                raise OSError(errno.EFBIG, f"{size:,} bytes, more than there can be in it")
            return _read(file, 0, size)

    def read_record(self, place: RecordPlace) -> memoryview:
        """Return the bytes of a record, in memory of their own; fewer where the file ends before.

        Raises
        ------
        OSError
            If the file cannot be read, or is none.
        """
        with open_regular(self._path / place.name) as file:
            size = os.fstat(file.fileno()).st_size
            return _read(file, place.offset, max(min(place.length, size - place.offset), 0))

    def announce(self, places: Sequence[RecordPlace]) -> None:
        """Do nothing: files of this machine need no fetching ahead."""


def _read(file: BufferedReader, offset: int, length: int) -> memoryview:
    memory = memoryview(_memory(length))[:length]
    file.seek(offset)
    return memory[: file.readinto(memory)]


def _memory(size: int) -> mmap.mmap:
    """Private memory, in large pages where the system has them: it takes half the time to get."""
    memory = mmap.mmap(-1, max(size, 1))
    if size >= LARGE_PAGE and hasattr(mmap, "MADV_HUGEPAGE"):
        with suppress(OSError):
            memory.madvise(mmap.MADV_HUGEPAGE)
    return memory
