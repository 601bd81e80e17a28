# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Priors in latitude, longitude and height, from tables and logs of receivers, in the coordinates of a map."""

from dataclasses import dataclass
from pathlib import Path

from maxcon.errors import CrsError
from maxcon.io.fixes import PlacedFixes, place_fixes
from maxcon.io.geographic import GeographicFrame
from maxcon.io.geographic_csv import has_geographic_header, read_geographic_csv
from maxcon.io.nmea import is_nmea, read_nmea

__all__ = ["GeographicPrior", "is_geographic", "read_geographic_prior"]


@dataclass(frozen=True, slots=True, eq=False)
class GeographicPrior:
    """Rough poses from positions in latitude, longitude and height.

    Parameters
    ----------
    placed : PlacedFixes
        In the coordinates of the map.
    words : str
        Where they come from, what headings and heights are, in a line.
    left_out : tuple of str
        What is wrong with rows that are no positions.
    """

    placed: PlacedFixes
    words: str
    left_out: tuple[str, ...] = ()


def is_geographic(path: Path) -> bool:
    """Whether a prior is a log of NMEA sentences, or a table with a column latitude."""
    return is_nmea(path) or (path.suffix.lower() == ".csv" and has_geographic_header(path))


def read_geographic_prior(
    path: Path, crs: str | None, geoid_height: float | None = None, *, are_sure: bool = False
) -> GeographicPrior:
    """Return the poses in a log of NMEA sentences, or in a table with a column latitude.

    Parameters
    ----------
    path : Path
        The file: see `read_nmea`, `read_geographic_csv`.
    crs : str or None
        Of the map, WKT or a code.
    geoid_height : float, optional
        Of the geoid above the ellipsoid, m: subtracted from ellipsoidal heights.
    are_sure : bool
        Whether headings are believed even if they are nothing like the course over ground.

    Raises
    ------
    FileError, TrajectoryError
        If the file cannot be read, or its positions cannot be used.
    CrsError
        If the map has no CRS, or heights cannot be turned into its.
    OptionError
        If `geoid_height` is given with heights above the geoid.
    """
    if crs is None:
        raise CrsError(
            f"Expected a map with a CRS, to place {path}, which is in latitude and longitude; got one without. Build"
            " it with --crs."
        )
    frame = GeographicFrame(crs)
    if is_nmea(path):
        log = read_nmea(path)
        placed = place_fixes(log.fixes, log.orientations, frame, geoid_height, str(path), are_sure=are_sure)
        return GeographicPrior(placed, f"positions from {path.name} (NMEA); {log.words}; {placed.words}")
    rows = read_geographic_csv(path)
    placed = place_fixes(rows.fixes, rows.orientations, frame, geoid_height, str(path), are_sure=are_sure)
    return GeographicPrior(placed, f"positions from {path.name}; {placed.words}", rows.left_out)
