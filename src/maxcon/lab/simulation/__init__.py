"""A seeded city or suburb, ray-cast by a mapping vehicle and by a car, and written in the formats of real data."""

from maxcon.lab.simulation.datasets import simulate, simulate_campaign, simulate_suburb
from maxcon.lab.simulation.drive import Carrier, PriorErrors
from maxcon.lab.simulation.scanners import ScannerLayout

__all__ = ["Carrier", "PriorErrors", "ScannerLayout", "simulate", "simulate_campaign", "simulate_suburb"]
