# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Levels of prior errors, and the methods compared at a level, which know it."""

import math
from collections.abc import Sequence

import numpy as np

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MapTargets, MultiStart
from maxcon.lab.simulation import PriorErrors
from maxcon.lab.study.methods import StudyMethod
from maxcon.localizer import MaximumConsensus
from maxcon.search.space import SearchSpace

__all__ = [
    "COUNT_THEN_GICP",
    "GICP_FROM_MANY",
    "LEVELS",
    "MAXCON",
    "methods_at",
    "parse_level",
    "prior_at",
    "prior_level",
    "space_of",
]

MAXCON, COUNT_THEN_GICP, GICP_FROM_MANY = "maxcon", "count 1 m, then GICP", "GICP from 75 starts"
"""Names among `methods_at`: of what searches the level; the last takes longest."""


def prior_level(offset: float, heading_deg: float) -> PriorErrors:
    """Return the level of priors wrong by up to `offset` (m) in x and in y and by up to `heading_deg` (degrees).

    Height, roll and pitch are those of the reference.
    """
    return PriorErrors(offset, heading_deg, z=0.0, tilt_deg=0.0)


LEVELS = tuple(
    prior_level(*level) for level in ((1.0, 1.0), (3.0, 2.0), (6.0, 5.0), (12.0, 10.0), (18.0, 15.0), (25.0, 20.0))
)
"""From a good satellite fix to one between high houses, and a heading that was kept by dead reckoning."""


def parse_level(word: str) -> PriorErrors:
    """Return the level of a word such as 12:10, metres and degrees."""
    try:
        offset, heading_deg = (float(number) for number in word.split(":"))
    except ValueError:
        offset, heading_deg = math.nan, math.nan
    if not (0.0 < offset < math.inf and 0.0 < heading_deg <= 180.0):
        raise OptionError(
            f"Expected a level as METRES:DEGREES, both above 0, of at most 180 degrees, got {word!r}."
            " Write 12:10 for 12 m and 10 degrees."
        )
    return prior_level(offset, heading_deg)


def prior_at(reference: Pose, level: PriorErrors, seed: int, epoch: int) -> Pose:
    """Draw the prior of an epoch: the same at every call, whatever else was drawn before.

    reference: the pose held for true.
    level: how far off it may be.
    seed, epoch: from 0.
    """
    millis = (round(1e3 * level.offset), round(1e3 * level.heading_deg))
    return level.prior(reference, np.random.default_rng((seed, epoch, *millis)))


def space_of(level: PriorErrors) -> SearchSpace:
    """Return the search space of a level."""
    return SearchSpace(half_width=level.offset, heading_half_width_deg=level.heading_deg)


def methods_at(level: PriorErrors, gates: Sequence[float] = (1.0, 3.0, 6.0)) -> list[StudyMethod]:
    """Return maximum consensus and the methods it is compared with; those that search a window get the level's.

    level: how wrong the priors are.
    gates: of registration from one start, m; ICP has all but those above 3.
    Returns maximum consensus has all its defaults and the standard map. The peers get the ground too: it holds height
        and tilt, which GICP solves for, and ICP is right more often with it (docs/prior_error.md).
    """
    targets = MapTargets()
    # Seventy-five starts of a scan thinned as usual take seconds; coarser, they end at the same places.
    quick = Gicp(3.0, thinning=2.0, step_tolerance=0.02, turn_tolerance=5e-3, targets=targets)
    many = MultiStart(
        quick,
        n_side=5,
        spacing=2.0 * level.offset / 5,
        n_headings=3,
        heading_spacing_deg=2.0 * level.heading_deg / 3,
        choice="overlap",
    )
    count = CountThenGicp(level.offset, level.heading_deg, gicp=Gicp(3.0, targets=targets))
    found = [
        StudyMethod(MAXCON, MaximumConsensus(space_of(level))),
        StudyMethod(COUNT_THEN_GICP, count, "ground"),
        StudyMethod(GICP_FROM_MANY, many, "ground"),
    ]
    found += [StudyMethod(f"GICP, gate {gate:g} m", Gicp(gate, targets=targets), "ground") for gate in gates]
    return found + [
        StudyMethod(f"ICP, gate {gate:g} m", Icp(gate=gate, targets=targets), "ground") for gate in gates if gate <= 3.0
    ]
