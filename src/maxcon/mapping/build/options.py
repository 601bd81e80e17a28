"""Options of a map build: voxels, area, coordinate reference system, and which classes of points are left out."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.map.layout import CELLS, check_sigma
from maxcon.scan.trajectory import Trajectory

# By ASPRS LAS 1.4 R15, table 17. There is no class for vehicles: 22 is for what changes between surveys, 64 and above
# are the user's own.
CLASS_NAMES: dict[str, tuple[int, ...]] = {
    "unclassified": (0, 1), "ground": (2, 11, 20), "low-vegetation": (3,), "medium-vegetation": (4,),
    "high-vegetation": (5,), "building": (6,), "noise": (7, 18), "water": (9,), "rail": (10,), "wire": (13, 14, 16),
    "tower": (15,), "bridge": (17,), "overhead": (19,), "snow": (21,), "temporal-exclusion": (22,),
    "vegetation": (3, 4, 5),
}  # fmt: skip
DEFAULT_DROP = ("ground", "vegetation", "noise", "temporal-exclusion")
# Of classes that a build finds itself: hedges stay, as they help to localize on real roads.
FOUND_DROP = ("ground", "temporal-exclusion")
FOUND = frozenset({2, 3, 4, 5, 22})  # classes that a build can find itself

# Vehicles drive on it: its heights are kept, whether its points are dropped or not.
GROUND = frozenset(CLASS_NAMES["ground"] + CLASS_NAMES["bridge"])
UNCLASSIFIED = frozenset(CLASS_NAMES["unclassified"])
NOISE = frozenset(CLASS_NAMES["noise"])

Classify = Literal["auto", "always", "off"]
LEAST_CELL = 0.06  # m; the paper's, and that of dense maps
LARGEST_CLASSIFIED_CELL = 0.25  # m: in larger voxels classes cannot be found from the shapes of surfaces


def class_name(number: int) -> str:
    """Return the name of a class number, "class 64" for one without a name."""
    return next((name for name, numbers in CLASS_NAMES.items() if number in numbers), f"class {number}")


def found_ratios(n_points: Mapping[str, int], dropped: Collection[int]) -> list[tuple[str, float]]:
    """Ratios of the points found to be ground, vegetation and temporary, and of those kept, from numbers by class."""
    numbers = {int(number): n for number, n in n_points.items()}
    groups = {name: CLASS_NAMES[name] for name in ("ground", "vegetation")}
    groups |= {"temporary": CLASS_NAMES["temporal-exclusion"], "kept": tuple(numbers.keys() - set(dropped))}
    total = max(1, sum(numbers.values()))
    return [(name, sum(numbers.get(n, 0) for n in group) / total) for name, group in groups.items()]


def parse_classes(names: Iterable[str], vehicle_classes: Iterable[int] = ()) -> frozenset[int]:
    """Return the numbers of classes, named or as text; "vehicle" stands for `vehicle_classes`; or OptionError."""
    vehicles = frozenset(vehicle_classes)
    known = CLASS_NAMES | {str(number): (number,) for number in range(256)}
    if vehicles:
        known |= dict.fromkeys(("vehicle", "vehicles"), tuple(vehicles))
    written = {name: name.strip().lower().replace("_", "-") for name in (*names, *map(str, vehicles))}
    keys = {name: key.lstrip("0") or key for name, key in written.items()}
    if unknown := [name for name, key in keys.items() if key not in known]:
        raise OptionError(
            f"Expected a class number from 0 to 255 or one of {', '.join(CLASS_NAMES)}, got {unknown[0]!r}."
            " For vehicles, say which number they have: --vehicle-class 64."
        )
    return frozenset(number for key in keys.values() for number in known[key])


@dataclass(frozen=True, slots=True)
class Area:
    """Rectangle of a map in the coordinates of its CRS, m; OptionError if its sides are not finite and in order."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, astuple(self))) or not (self.x_min < self.x_max and self.y_min < self.y_max):
            raise self._refused(",".join(f"{side:.12g}" for side in astuple(self)))

    @classmethod
    def parse(cls, text: str) -> "Area":
        """Return the area of four numbers separated by commas; OptionError if they are not."""
        try:
            x_min, y_min, x_max, y_max = map(float, text.split(","))
        except ValueError:
            raise cls._refused(f"{text!r:.80}") from None
        return cls(x_min, y_min, x_max, y_max)

    @staticmethod
    def _refused(got: str) -> OptionError:
        return OptionError(
            "Expected an area as four numbers x_min,y_min,x_max,y_max, the smaller ones first, got"
            f" {got}. Give it in the coordinates of the map."
        )

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points, shape (n, 3), lie in it, its lower sides included."""
        x, y = points[:, 0], points[:, 1]
        return np.asarray((x >= self.x_min) & (x < self.x_max) & (y >= self.y_min) & (y < self.y_max))


@dataclass(frozen=True, slots=True)
class MapOptions:
    """How a map is made of its points."""

    cell: float | None = None  # voxel edge, m; if None one that suits the spacing of the points
    # Classes to leave out, by name or number; `DEFAULT_DROP` and vehicles if None, and of these only the last where
    # classes are not the ASPRS's (not LAS).
    drop: Sequence[str] | None = None
    vehicle_classes: Iterable[int] = ()  # numbers of classes that mean vehicles; left out whatever `drop` names
    trajectory: Trajectory | None = None  # of the sensor, to turn normals to its side, matched by the points' times
    # Whether the sources' normals are turned to the sensor's side. They are used if their side is known, from this or
    # from the trajectory; otherwise planes are fitted.
    normals_have_sides: bool = False
    crs: str | None = None  # of sources that name none
    keep_every: int = 1  # only every n-th point of each source is taken: a thinner map to compare with
    sigma: float | None = None  # of the map's position along any axis, m; estimated from passes if None
    to_crs: str | None = None  # of the map and the trajectory; points are transformed into it. The sources' if None
    allow_inexact_crs: bool = False  # whether PROJ may transform them less exactly than to a voxel edge
    area: Area | None = None  # only points in it are taken
    classes_are_asprs: bool = False  # whether class numbers of clouds that are not LAS are those of the ASPRS, too
    # Whether ground, vegetation and temporary objects are found from the points: "auto" where no cloud has classes
    # (but 0, 1 or noise), "always" also where they have (of these only noise and vehicles count then), or "off".
    classify: Classify = "off"

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle_classes", tuple(self.vehicle_classes))
        if not CELLS[0] <= self.edge <= CELLS[1]:
            raise ArrayError(
                f"Expected a positive voxel edge, {CELLS[0]:g} to {CELLS[1]:g} m, got {self.cell}. Leave it out, and it"
                " is chosen by how far apart the points lie."
            )
        if self.keep_every < 1 or self.classify not in get_args(Classify):
            raise OptionError(
                "Expected to keep one point of 1 or more, and classify to be auto, always or off, got"
                f" {self.keep_every} and {self.classify!r}. Correct it."
            )
        if self.to_crs is not None and self.normals_have_sides:
            raise OptionError(
                "Expected the clouds' own normals in the CRS of the map, got points that are to be transformed. Leave"
                " out --signed-normals or --to-crs."
            )
        if self.classify == "always" and self.edge > LARGEST_CLASSIFIED_CELL:
            raise OptionError(
                f"Expected voxels of at most {LARGEST_CLASSIFIED_CELL:g} m to tell shapes by, got {self.edge:g} m."
                " Leave out --classify, or make the cell smaller (--cell)."
            )
        if self.sigma is not None:
            check_sigma(self.sigma)

    @property
    def edge(self) -> float:
        """The voxel edge, m; where it is still to be chosen, the one that points are looked at with."""
        return LEAST_CELL if self.cell is None else self.cell

    @property
    def may_find_classes(self) -> bool:
        """Whether classes are found, or may be once all points are read."""
        is_possible = self.edge <= LARGEST_CLASSIFIED_CELL and bool(self.dropped_found_classes() & FOUND)
        return self.classify == "always" or (self.classify == "auto" and is_possible)

    def dropped_found_classes(self) -> frozenset[int]:
        """Class numbers that are left out where classes are found: vegetation stays unless `drop` names it."""
        return parse_classes(FOUND_DROP) if self.drop is None else self.dropped_classes()

    def dropped_classes(self, *, are_asprs: bool = True) -> frozenset[int]:
        """Class numbers that are left out of a source; the default speaks of ASPRS classes only."""
        default = DEFAULT_DROP if are_asprs else ()
        return parse_classes(default if self.drop is None else self.drop, self.vehicle_classes)
