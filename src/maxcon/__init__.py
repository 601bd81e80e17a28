# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maximum-consensus localization of LiDAR scans in dense point-cloud maps.

The names below are the public face; they are loaded when first used, so that ``import maxcon`` and
``maxcon --help`` stay instant.
"""

import importlib
from typing import TYPE_CHECKING, Any

from maxcon.version import __version__

if TYPE_CHECKING:
    from maxcon import search
    from maxcon.accumulator import Accumulator
    from maxcon.errors import MaxconError
    from maxcon.estimate import Estimate, Status
    from maxcon.geometry import LocalFrame, Pose
    from maxcon.integrity import Trust
    from maxcon.maximum_consensus import MaximumConsensus
    from maxcon.objectives import Count, Helmert, MaxEigenvalue, Objective
    from maxcon.point_map import PointMap
    from maxcon.scan import Scan
    from maxcon.search import Multiplicity, Weighting
    from maxcon.search_space import SearchSpace
    from maxcon.tracking import Motion, MotionNoise, Tracker, TrackingOptions, UncertainPose
    from maxcon.trajectory import Trajectory

__all__ = [
    "Accumulator",
    "Count",
    "Estimate",
    "Helmert",
    "LocalFrame",
    "MaxEigenvalue",
    "MaxconError",
    "MaximumConsensus",
    "Motion",
    "MotionNoise",
    "Multiplicity",
    "Objective",
    "PointMap",
    "Pose",
    "Scan",
    "SearchSpace",
    "Status",
    "Tracker",
    "TrackingOptions",
    "Trajectory",
    "Trust",
    "UncertainPose",
    "Weighting",
    "__version__",
    "search",
]

_HOME = {
    "Accumulator": "maxcon.accumulator",
    "Count": "maxcon.objectives",
    "Estimate": "maxcon.estimate",
    "Helmert": "maxcon.objectives",
    "LocalFrame": "maxcon.geometry",
    "MaxEigenvalue": "maxcon.objectives",
    "MaxconError": "maxcon.errors",
    "MaximumConsensus": "maxcon.maximum_consensus",
    "Motion": "maxcon.tracking",
    "MotionNoise": "maxcon.tracking",
    "Multiplicity": "maxcon.search",
    "Objective": "maxcon.objectives",
    "PointMap": "maxcon.point_map",
    "Pose": "maxcon.geometry",
    "Scan": "maxcon.scan",
    "SearchSpace": "maxcon.search_space",
    "Status": "maxcon.estimate",
    "Tracker": "maxcon.tracking",
    "TrackingOptions": "maxcon.tracking",
    "Trajectory": "maxcon.trajectory",
    "Trust": "maxcon.integrity",
    "UncertainPose": "maxcon.tracking",
    "Weighting": "maxcon.search",
}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name == "search":
        return importlib.import_module("maxcon.search")
    if name not in _HOME:
        raise AttributeError(f"module 'maxcon' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
