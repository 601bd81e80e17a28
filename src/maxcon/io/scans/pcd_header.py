# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The header of a PCD file, checked against the size of the file before its points are read."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from maxcon.errors import FileError
from maxcon.io.text import printable

__all__ = ["PcdLayout", "read_pcd_layout"]

MAX_HEADER_BYTES = 2**16
MAX_COLUMNS = 10_000
# The compression of PCD reaches 88 at the very most.
MAX_RATIO = 300
TYPES = {"F4", "F8", "U1", "U2", "U4", "U8", "I1", "I2", "I4", "I8"}
ENCODINGS = ("ascii", "binary", "binary_compressed")
KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")


@dataclass(frozen=True, slots=True)
class PcdLayout:
    """Where the points of a PCD file are, and their fields.

    Parameters
    ----------
    encoding : str
        ascii, binary or binary_compressed.
    start : int
        Offset of what follows the header, bytes.
    n_points : int
        How many points.
    fields, types, counts : tuple
        Name, type such as F4, and how many numbers, of each field.
    """

    encoding: str
    start: int
    n_points: int
    fields: tuple[str, ...]
    types: tuple[str, ...]
    counts: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[np.void]:
        """One binary record; fields are numbered, because names need not be unique."""
        rows = enumerate(zip(self.types, self.counts, strict=True))
        return np.dtype(
            [(f"f{i}", f"({count},)<{kind.lower()}" if count > 1 else f"<{kind.lower()}") for i, (kind, count) in rows]
        )

    def column(self, field: str) -> int:
        """Which number of an ascii row `field` is."""
        return sum(self.counts[: self.fields.index(field)])


def read_pcd_layout(file: Path, stream: BinaryIO, n_most: int) -> PcdLayout:
    """Return the layout of an open PCD file, checked against its size.

    Raises
    ------
    FileError
        If the header is broken or contradicts itself, x, y or z is missing, there are no points or more
        than `n_most`, or the file is too short for them.
    """
    header = _header(file, stream)
    fields = _lower_axes(tuple(header.get("FIELDS", [])))
    types = tuple(kind + size for kind, size in zip(header.get("TYPE", []), header.get("SIZE", []), strict=False))
    counts = tuple(_whole(file, "COUNT", text) for text in header.get("COUNT", ["1"] * len(fields)))
    n_each = {len(fields), len(header.get("SIZE", [])), len(header.get("TYPE", [])), len(counts)}
    if len(n_each) != 1 or not set(types) <= TYPES or not 0 < sum(counts) <= MAX_COLUMNS or 0 in counts:
        raise _broken(file, "FIELDS, SIZE, TYPE, COUNT of the same length, with types F, U, I", "others")
    for name in "xyz":
        if fields.count(name) != 1 or counts[fields.index(name)] != 1:
            raise _broken(file, f"one field {name!r}", f"FIELDS {printable(' '.join(fields)[:80])}")
    encoding = header["DATA"][0] if header["DATA"] else ""
    if encoding not in ENCODINGS:
        raise _broken(file, f"DATA {', '.join(ENCODINGS)}", repr(encoding))
    layout = PcdLayout(encoding, stream.tell(), _count_points(file, header, n_most), fields, types, counts)
    _check_size(file, stream, layout)
    return layout


def _lower_axes(fields: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names with X, Y and Z, as some write them, for x, y and z where there are none."""
    if any(name in fields for name in "xyz"):
        return fields
    return tuple(name.lower() if name in ("X", "Y", "Z") else name for name in fields)


def _broken(file: Path, expected: str, got: str) -> FileError:
    return FileError(f"Expected {expected} in the PCD file {file}, got {got}. Write it anew, or copy it again.")


def _whole(file: Path, key: str, text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise _broken(file, f"whole numbers as {key}", repr(text[:40]))
    return int(text)


def _header(file: Path, stream: BinaryIO) -> dict[str, list[str]]:
    """Words behind each key; the stream stands behind the header afterwards."""
    header: dict[str, list[str]] = {}
    while "DATA" not in header:
        raw = stream.readline(MAX_HEADER_BYTES)
        if not raw.endswith(b"\n") or stream.tell() > MAX_HEADER_BYTES:
            raise _broken(file, f"a header of at most {MAX_HEADER_BYTES} bytes that ends with DATA", "none")
        words = raw.decode("latin-1").partition("#")[0].split()
        if not words:
            continue
        if words[0] not in KEYS or words[0] in header:
            raise _broken(file, f"header lines {', '.join(KEYS)}, each once", repr(words[0][:40]))
        header[words[0]] = words[1:]
    return header


def _count_points(file: Path, header: dict[str, list[str]], n_most: int) -> int:
    sizes = {}
    for key in ("WIDTH", "HEIGHT", "POINTS"):
        if key in header:
            if len(header[key]) != 1:
                raise _broken(file, f"one number as {key}", repr(" ".join(header[key])[:40]))
            sizes[key] = _whole(file, key, header[key][0])
    area = sizes.get("WIDTH", 0) * sizes.get("HEIGHT", 1)
    n_points = sizes.get("POINTS", area)
    if n_points != area:
        raise _broken(file, "POINTS to be WIDTH times HEIGHT", f"{n_points} and {area}")
    if not 0 < n_points <= n_most:
        raise _broken(file, f"1 to {n_most:,} points", f"{n_points:,}")
    return n_points


def _check_size(file: Path, stream: BinaryIO, layout: PcdLayout) -> None:
    """Check the number of points against the bytes that are there; the stream is left at their start."""
    n_there = stream.seek(0, 2) - layout.start
    stream.seek(layout.start)
    n_needed = layout.n_points * layout.dtype.itemsize
    if layout.encoding == "ascii":
        n_needed = layout.n_points * 2 * sum(layout.counts) - 1  # a digit and a blank or line end each
    elif layout.encoding == "binary_compressed":
        sizes = stream.read(8)
        stream.seek(layout.start)
        if len(sizes) < 8:
            raise _broken(file, "the sizes of the compressed points", "the end of the file: truncated")
        n_packed, n_unpacked = struct.unpack("<II", sizes)
        if n_unpacked != n_needed or n_unpacked > MAX_RATIO * n_packed:
            raise _broken(file, f"points that unpack to {n_needed} bytes", f"{n_unpacked} from {n_packed} bytes")
        n_needed = 8 + n_packed
    if n_there < n_needed:
        raise _broken(file, f"{n_needed} bytes of points", f"{n_there}: truncated")
