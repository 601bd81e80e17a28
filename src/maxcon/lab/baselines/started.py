# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Methods that iterate from a start: their interface, and how their options are declared and checked."""

import math
from dataclasses import Field, field, fields
from typing import Any, ClassVar, Protocol

import numpy as np

from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan


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
        """Localize a scan (its normals are not used) from the prior, T_map_sensor in the local frame of the map.

        MissingExtraError if small_gicp is needed and not installed.
        """
        return self.prepare(scan, point_map, prior).align(prior)


def no_answer(start: Pose, status: Status = Status.NO_MATCH) -> Estimate:
    """Return the estimate of a method that found nothing: its start."""
    return Estimate(start, 0.0, None, status, np.diag([np.inf, np.inf]))


def number(default: float, unit: str, *, may_be_zero: bool = False) -> Any:
    """Return the field of an option that is a finite number of a unit, above zero."""
    return field(default=default, metadata={"unit": unit, "may_be_zero": may_be_zero})


def whole_number(default: int, least: int = 1) -> Any:
    """Return the field of an option that is a whole number, from `least`."""
    return field(default=default, metadata={"least": least})


class _WithOptions(Protocol):
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


def check_options(method: _WithOptions) -> None:
    """Refuse options, fields made by `number` and `whole_number`, that are out of their range; OptionError."""
    for option in fields(method):
        value, limits = getattr(method, option.name), option.metadata
        if "unit" in limits:
            sign = ">=" if limits["may_be_zero"] else ">"
            is_good = math.isfinite(value) and (value > 0.0 or (limits["may_be_zero"] and value == 0.0))
            wanted = f"{sign} 0 {limits['unit']}"
        elif "least" in limits:
            is_good = value >= limits["least"] and value == int(value)
            wanted = f"to be a whole number from {limits['least']}"
        else:
            continue
        if not is_good:
            raise OptionError(f"Expected `{option.name}` {wanted}, got {value}. The default is {option.default:g}.")
