# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""GeographicFrame: latitude, longitude and ellipsoidal height, true east and north, beside the CRS of a map."""

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError
from maxcon.io.crs import parse_crs

__all__ = ["GeographicFrame"]

GEOGRAPHIC, GEOGRAPHIC_3D = "EPSG:4326", "EPSG:4979"
NORTHWARDS = 1e-4
"""Degrees, some 11 m: over such a way the direction of north on the grid is found."""


class GeographicFrame:
    """What a GNSS receiver says, in the coordinates of a map whose CRS is given as WKT or a code.

    CrsError if that is unknown.
    """

    def __init__(self, crs: str) -> None:
        self._crs = parse_crs(crs)

    def contains(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether places (latitude, longitude) lie where the map's CRS is meant for, about 1 degree around included.

        All do where it does not say.
        """
        area = self._crs.area_of_use
        if area is None and (code := self._crs.to_authority()) is not None:
            area = parse_crs(":".join(code)).area_of_use
        if area is None or area.west > area.east:
            return np.ones(len(places), dtype=bool)
        north, east = places[:, 0], places[:, 1]
        is_inside = (north >= area.south - 1.0) & (north <= area.north + 1.0)
        return np.asarray(is_inside & (east >= area.west - 1.0) & (east <= area.east + 1.0))

    @property
    def has_heights(self) -> bool:
        """Whether the map's CRS says what its heights are; if not, ellipsoidal ones are taken as they are."""
        return len(self._crs.axis_info) > 2

    @property
    def has_ellipsoidal_heights(self) -> bool:
        """Whether the map's CRS says that its heights are above the ellipsoid."""
        return self.has_heights and not self._crs.is_compound

    def to_map(self, places: NDArray[np.float64], geoid_height: float | None = None) -> NDArray[np.float64]:
        """Return coordinates in the map's CRS, shape (n, 3), m.

        Parameters
        ----------
        places : array, shape (n, 3)
            Latitude, longitude (degrees), ellipsoidal height (m).
        geoid_height : float, optional
            Of the geoid above the ellipsoid there, m: it is subtracted from the heights, whatever the CRS says.

        Raises
        ------
        CrsError
            If the map's CRS has heights of its own, but not the grid to find them, and no `geoid_height` is given.
        """
        latitude, longitude, height = places.T
        if self.has_heights and geoid_height is None:
            return np.stack(self._transformer.transform(longitude, latitude, height), axis=1)
        x, y = self._plane.transform(longitude, latitude)
        return np.stack([x, y, height - (geoid_height or 0.0)], axis=1)

    def to_geographic(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return latitude, longitude (degrees) and height (m), shape (n, 3), of coordinates in the map's CRS."""
        x, y, z = positions.T
        if self.has_heights:
            longitude, latitude, z = self._transformer.transform(x, y, z, direction="INVERSE")
        else:
            longitude, latitude = self._plane.transform(x, y, direction="INVERSE")
        return np.stack([latitude, longitude, z], axis=1)

    def convergence(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far true north is turned from the grid's, shape (n,), rad, counter-clockwise."""
        latitude, longitude = places[:, 0], places[:, 1]
        x, y = self._plane.transform(longitude, latitude)
        further_x, further_y = self._plane.transform(longitude, latitude + NORTHWARDS)
        return np.asarray(np.arctan2(np.subtract(further_y, y), np.subtract(further_x, x)) - math.pi / 2.0, np.float64)

    def quaternions_to_map(
        self, places: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return orientations towards the axes of the map, shape (n, 4), of those towards true east, north and up."""
        return _turned_about_up(self.convergence(places), quaternions_xyzw)

    def quaternions_to_enu(
        self, places: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return orientations towards true east, north and up, shape (n, 4), of those towards the axes of the map."""
        return _turned_about_up(-self.convergence(places), quaternions_xyzw)

    @cached_property
    def _plane(self) -> Any:
        from pyproj import Transformer

        plane = self._crs.sub_crs_list[0] if self._crs.is_compound else self._crs
        return Transformer.from_crs(GEOGRAPHIC, plane, always_xy=True)

    @cached_property
    def _transformer(self) -> Any:
        """Of a map whose CRS has heights."""
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        why = "no value"
        try:
            found = Transformer.from_crs(GEOGRAPHIC_3D, self._crs, always_xy=True, allow_ballpark=False, only_best=True)
            # A missing grid of the geoid is noticed when it is asked.
            area = self._crs.area_of_use
            place = (0.0, 0.0) if area is None else ((area.west + area.east) / 2, (area.south + area.north) / 2)
            if np.isfinite(found.transform(place[0], place[1], 0.0, errcheck=True)).all():
                return found
        except ProjError as error:
            why = str(error).splitlines()[0][:100]
        raise CrsError(
            f"Expected to be able to turn ellipsoidal heights into those of {self._crs.name}, got: {why}. Say how high"
            " the geoid is there: --geoid-height."
        )


def _turned_about_up(angles: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("z", angles[:, None]) * Rotation.from_quat(quaternions_xyzw)
    return np.asarray(turned.as_quat(), dtype=np.float64)
