# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How far the walls of scans lie from those of the map at their answers, by the direction that walls face."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.refine.adjustment import table_around
from maxcon.refine.patterns import Partners
from maxcon.refine.validation import LEVEL, N_BINS
from maxcon.scan import Scan


class Facing(NamedTuple):
    """Walls of one direction.

    first_deg, last_deg: the azimuths of their normals, degrees from +x, both sides of a wall alike.
    n_points: wall points of the scans; found: which ratio of them has a wall of the map beside it, 0 to 1.
    offset: median of where the map's walls lie beside the scans', along the azimuth, m; p95: of the distances, m.
    """

    first_deg: float
    last_deg: float
    n_points: int
    found: float
    offset: float
    p95: float


def facings(scans: Iterable[tuple[Scan, Pose]], point_map: PointMap) -> list[Facing]:
    """Return the facings of scans at poses, local frame, those with wall points; of each some thousand points."""
    azimuths, offsets = [np.empty(0)], [np.empty(0)]
    for scan, pose in scans:
        partners = Partners.of(scan.sample, pose, point_map, table_around(scan.sample, point_map, [pose]))
        normals = partners.normals @ pose.rotation.T
        azimuth = np.arctan2(normals[:, 1], normals[:, 0]) % np.pi
        towards = partners.planes[:, 0] * np.cos(azimuth) + partners.planes[:, 1] * np.sin(azimuth)
        is_wall = np.abs(normals[:, 2]) < LEVEL
        azimuths.append(azimuth[is_wall])
        offsets.append((partners.distances * np.where(towards < 0.0, -1.0, 1.0))[is_wall])
    bins = np.minimum(np.concatenate(azimuths) * N_BINS / np.pi, N_BINS - 1).astype(int)
    found, width = [], 180.0 / N_BINS
    for k in range(N_BINS):
        of_facing = np.concatenate(offsets)[bins == k]
        near = of_facing[np.isfinite(of_facing)]
        if len(near):
            p95, share = float(np.quantile(np.abs(near), 0.95)), len(near) / len(of_facing)
            found.append(Facing(k * width, (k + 1) * width, len(of_facing), share, float(np.median(near)), p95))
    return found
