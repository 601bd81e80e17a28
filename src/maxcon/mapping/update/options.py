# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of a map update: which scans are observations, what they add, and when a surface is gone or new."""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.io.scans import check_range

_BOUNDS: tuple[tuple[str, Callable[[float], bool], tuple[str, ...]], ...] = (
    ("a number above 0", lambda value: value > 0.0, ("reach", "sigma_range", "sigmas", "hit", "highest", "new_at")),
    (
        "a number >= 0",
        lambda value: value >= 0.0,
        ("least_motion", "sigma_position", "sigma_angle_deg", "least_time", "start"),
    ),
    ("a number below 0", lambda value: value < 0.0, ("miss", "lowest", "gone_at")),
    ("a number above 0 and up to 1", lambda value: 0.0 < value <= 1.0, ("least_cosine", "least_share")),
    ("at least 1", lambda value: value >= 1, ("least_looks", "least_voxels")),
)


@dataclass(frozen=True, slots=True)
class UpdateOptions:
    """Which scans are observations, how they are weighed, and when a surface is gone or new.

    OptionError if a value is out of its range.

    Parameters
    ----------
    min_range, max_range : float
        Points nearer or farther than this are left out, m.
    reach : float
        Surfaces farther from the sensor than this are not judged, m: an angle of 0.1 degrees is 5 cm at 30 m.
    least_motion : float
        An epoch is an observation of its own where the sensor has moved so far since the last one, m: while it stands,
        its rays say the same again and again.
    sigma_range : float
        Standard deviation of a range, m.
    sigma_position : float
        Standard deviation of a pose along any axis, m, where the table of poses has none.
    sigma_angle_deg : float
        The same of its angles, degrees.
    sigmas : float
        A ray misses a surface if it ended so many standard deviations behind it.
    least_cosine : float
        Cosine of the angle between a ray and the normal of a surface; flatter rays are no evidence.
    hit, miss : float
        Log-odds that an observation adds to a surface that it hit, and to one that it missed.
    start : float
        Log-odds of a surface of the map before the first observation; new ones begin at 0.
    lowest, highest : float
        Log-odds are kept between these: what was seen a hundred times can change within a few observations.
    gone_at : float
        A surface of the map is gone if the log-odds are at most this, in the mean over its neighbourhood, too.
    new_at : float
        A surface that the map does not have is new if they are at least this.
    least_looks : int
        Fewest observations for either.
    least_time : float
        From the first to the last hit of a new surface, s, where a single drive saw it: what passes is not new.
    least_share : float
        A neighbourhood is gone if at least this ratio of the observations of it missed it.
    least_voxels : int
        A neighbourhood has at least so many voxels that changed the same way: single ones are noise.
    """

    min_range: float = 1.0
    max_range: float = 120.0
    reach: float = 30.0
    least_motion: float = 0.5
    sigma_range: float = 0.03
    sigma_position: float = 0.03
    sigma_angle_deg: float = 0.1
    sigmas: float = 3.0
    least_cosine: float = 0.1
    hit: float = 0.85
    miss: float = -0.4
    start: float = 0.4
    lowest: float = -2.0
    highest: float = 3.5
    gone_at: float = -0.3
    new_at: float = 1.7
    least_looks: int = 2
    least_time: float = 1.0
    least_share: float = 0.7
    least_voxels: int = 6

    def __post_init__(self) -> None:
        for field in fields(self):
            if not math.isfinite(getattr(self, field.name)):
                raise self._refused(field.name, "a finite number")
        for expected, is_valid, names in _BOUNDS:
            for name in names:
                if not is_valid(getattr(self, name)):
                    raise self._refused(name, expected)
        if not (self.lowest <= self.gone_at and self.new_at <= self.highest):
            raise self._refused("gone_at", "at least `lowest`, and `new_at` at most `highest`")
        check_range(self.min_range, self.max_range)

    def _refused(self, name: str, expected: str) -> OptionError:
        return OptionError(
            f"Expected `{name}` of an update to be {expected}, got {getattr(self, name)}. Leave it out for the default."
        )

    def margins(
        self, sigma_position: float | None, sigma_angle: float | None, sigma_map: float, distances: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How far behind a surface rays must end to be a miss of it, m.

        `sigma_position`, `sigma_angle`: standard deviations of the pose along any axis, m, and about any, rad; those of
        the options if None; `sigma_map`: of the position of the map's surfaces, m; `distances` (n,): how far from the
        sensor the rays ended, m.
        """
        position = self.sigma_position if sigma_position is None else sigma_position
        angle = math.radians(self.sigma_angle_deg) if sigma_angle is None else sigma_angle
        variances = self.sigma_range**2 + position**2 + sigma_map**2 + (angle * distances) ** 2
        return np.asarray(self.sigmas * np.sqrt(variances))
