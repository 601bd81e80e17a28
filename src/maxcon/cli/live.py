# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon live`."""

from pathlib import Path

from maxcon.cli.flags import OptionGroup, argument, flag, flags
from maxcon.cli.options import AtStamp, RangeOptions
from maxcon.cli.terminal import warn
from maxcon.errors import OptionError


class Topics(OptionGroup, title="Inputs"):
    """What is listened to."""

    map_folder: Path = argument(..., "Map made by `maxcon map build`.", "MAP")
    ros2: bool = flag(False, "Messages come by ROS 2 (DDS): the only way so far.")
    domain: int = flag(0, "Domain of ROS 2.", metavar="N", min=0, max=232, envvar="ROS_DOMAIN_ID")
    points: str = flag("/points", "Topic of the scans (PointCloud2).", metavar="TOPIC")
    odometry: str = flag("/odom", "Topic of the odometry (Odometry).", metavar="TOPIC")
    fix: str = flag(
        "/fix", "Topic of the positions (NavSatFix), for maps with a CRS; heights are not used.", metavar="TOPIC"
    )
    mounting: Path | None = flag(None, "Where scanner, antenna and odometry are in the vehicle.", metavar="TOML")
    at_stamp: AtStamp = False
    deskew: bool = flag(False, "Points have times: move them to where they were at the time of their scan.")


class Outputs(OptionGroup, title="Output"):
    """What is published."""

    map_frame: str = flag("map", "Name of the map's local frame.", metavar="NAME")
    map_spacing: float = flag(1.0, "Publish the map, a point per cube of this edge, m; 0: do not.", metavar="M", min=0)
    tf_ahead: float = flag(0.2, "Stamp the transform so much later than its scan, for what comes next.", metavar="S")


class Waiting(OptionGroup, title="How it is done"):
    """How messages are waited for."""

    delay: float = flag(0.05, "Messages may come so late.", metavar="S")
    queue: int = flag(3, "Scans that wait at most; of more the oldest is dropped.", metavar="N")
    patience: int = flag(10, "After so many scans without a place the map is searched without a prior.", metavar="N")
    threads: int = flag(1, "Headings searched at once.", min=1)


@flags
def live(topics: Topics, ranges: RangeOptions, outputs: Outputs, waiting: Waiting) -> None:
    """Localize scans as they come by ROS 2, until a signal ends it. No ROS is needed on this machine.

    Publishes /maxcon/pose (PoseWithCovarianceStamped, of scans that are localized), /tf (map to odometry),
    /diagnostics (of each scan: status, reason, latency, scans dropped), and once, latched, /maxcon/map (PointCloud2).

    Coordinates are metres about the map's local origin, which is in the diagnostics: x, y and z in the CRS less those.
    """
    from maxcon.drive.live import LiveLocalizer
    from maxcon.drive.live_inbox import LiveOptions
    from maxcon.drive.localize import DriveOptions
    from maxcon.drive.ros2_node import NodeOptions, Ros2Node
    from maxcon.io.ros2_wire import Ros2Wire
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap
    from maxcon.scan.mounting import Mounting, read_mounting

    if not topics.ros2:
        raise OptionError("Expected --ros2, by which messages come, got nothing. Add it.")
    mounting = Mounting() if topics.mounting is None else read_mounting(topics.mounting)
    options = NodeOptions(
        topics.points, topics.odometry, topics.fix, topics.at_stamp, topics.deskew,
        outputs.map_frame, outputs.map_spacing, outputs.tf_ahead, mounting,
    )  # fmt: skip
    point_map = PointMap.open(topics.map_folder)
    localizer = LiveLocalizer(
        point_map,
        MaximumConsensus(n_threads=waiting.threads),
        options=LiveOptions(waiting.delay, waiting.queue, waiting.patience),
        drive=DriveOptions(ranges.min_range, ranges.max_range),
    )
    Ros2Node(localizer, Ros2Wire(topics.domain), options, warn).run()
