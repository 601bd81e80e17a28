# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PointTransform: points of one coordinate reference system in those of another, with what becomes of heights."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError
from maxcon.io.crs import crs_name, metric_crs, parse_crs, same_crs

__all__ = ["PointTransform"]

NEAREST, FARTHEST = 6_340_000.0, 6_470_000.0
"""Of surveys, from the middle of the earth, m: from under the sea at the poles to aircraft above the equator."""


MARKS = 21
"""Points on each side of a rectangle that are transformed to find one around it."""


class PointTransform:
    """Turns points of a source into coordinates of a projected CRS in metres.

    Heights are converted with their reference where both CRS say what it is, and from geocentric coordinates into
    ellipsoidal ones. Otherwise they keep their reference, and only their unit becomes the metre: that of the heights,
    or where a projected CRS has none, that of its plane.

    Parameters
    ----------
    source : str
        CRS of the points, WKT or a code.
    target : str
        CRS to turn them into, likewise.

    Raises
    ------
    CrsError
        If one is unknown, the target is not in metres, there is no way between them, or the target says what heights
        are and the source does not.
    """

    def __init__(self, source: str, target: str) -> None:
        self._source, self._target = parse_crs(source), parse_crs(metric_crs(target))
        self._has_heights = self._source.is_geocentric or len(self._target.axis_info) > 2
        self._transformer, self._height_unit = self._with_heights() if self._has_heights else self._in_plane()

    @property
    def height_reference(self) -> str:
        """What heights of the source are counted from; empty where it does not say."""
        crs = self._source
        if crs.is_compound:
            return str(crs.sub_crs_list[-1].name)
        return "the ellipsoid" if len(crs.axis_info) > 2 else ""

    @property
    def words(self) -> str:
        """From which CRS, how exactly, and what became of heights."""
        accuracy = "" if self._transformer is None else _accuracy(self._transformer)
        unit = "" if self._height_unit == 1.0 else f", heights times {self._height_unit:.10g}"
        return f"from {crs_name(self._source.to_wkt())}{accuracy}{unit}"

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points in the target, shape (n, 3), m; not finite where it does not reach.

        Raises
        ------
        CrsError
            If points said to be geocentric are nowhere near the surface of the earth.
        """
        x, y, z = points.T
        if self._source.is_geocentric:
            _check_geocentric(points)
        if self._has_heights:
            return np.stack(self._transformer.transform(x, y, z), axis=1)
        if self._transformer is not None:
            x, y = self._transformer.transform(x, y)
        return np.stack([x, y, z * self._height_unit], axis=1)

    def bounds_in_source(self, bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float] | None:
        """A rectangle of the source that holds one of the target; None where heights or the earth's middle take part.

        Parameters
        ----------
        bounds : tuple of float
            x_min, y_min, x_max, y_max in the target, m.
        """
        if self._has_heights:
            return None
        if self._transformer is None:
            return bounds
        found = self._transformer.transform_bounds(*bounds, densify_pts=MARKS, direction="INVERSE")
        if not np.isfinite(found).all():
            return None
        x_min, y_min, x_max, y_max = map(float, found)
        # Between marks the sides bend by far less than this.
        x_slack, y_slack = (x_max - x_min) / MARKS, (y_max - y_min) / MARKS
        return x_min - x_slack, y_min - y_slack, x_max + x_slack, y_max + y_slack

    def _with_heights(self) -> tuple[Any, float]:
        target = self._target
        if len(target.axis_info) < 3:
            target = target.to_3d()
        elif len(self._source.axis_info) < 3:
            raise CrsError(
                f"Expected points whose CRS says what heights are, to turn them into {target.name}, got"
                f" {self._source.name}. Name a CRS without heights: they stay what they are."
            )
        return self._found(self._source, target, only_best=True), 1.0

    def _in_plane(self) -> tuple[Any, float]:
        crs = self._source
        axes = crs.axis_info
        plane = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()
        if len(axes) > 2:
            unit = float(axes[2].unit_conversion_factor)
        else:
            unit = 1.0 if crs.is_geographic or not axes else float(axes[0].unit_conversion_factor)
        if same_crs(plane.to_wkt(), self._target.to_wkt()):
            return None, unit
        return self._found(plane, self._target), unit

    def _found(self, source: Any, target: Any, *, only_best: bool = False) -> Any:
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        try:
            return Transformer.from_crs(source, target, always_xy=True, allow_ballpark=False, only_best=only_best)
        except ProjError as error:
            raise CrsError(
                f"Expected a way from {source.name} to {target.name}, got: {str(error).splitlines()[0][:100]}. Choose"
                " another CRS, or transform the points first."
            ) from error


def _check_geocentric(points: NDArray[np.float64]) -> None:
    finite = points[np.isfinite(points).all(axis=1)]
    if len(finite) and not NEAREST < float(np.median(np.linalg.norm(finite, axis=1))) < FARTHEST:
        x, y, z = finite[0].tolist()
        raise CrsError(
            f"Expected geocentric coordinates, some 6,370 km from the middle of the earth, as the CRS of the points"
            f" says, got {x:.1f}, {y:.1f}, {z:.1f}. They are of another CRS: assign it anew with the program they"
            " come from."
        )


def _accuracy(transformer: Any) -> str:
    """How exact a transformation is said to be; nothing where that is not known."""
    accuracy = float(transformer.accuracy)
    return f", exact to {accuracy:g} m" if accuracy > 0.0 else ""
