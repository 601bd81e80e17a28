# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A seeded city or suburb, ray-cast by a mapping vehicle and by a car, and written in the formats of real data."""

from maxcon.simulation.campaign import simulate_campaign
from maxcon.simulation.campaign_world import CampaignWorld
from maxcon.simulation.circuit import Circuit, circuit_through
from maxcon.simulation.city import City, build_city
from maxcon.simulation.dataset import simulate
from maxcon.simulation.drive import Drive, PriorErrors, Route, drive_along, route_over_crossing
from maxcon.simulation.georeferencing import GeoreferencingErrors, draw_georeferencing_errors
from maxcon.simulation.gnss_priors import GnssErrors
from maxcon.simulation.las_classes import LasClass
from maxcon.simulation.mapped_drives import ScanEpoch
from maxcon.simulation.moving_scanner import DeskewErrors, MovingScanner
from maxcon.simulation.odometry import OdometryErrors
from maxcon.simulation.ray_caster import Hits, RayCaster
from maxcon.simulation.round_drive import RoundDriver, drive_round
from maxcon.simulation.scanner_layouts import ScannerLayout
from maxcon.simulation.scanners import Echoes, ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.simulation.street_grid import CAMPAIGN_GRID, StreetGrid
from maxcon.simulation.suburb import simulate_suburb
from maxcon.simulation.suburb_road import ResidentialRoad, draw_road
from maxcon.simulation.suburb_world import SuburbWorld
from maxcon.simulation.world import Epoch, SimulatedWorld

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
