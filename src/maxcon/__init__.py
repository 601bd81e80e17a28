"""Maximum-consensus localization of LiDAR scans in dense point-cloud maps.

Read: `PointMap` (a map: open, from_points; its `LocalFrame`), `open_scans` (`Scans` of a folder or a recording, each
a `RawScan`), `read_trajectory` (a `Trajectory`: rough poses, or answers), `read_recorded_poses` (`RecordedPoses`).

Localize one scan: `MaximumConsensus` with a `SearchSpace` and an objective (`Helmert`, `Count`, `MaxEigenvalue`, or
an `Objective` of your own), a `Multiplicity` and a `Weighting`, given a `Scan` and the prior `Pose`, returns an
`Estimate` with its `Status`; `Trust` says when it is called localized. The scores of all cells: `Accumulator`.

Localize a drive: `localize_drive` with `DriveOptions` yields an `EpochEstimate` each; or a `Tracker` with its
`TrackingOptions`, given each `Motion` with its `MotionNoise`, knows an `UncertainPose`.

Live: a `LiveLocalizer` with `LiveOptions` takes what comes, and gives a `LiveAnswer` with `LiveCounts` for each scan.

Without a prior: a `Relocalizer` finds a scan in a whole map; its `Relocalization` says what is known of other places.

Look: `plot_epoch`, `plot_poses` and `plot_drive` write pictures. `search` has the searches themselves.

Units are metres, seconds and radians (`_deg`: degrees). Errors are kinds of `MaxconError`, in words.
"""

import importlib
from typing import TYPE_CHECKING, Any

from maxcon._system.version import __version__

if TYPE_CHECKING:
    from maxcon import search
    from maxcon.drive.live import LiveAnswer, LiveLocalizer
    from maxcon.drive.live_inbox import LiveCounts, LiveOptions
    from maxcon.drive.localize import DriveOptions, EpochEstimate, localize_drive
    from maxcon.drive.motion import Motion, MotionNoise, UncertainPose
    from maxcon.drive.tracker import Tracker, TrackingOptions
    from maxcon.errors import MaxconError
    from maxcon.estimate import Estimate, Status
    from maxcon.geometry import LocalFrame, Pose
    from maxcon.integrity import Trust
    from maxcon.io.fixes import RecordedPoses
    from maxcon.io.recordings.poses import read_recorded_poses
    from maxcon.io.scans import RawScan, Scans, open_scans
    from maxcon.io.trajectories import read_trajectory
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap
    from maxcon.plotting import plot_drive, plot_epoch, plot_poses
    from maxcon.relocalization import Relocalization, Relocalizer
    from maxcon.scan import Scan
    from maxcon.scan.trajectory import Trajectory
    from maxcon.search import Multiplicity, Weighting
    from maxcon.search.accumulator import Accumulator
    from maxcon.search.objectives import Count, Helmert, MaxEigenvalue, Objective
    from maxcon.search.space import SearchSpace

__all__ = [
    "Accumulator", "Count", "DriveOptions", "EpochEstimate", "Estimate", "Helmert", "LiveAnswer", "LiveCounts",
    "LiveLocalizer", "LiveOptions", "LocalFrame", "MaxEigenvalue", "MaxconError", "MaximumConsensus", "Motion",
    "MotionNoise", "Multiplicity", "Objective", "PointMap", "Pose", "RawScan", "RecordedPoses", "Relocalization",
    "Relocalizer", "Scan", "Scans", "SearchSpace", "Status", "Tracker", "TrackingOptions", "Trajectory", "Trust",
    "UncertainPose", "Weighting", "__version__", "localize_drive", "open_scans", "plot_drive", "plot_epoch",
    "plot_poses", "read_recorded_poses", "read_trajectory", "search",
]  # fmt: skip

_NAMES = {
    "drive.live": "LiveAnswer LiveLocalizer", "drive.live_inbox": "LiveCounts LiveOptions",
    "drive.localize": "DriveOptions EpochEstimate localize_drive", "drive.motion": "Motion MotionNoise UncertainPose",
    "drive.tracker": "Tracker TrackingOptions", "errors": "MaxconError", "estimate": "Estimate Status",
    "geometry": "LocalFrame Pose", "integrity": "Trust", "io.fixes": "RecordedPoses",
    "io.recordings.poses": "read_recorded_poses", "io.scans": "RawScan Scans open_scans",
    "io.trajectories": "read_trajectory", "localizer": "MaximumConsensus", "map": "PointMap",
    "plotting": "plot_drive plot_epoch plot_poses", "relocalization": "Relocalization Relocalizer", "scan": "Scan",
    "scan.trajectory": "Trajectory", "search": "Multiplicity Weighting", "search.accumulator": "Accumulator",
    "search.objectives": "Count Helmert MaxEigenvalue Objective", "search.space": "SearchSpace",
}  # fmt: skip
"""Where the public names are: by modules of this package."""
_HOME = {name: f"maxcon.{module}" for module, names in _NAMES.items() for name in names.split()}


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
