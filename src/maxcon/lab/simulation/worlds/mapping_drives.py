# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MappingDrives: the drives of the mapping vehicle, and what is measured on them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.driving.georeferencing import GeoreferencingErrors
from maxcon.lab.simulation.sensing.ray_caster import RayCaster
from maxcon.lab.simulation.sensing.scanners import Echoes, ProfileScanner
from maxcon.lab.simulation.worlds.map_pieces import drive_poses, map_echoes, map_pieces

__all__ = ["MAP_HEIGHT", "MAP_START", "PAUSE", "MappingDrives"]

MAP_START = 300_000.0
"""When the mapping vehicle sets out, seconds of the GPS week."""
PAUSE = 60.0
"""From the end of one of its drives to the start of the next, s."""
MAP_HEIGHT = 2.4
"""Of its profile scanners above the carriageway, m."""


@dataclass(frozen=True, slots=True, eq=False)
class MappingDrives:
    """The drives of the mapping vehicle, before anything is measured on them.

    caster: the scene on the day of the map.
    drives: true drives, one after the other.
    seed: of the scanners' noise.
    georeferencing: errors of the vehicle's post-processed trajectory, and so of the map; none if None.
    """

    caster: RayCaster
    drives: tuple[Drive, ...]
    seed: Sequence[int]
    georeferencing: GeoreferencingErrors | None = None

    def n_pieces(self, scanners: Sequence[ProfileScanner]) -> int:
        """How many pieces `echoes` yields."""
        return len(map_pieces(self.drives, scanners))

    def echoes(self, scanners: Sequence[ProfileScanner]) -> Iterator[Echoes]:
        """Measure the map piece by piece, in order of time, placed by the vehicle's trajectory with its errors."""
        for echoes in map_echoes(self.caster, map_pieces(self.drives, scanners), self.seed):
            if self.georeferencing is None:
                yield echoes
            else:
                offsets = self.georeferencing.at(echoes.times)
                yield echoes._replace(points=echoes.points + offsets, origins=echoes.origins + offsets)

    def poses(self) -> tuple[NDArray[np.float64], list[Pose]]:
        """Times (s) and poses (T_city_vehicle) of the mapping vehicle, with the errors of its trajectory."""
        times, poses = drive_poses(self.drives)
        if self.georeferencing is None:
            return times, poses
        offsets = self.georeferencing.at(times)
        return times, [pose.translated(offset) for pose, offset in zip(poses, offsets, strict=True)]
