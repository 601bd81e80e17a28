# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The small map that servers have in these tests: voxels and ground of 16 tiles."""

import numpy as np

from maxcon import PointMap
from maxcon.map.ground import GroundInMemory

CELL = 0.06
RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-40.0, 40.0, (3000, 3)) * [1, 1, 0.05]
VOXELS = PointMap.from_points(POINTS, np.tile([0.0, 1.0, 0.0], (3000, 1)), CELL)
GROUND = GroundInMemory.of_points(POINTS, CELL)
