"""Point clouds from files, read chunk by chunk; the suffix says how."""

import os
from collections.abc import Callable
from pathlib import Path

from maxcon._system.regular_file import check_regular
from maxcon.errors import FileError
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader
from maxcon.io.clouds.e57 import E57Reader
from maxcon.io.clouds.las import LasReader
from maxcon.io.clouds.pcd import PcdReader
from maxcon.io.clouds.records import NpzReader, PlyReader
from maxcon.io.clouds.xyz import XyzReader
from maxcon.io.text import reading

__all__ = ["CLOUD_SUFFIXES", "Bounds", "CloudChunk", "CloudHeader", "CloudReader", "open_cloud"]

_READERS: dict[str, Callable[[Path], CloudReader]] = {
    ".las": LasReader, ".laz": LasReader, ".ply": PlyReader, ".pcd": PcdReader, ".npz": NpzReader, ".e57": E57Reader,
    ".xyz": XyzReader, ".csv": XyzReader, ".txt": XyzReader,
}  # fmt: skip
CLOUD_SUFFIXES = tuple(_READERS)


def open_cloud(path: str | os.PathLike[str]) -> CloudReader:
    """Return a reader of the point cloud in a file, by its suffix (see `CLOUD_SUFFIXES`); use it in a `with` block."""
    file = Path(path)
    with reading(file, "a point-cloud file"):
        check_regular(file)
        is_empty = file.stat().st_size == 0
    reader = _READERS.get(file.suffix.lower())
    if reader is None or is_empty:
        remedy = "Convert it to one of these, or leave it out."
        if file.suffix.lower() == ".bin":
            remedy = "A map of scans is built with `maxcon map build --scans FOLDER --poses POSES`."
        raise FileError(
            f"Expected a point cloud with suffix {', '.join(CLOUD_SUFFIXES)}, got {file}"
            f"{', an empty file' if is_empty else ''}. {remedy}"
        )
    return reader(file)
