"""What a match adds to its cell (D4, D5), and the accumulator: the moments of every cell.

All searches share what is here: how often a match counts, its weight, how contributions are rounded so that their sums
are exact, and how the scan is turned by the prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError, OptionError, SearchSpaceError
from maxcon.geometry import Pose, rotation_matrices
from maxcon.map import PointMap
from maxcon.map.layout import LEVEL_FACTORS
from maxcon.scan import Scan
from maxcon.search.objectives import Moments, Objective, Scores, scores_of
from maxcon.search.space import Cell, SearchSpace

CONTRIBUTION_STEP = 2.0**-24
"""What a match adds to N is rounded to multiples of this: float64 sums are then exact, and equal in any order, up to
2^29 matches in a cell (D8)."""

ROUNDER = 1.5 * 2.0**52 * CONTRIBUTION_STEP
"""Adding and subtracting this rounds a float64 to multiples of the step, ties to even, as numpy.rint does."""

MOST_CELLS = 2**26  # most cells of an accumulator: so many take 2 GiB, 32 bytes each


class NamedOption(StrEnum):
    """Base of options whose values have names, the same in Python, in a study and on the command line."""

    option: ClassVar[str]

    def __init_subclass__(cls, *, option: str, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        cls.option = option

    @classmethod
    def parse(cls, value: str | Self) -> Self:
        """Return the value of that name, blanks and underscores read as hyphens; `OptionError` if there is none."""
        try:
            return cls(str(value).replace(" ", "-").replace("_", "-"))
        except ValueError:
            *others, last = (repr(member.value) for member in cls)
            names = f"{', '.join(others)} or {last}"
            raise OptionError(f"Expected `{cls.option}` to be {names}, got {value!r}.") from None


class Multiplicity(NamedOption, option="multiplicity"):
    """How often a match counts (D4)."""

    OCCUPIED = "occupied"
    """Once: free of density."""

    POINTS = "points"
    """As often as the voxel has map points: the paper's count, biased by map density."""


class Weighting(NamedOption, option="weighting"):
    """The weight w of a match in N, equation (4); its count does not depend on it (D5).

    The direction of an observation is the map's normal; the scan's only weighs it. A map voxel without a normal
    constrains nothing, whatever the weight.
    """

    COSINE = "cosine"
    """max(0, n_scan . n_map); abs(n_scan . n_map) where the map's normals have no side. 1/2, its mean over all
    directions that the sensor can see, where the scan point has no normal."""

    PUBLISHED = "published"
    """The same, but 0 where the scan point has no normal: it counts, and constrains nothing."""

    ONE = "one"
    """1, whatever the normal of the scan point: what the other weights are compared with."""

    @property
    def without_normal(self) -> float:
        """Weight of a match whose scan point has no normal."""
        return {Weighting.COSINE: 0.5, Weighting.PUBLISHED: 0.0, Weighting.ONE: 1.0}[self]


class SearchMethod(NamedOption, option="search"):
    """How the best cell is found; it is the same one (D7)."""

    EXHAUSTIVE = "exhaustive"
    """Score every cell. Only an answer in doubt is searched for farther around by bounds, coarse to fine."""

    BRANCH_AND_BOUND = "branch-and-bound"
    """Bound every cell, and score those that could be the best."""


@dataclass(frozen=True, slots=True, eq=False)
class Accumulator:
    """The moments of every cell of a search space: every objective is a function of them.

    Parameters
    ----------
    moments : array, shape (headings, ny, nx, 4)
        Count, Nxx, Nxy and Nyy of each cell (equation (4)).
    space : SearchSpace
        The cells.
    prior : Pose
        The pose the cells lie around, local frame.
    """

    moments: Moments
    space: SearchSpace
    prior: Pose

    def __repr__(self) -> str:
        return f"Accumulator({' x '.join(map(str, self.space.shape))} cells around {self.prior})"

    def __post_init__(self) -> None:
        expected = (*self.space.shape, 4)
        if self.moments.shape != expected:
            raise ArrayError(f"Expected `moments` to have shape {expected}, got {self.moments.shape}.")

    def score(self, objective: Objective) -> Scores:
        """Scores of all cells, shape (headings, ny, nx); `ArrayError` if they have another shape or are NaN."""
        return scores_of(objective, self.moments)

    def best_cell(self, objective: Objective) -> Cell:
        """Return the cell with the highest score; the first in index order at ties (D8). Errors as of `score`."""
        return highest(self.score(objective))

    def normal_matrix(self, cell: Cell) -> NDArray[np.float64]:
        """N of one cell, shape (2, 2)."""
        _, nxx, nxy, nyy = self.moments[cell].astype(np.float64)
        return np.array([[nxx, nxy], [nxy, nyy]])


def highest(scores: Scores) -> Cell:
    """Return the cell with the highest of the scores of all cells, the first in index order at ties (D8)."""
    return cast(Cell, tuple(int(index) for index in np.unravel_index(int(np.argmax(scores)), scores.shape)))


@dataclass(frozen=True, slots=True, eq=False)
class UprightScan:
    """A scan, (n, 3), turned by the prior's roll and pitch and raised by its z, not turned by its heading (D2)."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]


def upright(scan: Scan, prior: Pose) -> UprightScan:
    """Turn a scan by the prior's roll and pitch, and raise it by its z (D2)."""
    rotation = rotation_matrices(prior.roll, prior.pitch, 0.0)
    points = _rotate(scan.points, rotation)
    points[:, 2] += prior.z
    return UprightScan(points, _rotate(scan.normals, rotation))


def turn(vectors: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    """Rz(heading) v for each row of `vectors`, shape (n, 3)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    x, y, z = vectors.T
    return np.column_stack([x * cosine - y * sine, x * sine + y * cosine, z])


def _rotate(vectors: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """R v for each row, term by term: a row's result must not depend on its place, as with BLAS it may."""
    x, y, z = vectors.T
    return np.column_stack([x * row[0] + y * row[1] + z * row[2] for row in rotation])


def level_of(point_map: PointMap, space: SearchSpace) -> PointMap:
    """Return the level of a map whose voxels are the cells of a space; `SearchSpaceError` if there is none."""
    for factor in LEVEL_FACTORS:
        if np.isclose(space.cell_edge, point_map.cell * factor, rtol=1e-9, atol=0.0):
            return point_map.level(factor)
    raise SearchSpaceError(
        f"Expected the cell edge of the search space to be the map's voxel edge, {point_map.cell:g} m, or 2, 4, ... 32"
        f" times that, got {space.cell_edge:g} m. Choose one of these, or leave it out: it is found then."
    )


def cells_of(space: SearchSpace, point_map: PointMap) -> SearchSpace:
    """Return a space whose cells are the map's voxels (D4): an open one is given them, others are refused."""
    space = space.at(point_map.cell)
    if not np.isclose(space.cell_edge, point_map.cell, rtol=1e-9, atol=0.0):
        raise SearchSpaceError(
            f"Expected the cell edge of the search space to be the map's voxel edge, {point_map.cell:g} m,"
            f" got {space.cell_edge:g} m. Search in a level of the map that has it, or give the space no cell."
        )
    return space


def check_one_height(space: SearchSpace) -> None:
    """Refuse a search space of several heights where the cells of one are asked for."""
    if space.n_heights > 1:
        raise SearchSpaceError(
            f"Expected a search space of one height, got {space.n_heights}. Search its `plane` around each of its"
            " `priors`, as `search.accumulators` does, or use `search.branch_and_bound`."
        )


def check_all_fit(space: SearchSpace) -> None:
    """Refuse a search space that has too many cells to score all of them."""
    if space.n_cells > MOST_CELLS:
        raise SearchSpaceError(
            f"Expected at most {MOST_CELLS:,} cells in an exhaustive search, got {space.n_cells:,}."
            " Narrow the search space, or enlarge the cell or the heading step."
        )


def check_threads(n_threads: int) -> None:
    """Refuse to search on no thread."""
    if n_threads < 1:
        raise OptionError(f"Expected `n_threads` to be 1 or more, got {n_threads}. One is the default.")
