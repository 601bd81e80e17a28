"""`maxcon live`."""

from pathlib import Path
from typing import Any

import typer

from maxcon._system.regular_file import read_regular
from maxcon.cli.flags import OptionGroup, flag, flags
from maxcon.cli.options import Outputs, RangeOptions, Topics
from maxcon.errors import FileError, OptionError, needs_extra

NODE = ("/**", "/*", "/maxcon", "maxcon")  # the keys in a file of parameters that mean this node
OF_CLOCK = "use_sim_time"  # what every node has; here all times are those of the messages
MOST_BYTES = 2**20


def take_parameters(context: typer.Context, file: Path | None) -> Path | None:
    """Make the parameters of ROS 2 in a file the defaults of the options: what is given beside it counts more."""
    if file is None or context.resilient_parsing:
        return file
    names = {each.name: each.name for each in context.command.params if each.name not in ("params_file", "help")}
    names["map"] = names.pop("map_folder")
    context.default_map = {}
    for name, value in _parameters_of(file).items():
        if name == OF_CLOCK:
            continue
        if name not in names or not isinstance(value, bool | int | float | str):
            got = f"{name}" if name not in names else f"{name} with a value that is no single one"
            raise OptionError(f"Expected in {file} parameters among {', '.join(sorted(names))}, got {got}. Correct it.")
        context.default_map[names[name]] = str(value)  # as typed: else 2.7 would do for a whole number
    return file


def _parameters_of(file: Path) -> dict[str, object]:
    """The parameters of this node in a file, of all sections that mean it, the last one counting."""
    with needs_extra("ruamel.yaml", f"to read {file}", "ros2"):
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError

    from maxcon.io.text import reading

    try:
        with reading(file, "parameters of ROS 2"):
            content: Any = YAML(typ="safe", pure=True).load(read_regular(file, MOST_BYTES))
    except (YAMLError, ValueError, RecursionError) as error:
        raise FileError(f"Expected {file} to be YAML, got: {' '.join(str(error).split())[:200]}. Mend it.") from error
    sections = content.items() if isinstance(content, dict) else ()
    found: list[Any] = [
        section.get("ros__parameters") for name, section in sections if name in NODE and isinstance(section, dict)
    ]
    if not found or not all(isinstance(each, dict) for each in found):
        raise FileError(f"Expected `maxcon:` with `ros__parameters:` below in {file}, got none. Write them so.")
    return {str(name): value for each in found for name, value in each.items()}


class ParameterFile(OptionGroup, title="Inputs"):
    """Where the other options may stand, too."""

    params_file: Path | None = flag(
        None,
        "Parameters as ROS 2 has them, `maxcon: {ros__parameters: {points: /lidar/points}}`: the options by their names"
        " with _ for -, and map. Options that are given count more.",
        metavar="YAML", callback=take_parameters, is_eager=True,
    )  # fmt: skip


class Waiting(OptionGroup, title="How it is done"):
    """How messages are waited for."""

    delay: float = flag(0.03, "Messages may come so late.", metavar="S")
    queue: int = flag(2, "Scans that wait at most; of more the oldest is dropped.", metavar="N")
    patience: int = flag(10, "After so many scans without a place the map is searched without a prior.", metavar="N")
    threads: int = flag(1, "Headings searched at once.", min=1)


@flags
def live(topics: Topics, parameters: ParameterFile, ranges: RangeOptions, outputs: Outputs, waiting: Waiting) -> None:
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
    method, drive = MaximumConsensus(n_threads=waiting.threads), DriveOptions(**vars(ranges))
    options = LiveOptions(waiting.delay, waiting.queue, waiting.patience)
    localizer = LiveLocalizer(point_map, method, options=options, drive=drive)
    Ros2Node(localizer, Ros2Wire(topics.domain), topics, outputs).run()
