# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maximum-consensus localization of LiDAR scans in dense point-cloud maps.

Read: `PointMap` (a map: open, from_points; its `LocalFrame`), `open_scans` (`Scans` of a folder or a recording, each
a `RawScan`), `read_trajectory` (a `Trajectory`: rough poses, or answers), `read_recorded_poses` (`RecordedPoses`).

Localize one scan: `MaximumConsensus` with a `SearchSpace` and an objective (`Helmert`, `Count`, `MaxEigenvalue`, or
an `Objective` of your own), a `Multiplicity` and a `Weighting`, given a `Scan` and the prior `Pose`, returns an
`Estimate` with its `Status`; `Trust` says when it is called localized. The scores of all cells: `Accumulator`.

Localize a drive: `localize_drive` with `DriveOptions` yields an `EpochEstimate` each; or a `Tracker` with its
`TrackingOptions`, given each `Motion` with its `MotionNoise`, knows an `UncertainPose`.

Without a prior: a `Relocalizer` finds a scan in a whole map; its `Relocalization` says what is known of other places.

Look: `plot_epoch`, `plot_poses` and `plot_drive` write pictures. `search` has the searches themselves.

Units are metres, seconds and radians (`_deg`: degrees). Errors are kinds of `MaxconError`, in words.
"""

import importlib
from typing import TYPE_CHECKING, Any

from maxcon.version import __version__

if TYPE_CHECKING:
    from maxcon import search
    from maxcon.accumulator import Accumulator
    from maxcon.drive.localize import DriveOptions, EpochEstimate, localize_drive
    from maxcon.errors import MaxconError
    from maxcon.estimate import Estimate, Status
    from maxcon.geometry import LocalFrame, Pose
    from maxcon.integrity import Trust
    from maxcon.io.recordings.poses import RecordedPoses, read_recorded_poses
    from maxcon.io.scans import RawScan, Scans, open_scans
    from maxcon.io.trajectories import read_trajectory
    from maxcon.maximum_consensus import MaximumConsensus
    from maxcon.objectives import Count, Helmert, MaxEigenvalue, Objective
    from maxcon.point_map import PointMap
    from maxcon.relocalization import Relocalization, Relocalizer
    from maxcon.report import plot_drive, plot_epoch, plot_poses
    from maxcon.scan import Scan
    from maxcon.search import Multiplicity, Weighting
    from maxcon.search_space import SearchSpace
    from maxcon.tracking import Motion, MotionNoise, Tracker, TrackingOptions, UncertainPose
    from maxcon.trajectory import Trajectory

__all__ = [
    "Accumulator",
    "Count",
    "DriveOptions",
    "EpochEstimate",
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
    "RawScan",
    "RecordedPoses",
    "Relocalization",
    "Relocalizer",
    "Scan",
    "Scans",
    "SearchSpace",
    "Status",
    "Tracker",
    "TrackingOptions",
    "Trajectory",
    "Trust",
    "UncertainPose",
    "Weighting",
    "__version__",
    "localize_drive",
    "open_scans",
    "plot_drive",
    "plot_epoch",
    "plot_poses",
    "read_recorded_poses",
    "read_trajectory",
    "search",
]

_HOME = {
    "Accumulator": "maxcon.accumulator",
    "Count": "maxcon.objectives",
    "DriveOptions": "maxcon.drive.localize",
    "EpochEstimate": "maxcon.drive.localize",
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
    "RawScan": "maxcon.io.scans",
    "RecordedPoses": "maxcon.io.recordings.poses",
    "Relocalization": "maxcon.relocalization",
    "Relocalizer": "maxcon.relocalization",
    "Scan": "maxcon.scan",
    "Scans": "maxcon.io.scans",
    "SearchSpace": "maxcon.search_space",
    "Status": "maxcon.estimate",
    "Tracker": "maxcon.tracking",
    "TrackingOptions": "maxcon.tracking",
    "Trajectory": "maxcon.trajectory",
    "Trust": "maxcon.integrity",
    "UncertainPose": "maxcon.tracking",
    "Weighting": "maxcon.search",
    "localize_drive": "maxcon.drive.localize",
    "open_scans": "maxcon.io.scans",
    "plot_drive": "maxcon.report",
    "plot_epoch": "maxcon.report",
    "plot_poses": "maxcon.report",
    "read_recorded_poses": "maxcon.io.recordings.poses",
    "read_trajectory": "maxcon.io.trajectories",
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
