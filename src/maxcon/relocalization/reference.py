# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The coarse filter as it is defined: every cell of every region at every heading, one after the other (D7)."""

import numpy as np
from numpy.typing import NDArray

from maxcon.relocalization.coarse_map import REGION, Region, Regions
from maxcon.relocalization.coarse_scan import HEADINGS, CandidateCells, CoarseScan


def counts_of_region(scan: CoarseScan, region: Region, cell: float) -> NDArray[np.int32]:
    """Points that match at each heading and cell of a region, shape (headings, REGION, REGION).

    Cells in which no scanner may stand have -1. A point matches where the voxel that it falls in has its orientation
    bin. The scanner stands in the middle of the cell.
    """
    turned = scan.turned(HEADINGS, cell)
    counts = np.zeros((len(HEADINGS), REGION, REGION), np.int32)
    for heading in range(len(HEADINGS)):
        columns = turned.columns[heading] + region.margin
        for layer, (x, y), bit in zip(turned.layers, columns, turned.bins[heading], strict=True):
            counts[heading] += (region.voxels.bins[layer, y : y + REGION, x : x + REGION] & (1 << int(bit))) != 0
    counts[:, ~region.is_allowed] = -1
    return counts


def filter_cells(scan: CoarseScan, regions: Regions, ratio: float) -> CandidateCells:
    """Find every cell whose count reaches a ratio of the highest one, by counting all."""
    counts = {key: counts_of_region(scan, regions.load(key), regions.tiles.cell) for key in regions.keys}
    best = max((int(each.max()) for each in counts.values()), default=0)
    cells, scores = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    if best > 0:
        for (key_x, key_y), each in counts.items():
            reaching = np.argwhere(each >= ratio * best)
            cells.append(reaching + np.array([0, key_y * REGION, key_x * REGION]))
            scores.append(each[tuple(reaching.T)].astype(np.int64))
    return CandidateCells.sorted(np.concatenate(cells), np.concatenate(scores), ratio)
