# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of an alignment of rounds."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from maxcon.errors import OptionError
from maxcon.mapping.align.pose_graph import Georeference
from maxcon.mapping.build.classes import parse_classes

__all__ = ["AlignmentOptions"]

DEFAULT_DROP = ("vegetation", "noise", "temporal-exclusion")
"""Classes without a firm surface, or that change from round to round. Ground determines height, roll and pitch."""


@dataclass(frozen=True, slots=True)
class AlignmentOptions:
    """How rounds are aligned.

    Parameters
    ----------
    rounds_by : str
        What tells rounds apart: "time", by pauses in gps_time; "source", by point source ids; "file".
    pause : float
        Seconds without a point that separate two rounds, where times tell rounds apart.
    georeference_sigma : float
        How well each round is georeferenced: standard deviation of its position along any axis, m.
    georeference_sigma_deg : float
        The same of its roll, pitch and heading, degrees.
    drift_sigma : float or None
        Standard deviation, m, of how a round's errors change within it, along any axis; 0 for rigid rounds, None to let
        the matches decide.
    knot_spacing : float
        Largest time between two knots of a round that drifts, s; corrections are interpolated between knots.
    drop : sequence of str, optional
        Classes that are not matched (they are moved like all others); vegetation, noise, temporal exclusion if None.
    vehicle_classes : iterable of int
        Class numbers that mean vehicles: not matched either.
    crs : str, optional
        CRS of clouds that name none.

    Raises
    ------
    OptionError
        If a number is out of range.
    """

    rounds_by: str = "time"
    pause: float = 20.0
    georeference_sigma: float = 0.1
    georeference_sigma_deg: float = 0.05
    drift_sigma: float | None = None
    knot_spacing: float = 10.0
    drop: Sequence[str] | None = None
    vehicle_classes: Iterable[int] = ()
    crs: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle_classes", tuple(self.vehicle_classes))
        for name in ("pause", "georeference_sigma", "georeference_sigma_deg"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise OptionError(f"Expected `{name}` above 0, got {value}.")
        if not 1.0 <= self.knot_spacing < math.inf:
            raise OptionError(f"Expected `knot_spacing` of 1 s or more, got {self.knot_spacing}. The default is 10.")
        if self.drift_sigma is not None and not 0.0 <= self.drift_sigma < math.inf:
            raise OptionError(f"Expected `drift_sigma` of 0 m or more, got {self.drift_sigma}. 0 is for rigid rounds.")

    @property
    def georeference(self) -> Georeference:
        """The prior of each round."""
        return Georeference(self.georeference_sigma, math.radians(self.georeference_sigma_deg))

    def dropped_classes(self) -> frozenset[int]:
        """Class numbers that are not matched."""
        named = parse_classes(DEFAULT_DROP if self.drop is None else self.drop, self.vehicle_classes)
        return named | parse_classes([str(number) for number in self.vehicle_classes])
