# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Height, roll and pitch from the ground: where a scan's ground lies on that of the map (decision 17)."""

from maxcon.refine.ground.levelling import GroundFit, fit_ground

__all__ = ["GroundFit", "fit_ground"]
