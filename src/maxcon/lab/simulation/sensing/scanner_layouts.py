# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ScannerLayout: rotating scanners that are on the market, with the elevations of their layers."""

import numpy as np

from maxcon.lab.simulation.sensing.scanners import RotatingScanner
from maxcon.search.options import NamedOption

__all__ = ["ScannerLayout"]

VLP_32C_DEG = (
    -25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667, -2.333,
    -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0,
    10.333, 15.0,
)  # fmt: skip
"""Elevations of the layers: half of them within 2.3 degrees of the horizon."""
HDL_64E_DEG = tuple(np.concatenate([np.linspace(-24.33, -8.83, 32), np.linspace(-8.33, 2.0, 32)]).round(3).tolist())
"""Elevations of the layers: two blocks of 32, the lower with steps of 1/2 degree, the upper of 1/3 degree."""


class ScannerLayout(NamedOption, option="scanner"):
    """A scanner by its product name, turning ten times a second."""

    VLP_16 = "vlp-16"
    VLP_32C = "vlp-32c"
    HDL_64E = "hdl-64e"
    OS1_64 = "os1-64"

    def scanner(self) -> RotatingScanner:
        """Return the scanner with the elevations, columns and ranges of its data sheet."""
        match self:
            case ScannerLayout.VLP_16:
                return RotatingScanner()
            case ScannerLayout.VLP_32C:
                return RotatingScanner(max_range=200.0, elevations_deg=VLP_32C_DEG)
            case ScannerLayout.HDL_64E:
                return RotatingScanner(
                    azimuth_step_deg=360.0 / 2083, noise=0.02, max_range=120.0, elevations_deg=HDL_64E_DEG
                )
            case ScannerLayout.OS1_64:
                return RotatingScanner(
                    n_layers=64,
                    lowest_deg=-22.5,
                    highest_deg=22.5,
                    azimuth_step_deg=360.0 / 1024,
                    min_range=0.5,
                    max_range=120.0,
                )
