# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the baselines have in common: they go from a start, and share work between the starts of one scan."""

import math
from typing import Protocol

from maxcon.errors import OptionError
from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.point_map import PointMap
from maxcon.scan import Scan

__all__ = ["Aligner", "StartedMethod", "check_number", "check_steps"]


class Aligner(Protocol):
    """A scan and the map around it, made ready."""

    def align(self, start: Pose) -> Estimate:
        """Return where the method ends from a start: T_map_sensor, local frame of the map."""
        ...


class StartedMethod(Protocol):
    """A method whose answer depends on where it starts."""

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> Aligner:
        """Do once what all starts share.

        Parameters
        ----------
        scan : Scan
            Points of one epoch, sensor frame.
        point_map : PointMap
            The map.
        around : Pose
            T_map_sensor, local frame of the map: the middle of the starts.
        spread : float
            How far from it the starts lie at most, in x and y, m.
        """
        ...


def check_number(name: str, value: float, default: float, unit: str, *, may_be_zero: bool = False) -> None:
    """Refuse an option that is not a finite number above zero.

    Raises
    ------
    OptionError
        If it is not.
    """
    is_good = math.isfinite(value) and (value > 0.0 or (may_be_zero and value == 0.0))
    if not is_good:
        sign = ">=" if may_be_zero else ">"
        raise OptionError(f"Expected `{name}` {sign} 0 {unit}, got {value}. The default is {default:g}.")


def check_steps(name: str, value: int, default: int) -> None:
    """Refuse a number of steps that is not a whole number from 1.

    Raises
    ------
    OptionError
        If it is not.
    """
    if not (value >= 1 and value == int(value)):
        raise OptionError(
            f"Expected `{name}` to be a whole number from 1, got {value}. The default is {default}."
        )
