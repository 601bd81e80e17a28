# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Temporary objects: what one pass of the mapping vehicle saw and another did not, though it saw the ground there.

A pass that saw the ground under a block of space looked through the block, from wherever it was: what another pass saw
in it was gone (decision 23). Nothing is said of places that were seen in one pass only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.pass_differences import LEAST_PAUSE
from maxcon.mapping.build.sightings import STRETCH

__all__ = ["Blocks", "temporary_blocks"]

HIGHEST = 4.0
"""Above the ground, m: higher up is no car, and the ground is seen past what hangs over it."""
LEAST_SEEN = 5
"""Of nine columns around a block, in which a pass saw the ground where it looked through."""
LEAST_GONE = 3
"""Blocks within cubes of `AROUND` in which a pass saw nothing where others did."""
SHARE_GONE = 0.8
"""Of the blocks there that it looked through or saw: it was not there at all."""
AROUND = 5
"""Blocks: 1.2 m."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """What is known of the blocks over a piece of ground.

    Parameters
    ----------
    is_temporary : array, shape (layers, ny, nx), bool
        Whether what is in a block is temporary; nothing is said of layer 0, which the ground ends in.
    n_passes : array, shape (ny, nx), int64
        That saw the ground of a column.
    """

    is_temporary: NDArray[np.bool_]
    n_passes: NDArray[np.int64]


def pass_of(times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the passes that stretches of time belong to, from 0 on; times (s) in any order."""
    ticks, tick_of = np.unique(times, return_inverse=True)
    numbers = np.cumsum(np.diff(ticks, prepend=ticks[:1]) > LEAST_PAUSE + STRETCH)
    return np.asarray(numbers[tick_of], np.int64)


def temporary_blocks(
    layers: NDArray[np.int64], columns: NDArray[np.int64], times: NDArray[np.float64], shape: Sequence[int]
) -> Blocks:
    """Find what is temporary among blocks that were seen.

    Parameters
    ----------
    layers : array, shape (n,)
        Of each sighting, from that in which the ground ends on: -1 (also ground), 0, 1, ...
    columns : array, shape (n, 2)
        (x, y) of each sighting.
    times : array, shape (n,)
        s.
    shape : sequence of 3 int
        How many layers, and columns along y and x, there are. Sightings elsewhere are left out.
    """
    from scipy.ndimage import maximum_filter, uniform_filter

    n_layers, ny, nx = shape
    passes = pass_of(times)
    x, y = columns.T
    is_inside = (layers >= -1) & (layers < n_layers) & (x >= 0) & (x < nx) & (y >= 0) & (y < ny)
    layers, x, y, passes = np.maximum(layers[is_inside], 0), x[is_inside], y[is_inside], passes[is_inside]
    is_seen = np.zeros((int(passes.max(initial=-1)) + 1, n_layers, ny, nx), bool)
    is_seen[passes, layers, y, x] = True
    sees_ground = is_seen[:, 0].copy()
    is_seen[:, 0] = False
    is_occupied = is_seen.any(axis=0)
    is_gone = np.zeros(is_occupied.shape, bool)
    for seen, ground in zip(is_seen, sees_ground, strict=True):
        if not ground.any() or not (is_occupied & ~seen).any():
            continue
        n_around = uniform_filter(ground.astype(np.float64), size=3, mode="constant") * 9.0
        looks_through = ground & (n_around > LEAST_SEEN - 0.5)
        is_there = maximum_filter(seen, size=3, mode="constant", cval=False)
        gone = is_occupied & looks_through & ~is_there
        there = is_occupied & is_there
        n_gone, n_there = (
            uniform_filter(flags.astype(np.float64), size=AROUND, mode="constant") * AROUND**3
            for flags in (gone, there)
        )
        is_gone |= (n_gone > LEAST_GONE - 0.5) & (n_gone >= SHARE_GONE * (n_gone + n_there) - 1e-6)
    return Blocks(is_gone & is_occupied, sees_ground.sum(axis=0))
