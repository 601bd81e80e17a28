# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""NPZ: arrays `points`, and optionally `normals`, `classes`, `times`, of an archive of NumPy's."""

import io
import zipfile
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.io.clouds.base import (
    Bounds,
    CloudChunk,
    CloudHeader,
    CloudReader,
    as_file_error,
    check_unpacked_size,
    cloud_chunk,
)
from maxcon.io.text import printable

COLUMNS = {"points": (3,), "normals": (3,), "classes": (), "times": ()}
# Coordinates hardly compress; a large array that claims a higher ratio than this was made to exhaust memory.
MAX_RATIO = 100
KIND = "an NPZ archive of numpy.savez(path, points=...)"


class NpzReader(CloudReader):
    """Points of an archive written by `numpy.savez` or `numpy.savez_compressed`; nothing is unpickled.

    Arrays are `points` (n, 3), and optionally `normals` (n, 3), `classes` (n,) and `times` (n,); they are in memory
    while the cloud is open, as they were when they were written. FileError if it is no such archive, an array has
    another shape or type than these, or sizes contradict.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND):
            self._arrays = _read_arrays(file)
        has: dict[str, Any] = {f"has_{name}": name in self._arrays for name in ("normals", "classes", "times")}
        self.header = CloudHeader(file, len(self._arrays["points"]), **has)

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        with as_file_error(self.header.path, KIND):
            for start in range(0, self.header.n_points, max_points):
                yield cloud_chunk(**{name: array[start : start + max_points] for name, array in self._arrays.items()})


def _read_arrays(file: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive by their names, each with a row per point."""
    with zipfile.ZipFile(file) as archive:
        there = {info.filename.removesuffix(".npy") for info in archive.infolist()}
        if "points" not in there:
            raise ValueError(f"no array `points` among {printable(', '.join(sorted(there))) or 'none'}")
        arrays = {name: _array(archive, name) for name in COLUMNS if name in there}
    if len({len(array) for array in arrays.values()}) > 1 or not len(arrays["points"]):
        counts = ", ".join(f"{len(array)} of `{name}`" for name, array in arrays.items())
        raise ValueError(f"rows that are none, or not one per point: {counts}")
    return arrays


def _array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """One array; its header is held against the bytes that are there, which NumPy would allocate for it first."""
    info = archive.getinfo(f"{name}.npy")
    if name == "points":  # classes that are all alike do compress
        check_unpacked_size(info.file_size, info.compress_size, MAX_RATIO)
    stream = io.BytesIO(archive.read(info))
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, is_fortran, dtype = read_header(stream)
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise ValueError(f"`{name}` of {dtype}, no numbers: save .astype(float)")
    if len(shape) != 1 + len(COLUMNS[name]) or shape[1:] != COLUMNS[name]:
        raise ValueError(f"`{name}` of shape {shape}, not (n{', 3' if COLUMNS[name] else ','})")
    return np.ndarray(shape, dtype, stream.getbuffer(), stream.tell(), order="F" if is_fortran else "C")
