# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon live`."""

from maxcon.cli.flags import OptionGroup, flag, flags
from maxcon.cli.options import Outputs, RangeOptions, Topics
from maxcon.errors import OptionError


class Waiting(OptionGroup, title="How it is done"):
    """How messages are waited for."""

    delay: float = flag(0.05, "Messages may come so late.", metavar="S")
    queue: int = flag(2, "Scans that wait at most; of more the oldest is dropped.", metavar="N")
    patience: int = flag(10, "After so many scans without a place the map is searched without a prior.", metavar="N")
    threads: int = flag(1, "Headings searched at once.", min=1)


@flags
def live(topics: Topics, ranges: RangeOptions, outputs: Outputs, waiting: Waiting) -> None:
    """Localize scans as they come by ROS 2, until a signal ends it. No ROS is needed on this machine.

    Publishes /maxcon/pose (PoseWithCovarianceStamped, of scans that are localized), /tf (map to odometry),
    /diagnostics (of each scan: status, reason, latency, scans dropped), and once, latched, /maxcon/map (PointCloud2).

    Coordinates are metres about the map's local origin, which is in the diagnostics: x, y and z in the CRS less those.
    """
    from maxcon.cli.ros2_node import Ros2Node
    from maxcon.drive.live import LiveLocalizer
    from maxcon.drive.live_inbox import LiveOptions
    from maxcon.drive.localize import DriveOptions
    from maxcon.io.ros2_wire import Ros2Wire
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap

    if not topics.ros2:
        raise OptionError("Expected --ros2, by which messages come, got nothing. Add it.")
    point_map = PointMap.open(topics.map_folder)
    localizer = LiveLocalizer(
        point_map,
        MaximumConsensus(n_threads=waiting.threads),
        options=LiveOptions(waiting.delay, waiting.queue, waiting.patience),
        drive=DriveOptions(ranges.min_range, ranges.max_range),
    )
    Ros2Node(localizer, Ros2Wire(topics.domain), topics, outputs).run()
