"""From point clouds to a map on disk."""

from maxcon.mapping.build.build import build_map
from maxcon.mapping.build.options import Area, MapOptions

__all__ = ["Area", "MapOptions", "build_map"]
