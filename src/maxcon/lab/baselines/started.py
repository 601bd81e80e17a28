# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the baselines have in common: they go from a start, and share work between the starts of one scan."""

import math
from dataclasses import fields
from typing import Any, ClassVar, Protocol, cast

from maxcon.errors import OptionError
from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan

__all__ = ["Aligner", "IteratedMethod", "StartedMethod", "check_iteration", "check_number", "check_steps"]


class Aligner(Protocol):
    """A scan and the map around it, made ready."""

    def align(self, start: Pose) -> Estimate:
        """Return where the method ends from a start: T_map_sensor, local frame of the map."""
        ...

    def n_near_map(self, pose: Pose, distance: float) -> int:
        """How many points of the thinned scan lie within `distance` (m) of the map's points at a pose."""
        ...


class StartedMethod(Protocol):
    """A method whose answer depends on where it starts."""

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> Aligner:
        """Do once what all starts share.

        scan: points of one epoch, sensor frame.
        point_map: the map.
        around: T_map_sensor, local frame of the map: the middle of the starts.
        spread: how far from it the starts lie at most, in x and y, m.
        """
        ...


def check_number(name: str, value: float, default: float, unit: str, *, may_be_zero: bool = False) -> None:
    """Refuse an option that is not a finite number above zero."""
    is_good = math.isfinite(value) and (value > 0.0 or (may_be_zero and value == 0.0))
    if not is_good:
        sign = ">=" if may_be_zero else ">"
        raise OptionError(f"Expected `{name}` {sign} 0 {unit}, got {value}. The default is {default:g}.")


def check_steps(name: str, value: int, default: int) -> None:
    """Refuse a number of steps that is not a whole number from 1."""
    if not (value >= 1 and value == int(value)):
        raise OptionError(f"Expected `{name}` to be a whole number from 1, got {value}. The default is {default}.")


class IteratedMethod(Protocol):
    """A dataclass of a method that iterates from a start, with the options that `check_iteration` checks."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def max_iterations(self) -> int:
        """Largest number of steps."""
        ...


def check_iteration(method: IteratedMethod) -> None:
    """Refuse options that all methods which iterate from a start have; defaults are those of its class."""
    defaults = {option.name: option.default for option in fields(method)}

    def check(name: str, unit: str, *, may_be_zero: bool = False) -> None:
        check_number(name, getattr(method, name), cast(float, defaults[name]), unit, may_be_zero=may_be_zero)

    check("gate", "m")
    check("thinning", "m", may_be_zero=True)
    check_steps("max_iterations", method.max_iterations, cast(int, defaults["max_iterations"]))
    check("step_tolerance", "m")
    check("turn_tolerance", "rad")
    check("target_edge", "m")
