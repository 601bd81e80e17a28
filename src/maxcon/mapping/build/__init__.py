# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""From point clouds to a map on disk."""

from maxcon.mapping.build.build import build_map
from maxcon.mapping.build.map_options import MapOptions
from maxcon.mapping.build.placement import Area

__all__ = ["Area", "MapOptions", "build_map"]
