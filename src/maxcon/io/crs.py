# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coordinate reference systems: of text, and whether two are the same (D1)."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from maxcon.errors import CrsError

__all__ = ["crs_name", "metric_crs", "parse_crs", "same_crs", "to_wgs84"]


@lru_cache(maxsize=32)
def parse_crs(text: str) -> Any:
    """Return the pyproj.CRS of a code or WKT.

    Raises
    ------
    CrsError
        If it is unknown.
    """
    import pyproj
    from pyproj.exceptions import CRSError

    try:
        return pyproj.CRS.from_user_input(text)
    except CRSError as error:
        reason = str(error).splitlines()[0][:120]
        raise CrsError(
            f"Expected a coordinate reference system such as EPSG:25832, or WKT, got {text[:80]!r}: {reason}."
        ) from None


def metric_crs(text: str) -> str:
    """WKT of a projected (or local) CRS in metres.

    Parameters
    ----------
    text : str
        A code such as "EPSG:25832", or WKT.

    Raises
    ------
    CrsError
        If it is unknown, not a projected one, or an axis (also the heights') is not in metres.
    """
    crs = parse_crs(text)
    units = {axis.unit_name for axis in crs.axis_info}
    if crs.is_geographic or crs.is_geocentric or not units <= {"metre", "meter", "m"}:
        raise CrsError(
            f"Expected a projected CRS in metres, got {crs.name} in"
            f" {', '.join(sorted(units)) or 'unknown units'}."
            " Reproject the points first, to the UTM zone for example: `map build --to-crs`."
        )
    wkt: str = crs.to_wkt()
    return wkt


def same_crs(one: str, other: str) -> bool:
    """Whether two CRS, as WKT, mean the same, whatever the order of their axes."""
    return one == other or bool(parse_crs(one).equals(parse_crs(other), ignore_axis_order=True))


def crs_name(wkt: str | None) -> str:
    """Return "ETRS89 / UTM zone 32N (EPSG:25832)" or the like, "unknown" for None."""
    if wkt is None:
        return "unknown"
    crs = parse_crs(wkt)
    authority = crs.to_authority()
    return f"{crs.name} ({':'.join(authority)})" if authority else str(crs.name)


def to_wgs84(crs: str, places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return longitude and latitude, degrees of WGS 84, of places (x, y) in a projected CRS in metres.

    Raises
    ------
    CrsError
        If that is unknown or not one.
    """
    import pyproj

    horizontal = parse_crs(metric_crs(crs)).to_2d()
    transformer = pyproj.Transformer.from_crs(horizontal, "EPSG:4326", always_xy=True)
    x, y = zip(*places, strict=True) if places else ((), ())
    longitudes, latitudes = transformer.transform(x, y)
    return list(zip(longitudes, latitudes, strict=True))
