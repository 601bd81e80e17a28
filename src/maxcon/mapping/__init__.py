# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""From point clouds to a map on disk."""

from maxcon.mapping.build import build_map
from maxcon.mapping.dataset_options import dataset_map_options
from maxcon.mapping.map_options import MapOptions
from maxcon.mapping.placement import Area

__all__ = ["Area", "MapOptions", "build_map", "dataset_map_options"]
