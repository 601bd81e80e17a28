# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""KML: the localized epochs as places on the ground, with the way between them."""

import os
from collections.abc import Sequence
from xml.etree import ElementTree

from maxcon._system.atomic import atomic_file
from maxcon.export.rows import PoseRow, bearing_deg
from maxcon.io.crs import to_wgs84

__all__ = ["write_kml"]

ON_THE_GROUND = "clampToGround"
NAMESPACE = "http://www.opengis.net/kml/2.2"


def write_kml(path: str | os.PathLike[str], rows: Sequence[PoseRow], crs: str) -> None:
    """Write the way as a line and each localized epoch as a point with its heading.

    Heights are those of the map, and viewers are told to draw on the ground: KML counts heights from the sea, and a
    map's CRS mostly does not say what its are counted from.
    """
    root = ElementTree.Element("kml", xmlns=NAMESPACE)
    document = ElementTree.SubElement(root, "Document")
    ElementTree.SubElement(document, "name").text = "maxcon"
    found = [(row, row.pose) for row in rows if row.pose is not None]
    lonlat = to_wgs84(crs, [(pose.x, pose.y) for _, pose in found])
    places = [f"{x:.9f},{y:.9f},{pose.z:.3f}" for (x, y), (_, pose) in zip(lonlat, found, strict=True)]
    way = ElementTree.SubElement(document, "Placemark")
    ElementTree.SubElement(way, "name").text = "way"
    line = ElementTree.SubElement(way, "LineString")
    ElementTree.SubElement(line, "tessellate").text = "1"
    ElementTree.SubElement(line, "altitudeMode").text = ON_THE_GROUND
    ElementTree.SubElement(line, "coordinates").text = " ".join(places)
    for (row, pose), place in zip(found, places, strict=True):
        mark = ElementTree.SubElement(document, "Placemark")
        ElementTree.SubElement(mark, "name").text = f"{row.time:.3f}"
        words = f"{row.status}, bearing {bearing_deg(pose):.2f} degrees. {row.reason}".strip()
        ElementTree.SubElement(mark, "description").text = words
        point = ElementTree.SubElement(mark, "Point")
        ElementTree.SubElement(point, "altitudeMode").text = ON_THE_GROUND
        ElementTree.SubElement(point, "coordinates").text = place
    with atomic_file(path) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
