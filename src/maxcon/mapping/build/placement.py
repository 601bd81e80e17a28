# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where the points of a source are in the coordinates of the map, and which of them are asked for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, OptionError
from maxcon.io.clouds import Bounds, CloudHeader
from maxcon.io.crs import metric_crs
from maxcon.io.crs import PointTransform

__all__ = ["Area", "Placement", "placements"]


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of a map, in the coordinates of its CRS.

    Parameters
    ----------
    x_min, y_min, x_max, y_max : float
        Its sides, m.

    Raises
    ------
    OptionError
        If it is none.
    """

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    def __post_init__(self) -> None:
        sides = (self.x_min, self.y_min, self.x_max, self.y_max)
        if not all(map(math.isfinite, sides)) or not (self.x_min < self.x_max and self.y_min < self.y_max):
            raise OptionError(
                f"Expected an area x_min,y_min,x_max,y_max, the smaller numbers first, got"
                f" {','.join(f'{side:.12g}' for side in sides)}. Give it in the coordinates of the map."
            )

    @classmethod
    def parse(cls, text: str) -> "Area":
        """Return the area of four numbers apart by commas.

        Raises
        ------
        OptionError
            If they are none.
        """
        try:
            x_min, y_min, x_max, y_max = map(float, text.split(","))
        except ValueError:
            raise OptionError(
                f"Expected an area as x_min,y_min,x_max,y_max, four numbers, got {text!r:.80}. Give it in the"
                " coordinates of the map."
            ) from None
        return cls(x_min, y_min, x_max, y_max)

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points, shape (n, 3), lie in it, its lower sides included."""
        x, y = points[:, 0], points[:, 1]
        inside: NDArray[np.bool_] = (
            (x >= self.x_min) & (x < self.x_max) & (y >= self.y_min) & (y < self.y_max)
        )
        return inside


@dataclass(frozen=True, slots=True)
class Placement:
    """Where the points of a source are in the map.

    Parameters
    ----------
    transform : PointTransform or None
        Into the CRS of the map; None: they are there.
    area : Area or None
        Only points in it are wanted; None: all.
    """

    transform: PointTransform | None = None
    area: Area | None = None

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points, shape (n, 3), in the coordinates of the map."""
        return points if self.transform is None else self.transform.apply(points)

    @property
    def bounds_in_source(self) -> Bounds | None:
        """Where the points that are wanted lie in the coordinates of the source; None: perhaps anywhere."""
        if self.area is None:
            return None
        sides = (self.area.x_min, self.area.y_min, self.area.x_max, self.area.y_max)
        found = sides if self.transform is None else self.transform.bounds_in_source(sides)
        return None if found is None else Bounds(*found)


def placements(
    headers: Sequence[CloudHeader], crs: str | None, to_crs: str, area: Area | None
) -> tuple[str, list[Placement]]:
    """Return the CRS of a map as WKT, and where the points of each source are in it.

    Parameters
    ----------
    headers : sequence of CloudHeader
        The sources.
    crs : str or None
        The CRS of sources that name none.
    to_crs : str
        That of the map.
    area : Area or None
        In the coordinates of the map.

    Raises
    ------
    CrsError
        If a source names no CRS, or one that cannot be turned into that of the map, or heights would be mixed.
    """
    target = metric_crs(to_crs)
    transforms = []
    for header in headers:
        own = header.crs or crs
        if own is None:
            got = header.crs_fault or "none"
            raise CrsError(
                f"Expected a coordinate reference system in {header.path}, to turn its points into {to_crs}, got"
                f" {got}. Say which it is with --crs."
            )
        transforms.append(PointTransform(own, target))
    references = {
        transform.height_reference: header for transform, header in zip(transforms, headers, strict=True)
    }
    if len(references) > 1:
        one, other = list(references.items())[:2]
        raise CrsError(
            f"Expected heights of one kind in all point clouds, got those of {one[0] or 'no stated reference'} in"
            f" {one[1].path} and of {other[0] or 'no stated reference'} in {other[1].path}. Make a map of each, or"
            " convert one."
        )
    return target, [Placement(transform, area) for transform in transforms]
