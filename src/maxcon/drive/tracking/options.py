# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a tracker asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maxcon.errors import OptionError

__all__ = ["TrackingOptions"]


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """What the tracker asks for before it calls a pose localized.

    Parameters
    ----------
    sigmas : float
        A scan is searched within so many standard deviations of the prediction.
    largest_sigma : float
        Of a position, in the direction that is known worst, m: a pose known less well is not called localized.
    least_agreement : float
        Before a place is called localized, the matched shares of the scans that agreed with it have to add up to this:
        half a scan, which takes two scans that match by 25 %, or five that match by 10 %.
    check_distance : float
        Every so many metres the whole search space is looked at for a place that fits better.
    patience : float
        A track that stays outside of the prior's search space for so many metres is lost. A single motion as long is a
        gap, after which scans have to agree anew.

    Raises
    ------
    OptionError
        If a number is not above 0.
    """

    sigmas: float = 3.0
    largest_sigma: float = 0.1
    least_agreement: float = 0.5
    check_distance: float = 3.0
    patience: float = 20.0

    def __post_init__(self) -> None:
        for name in ("sigmas", "largest_sigma", "least_agreement", "check_distance", "patience"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise OptionError(
                    f"Expected `{name}` above 0, got {value}. The default is {getattr(TrackingOptions(), name)}."
                )
