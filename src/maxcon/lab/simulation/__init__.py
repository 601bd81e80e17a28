# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A seeded city or suburb, ray-cast by a mapping vehicle and by a car, and written in the formats of real data."""

from maxcon.lab.simulation.city import City, build_city
from maxcon.lab.simulation.datasets import simulate, simulate_campaign, simulate_suburb
from maxcon.lab.simulation.drive import (
    Circuit,
    Drive,
    GeoreferencingErrors,
    OdometryErrors,
    PriorErrors,
    RoundDriver,
    Route,
    draw_georeferencing_errors,
    draw_gnss_errors,
    drive_along,
    drive_round,
)
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.scanners import (
    MAPPING_SCANNERS,
    DeskewErrors,
    Hits,
    ProfileScanner,
    RayCaster,
    Returns,
    RotatingScanner,
    ScannerLayout,
    scan_moving,
)
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, StreetGrid, circuit_through, route_over_crossing
from maxcon.lab.simulation.suburb_ground import ResidentialRoad, draw_road
from maxcon.lab.simulation.worlds import CampaignWorld, Epoch, SimulatedWorld, SuburbWorld, World

__all__ = [
    "CAMPAIGN_GRID", "MAPPING_SCANNERS", "CampaignWorld", "Circuit", "City", "DeskewErrors", "Drive", "Epoch",
    "GeoreferencingErrors", "Hits", "LasClass", "OdometryErrors", "PriorErrors", "ProfileScanner", "RayCaster",
    "ResidentialRoad", "Returns", "RotatingScanner", "RoundDriver", "Route", "ScannerLayout", "SimulatedWorld",
    "StreetGrid", "SuburbWorld", "World", "build_city", "circuit_through", "draw_georeferencing_errors",
    "draw_gnss_errors", "draw_road", "drive_along", "drive_round", "route_over_crossing", "scan_moving", "simulate",
    "simulate_campaign", "simulate_suburb",
]  # fmt: skip
