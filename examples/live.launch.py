# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localize beside the nodes of a robot: `ros2 launch examples/live.launch.py map:=city.map`.

`maxcon` has to be on the PATH, in whatever Python environment; it is started again where it ends.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    parameters, map_folder = LaunchConfiguration("params_file"), LaunchConfiguration("map")
    return LaunchDescription(
        [
            DeclareLaunchArgument("map", description="Map made by `maxcon map build`"),
            DeclareLaunchArgument("params_file", default_value=str(Path(__file__).with_name("live.yaml"))),
            ExecuteProcess(
                cmd=["maxcon", "live", map_folder, "--ros2", "--params-file", parameters],
                output="screen",
                respawn=True,
                respawn_delay=1.0,
            ),
        ]
    )
