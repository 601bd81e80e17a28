# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""SurfaceClass: whether the surface in a voxel still stands, as drives through the map have found (decision 31)."""

from enum import IntEnum

__all__ = ["ALL_BUT_KNOWN", "NOT_SEARCHED", "SurfaceClass"]


class SurfaceClass(IntEnum):
    """State of the surface in a voxel of a map that was updated."""

    KNOWN = 0
    """It was there when the map was built, and nothing speaks against it."""
    GONE = 1
    """It was there when the map was built; drives since then have seen through it."""
    NEW = 2
    """It was not there; drives since then have seen it."""


NOT_SEARCHED = frozenset({SurfaceClass.GONE})
"""Classes that a search leaves out by default."""
ALL_BUT_KNOWN = frozenset({SurfaceClass.GONE, SurfaceClass.NEW})
"""Classes to leave out to search the surfaces of the original map only."""
