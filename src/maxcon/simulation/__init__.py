# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A seeded city or suburb, ray-cast by a mapping vehicle and by a car, and written in the formats of real data."""

from maxcon.simulation.datasets.campaign import simulate_campaign
from maxcon.simulation.datasets.dataset import simulate
from maxcon.simulation.datasets.suburb import simulate_suburb
from maxcon.simulation.drive import Drive, Route, drive_along
from maxcon.simulation.driving.circuit import Circuit, circuit_through
from maxcon.simulation.driving.crossing_route import route_over_crossing
from maxcon.simulation.driving.georeferencing import GeoreferencingErrors, draw_georeferencing_errors
from maxcon.simulation.driving.gnss_priors import GnssErrors
from maxcon.simulation.driving.odometry import OdometryErrors
from maxcon.simulation.driving.prior_errors import PriorErrors
from maxcon.simulation.driving.round_drive import RoundDriver, drive_round
from maxcon.simulation.scenes.city import City, build_city
from maxcon.simulation.scenes.las_classes import LasClass
from maxcon.simulation.scenes.street_grid import CAMPAIGN_GRID, StreetGrid
from maxcon.simulation.scenes.suburb_road import ResidentialRoad, draw_road
from maxcon.simulation.sensing.moving_scanner import DeskewErrors, MovingScanner
from maxcon.simulation.sensing.ray_caster import Hits, RayCaster
from maxcon.simulation.sensing.scanner_layouts import ScannerLayout
from maxcon.simulation.sensing.scanners import (
    Echoes,
    ProfileScanner,
    RotatingScanner,
    mobile_mapping_scanners,
)
from maxcon.simulation.worlds.campaign_world import CampaignWorld
from maxcon.simulation.worlds.scan_epochs import ScanEpoch
from maxcon.simulation.worlds.suburb_world import SuburbWorld
from maxcon.simulation.worlds.world import Epoch, SimulatedWorld

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
