"""Sizes and limits of a map: square tiles of square patches of voxels, its levels, and the classes of its voxels."""

import math
from enum import IntEnum

from maxcon.errors import ArrayError

TileKey = tuple[int, int]
"""(x, y) index of a tile: floor(voxel index / voxels along its edge), TILE_VOXELS or in a level fewer."""

TILE_VOXELS = 512  # voxels along the edge of a tile of the map
PATCH_VOXELS = 16  # voxels along the edge of a patch of a tile
TILE_PATCHES = TILE_VOXELS // PATCH_VOXELS  # patches along the edge of a tile of the map
WORD_BITS = 64  # bits of a word in the occupancy of a tile
MEAN_STEPS = 256  # steps of a voxel's edge in which the mean of its points is kept
NORMAL_STEPS, PRODUCT_STEPS = 127, 64
"""Steps of 1 in which a dense grid keeps the x and y of a normal, and the squared product of a normal with an axis."""
ROW_BLOCK = 64  # bytes that are read at once from a row of a dense grid: so many are behind its last voxel
CANCELLED_LENGTH = 1e-3
"""A sum of n normals shorter than n times this has no direction: both faces of a thin wall in one voxel."""
LEVEL_FACTORS = tuple(2**power for power in range(TILE_PATCHES.bit_length()))
"""How many times as large the voxels of a level may be as the map's: whole patches fill a tile."""
CELLS = (1e-4, 100.0)  # smallest and largest voxel edge of a map, m
UNKNOWN_SIGMA = 0.02
"""Sigma of a map of which it is not known, m: what a mapping vehicle's trajectory is usually good to."""


def check_sigma(sigma: float) -> None:
    """Refuse a standard deviation of a map's position (m) that is negative or not finite, by an ArrayError."""
    if not 0.0 <= sigma < math.inf:
        raise ArrayError(f"Expected `sigma` of the map >= 0 m, got {sigma}. Leave it out if you do not know it.")


class SurfaceClass(IntEnum):
    """Whether the surface in a voxel of an updated map still stands, as drives through the map have found."""

    KNOWN = 0
    """It was there when the map was built, and nothing speaks against it."""
    GONE = 1
    """It was there when the map was built; drives since then have seen through it."""
    NEW = 2
    """It was not there; drives since then have seen it."""


NOT_SEARCHED = frozenset({SurfaceClass.GONE})  # classes that a search leaves out by default
ALL_BUT_KNOWN = frozenset({SurfaceClass.GONE, SurfaceClass.NEW})
"""Classes to leave out to search the surfaces of the original map only."""
