# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How a map is laid out: in square tiles, of square patches, of voxels whose means are kept in steps."""

__all__ = ["MEAN_STEPS", "PATCH_VOXELS", "TILE_PATCHES", "TILE_VOXELS", "WORD_BITS", "TileKey"]

TileKey = tuple[int, int]
"""(x, y) index of a tile: floor(voxel index / voxels along its edge), TILE_VOXELS or in a level fewer."""

TILE_VOXELS = 512
"""Voxels along the edge of a tile of the map."""
PATCH_VOXELS = 16
"""Voxels along the edge of a patch of a tile."""
TILE_PATCHES = TILE_VOXELS // PATCH_VOXELS
"""Patches along the edge of a tile of the map."""
WORD_BITS = 64
"""Bits of a word in the occupancy of a tile."""
MEAN_STEPS = 256
"""Steps of a voxel's edge in which the mean of its points is kept."""
