# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A seeded city or suburb, ray-cast by a mapping vehicle and by a car, and written in the formats of real data."""

from maxcon.lab.simulation.datasets.campaign import simulate_campaign
from maxcon.lab.simulation.datasets.dataset import simulate
from maxcon.lab.simulation.datasets.suburb import simulate_suburb
from maxcon.lab.simulation.drive import Drive, Route, drive_along
from maxcon.lab.simulation.driving.circuit import Circuit, circuit_through
from maxcon.lab.simulation.driving.crossing_route import route_over_crossing
from maxcon.lab.simulation.driving.georeferencing import GeoreferencingErrors, draw_georeferencing_errors
from maxcon.lab.simulation.driving.gnss_priors import GnssErrors
from maxcon.lab.simulation.driving.odometry import OdometryErrors
from maxcon.lab.simulation.driving.prior_errors import PriorErrors
from maxcon.lab.simulation.driving.round_drive import RoundDriver, drive_round
from maxcon.lab.simulation.scenes.city import City, build_city
from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.street_grid import CAMPAIGN_GRID, StreetGrid
from maxcon.lab.simulation.scenes.suburb_road import ResidentialRoad, draw_road
from maxcon.lab.simulation.sensing.moving_scanner import DeskewErrors, MovingScanner
from maxcon.lab.simulation.sensing.ray_caster import Hits, RayCaster
from maxcon.lab.simulation.sensing.scanner_layouts import ScannerLayout
from maxcon.lab.simulation.sensing.scanners import Echoes, ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.lab.simulation.worlds.campaign_world import CampaignWorld
from maxcon.lab.simulation.worlds.scan_epochs import ScanEpoch
from maxcon.lab.simulation.worlds.suburb_world import SuburbWorld
from maxcon.lab.simulation.worlds.world import Epoch, SimulatedWorld

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
