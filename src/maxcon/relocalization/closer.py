# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A closer look: places that the sieve left open are counted again in cells half as large."""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from maxcon.relocalization.regions import REGION, Regions
from maxcon.relocalization.sieve_scan import SieveScan
from maxcon.relocalization.sifted import STEP_DEG

__all__ = ["Places", "look_closer"]

# Offsets that are counted around the middle of a large cell: cells of half the edge, headings of half the step.
NEAR = range(-1, 3)
NEAR_HEADINGS = range(-2, 3)
CLOSER_HEADINGS = np.radians(np.arange(-180.0, 180.0, 0.5 * STEP_DEG))
N_HEADINGS = len(CLOSER_HEADINGS)


@dataclass(frozen=True, slots=True)
class Places:
    """Places in which a scan may have been taken, the highest count first.

    Parameters
    ----------
    poses : array, shape (n, 3)
        x, y (local frame, m) and heading (rad).
    counts : array, shape (n,), int64
        Points that match there.
    left_out : float
        Share of the highest count that none of the other places reaches.
    """

    poses: NDArray[np.float64]
    counts: NDArray[np.int64]
    left_out: float

    def __len__(self) -> int:
        return len(self.poses)

    def reaching(self, share: float) -> "Places":
        """Those that reach a share of the highest count."""
        kept = self.counts >= share * self.counts.max(initial=0)
        return Places(self.poses[kept], self.counts[kept], max(self.left_out, share))

    def distinct(self, same: float, same_turn: float, most: int) -> "Places":
        """One pose of each place, the first of those within `same` (m) and `same_turn` (rad); at most `most`."""
        kept: list[int] = []
        is_left = np.ones(len(self), bool)
        for number in range(len(self)):
            if not is_left[number]:
                continue
            if len(kept) == most:
                share = float(self.counts[number] / self.counts[0])
                return Places(self.poses[kept], self.counts[kept], max(self.left_out, share))
            kept.append(number)
            others = self.poses[number:]
            away = np.hypot(others[:, 0] - others[0, 0], others[:, 1] - others[0, 1])
            turns = np.abs((others[:, 2] - others[0, 2] + np.pi) % (2.0 * np.pi) - np.pi)
            is_left[number:] &= (away > same) | (turns > same_turn)
        return Places(self.poses[kept], self.counts[kept], self.left_out)


def look_closer(scan: SieveScan, places: Places, cell: float, regions: Regions) -> Places:
    """Count the cells around places once more, in voxels of half the edge.

    Parameters
    ----------
    scan : SieveScan
        The scan, with more points than the sieve had.
    places : Places
        Middles of cells, at headings of `HEADINGS`.
    cell : float
        Edge of these cells, m.
    regions : Regions
        Of half the edge.

    Returns
    -------
    Places
        For each place the best cell around it, the first in index order; the highest count first.
    """
    from maxcon.relocalization import kernels

    if not len(places):
        return places
    around = np.array(list(product(NEAR_HEADINGS, NEAR, NEAR)))
    middles = np.round(places.poses[:, [2, 1, 0]] / [math.radians(0.5 * STEP_DEG), 0.5 * cell, 0.5 * cell])
    cells = middles.astype(np.int64)[:, None, :] + around
    cells[..., 0] = (cells[..., 0] + N_HEADINGS // 2) % N_HEADINGS
    used, heading = np.unique(cells[..., 0], return_inverse=True)
    turned = scan.turned(CLOSER_HEADINGS[used], regions.tiles.cell)
    keys, counts = cells[:, 0, 1:] // REGION, np.empty(cells.shape[:2], np.int64)
    for key_y, key_x in np.unique(keys, axis=0).tolist():
        mine = (keys == [key_y, key_x]).all(axis=1)
        region = regions.load((key_x, key_y))
        inside = cells[mine] - [0, key_y * REGION, key_x * REGION]
        inside[..., 0] = heading.reshape(counts.shape)[mine]
        found = np.empty(inside.shape[0] * inside.shape[1], np.int64)
        kernels.count_cells(
            region.voxels.facings,
            turned.layers,
            turned.columns,
            turned.facings,
            inside.reshape(-1, 3),
            region.margin,
            found,
        )
        counts[mine] = found.reshape(len(inside), -1)
    each, best = np.arange(len(cells)), np.argmax(counts, axis=1)
    heading_of_best, y, x = cells[each, best].T
    poses = np.stack(
        [(x + 0.5) * regions.tiles.cell, (y + 0.5) * regions.tiles.cell, CLOSER_HEADINGS[heading_of_best]], 1
    )
    order = np.argsort(-counts[each, best], kind="stable")
    return Places(poses[order], counts[each, best][order], places.left_out)
