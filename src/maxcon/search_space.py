# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""SearchSpace: all cells that are tried, and which pose each stands for (D3)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose, wrap_angle

__all__ = ["Cell", "SearchSpace"]

# Enough for 6 km at 6 cm; it keeps every number of cells finite.
MOST_STEPS = 100_000

Cell = tuple[int, int, int]
"""(heading, y, x) indices of one cell; a search over z will stand between heading and y."""


def _n_steps(half_width: float, step: float, what: str, unit: str) -> int:
    """How many steps make the half width, which must be a whole number."""
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


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """A grid of headings and offsets around a prior; the default is the paper's.

    Cell (h, iy, ix) stands for heading prior + headings[h] and offset (offsets[ix], offsets[iy]) in map
    axes. The offset (0, 0) and the heading 0 are cells. Offsets run from -half_width to
    half_width - cell, headings from -half width to +half width.

    Parameters
    ----------
    half_width : float
        Largest offset from the prior in x and in y, m; a multiple of `cell`.
    cell : float
        Cell edge e, m. The map must have the same.
    heading_half_width_deg, heading_step_deg : float
        Largest turn from the prior's heading, and the step between headings, degrees.

    Raises
    ------
    SearchSpaceError
        If a half width is not a multiple of its step, or a number is negative or not finite.
    """

    half_width: float = 3.0
    cell: float = 0.06
    heading_half_width_deg: float = 2.0
    heading_step_deg: float = 0.5

    def __post_init__(self) -> None:
        _n_steps(self.half_width, self.cell, "offsets", "m")
        _n_steps(self.heading_half_width_deg, self.heading_step_deg, "headings", "degrees")

    @property
    def shape(self) -> tuple[int, int, int]:
        """(headings, ny, nx): how many cells along each axis."""
        n_offsets = max(1, 2 * _n_steps(self.half_width, self.cell, "offsets", "m"))
        n_turns = _n_steps(self.heading_half_width_deg, self.heading_step_deg, "headings", "degrees")
        return 2 * n_turns + 1, n_offsets, n_offsets

    @property
    def n_cells(self) -> int:
        """How many cells there are in all."""
        return math.prod(self.shape)

    @property
    def offsets(self) -> NDArray[np.float64]:
        """Offset of each column (and of each row) from the prior, shape (nx,), m."""
        n_offsets = self.shape[2]
        return np.asarray((np.arange(n_offsets) - n_offsets // 2) * self.cell, dtype=np.float64)

    @property
    def headings(self) -> NDArray[np.float64]:
        """Turn of each heading from the prior's, shape (headings,), rad."""
        n_headings = self.shape[0]
        turns_deg = (np.arange(n_headings) - n_headings // 2) * self.heading_step_deg
        return np.asarray(np.radians(turns_deg), dtype=np.float64)

    @property
    def reach(self) -> float:
        """Farthest a cell can lie from the prior, along x or y, m."""
        return self.shape[2] // 2 * self.cell

    def pose(self, cell: Cell, prior: Pose) -> Pose:
        """Return the pose that `cell` stands for; z, roll and pitch are the prior's."""
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
        heading = round(math.degrees(turn) / self.heading_step_deg) + n_headings // 2
        iy = round((pose.y - prior.y) / self.cell) + ny // 2
        ix = round((pose.x - prior.x) / self.cell) + nx // 2
        return (
            min(max(heading, 0), n_headings - 1),
            min(max(iy, 0), ny - 1),
            min(max(ix, 0), nx - 1),
        )

    def is_at_rim(self, cell: Cell) -> bool:
        """Whether `cell` lies in the outermost rows or columns of offsets (where there are others)."""
        _, ny, nx = self.shape
        return (ny > 2 and cell[1] in (0, ny - 1)) or (nx > 2 and cell[2] in (0, nx - 1))
