# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of a map build: voxels, area, coordinate reference system, and which classes are dropped."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.map.layout import CELLS, check_sigma
from maxcon.mapping.build.classes import DEFAULT_DROP, FOUND, FOUND_DROP, parse_classes
from maxcon.scan.trajectory import Trajectory

Classify = Literal["auto", "always", "off"]
LARGEST_CLASSIFIED_CELL = 0.25
"""Largest voxel edge, m, at which classes can be found from the shapes of surfaces."""


@dataclass(frozen=True, slots=True)
class Area:
    """Rectangle of a map in the coordinates of its CRS, m; OptionError if its sides are not finite and in order."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    def __post_init__(self) -> None:
        sides = astuple(self)
        if not all(map(math.isfinite, sides)) or not (self.x_min < self.x_max and self.y_min < self.y_max):
            raise OptionError(
                "Expected an area x_min,y_min,x_max,y_max, the smaller numbers first, got"
                f" {','.join(f'{side:.12g}' for side in sides)}. Give it in the coordinates of the map."
            )

    @classmethod
    def parse(cls, text: str) -> "Area":
        """Return the area of four numbers separated by commas; OptionError if they are not."""
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
        return np.asarray((x >= self.x_min) & (x < self.x_max) & (y >= self.y_min) & (y < self.y_max))


@dataclass(frozen=True, slots=True)
class MapOptions:
    """How a map is made of its points.

    Parameters
    ----------
    cell : float
        Voxel edge, m.
    drop : sequence of str, optional
        Classes to leave out, by name or number; ground, vegetation, noise, temporal exclusion and the
        vehicle classes if None, and of these only the last where classes are not the ASPRS's (not LAS).
    vehicle_classes : iterable of int
        Class numbers that mean vehicles; they are left out whatever `drop` names.
    trajectory : Trajectory, optional
        Sensor positions, matched by the points' times, to turn normals to the sensor's side.
    normals_have_sides : bool
        Whether the sources' own normals are turned to the sensor's side already. Own normals are used if
        their side is known, from this or from the trajectory; otherwise planes are fitted.
    crs : str, optional
        CRS of sources that name none.
    keep_every : int
        Only every n-th point of each source is taken: a thinner map to compare with.
    sigma : float, optional
        Standard deviation of the map's position along any axis, m. If None it is estimated from the differences
        between passes of the mapping vehicle, and `UNKNOWN_SIGMA` where there is only one.
    to_crs : str, optional
        CRS of the map, into which all points are transformed; that of the sources if None. The trajectory is in it.
    area : Area, optional
        Only points in it are taken.
    classes_are_asprs : bool
        Whether class numbers of clouds that are not LAS are those of the ASPRS, too.
    classify : str
        Whether ground, vegetation and temporary objects are found from the points themselves: "auto" where no cloud
        has classes (all points are 0 or 1, or noise), "always" also where they have (of these only noise and vehicles
        count then), or "off". Where they are found, ground and temporary objects are left out if `drop` is None.
    """

    cell: float = 0.06
    drop: Sequence[str] | None = None
    vehicle_classes: Iterable[int] = ()
    trajectory: Trajectory | None = None
    normals_have_sides: bool = False
    crs: str | None = None
    keep_every: int = 1
    sigma: float | None = None
    to_crs: str | None = None
    area: Area | None = None
    classes_are_asprs: bool = False
    classify: Classify = "off"

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle_classes", tuple(self.vehicle_classes))
        if not CELLS[0] <= self.cell <= CELLS[1]:
            raise ArrayError(
                f"Expected a positive voxel edge, {CELLS[0]:g} to {CELLS[1]:g} m, got {self.cell}. The default is 0.06."
            )
        if self.keep_every < 1:
            raise OptionError(f"Expected to keep one point of 1 or more, got {self.keep_every}. 1 keeps all.")
        if self.to_crs is not None and self.normals_have_sides:
            raise OptionError(
                "Expected the clouds' own normals in the CRS of the map, got points that are to be transformed. Leave"
                " out --signed-normals or --to-crs."
            )
        if self.classify not in get_args(Classify):
            raise OptionError(f"Expected classify to be auto, always or off, got {self.classify!r}. Correct it.")
        if self.classify == "always" and self.cell > LARGEST_CLASSIFIED_CELL:
            raise OptionError(
                f"Expected voxels of at most {LARGEST_CLASSIFIED_CELL:g} m to tell shapes by, got {self.cell:g} m."
                " Leave out --classify, or make the cell smaller."
            )
        if self.sigma is not None:
            check_sigma(self.sigma)

    @property
    def vehicle_numbers(self) -> frozenset[int]:
        """Class numbers that mean vehicles."""
        return parse_classes([str(number) for number in self.vehicle_classes])

    @property
    def may_find_classes(self) -> bool:
        """Whether classes are found, or may be once all points are read."""
        return self.classify == "always" or (
            self.classify == "auto"
            and self.cell <= LARGEST_CLASSIFIED_CELL
            and bool(self.dropped_found_classes() & FOUND)
        )

    def dropped_found_classes(self) -> frozenset[int]:
        """Class numbers that are left out where classes are found: vegetation stays unless `drop` names it."""
        return parse_classes(FOUND_DROP) if self.drop is None else self.dropped_classes()

    def dropped_classes(self, *, are_asprs: bool = True) -> frozenset[int]:
        """Class numbers that are left out of a source; the default speaks of ASPRS classes only."""
        default = DEFAULT_DROP if are_asprs else ()
        return parse_classes(default if self.drop is None else self.drop, self.vehicle_classes) | self.vehicle_numbers
