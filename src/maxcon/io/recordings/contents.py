# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Contents of messages, as nested values by the names of their definitions."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.geometry.quaternions import quaternions_from_angles

FLOAT32 = 7  # code in sensor_msgs/PointField


def position_and_turn(pose: Pose, names: tuple[str, str]) -> dict[str, dict[str, float]]:
    """Return a pose, or a transform, of its position and its quaternion by these names."""
    turn = quaternions_from_angles(pose.roll, pose.pitch, pose.heading).ravel().tolist()
    position = pose.position.tolist()
    return {names[0]: dict(zip("xyz", position, strict=True)), names[1]: dict(zip("xyzw", turn, strict=True))}


def cloud_content(columns: Mapping[str, NDArray[np.float64]]) -> dict[str, Any]:
    """Return a sensor_msgs/PointCloud2 without a header, of one row; fields by their names, all float32."""
    rows = np.stack(list(columns.values()), axis=1).astype("<f4")
    step = 4 * len(columns)
    return {
        "height": 1,
        "width": len(rows),
        "fields": [dict(name=name, offset=4 * k, datatype=FLOAT32, count=1) for k, name in enumerate(columns)],
        "is_bigendian": False,
        "point_step": step,
        "row_step": step * len(rows),
        "data": rows.ravel().view(np.uint8),
        "is_dense": True,
    }
