# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map: voxels in tiles, in memory or on disk."""

from maxcon.point_map.point_map import PointMap
from maxcon.point_map.tile import BLOCK_VOXELS, TILE_BLOCKS, TILE_VOXELS, TileKey, VoxelTile

__all__ = ["BLOCK_VOXELS", "TILE_BLOCKS", "TILE_VOXELS", "PointMap", "TileKey", "VoxelTile"]
