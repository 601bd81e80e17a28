# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A seeded city, ray-cast by a mapping vehicle and by a car, so that a demo walks the road of real data."""

from maxcon.simulation.city import City, build_city
from maxcon.simulation.dataset import simulate
from maxcon.simulation.drive import Drive, PriorErrors, Route, drive_along, route_over_crossing
from maxcon.simulation.las_classes import LasClass
from maxcon.simulation.ray_caster import Hits, RayCaster
from maxcon.simulation.scanners import Echoes, ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.simulation.world import Epoch, SimulatedWorld

__all__ = [
    "City",
    "Drive",
    "Echoes",
    "Epoch",
    "Hits",
    "LasClass",
    "PriorErrors",
    "ProfileScanner",
    "RayCaster",
    "RotatingScanner",
    "Route",
    "SimulatedWorld",
    "build_city",
    "drive_along",
    "mobile_mapping_scanners",
    "route_over_crossing",
    "simulate",
]
