# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Point clouds from files, read chunk by chunk; the suffix says how."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

from maxcon._system.regular_file import special_kind
from maxcon.errors import FileError
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader
from maxcon.io.clouds.e57 import E57Reader
from maxcon.io.clouds.las import LasReader
from maxcon.io.clouds.npz import NpzReader
from maxcon.io.clouds.ply import PlyReader
from maxcon.io.clouds.xyz import XyzReader

__all__ = ["CLOUD_SUFFIXES", "Bounds", "CloudChunk", "CloudHeader", "CloudReader", "open_cloud"]

_READERS: dict[str, Callable[[Path], CloudReader]] = {
    **dict.fromkeys((".las", ".laz"), LasReader),
    ".ply": PlyReader,
    ".npz": NpzReader,
    ".e57": E57Reader,
    **dict.fromkeys((".xyz", ".csv", ".txt"), XyzReader),
}
CLOUD_SUFFIXES = tuple(_READERS)


def open_cloud(path: str | os.PathLike[str]) -> CloudReader:
    """Return a reader of the point cloud in `path`; use it in a `with` block.

    path: a file with suffix .las, .laz (also .copc.laz), .ply, .npz, .e57, .xyz, .csv or .txt.
    """
    file = Path(path)
    try:
        status = file.stat()
    except OSError as error:
        got = " no such file" if isinstance(error, FileNotFoundError) else f": {error.strerror}"
        raise FileError(f"Expected a point cloud at {file}, got{got}. Check the path.") from error
    if stat.S_ISDIR(status.st_mode):
        raise FileError(f"Expected a point-cloud file, got the folder {file}. Name the files in it.")
    if not stat.S_ISREG(status.st_mode):
        raise FileError(f"Expected a point-cloud file, got {file}, a {special_kind(status.st_mode)}. Name a file.")
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise FileError(
            f"Expected a point cloud with suffix {', '.join(CLOUD_SUFFIXES)}, got {file}. Convert it to one of these."
        )
    if status.st_size == 0:
        raise FileError(f"Expected points in {file}, got an empty file. Copy it again, or leave it out.")
    return reader(file)
