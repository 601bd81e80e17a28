# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The coordinate reference system that a LAS file names, and whether its record is intact.

laspy skips records that it cannot parse: a file with a damaged one would seem to name no CRS.
"""

import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

__all__ = ["LasCrs", "read_las_crs"]

WKT, GEO_KEYS = 2112, 34735
PROJECTED_KEY, GEODETIC_KEY = 3072, 2048
USER_DEFINED = 32767
EPSG_CODES = range(1024, USER_DEFINED)


class LasCrs(NamedTuple):
    """The CRS as WKT, None if the file names none that can be used; in `fault`, what it has instead of one."""

    wkt: str | None
    fault: str = ""


def read_las_crs(stream: BinaryIO, wkt_after_points: bytes | None) -> LasCrs:
    """Return the CRS of an open LAS file whose header has been checked.

    Parameters
    ----------
    stream : binary file
        The open file, seekable.
    wkt_after_points : bytes or None
        The WKT in the extended records, if there is one.
    """
    records = list(_records(stream))
    wkts = [content for user, number, content in records if (user, number) == (b"LASF_Projection", WKT)]
    wkts += [wkt_after_points] if wkt_after_points is not None else []
    for content in wkts:
        if content.strip(b"\0 "):
            return _of_wkt(content)
    keys = [content for user, number, content in records if (user, number) == (b"LASF_Projection", GEO_KEYS)]
    found = _of_keys(keys[0]) if keys else LasCrs(None)
    if found.wkt is None:  # libLAS wrote WKT into a record of its own, beside keys of its own making
        for user, number, content in records:
            if (user, number) == (b"liblas", WKT) and content.strip(b"\0 "):
                return _of_wkt(content)
    return found


def _records(stream: BinaryIO) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield user, number and content of the records between header and points."""
    stream.seek(94)
    at, start, n_records = struct.unpack("<HII", stream.read(10))
    for _ in range(n_records):
        stream.seek(at)
        head = stream.read(54)
        if len(head) < 54 or at + 54 > start:
            return
        number, length = struct.unpack_from("<HH", head, 18)
        yield head[2:18].partition(b"\0")[0], number, stream.read(length)
        at += 54 + length


def _of_wkt(content: bytes) -> LasCrs:
    import pyproj

    try:
        return LasCrs(pyproj.CRS.from_wkt(content.rstrip(b"\0").decode("utf-8")).to_wkt())
    except (UnicodeDecodeError, pyproj.exceptions.CRSError) as error:
        return LasCrs(None, f"a WKT that it does not: {_first_words(error)}")


def _of_keys(content: bytes) -> LasCrs:
    """The CRS of GeoTIFF keys."""
    import pyproj

    if len(content) < 8 or content[:2] != b"\1\0":
        return LasCrs(None, "a damaged directory of GeoTIFF keys")
    n_keys = struct.unpack_from("<H", content, 6)[0]
    if 8 + 8 * n_keys > len(content):
        return LasCrs(None, f"{n_keys} GeoTIFF keys in {len(content)} bytes")
    rows = [struct.unpack_from("<4H", content, 8 + 8 * number) for number in range(n_keys)]
    codes = {key: code for key, place, _, code in rows if place == 0}
    for key in (PROJECTED_KEY, GEODETIC_KEY):
        code = codes.get(key, 0)
        if code == USER_DEFINED:
            return LasCrs(None, "GeoTIFF keys of a CRS of its own, without WKT")
        if code in EPSG_CODES:
            try:
                return LasCrs(pyproj.CRS.from_epsg(code).to_wkt())
            except pyproj.exceptions.CRSError as error:
                return LasCrs(None, f"EPSG:{code}: {_first_words(error)}")
        if code:
            return LasCrs(None, f"the code {code}")
    return LasCrs(None, "GeoTIFF keys without a code") if rows else LasCrs(None)


def _first_words(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
