# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""GeoJSON (RFC 7946): longitude and latitude of WGS 84, a feature per epoch."""

import json
import os
from collections.abc import Sequence

from maxcon._system.atomic import atomic_file
from maxcon.export.rows import PoseRow, properties
from maxcon.io.crs import to_wgs84

__all__ = ["write_geojson"]


def write_geojson(path: str | os.PathLike[str], rows: Sequence[PoseRow], crs: str) -> None:
    """Write a feature per epoch: a point where it is localized, else no geometry; status, covariance and reason.

    Position and covariance in the CRS of the map stand among the properties, as does the CRS. The height of a point is
    that of the map, m, whatever it is counted from.
    """
    features = []
    places = iter(to_wgs84(crs, [(row.pose.x, row.pose.y) for row in rows if row.pose is not None]))
    for row in rows:
        geometry, place = None, dict.fromkeys("xyz")
        if row.pose is not None:
            lonlat = [round(degrees, 9) for degrees in next(places)]
            geometry = {"type": "Point", "coordinates": [*lonlat, round(row.pose.z, 4)]}
            place = dict(zip("xyz", row.pose.position, strict=True))
        features.append({"type": "Feature", "geometry": geometry, "properties": {**place, **properties(row)}})
    content = {"type": "FeatureCollection", "crs_of_xyz": crs, "features": features}
    with atomic_file(path) as partial:
        partial.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
