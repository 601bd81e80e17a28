# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""KML: the localized epochs as places on the ground, with the way between them."""

import os
from collections.abc import Sequence
from xml.etree import ElementTree

from maxcon.atomic import atomic_file
from maxcon.export.rows import PoseRow, bearing_deg
from maxcon.io.crs import to_wgs84

__all__ = ["write_kml"]

NAMESPACE = "http://www.opengis.net/kml/2.2"


def write_kml(path: str | os.PathLike[str], rows: Sequence[PoseRow], crs: str) -> None:
    """Write the way as a line and each localized epoch as a point with its heading, on the ground.

    Heights are left out: KML wants them above the sea, and a map's CRS mostly does not say what its are above.
    """
    root = ElementTree.Element("kml", xmlns=NAMESPACE)
    document = ElementTree.SubElement(root, "Document")
    ElementTree.SubElement(document, "name").text = "maxcon"
    found = [(row, row.pose) for row in rows if row.pose is not None]
    places = [f"{x:.9f},{y:.9f}" for x, y in to_wgs84(crs, [(pose.x, pose.y) for _, pose in found])]
    way = ElementTree.SubElement(document, "Placemark")
    ElementTree.SubElement(way, "name").text = "way"
    line = ElementTree.SubElement(way, "LineString")
    ElementTree.SubElement(line, "tessellate").text = "1"
    ElementTree.SubElement(line, "coordinates").text = " ".join(places)
    for (row, pose), place in zip(found, places, strict=True):
        mark = ElementTree.SubElement(document, "Placemark")
        ElementTree.SubElement(mark, "name").text = f"{row.time:.3f}"
        words = f"{row.status}, bearing {bearing_deg(pose):.2f} degrees. {row.reason}".strip()
        ElementTree.SubElement(mark, "description").text = words
        ElementTree.SubElement(ElementTree.SubElement(mark, "Point"), "coordinates").text = place
    with atomic_file(path) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
