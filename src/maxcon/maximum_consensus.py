# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maximum-consensus localization: the page to read first.

The paper's method in the order of the paper: every cell of a search space around the prior is a candidate
pose; each match of a scan point with the map adds to its cell; the cell whose matches determine the
position best is the answer.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maxcon.accumulator import Accumulator, highest
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.objectives import SINGULAR_RATIO, Helmert, Objective
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search import Multiplicity, exhaustive
from maxcon.search_space import SearchSpace

__all__ = ["MaximumConsensus"]

# Less than one full match in the least determined direction does not fix a position, nor does what a single
# wall's matches add there when their normals are 3 degrees off: sin^2 of that, of each.
LEAST_EIGENVALUE = 1.0
LEAST_EIGENVALUE_RATIO = math.sin(math.radians(3.0)) ** 2


@dataclass(frozen=True)
class MaximumConsensus:
    """Localizes scans by exhaustive search for the cell of highest score (equations (1), (2) and (6)).

    Parameters
    ----------
    space : SearchSpace
        The candidate poses around each prior; the paper's if not given.
    objective : Objective
        What a cell is worth; Helmert's point error if not given. Any object with ``score(moments)``.
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    n_threads : int
        Headings searched at the same time; the answer does not depend on it.

    Raises
    ------
    OptionError
        If the multiplicity is unknown.
    """

    space: SearchSpace = field(default_factory=SearchSpace)
    objective: Objective = field(default_factory=Helmert)
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED
    n_threads: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "multiplicity", Multiplicity.parse(self.multiplicity))

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Find the pose of a scan in the map.

        Parameters
        ----------
        scan : Scan
            Points (and normals) of one epoch, sensor frame.
        point_map : PointMap
            The map; its voxel edge is the space's cell edge.
        prior : Pose
            T_map_sensor before localization, local frame of the map.

        Returns
        -------
        Estimate
            Its `status` says whether the pose may be used.

        Raises
        ------
        SearchSpaceError
            If the cell edge is not the map's, or the space is too large.
        """
        return self.conclude(self.accumulate(scan, point_map, prior))

    def accumulate(self, scan: Scan, point_map: PointMap, prior: Pose) -> Accumulator:
        """Moments of every cell: what `conclude` decides on, and what plots show."""
        return exhaustive(
            scan, point_map, prior, self.space, multiplicity=self.multiplicity, n_threads=self.n_threads
        )

    def conclude(self, accumulator: Accumulator) -> Estimate:
        """Take the best cell of an accumulator, and say what it is worth."""
        scores = accumulator.score(self.objective)
        cell = highest(scores, accumulator.space)
        normal_matrix = accumulator.normal_matrix(cell)
        is_determined, cofactor = _invert(normal_matrix)
        if not accumulator.moments[..., 0].any():
            status = Status.NO_MATCH
        elif not is_determined:
            status = Status.UNDETERMINED
        elif accumulator.space.is_at_rim(cell):
            status = Status.AT_RIM
        else:
            status = Status.LOCALIZED
        pose = (
            accumulator.prior
            if status is Status.NO_MATCH
            else accumulator.space.pose(cell, accumulator.prior)
        )
        return Estimate(pose, float(scores[cell]), cell, status, cofactor)


def _invert(normal_matrix: NDArray[np.float64]) -> tuple[bool, NDArray[np.float64]]:
    """Whether N determines x and y, and Q = N^-1 (equation (4)); infinite variances where it is singular."""
    smallest, largest = np.linalg.eigvalsh(normal_matrix)
    if smallest <= SINGULAR_RATIO * largest:
        return False, np.diag([np.inf, np.inf])
    is_determined = smallest >= max(LEAST_EIGENVALUE, LEAST_EIGENVALUE_RATIO * largest)
    return bool(is_determined), np.asarray(np.linalg.inv(normal_matrix), dtype=np.float64)
