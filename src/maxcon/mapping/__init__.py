# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""From point clouds to a map on disk."""

from maxcon.mapping.build import MapOptions, build_map

__all__ = ["MapOptions", "build_map"]
