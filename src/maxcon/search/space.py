"""Search space: all cells that are tried, and which pose each stands for (D3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, wrap_angle
from maxcon.geometry.arrays import sigmas_of

__all__ = ["PAPER_CELL", "PAPER_STEP_DEG", "Cell", "SearchSpace", "rounded_up"]

PAPER_CELL, PAPER_STEP_DEG = 0.06, 0.5
"""The paper's cell edge, m, and its step between headings, degrees: also the default where nothing else chose one."""

MOST_CELLS = 2**36  # more cells would take branch and bound over a quarter of an hour, and are refused

MOST_STEPS = 100_000  # most cells in a half width: 6 km at 6 cm. It keeps every number of cells finite.

GIVE_CELLS = "Give it cells: `space.at(point_map.cell)`."

Cell = tuple[int, int, int]
"""(heading, y, x) indices of a cell; where heights are searched too, the number of its height goes beside it."""


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """A grid of headings and offsets around a prior.

    Without a cell and a heading step the space is open: the method chooses them (automatic cells), and the space has
    no cells before it is given both, see `at`. `paper` is the paper's space.

    Cell (h, iy, ix) stands for heading prior + headings[h] and offset (offsets[ix], offsets[iy]) in map axes. The
    offset (0, 0) and the heading 0 are cells. Offsets run from -half_width to half_width - cell, headings from -half
    width to +half width. With a height half width there are these cells at every height k, around the prior raised by
    heights[k]. Index order is (heading, height, y, x) then; `shape` and `Cell` describe the cells of one height.

    Parameters
    ----------
    half_width : float
        Largest offset from the prior in x and in y, m; a multiple of `cell`, if that is given.
    cell : float, optional
        Cell edge e, m: that of the map, or 2, 4, ... 32 times as much.
    heading_half_width_deg : float
        Largest turn from the prior's heading, degrees; a multiple of the step, if that is given.
    heading_step_deg : float, optional
        Step between headings, degrees; 0.5 if only the cell is given.
    height_half_width : float
        Largest offset from the prior in z, up and down, m; a multiple of `cell`, if that is given.

    Raises
    ------
    SearchSpaceError
        If a half width is no multiple of its step, a number is out of range, or there are more than 2^36 cells.
    """

    half_width: float = 12.0
    cell: float | None = None
    heading_half_width_deg: float = 10.0
    heading_step_deg: float | None = None
    height_half_width: float = 0.0

    def __post_init__(self) -> None:
        if self.cell is not None and self.heading_step_deg is None:
            object.__setattr__(self, "heading_step_deg", PAPER_STEP_DEG)
        for half_width, step, what, unit in (
            (self.half_width, self.cell, "offsets", "m"),
            (self.height_half_width, self.cell, "heights", "m"),
            (self.heading_half_width_deg, self.heading_step_deg, "headings", "degrees"),
        ):
            if step is not None:
                _n_steps(half_width, step, what, unit)
            elif not 0.0 <= half_width < math.inf:
                raise SearchSpaceError(f"Expected a half width >= 0 for the {what}, got {half_width} {unit}.")
        if self.cell is not None and self.n_cells > MOST_CELLS:
            n_headings, ny, nx = self.shape
            raise SearchSpaceError(
                f"Expected at most {MOST_CELLS:,} cells in a search space, got {self.n_cells:.3g}:"
                f" {n_headings:,} headings of {ny:,} x {nx:,} positions. Narrow it, or take larger steps."
            )

    @classmethod
    def paper(cls) -> SearchSpace:
        """Return the paper's: 3 m in cells of 0.06 m, and 2 degrees in steps of 0.5 degrees."""
        return cls(3.0, PAPER_CELL, 2.0, PAPER_STEP_DEG)

    @classmethod
    def from_covariance(
        cls,
        covariance: ArrayLike,
        *,
        k: float = 3.0,
        cell: float | None = None,
        heading_step_deg: float | None = None,
        smallest_half_width: float = 0.0,
        smallest_heading_half_width_deg: float = 0.0,
        largest_half_width: float | None = None,
        largest_heading_half_width_deg: float | None = None,
    ) -> SearchSpace:
        """Return the space that holds every pose within k standard deviations of a prior (D2).

        Half widths are rounded up to whole cells and steps, if given, so that every pose within k sigma lies within
        half a cell of one that is tried. A variance of 0 gives one cell, or one heading. The turn is at most 180
        degrees, before rounding.

        Parameters
        ----------
        covariance : array_like, shape (3, 3)
            Of the prior's x, y and heading, map axes: m^2, m rad and rad^2. The window is a square: the larger of the
            variances of x and y counts, correlations do not matter.
        k : float
            Half widths in standard deviations, > 0.
        cell : float, optional
            Cell edge e, m.
        heading_step_deg : float, optional
            Step between headings, degrees.
        smallest_half_width, smallest_heading_half_width_deg : float
            Least half widths, m and degrees, whatever the covariance says.
        largest_half_width, largest_heading_half_width_deg : float, optional
            The space is cut to these, m and degrees, and to whole cells and steps within them.

        Raises
        ------
        SearchSpaceError
            If the covariance is not of shape (3, 3), finite, symmetric and positive semidefinite, a number is out of
            range, or the space has too many cells.
        """
        if cell is not None:
            _n_steps(0.0, cell, "offsets", "m")
        if heading_step_deg is not None:
            _n_steps(0.0, heading_step_deg, "headings", "degrees")
        if not 0.0 < k < math.inf:
            raise SearchSpaceError(f"Expected `k` > 0 standard deviations, got {k}. The default is 3.")
        for name, limit in (
            ("smallest_half_width", smallest_half_width),
            ("smallest_heading_half_width_deg", smallest_heading_half_width_deg),
            ("largest_half_width", largest_half_width),
            ("largest_heading_half_width_deg", largest_heading_half_width_deg),
        ):
            if limit is not None and not 0.0 <= limit < math.inf:
                raise SearchSpaceError(f"Expected `{name}` >= 0, got {limit}. Leave it out for no limit.")
        sigma_x, sigma_y, sigma_heading = sigmas_of(covariance).tolist()
        reach = max(k * max(sigma_x, sigma_y), smallest_half_width)
        turn_deg = min(max(k * math.degrees(sigma_heading), smallest_heading_half_width_deg), 180.0)
        return cls(
            rounded_up(reach, cell, largest_half_width, margin=0.5),  # the last column stands one cell before the end
            cell,
            rounded_up(turn_deg, heading_step_deg, largest_heading_half_width_deg),
            heading_step_deg,
        )

    @property
    def is_open(self) -> bool:
        """Whether cell and heading step are the method's to choose."""
        return self.cell is None and self.heading_step_deg is None

    def at(self, cell: float, heading_step_deg: float = PAPER_STEP_DEG) -> SearchSpace:
        """Return the space with a cell edge, m, and a heading step, degrees, where it has none, rounded up."""
        if self.cell is not None:
            return self
        step_deg = heading_step_deg if self.heading_step_deg is None else self.heading_step_deg
        return SearchSpace(
            rounded_up(self.half_width, cell), cell, rounded_up(self.heading_half_width_deg, step_deg), step_deg,
            rounded_up(self.height_half_width, cell),
        )  # fmt: skip

    @property
    def cell_edge(self) -> float:
        """Cell edge e, m; `SearchSpaceError` if it has none."""
        if self.cell is None:
            raise SearchSpaceError(f"Expected a search space with a cell, got {self}. {GIVE_CELLS}")
        return self.cell

    @property
    def step_deg(self) -> float:
        """Step between headings, degrees; `SearchSpaceError` if it has none."""
        if self.heading_step_deg is None:
            raise SearchSpaceError(f"Expected a search space with a heading step, got {self}. {GIVE_CELLS}")
        return self.heading_step_deg

    @property
    def shape(self) -> tuple[int, int, int]:
        """(headings, ny, nx): how many cells along each axis, at one height."""
        n_offsets = max(1, 2 * _n_steps(self.half_width, self.cell_edge, "offsets", "m"))
        n_turns = _n_steps(self.heading_half_width_deg, self.step_deg, "headings", "degrees")
        return 2 * n_turns + 1, n_offsets, n_offsets

    @property
    def n_heights(self) -> int:
        """Number of heights."""
        return 2 * _n_steps(self.height_half_width, self.cell_edge, "heights", "m") + 1

    @property
    def n_cells(self) -> int:
        """Number of cells at all heights."""
        return self.n_heights * math.prod(self.shape)

    @property
    def offsets(self) -> NDArray[np.float64]:
        """Offset of each column (and of each row) from the prior, shape (nx,), m."""
        return _centred(self.shape[2]) * self.cell_edge

    @property
    def headings(self) -> NDArray[np.float64]:
        """Turn of each heading from the prior's, shape (headings,), rad."""
        return np.asarray(np.radians(_centred(self.shape[0]) * self.step_deg), dtype=np.float64)

    @property
    def heights(self) -> NDArray[np.float64]:
        """Height of each plane of cells above the prior, shape (n_heights,), m."""
        return _centred(self.n_heights) * self.cell_edge

    @property
    def reach(self) -> float:
        """Largest offset of a cell from the prior along x or y, m."""
        return self.shape[2] // 2 * self.cell_edge

    @property
    def plane(self) -> SearchSpace:
        """The cells of one height: those of this space around a prior that is `raised` to it."""
        return replace(self, height_half_width=0.0)

    def raised(self, prior: Pose, height: int) -> Pose:
        """Return the prior raised to a height, by its number."""
        return replace(prior, z=prior.z + float(self.heights[height]))

    def priors(self, prior: Pose) -> Iterator[Pose]:
        """Yield the prior raised to each height, from the lowest on."""
        return (self.raised(prior, height) for height in range(self.n_heights))

    def pose(self, cell: Cell, prior: Pose) -> Pose:
        """Return the pose that `cell` stands for; z, roll and pitch are the prior's (see `raised`)."""
        heading, iy, ix = cell
        offsets = self.offsets
        x, y = prior.x + float(offsets[ix]), prior.y + float(offsets[iy])
        return replace(prior, x=x, y=y, heading=prior.heading + float(self.headings[heading]))

    def nearest_cell(self, pose: Pose, prior: Pose) -> Cell:
        """Return the cell whose pose is nearest to `pose`, clipped to the space."""
        n_headings, ny, nx = self.shape
        turn = wrap_angle(pose.heading - prior.heading)
        heading = round(math.degrees(turn) / self.step_deg) + n_headings // 2
        iy = round((pose.y - prior.y) / self.cell_edge) + ny // 2
        ix = round((pose.x - prior.x) / self.cell_edge) + nx // 2
        return (min(max(heading, 0), n_headings - 1), min(max(iy, 0), ny - 1), min(max(ix, 0), nx - 1))

    def is_at_boundary(self, cell: Cell) -> bool:
        """Whether `cell` lies in the outermost rows or columns of offsets (where there are others)."""
        _, ny, nx = self.shape
        return (ny > 2 and cell[1] in (0, ny - 1)) or (nx > 2 and cell[2] in (0, nx - 1))

    def is_outermost(self, heading: int) -> bool:
        """Whether a heading, by number, is the first or the last of several."""
        n_headings = self.shape[0]
        return n_headings > 1 and heading in (0, n_headings - 1)


def rounded_up(reach: float, step: float | None, largest: float | None = None, margin: float = 0.0) -> float:
    """Return the least multiple of `step` that holds `reach` and `margin` steps, but none beyond `largest`."""
    most = math.inf if largest is None else largest
    if step is None:
        return min(reach, most)
    steps = reach / step + margin if reach > 0.0 else 0.0
    if min(steps, most / step) > MOST_STEPS:
        return min(reach, most)
    whole = math.ceil(steps - 1e-9 * max(1.0, steps))
    if most / step < whole:
        whole = math.floor(most / step + 1e-6)
    return whole * step


@lru_cache(maxsize=4096)
def _n_steps(half_width: float, step: float, what: str, unit: str) -> int:
    """Number of steps in a half width, which must be a whole one."""
    if not (math.isfinite(half_width) and math.isfinite(step) and step > 0.0 and half_width >= 0.0):
        raise SearchSpaceError(
            f"Expected a half width >= 0 and a step > 0 for the {what}, got {half_width} {unit} and {step} {unit}."
            " The defaults are 3 m by 0.06 m and 2 degrees by 0.5 degrees."
        )
    steps = half_width / step
    if steps > MOST_STEPS:
        raise SearchSpaceError(
            f"Expected at most {MOST_STEPS:,} cells in the half width of the {what}, got {half_width:g} {unit} by"
            f" {step:g} {unit}. Narrow the search space, or take larger steps."
        )
    n_steps = round(steps)
    if abs(steps - n_steps) > 1e-6 * max(1.0, steps):
        raise SearchSpaceError(
            f"Expected the half width of the {what} to be a multiple of its step, got {half_width} {unit} and"
            f" {step} {unit}. Take {math.ceil(steps) * step:g} {unit}?"
        )
    return n_steps


def _centred(n: int) -> NDArray[np.float64]:
    """Numbers of n steps, 0 in the middle."""
    return np.asarray(np.arange(n) - n // 2, dtype=np.float64)
