# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""SearchSpace: all cells that are tried, and which pose each stands for (D3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, wrap_angle
from maxcon.geometry.covariances import sigmas_of
from maxcon.search.grid_rounding import n_steps, rounded_up

__all__ = ["Cell", "SearchSpace"]

GIVE_CELLS = "Give it cells: `space.at(point_map.cell)`."

PAPER_CELL, PAPER_STEP_DEG = 0.06, 0.5
"""The paper's cell edge, m, and its step between headings, degrees: also where nothing else has chosen one."""

MOST_CELLS = 2**36
"""Cells of a space that takes branch and bound a quarter of an hour; what has more was a slip of the pen."""

Cell = tuple[int, int, int]
"""(heading, y, x) indices of one cell; where heights are searched too, the number of its height goes beside it."""


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """A grid of headings and offsets around a prior.

    A cell and a heading step that are not given are the method's to choose: the space is open then, and has no cells
    before it is given both, see `at`. Given ones are obeyed. `paper` is the paper's.

    Cell (h, iy, ix) stands for heading prior + headings[h] and offset (offsets[ix], offsets[iy]) in map
    axes. The offset (0, 0) and the heading 0 are cells. Offsets run from -half_width to
    half_width - cell, headings from -half width to +half width.

    With a height half width there are these cells at every height k: those of the prior raised by heights[k]. Index
    order is (heading, height, y, x) then; `shape` and `Cell` speak of the cells of one height.

    Parameters
    ----------
    half_width : float
        Largest offset from the prior in x and in y, m; a multiple of `cell`, if that is given.
    cell : float, optional
        Cell edge e, m: that of the map, or 2, 4, ... 32 times as much.
    heading_half_width_deg : float
        Largest turn from the prior's heading, degrees; a multiple of the step, if that is given.
    heading_step_deg : float, optional
        Step between headings, degrees; 0.5 beside a cell, if not given.
    height_half_width : float
        Largest offset from the prior in z, up and down, m; a multiple of `cell`, if that is given.

    Raises
    ------
    SearchSpaceError
        If a half width is not a multiple of its step, a number is negative or not finite, or there are more than 2^36
        cells.
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
                n_steps(half_width, step, what, unit)
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

    @property
    def is_open(self) -> bool:
        """Whether cell and heading step are the method's to choose."""
        return self.cell is None and self.heading_step_deg is None

    def at(self, cell: float, heading_step_deg: float = PAPER_STEP_DEG) -> SearchSpace:
        """Return the space with a cell edge, m, and a heading step, degrees, where it has none yet.

        Half widths are rounded up to what these make.
        """
        if self.cell is not None:
            return self
        step_deg = heading_step_deg if self.heading_step_deg is None else self.heading_step_deg
        return SearchSpace(
            rounded_up(self.half_width, cell),
            cell,
            rounded_up(self.heading_half_width_deg, step_deg),
            step_deg,
            rounded_up(self.height_half_width, cell),
        )

    def n_cells_at(self, cell: float, heading_step_deg: float = PAPER_STEP_DEG) -> int:
        """How many cells the space has once it is given these (see `at`), even if they are too many to be searched."""
        step_deg = heading_step_deg if self.heading_step_deg is None else self.heading_step_deg
        edge = cell if self.cell is None else self.cell
        n_offsets, n_turns, n_up = (
            round(rounded_up(half_width, step) / step)
            for half_width, step in (
                (self.half_width, edge),
                (self.heading_half_width_deg, step_deg),
                (self.height_half_width, edge),
            )
        )
        return (2 * n_up + 1) * (2 * n_turns + 1) * max(1, 2 * n_offsets) ** 2

    @property
    def cell_edge(self) -> float:
        """Cell edge e, m.

        Raises
        ------
        SearchSpaceError
            If it is the method's to choose.
        """
        if self.cell is None:
            raise SearchSpaceError(f"Expected a search space with a cell, got {self}. {GIVE_CELLS}")
        return self.cell

    @property
    def step_deg(self) -> float:
        """Step between headings, degrees, of a space that is not open.

        Raises
        ------
        SearchSpaceError
            If it is.
        """
        if self.heading_step_deg is None:
            raise SearchSpaceError(f"Expected a search space with a heading step, got {self}. {GIVE_CELLS}")
        return self.heading_step_deg

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

        Parameters
        ----------
        covariance : array_like, shape (3, 3)
            Of the prior's x, y and heading: m^2, m rad and rad^2, axes of the map. x and y share the larger
            variance of the two, as the window is a square; how they are correlated does not matter.
        k : float
            Half widths in standard deviations, > 0.
        cell : float, optional
            Cell edge e, m; the method's to choose if not given.
        heading_step_deg : float, optional
            Step between headings, degrees; the method's to choose if not given.
        smallest_half_width, smallest_heading_half_width_deg : float
            The space reaches so far at least, m and degrees, whatever the covariance says.
        largest_half_width, largest_heading_half_width_deg : float, optional
            The space is cut to these, m and degrees, and to whole cells and steps within them, where those are given:
            poses beyond are not searched then.

        Raises
        ------
        SearchSpaceError
            If the covariance is not of shape (3, 3), finite, symmetric and positive semidefinite; if a number
            is negative or not finite, or the space has too many cells.

        Notes
        -----
        Half widths are rounded up to whole cells and steps, where those are given. As the last column stands one cell
        before the half width, that is at least k sigma and half a cell: every pose within k sigma lies within half a
        cell of one that is tried. A variance of 0 gives one cell, or one heading. Turns of more than 180 degrees are
        none: that is the most that is rounded up, to less than a step more.
        """
        if cell is not None:
            n_steps(0.0, cell, "offsets", "m")
        if heading_step_deg is not None:
            n_steps(0.0, heading_step_deg, "headings", "degrees")
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
            rounded_up(reach, cell, largest_half_width, rim=0.5),
            cell,
            rounded_up(turn_deg, heading_step_deg, largest_heading_half_width_deg),
            heading_step_deg,
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """(headings, ny, nx): how many cells along each axis, at one height."""
        n_offsets = max(1, 2 * n_steps(self.half_width, self.cell_edge, "offsets", "m"))
        n_turns = n_steps(self.heading_half_width_deg, self.step_deg, "headings", "degrees")
        return 2 * n_turns + 1, n_offsets, n_offsets

    @property
    def n_cells(self) -> int:
        """How many cells there are in all, at all heights."""
        return self.n_heights * math.prod(self.shape)

    @property
    def n_heights(self) -> int:
        """How many heights there are."""
        return 2 * n_steps(self.height_half_width, self.cell_edge, "heights", "m") + 1

    @property
    def heights(self) -> NDArray[np.float64]:
        """What each height lies above the prior, shape (n_heights,), m."""
        n_heights = self.n_heights
        return np.asarray((np.arange(n_heights) - n_heights // 2) * self.cell_edge, dtype=np.float64)

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

    @property
    def offsets(self) -> NDArray[np.float64]:
        """Offset of each column (and of each row) from the prior, shape (nx,), m."""
        n_offsets = self.shape[2]
        return np.asarray((np.arange(n_offsets) - n_offsets // 2) * self.cell_edge, dtype=np.float64)

    @property
    def headings(self) -> NDArray[np.float64]:
        """Turn of each heading from the prior's, shape (headings,), rad."""
        n_headings = self.shape[0]
        turns_deg = (np.arange(n_headings) - n_headings // 2) * self.step_deg
        return np.asarray(np.radians(turns_deg), dtype=np.float64)

    @property
    def reach(self) -> float:
        """Farthest a cell can lie from the prior, along x or y, m."""
        return self.shape[2] // 2 * self.cell_edge

    def pose(self, cell: Cell, prior: Pose) -> Pose:
        """Return the pose that `cell` stands for; z, roll and pitch are the prior's (see `raised`)."""
        heading, iy, ix = cell
        offsets = self.offsets
        return Pose(
            prior.x + float(offsets[ix]),
            prior.y + float(offsets[iy]),
            prior.z,
            prior.roll,
            prior.pitch,
            prior.heading + float(self.headings[heading]),
        )

    def nearest_cell(self, pose: Pose, prior: Pose) -> Cell:
        """Return the cell whose pose is nearest to `pose`, clipped to the space."""
        n_headings, ny, nx = self.shape
        turn = wrap_angle(pose.heading - prior.heading)
        heading = round(math.degrees(turn) / self.step_deg) + n_headings // 2
        iy = round((pose.y - prior.y) / self.cell_edge) + ny // 2
        ix = round((pose.x - prior.x) / self.cell_edge) + nx // 2
        return (min(max(heading, 0), n_headings - 1), min(max(iy, 0), ny - 1), min(max(ix, 0), nx - 1))

    def is_at_rim(self, cell: Cell) -> bool:
        """Whether `cell` lies in the outermost rows or columns of offsets (where there are others)."""
        _, ny, nx = self.shape
        return (ny > 2 and cell[1] in (0, ny - 1)) or (nx > 2 and cell[2] in (0, nx - 1))

    def is_outermost(self, heading: int) -> bool:
        """Whether a heading, by number, is the first or the last of several."""
        n_headings = self.shape[0]
        return n_headings > 1 and heading in (0, n_headings - 1)
