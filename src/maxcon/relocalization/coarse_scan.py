# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A scan as large voxels above its ground, at every heading; and the candidates: cells and poses that match it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, wrap_angle
from maxcon.relocalization.coarse_map import ANY_BIN, BIN_WIDTH, HIGHEST, N_BINS, REACH
from maxcon.scan import Scan
from maxcon.search.accumulator import upright

STEP_DEG = 2.0
HEADINGS = np.radians(np.arange(-180.0, 180.0, STEP_DEG))
"""Headings that are tried, rad."""
# Points lower than this above the scan's ground do not take part, m: what is there may be the ground itself.
LOWEST = 0.4
# A point of the scan has an orientation bin where its normal is within 60 degrees of horizontal.
LEAST_HORIZONTAL = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class TurnedScan:
    """Points of a scan at some headings, in voxels.

    layers : (n,) int64, height of each point above the ground; columns : (h, n, 2) int32, (x, y) from the cell in whose
    middle the scanner stands to that of the point; bins : (h, n) uint8, number of the bit that a voxel must have to
    match the point: points match voxels of their orientation only.
    """

    layers: NDArray[np.int64]
    columns: NDArray[np.int32]
    bins: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class CoarseScan:
    """Points of a scan that take part, with roll and pitch applied, from the ground up.

    points : (n, 3), x and y about the scanner, z above the ground, m; normals : (n, 3), same axes, zeros for none.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]

    @classmethod
    def of(cls, scan: Scan, T_ground_sensor: Pose) -> "CoarseScan":
        """Align a scan with its ground plane; points far off, on the ground or above `HIGHEST` are left out.

        Points come from the lowest to the highest, so that what is read of a map lies together.
        """
        aligned = upright(scan, T_ground_sensor)
        points = aligned.points
        away = np.hypot(points[:, 0], points[:, 1])
        takes_part = (points[:, 2] >= LOWEST) & (points[:, 2] < HIGHEST) & (away < REACH)
        order = np.argsort(points[takes_part, 2], kind="stable")
        return cls(points[takes_part][order], aligned.normals[takes_part][order])

    def __len__(self) -> int:
        return len(self.points)

    def turned(self, headings: NDArray[np.float64], cell: float) -> TurnedScan:
        """Voxels (edge `cell`, m) of the points at headings (h,), rad, of a scanner in the middle of a cell."""
        cosines = np.array([math.cos(heading) for heading in headings.tolist()])[:, None]
        sines = np.array([math.sin(heading) for heading in headings.tolist()])[:, None]
        x, y, z = self.points.T
        turned = np.stack([x * cosines - y * sines, x * sines + y * cosines], axis=2)
        columns = np.floor(turned / cell + 0.5).astype(np.int32)
        return TurnedScan(np.floor(z / cell).astype(np.int64), columns, self._bins(headings))

    def _bins(self, headings: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Numbers of bits (h, n) at headings (h,); a point whose normal is not nearly horizontal matches any voxel."""
        is_upright = np.hypot(self.normals[:, 0], self.normals[:, 1]) > LEAST_HORIZONTAL
        azimuths = np.arctan2(self.normals[:, 1], self.normals[:, 0])
        bins = np.floor((azimuths + headings[:, None]) / BIN_WIDTH + 0.5).astype(np.int64) % N_BINS
        return np.where(is_upright, bins, ANY_BIN).astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class CandidateCells:
    """Large cells in which a scan may have been taken: those the coarse filter leaves.

    cells: shape (n, 3), int64; (heading, y, x): number in `HEADINGS`, index of the cell in the local frame. The highest
        count comes first, the first in index order where counts are the same.
    counts: shape (n,), int64; points that match.
    left_out: ratio to the highest count that none of the other cells reaches.
    n_counted: counts that this took, of cells and of bounds.
    """

    cells: NDArray[np.int64]
    counts: NDArray[np.int64]
    left_out: float
    n_counted: int = 0

    @classmethod
    def sorted(
        cls, cells: NDArray[np.int64], counts: NDArray[np.int64], left_out: float, n_counted: int = 0
    ) -> "CandidateCells":
        """Put cells in order."""
        order = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0], -counts))
        return cls(cells[order], counts[order], left_out, n_counted)

    def __len__(self) -> int:
        return len(self.cells)


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePoses:
    """Poses at which a scan may have been taken, the highest count first.

    poses: shape (n, 3); x, y (local frame, m) and heading (rad).
    counts: shape (n,), int64; points that match there.
    left_out: ratio to the highest count that none of the other poses reaches.
    """

    poses: NDArray[np.float64]
    counts: NDArray[np.int64]
    left_out: float

    def __len__(self) -> int:
        return len(self.poses)

    def reaching(self, ratio: float) -> "CandidatePoses":
        """Those that reach a ratio of the highest count."""
        kept = self.counts >= ratio * self.counts.max(initial=0)
        return CandidatePoses(self.poses[kept], self.counts[kept], max(self.left_out, ratio))

    def distinct(self, same: float, same_turn: float, most: int) -> "CandidatePoses":
        """One pose of each place, the first of those within `same` (m) and `same_turn` (rad); at most `most`."""
        kept: list[int] = []
        left_out = self.left_out
        is_left = np.ones(len(self), bool)
        for number in range(len(self)):
            if not is_left[number]:
                continue
            if len(kept) == most:
                left_out = max(left_out, float(self.counts[number] / self.counts[0]))
                break
            kept.append(number)
            others = self.poses[number:]
            away = np.hypot(others[:, 0] - others[0, 0], others[:, 1] - others[0, 1])
            turns = np.abs(wrap_angle(others[:, 2] - others[0, 2]))
            is_left[number:] &= (away > same) | (turns > same_turn)
        return CandidatePoses(self.poses[kept], self.counts[kept], left_out)
