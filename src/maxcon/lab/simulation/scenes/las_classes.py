# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Classes of the surfaces of the simulated worlds, as codes in map clouds, and their reflectances."""

from enum import IntEnum

__all__ = ["REFLECTANCES", "LasClass"]


class LasClass(IntEnum):
    """Classes of LAS 1.4 (ASPRS); 64 and above are free for users."""

    UNCLASSIFIED = 1
    """In a suburb: fences, garden walls, bins, and the many plants that surveys leave unclassified."""
    GROUND = 2
    """Carriageway, kerbs, sidewalks and yards."""
    LOW_VEGETATION = 3
    """Grass and flower beds, below 0.5 m."""
    MEDIUM_VEGETATION = 4
    """Hedges, 0.5 to 2 m."""
    HIGH_VEGETATION = 5
    """Trees, trunk and canopy."""
    BUILDING = 6
    """Facades with their balconies, steps and rain pipes; roofs."""
    VEHICLE = 64
    """Parked cars; in the scans of a hard campaign also moving vehicles and pedestrians."""
    POLE = 65
    """Lamp poles and traffic signs."""


REFLECTANCES: dict[LasClass, float] = {
    LasClass.UNCLASSIFIED: 0.45,
    LasClass.GROUND: 0.25,
    LasClass.LOW_VEGETATION: 0.5,
    LasClass.MEDIUM_VEGETATION: 0.45,
    LasClass.HIGH_VEGETATION: 0.4,
    LasClass.BUILDING: 0.6,
    LasClass.VEHICLE: 0.35,
    LasClass.POLE: 0.7,
}
"""Part of the light that comes back from a surface hit at a right angle, 0 to 1."""
