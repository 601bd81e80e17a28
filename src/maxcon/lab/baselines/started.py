"""Methods that iterate from a start: their interface, the check of their options, and many starts (MultiStart)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import NamedOption

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Aligner(Protocol):
    """A scan and the map around it, prepared for any start near by."""

    def align(self, start: Pose) -> Estimate:
        """Return where the method ends from a start: T_map_sensor, local frame of the map."""
        ...

    def n_near_map(self, pose: Pose, distance: float) -> int:
        """Return how many points of the thinned scan lie within `distance` (m) of the map's points at a pose."""
        ...


class StartedMethod(Protocol):
    """A method whose answer depends on where it starts."""

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> Aligner:
        """Do once what all starts within `spread` (m, in x and y) of `around` share."""
        ...

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Localize a scan (its normals are not used) from the prior, T_map_sensor in the local frame of the map."""
        return self.prepare(scan, point_map, prior).align(prior)


def no_answer(start: Pose, status: Status = Status.NO_MATCH) -> Estimate:
    """Return the estimate of a method that found nothing: its start."""
    return Estimate(start, 0.0, None, status, np.diag([np.inf, np.inf]))


def check_options(method: "DataclassInstance", *may_be_zero: str) -> None:
    """Refuse numbers of a method that are not finite and above 0 (or 0, if they may be), and whole ones below 1."""
    for option in fields(method):
        value = getattr(method, option.name)
        if isinstance(option.default, int):
            is_good, wanted = value >= 1 and value == int(value), "a whole number from 1"
        elif isinstance(option.default, float):
            is_good = 0.0 < value < math.inf or (value == 0.0 and option.name in may_be_zero)
            wanted = "finite, and 0 or more" if option.name in may_be_zero else "finite, and above 0"
        else:
            continue
        if not is_good:
            raise OptionError(f"Expected `{option.name}` to be {wanted}, got {value}. The default is {option.default}.")


NEAR, SAME_HEADING = 0.3, math.radians(1.0)
"""Ends within these, m and rad, are one place; a scan point so near to the map counts for the overlap."""


class Choice(NamedOption, option="choice"):
    """Which end of many starts is the answer, and when it may be used."""

    AGREEMENT = "agreement"
    """The one with the most correspondences, the first of equal ones; it may be used if all starts ended there."""

    OVERLAP = "overlap"
    """The one that leaves the most scan points near the map; it may be used if the method itself says so."""


@dataclass(frozen=True)
class MultiStart(StartedMethod):
    """Localizes scans from a grid of starts around the prior; the default is the paper's 5 x 5 at 1 m."""

    method: StartedMethod  # what does not depend on the start is done once
    n_side: int = 5  # starts along each side of the grid
    spacing: float = 1.0  # between two of them, m
    n_headings: int = 1  # every place of the grid is tried at so many headings,
    heading_spacing_deg: float = 1.0  # so many degrees apart
    # Correspondences within a wide gate are about as many at a wrong place as at the right one: where most starts are
    # expected to fail, take `overlap`
    choice: str | Choice = Choice.AGREEMENT

    def __post_init__(self) -> None:
        object.__setattr__(self, "choice", Choice.parse(self.choice))
        check_options(self)

    def starts(self, centre: Pose) -> list[Pose]:
        """Poses around `centre`, in map axes, in the order (heading, y, x); all else is that of `centre`."""
        offsets = _steps_about_zero(self.n_side, self.spacing)
        turns = _steps_about_zero(self.n_headings, math.radians(self.heading_spacing_deg))
        return [
            replace(centre, x=centre.x + dx, y=centre.y + dy, heading=centre.heading + turn)
            for turn in turns
            for dy in offsets
            for dx in offsets
        ]

    @property
    def largest_offset(self) -> float:
        """How far from the centre the corners of the grid lie, m."""
        return math.sqrt(0.5) * self.spacing * (self.n_side - 1)

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> Aligner:
        """Do once what all starts share, those around any centre within `spread` (m) of `around`."""
        return self.method.prepare(scan, point_map, around, self.largest_offset + spread)

    def estimates(self, scan: Scan, point_map: PointMap, centre: Pose) -> list[Estimate]:
        """Return where the method ends from each start; with `overlap`, `score` counts points that end near the map."""
        aligner = self.prepare(scan, point_map, centre)
        ends = [aligner.align(start) for start in self.starts(centre)]
        if self.choice is Choice.AGREEMENT:
            return ends
        overlaps = [aligner.n_near_map(end.pose, NEAR) for end in ends]
        return [replace(end, score=float(overlap)) for end, overlap in zip(ends, overlaps, strict=True)]

    def choose(self, estimates: Sequence[Estimate]) -> Estimate:
        """Return the end with the highest score; by agreement it is `AMBIGUOUS` if not all starts ended near it."""
        best = max(estimates, key=lambda estimate: estimate.score)
        if self.choice is Choice.OVERLAP:
            return best
        agree = all(
            math.hypot(end.pose.x - best.pose.x, end.pose.y - best.pose.y) <= NEAR
            and abs(wrap_angle(end.pose.heading - best.pose.heading)) <= SAME_HEADING
            for end in estimates
        )
        return best if agree or not best.is_localized else replace(best, status=Status.AMBIGUOUS)

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Return what `choose` makes of `estimates` around the prior."""
        return self.choose(self.estimates(scan, point_map, prior))


def _steps_about_zero(n_steps: int, spacing: float) -> list[float]:
    """`n_steps` numbers, `spacing` apart, with the mean 0."""
    return [spacing * (step - 0.5 * (n_steps - 1)) for step in range(n_steps)]
