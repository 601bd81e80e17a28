"""Coordinate reference systems (D1): names, points of one in another with their heights, and what receivers say."""

import math
import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError

NEAREST, FARTHEST = 6_340_000.0, 6_470_000.0  # of surveys from the middle of the earth, m: undersea to aircraft
MARKS = 21  # points on each side of a rectangle that are transformed to find one around it
LARGEST_INEXACTNESS = 0.05  # m: a transformation that is less exact is worth a warning
MOVING = ("helmert", "molodensky", "molobadekas", "shift", "deformation")  # in the names of PROJ's steps
GEOGRAPHIC, GEOGRAPHIC_3D = "EPSG:4326", "EPSG:4979"
NORTHWARDS = 1e-4  # degrees, some 11 m: over such a way the direction of north on the grid is found
EASTWARDS = np.array([5.0, 0.0, 0.0])  # m to both sides, likewise for the direction of one grid's x axis on another


class FileCrs(NamedTuple):
    """The CRS that a file names, as WKT; None, and in words what the file has instead, if it cannot be used."""

    crs: str | None = None
    crs_fault: str = ""


def read_file_crs(content: str | bytes | int) -> FileCrs:
    """Return the CRS of WKT, or of an EPSG code, in a file; empty text names none."""
    import pyproj

    name = f"EPSG:{content}" if isinstance(content, int) else "a WKT that it does not"
    try:
        if isinstance(content, int):
            return FileCrs(pyproj.CRS.from_epsg(content).to_wkt())
        text = content.rstrip(b"\0").decode("utf-8") if isinstance(content, bytes) else content
        return FileCrs(pyproj.CRS.from_wkt(text).to_wkt()) if text else FileCrs()
    except (UnicodeDecodeError, pyproj.exceptions.CRSError) as error:
        return FileCrs(None, f"{name}: {_first_line(error)}")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


@lru_cache(maxsize=32)
def parse_crs(text: str) -> Any:
    """Return the pyproj.CRS of a code or WKT; CrsError if it is unknown."""
    import pyproj

    try:
        return pyproj.CRS.from_user_input(text)
    except pyproj.exceptions.CRSError as error:
        words = f"Expected a coordinate reference system such as EPSG:25832, or WKT, got {text[:80]!r}:"
        raise CrsError(f"{words} {_first_line(error)}.") from None


def metric_crs(text: str) -> str:
    """Return the WKT of a projected (or local) CRS in metres, given as code or WKT; CrsError if it is another."""
    crs = parse_crs(text)
    units = {axis.unit_name for axis in crs.axis_info}
    if crs.is_geographic or crs.is_geocentric or not units <= {"metre", "meter", "m"}:
        raise CrsError(
            f"Expected a projected CRS in metres, got {crs.name} in {', '.join(sorted(units)) or 'unknown units'}."
            " Reproject the points first, to the UTM zone for example: `map build --to-crs`."
        )
    return str(crs.to_wkt())


def plane_of(crs: Any) -> Any:
    """Return a pyproj.CRS without its heights."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


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


@cache
def crs_code(wkt: str | None) -> str:
    """Return "EPSG:25832" or the like, the name where it has no code, and nothing for None."""
    crs = parse_crs(wkt) if wkt is not None else None
    return "" if crs is None else ":".join(crs.to_authority() or (crs.name,))


def to_wgs84(crs: str, places: Sequence[tuple[float, float]]) -> list[list[float]]:
    """Return longitude and latitude, degrees of WGS 84, of places (x, y) in a projected CRS in metres."""
    from pyproj import Transformer

    transformer = Transformer.from_crs(parse_crs(metric_crs(crs)).to_2d(), GEOGRAPHIC, always_xy=True)
    found: list[list[float]] = np.stack(transformer.transform(*np.reshape(places, (-1, 2)).T), axis=1).tolist()
    return found


def beyond_area_of_use(crs: str | None, x: float, y: float) -> str:
    """A warning that a place is not where a projected CRS is meant for; nothing if that is not known."""
    if crs is None or not parse_crs(crs).is_projected:
        return ""
    if GeographicFrame(crs).contains(np.array(to_wgs84(crs, [(x, y)]))[:, ::-1])[0]:
        return ""
    return f"warning: x {x:.0f}, y {y:.0f} is outside of its area of use. Are coordinates local, or of another zone?"


class Operation(NamedTuple):
    """By which of its operations PROJ turned coordinates, and how exactly."""

    name: str  # PROJ's
    accuracy: float  # m; -1 if PROJ knows none, which `% math.inf` makes the worst of all
    moves: bool  # whether places move, or are only written otherwise
    grids: str = ""  # the files that are missing for the most exact operation there

    @classmethod
    def last_used(cls, transformer: Any, source: Any, target: Any, place: Sequence[float]) -> "Operation":
        """Return that of the last call: PROJ chose it by the place, in the source, and knows it in this thread."""
        from pyproj import Transformer
        from pyproj.aoi import AreaOfInterest
        from pyproj.exceptions import ProjError
        from pyproj.transformer import TransformerGroup

        with suppress(ProjError):  # of several none was called, as nothing is to be done
            transformer = transformer.get_last_used_operation()
        moves = any(word in transformer.definition for word in MOVING)
        used = cls(str(transformer.description), float(transformer.accuracy), moves)
        if used.is_exact:
            return used
        x, y, z = [*place, 0.0][:3]
        east, north, _ = Transformer.from_crs(source, GEOGRAPHIC_3D, always_xy=True).transform(x, y, z)
        area: Any = AreaOfInterest(east, north, east, north)
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # that grids are missing
            group = TransformerGroup(source, target, always_xy=True, area_of_interest=area)
        better = [each for each in group.unavailable_operations if 0.0 <= each.accuracy < used.accuracy % math.inf]
        grids = min(better, key=lambda each: each.accuracy).grids if better else ()
        return used._replace(grids=", ".join(grid.short_name for grid in grids if not grid.available))

    @property
    def is_exact(self) -> bool:
        """Whether nobody has to be warned."""
        return 0.0 <= self.accuracy <= LARGEST_INEXACTNESS

    @property
    def shift_sigma(self) -> float:
        """How far places may be off, m, as they moved into another datum; PROJ's metre of WGS 84 does not count."""
        return 0.0 if self.is_exact or not self.moves else max(self.accuracy, 0.0)

    @property
    def words(self) -> str:
        """Its name, its accuracy, and what would be more exact."""
        exact = f"exact to {self.accuracy:g} m" if self.accuracy > 0.0 else "exactly"
        exact = exact if self.accuracy >= 0.0 else "of unknown accuracy"
        grid = f" (more exact with {self.grids}: `pyproj sync --file {self.grids}`)" if self.grids else ""
        return f"by {self.name}, {exact}{grid}"

    def describe(self) -> dict[str, object]:
        """Return its entry in the manifest of a map."""
        return {"name": self.name, "accuracy": self.accuracy}

    def check(self, cell: float, what: str) -> None:
        """Refuse it for a map of voxels of this edge, m, unless it is at least as exact as they are: CrsError."""
        if not self.is_exact and not 0.0 <= self.accuracy <= cell:
            remedy = "Get the grid" if self.grids else "Choose a CRS of the same datum"
            raise CrsError(
                f"Expected a transformation of {what} exact to a voxel of the map, at most {cell:g} m, got one"
                f" {self.words}. {remedy}, or take it as it is: --allow-inexact-crs."
            )


class _Between:
    """From one CRS into another: `operation` is the least exact that PROJ has taken so far; None before the first."""

    asks_once = False  # whether the first one counts

    def __init__(self, source: Any, target: Any) -> None:
        self._ends = source, target
        self.operation: Operation | None = None

    def _turned(self, transformer: Any, *columns: NDArray[np.float64], inverse: bool = False) -> NDArray[np.float64]:
        """Coordinates in the target, of columns in the source, or the other way round; shape (n, k)."""
        found = np.stack(transformer.transform(*columns, direction="INVERSE" if inverse else "FORWARD"), axis=1)
        rows = np.flatnonzero(np.isfinite(found).all(axis=1))
        if len(rows) and not (self.asks_once and self.operation):
            place = [float(column[rows[-1]]) for column in (found.T if inverse else columns)]
            used = Operation.last_used(transformer, *self._ends, place)
            self.operation = max(used, self.operation or used, key=lambda each: each.accuracy % math.inf)
        return found


class PointTransform(_Between):
    """Turns points of a source into coordinates of a projected CRS in metres, both given as WKT or codes.

    Heights are converted where both CRS say what they are counted from; else only their unit becomes the metre.
    """

    def __init__(self, source: str, target: str) -> None:
        self._source, self._target = parse_crs(source), parse_crs(metric_crs(target))
        self.has_heights = self._source.is_geocentric or len(self._target.axis_info) > 2
        self._transformer, self._height_unit = self._with_heights() if self.has_heights else self._in_plane()
        ends = self._source, self._target
        super().__init__(*(ends if self.has_heights else (crs.to_2d() for crs in ends)))

    @property
    def height_reference(self) -> str:
        """What heights of the source are counted from; empty where it does not say."""
        crs = self._source
        if crs.is_compound:
            return str(crs.sub_crs_list[-1].name)
        return "the ellipsoid" if len(crs.axis_info) > 2 else ""

    @property
    def words(self) -> str:
        """From which CRS, by which operation and how exactly, and what became of heights."""
        exact = "" if self.operation is None else f" {self.operation.words}"
        unit = "" if self._height_unit == 1.0 else f", heights times {self._height_unit:.10g}"
        return f"from {crs_name(self._source.to_wkt())}{exact}{unit}"

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points in the target, shape (n, 3), m; not finite where it does not reach."""
        x, y, z = points.T
        if self._source.is_geocentric:
            _check_geocentric(points)
        if self.has_heights:
            return self._turned(self._transformer, x, y, z)
        plane = points[:, :2] if self._transformer is None else self._turned(self._transformer, x, y)
        return np.column_stack([plane, z * self._height_unit])

    def turns(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far headings of a grid are turned in the target, shape (n,), rad, at points (n, 3) of it."""
        with np.errstate(invalid="ignore"):  # of infinities
            east, north, _ = (self.apply(points + EASTWARDS) - self.apply(points - EASTWARDS)).T
        return np.asarray(np.arctan2(north, east), dtype=np.float64)

    def bounds_in_source(self, bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float] | None:
        """Return a rectangle (x_min, y_min, x_max, y_max) of the source around one of the target, if in plane."""
        if self.has_heights:
            return None
        if self._transformer is None:
            return bounds
        found = np.array(self._transformer.transform_bounds(*bounds, densify_pts=MARKS, direction="INVERSE"))
        # Between marks the sides bend by far less than this.
        slack = np.tile((found[2:] - found[:2]) / MARKS, 2) * [-1.0, -1.0, 1.0, 1.0]
        x_min, y_min, x_max, y_max = (found + slack).tolist()
        return (x_min, y_min, x_max, y_max) if np.isfinite(found).all() else None

    def _with_heights(self) -> tuple[Any, float]:
        target = self._target
        if len(target.axis_info) < 3:
            target = target.to_3d()
        elif len(self._source.axis_info) < 3:
            raise CrsError(
                f"Expected points whose CRS says what heights are, to turn them into {target.name}, got"
                f" {self._source.name}. Name a CRS without heights: they stay what they are."
            )
        return _transformer(self._source, target, only_best=True), 1.0

    def _in_plane(self) -> tuple[Any, float]:
        crs = self._source
        axes = crs.axis_info
        plane = plane_of(crs)
        if len(axes) > 2:
            unit = float(axes[2].unit_conversion_factor)
        else:
            unit = 1.0 if crs.is_geographic or not axes else float(axes[0].unit_conversion_factor)
        if same_crs(plane.to_wkt(), self._target.to_wkt()):
            return None, unit
        return _transformer(plane, self._target), unit


def _transformer(source: Any, target: Any, *, only_best: bool = False) -> Any:
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        return Transformer.from_crs(source, target, always_xy=True, allow_ballpark=False, only_best=only_best)
    except ProjError as error:
        raise CrsError(
            f"Expected a way from {source.name} to {target.name}, got: {_first_line(error)}. Choose another CRS, or"
            " transform the points first."
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


class GeographicFrame(_Between):
    """What a GNSS receiver says, in the coordinates of a map whose CRS is given as WKT or a code."""

    asks_once = True  # positions come one by one

    def __init__(self, crs: str) -> None:
        self._crs = parse_crs(crs)
        super().__init__(parse_crs(GEOGRAPHIC), self._crs.to_2d())
        self.has_heights = len(self._crs.axis_info) > 2  # else ellipsoidal heights are taken as they are
        self.has_ellipsoidal_heights = self.has_heights and not self._crs.is_compound

    def contains(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether (latitude, longitude) lie within about 1 degree of where the map's CRS says it is meant for."""
        area = self._crs.area_of_use
        if area is None and (code := self._crs.to_authority()) is not None:
            area = parse_crs(":".join(code)).area_of_use
        if area is None or area.west > area.east:
            return np.ones(len(places), dtype=bool)
        low, high = [area.south - 1.0, area.west - 1.0], [area.north + 1.0, area.east + 1.0]
        return np.asarray(((places[:, :2] >= low) & (places[:, :2] <= high)).all(axis=1))

    @property
    def shift_sigma(self) -> float:
        """As of its operation, m."""
        return 0.0 if self.operation is None else self.operation.shift_sigma

    def to_map(self, places: NDArray[np.float64], geoid_height: float | None = None) -> NDArray[np.float64]:
        """Return x, y, z in the map's CRS, m, of latitude, longitude (degrees), height less that of the geoid."""
        latitude, longitude, height = places.T
        if self.has_heights and geoid_height is None:
            return self._turned(self._transformer, longitude, latitude, height)
        plane = self._turned(self._plane, longitude, latitude)
        return np.column_stack([plane, height - (geoid_height or 0.0)])

    def to_geographic(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return latitude, longitude (degrees) and height (m), shape (n, 3), of coordinates in the map's CRS."""
        x, y, z = positions.T
        if self.has_heights:
            return self._turned(self._transformer, x, y, z, inverse=True)[:, [1, 0, 2]]
        return np.column_stack([self._turned(self._plane, x, y, inverse=True)[:, ::-1], z])

    def convergence(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far true north is turned from the grid's, shape (n,), rad, counter-clockwise."""
        latitude, longitude = places[:, 0], places[:, 1]
        x, y = self._plane.transform(longitude, latitude)
        further_x, further_y = self._plane.transform(longitude, latitude + NORTHWARDS)
        return np.asarray(np.arctan2(np.subtract(further_y, y), np.subtract(further_x, x)) - math.pi / 2.0, np.float64)

    def quaternions_to_map(
        self, places: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64], *, inverse: bool = False
    ) -> NDArray[np.float64]:
        """Return orientations towards the axes of the map, (n, 4), of those towards true east, north, up."""
        from scipy.spatial.transform import Rotation

        angles = self.convergence(places)[:, None] * (-1.0 if inverse else 1.0)
        turned = Rotation.from_euler("z", angles) * Rotation.from_quat(quaternions_xyzw)
        return np.asarray(turned.as_quat(), dtype=np.float64)

    @cached_property
    def _plane(self) -> Any:
        from pyproj import Transformer

        return Transformer.from_crs(GEOGRAPHIC, plane_of(self._crs), always_xy=True)

    @cached_property
    def _transformer(self) -> Any:
        """From latitude, longitude and ellipsoidal height into the map's CRS, which has heights."""
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
            why = _first_line(error)
        raise CrsError(
            f"Expected to be able to turn ellipsoidal heights into those of {self._crs.name}, got: {why}. Say how high"
            " the geoid is there: --geoid-height."
        )
