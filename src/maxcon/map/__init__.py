"""The map: voxels in tiles, in memory or on disk."""

from maxcon.map.layout import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS, TileKey
from maxcon.map.point_map import PointMap
from maxcon.map.tile import VoxelTile

__all__ = ["PATCH_VOXELS", "TILE_PATCHES", "TILE_VOXELS", "PointMap", "TileKey", "VoxelTile"]
