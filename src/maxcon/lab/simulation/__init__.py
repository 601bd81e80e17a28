# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A seeded city or suburb, ray-cast by a mapping vehicle and by a car, and written in the formats of real data."""

from maxcon.lab.simulation.campaign_world import CampaignWorld
from maxcon.lab.simulation.city import City, build_city
from maxcon.lab.simulation.drive import Drive, Route, drive_along
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.measured_poses import GnssErrors, OdometryErrors, PriorErrors
from maxcon.lab.simulation.passes import GeoreferencingErrors, RoundDriver, draw_georeferencing_errors, drive_round
from maxcon.lab.simulation.ray_caster import Hits, RayCaster
from maxcon.lab.simulation.scanners import (
    DeskewErrors,
    Echoes,
    MovingScanner,
    ProfileScanner,
    RotatingScanner,
    ScannerLayout,
    mobile_mapping_scanners,
)
from maxcon.lab.simulation.simulated_datasets import simulate, simulate_campaign, simulate_suburb
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, Circuit, StreetGrid, circuit_through, route_over_crossing
from maxcon.lab.simulation.suburb_ground import ResidentialRoad, draw_road
from maxcon.lab.simulation.suburb_world import SuburbWorld
from maxcon.lab.simulation.world import Epoch, ScanEpoch, SimulatedWorld

__all__ = [
    "CAMPAIGN_GRID",
    "CampaignWorld",
    "Circuit",
    "City",
    "DeskewErrors",
    "Drive",
    "Echoes",
    "Epoch",
    "GeoreferencingErrors",
    "GnssErrors",
    "Hits",
    "LasClass",
    "MovingScanner",
    "OdometryErrors",
    "PriorErrors",
    "ProfileScanner",
    "RayCaster",
    "ResidentialRoad",
    "RotatingScanner",
    "RoundDriver",
    "Route",
    "ScanEpoch",
    "ScannerLayout",
    "SimulatedWorld",
    "StreetGrid",
    "SuburbWorld",
    "build_city",
    "circuit_through",
    "draw_georeferencing_errors",
    "draw_road",
    "drive_along",
    "drive_round",
    "mobile_mapping_scanners",
    "route_over_crossing",
    "simulate",
    "simulate_campaign",
    "simulate_suburb",
]
