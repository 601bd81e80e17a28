"""Clouds as Livox's drivers write them unless told otherwise: CustomMsg, decoded as one array.

rosbags would make an object of each point, which takes 0.1 s a scan.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from maxcon.io.point_records import MAX_POINTS, record_type
from maxcon.io.recordings.recording import Message

LIVOX = tuple(f"{driver}/msg/CustomMsg" for driver in ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces"))


def records_of_livox(message: Message) -> tuple[int, NDArray[np.void]]:
    """Return the time in the header of a CustomMsg, ns, and its points, whose `timestamp` is timebase + offset_time."""
    is_ros1 = message.encoding == "ros1"
    order = "<" if is_ros1 or message.data[1] & 1 else ">"
    data = message.data[4:]  # behind the number of the message, or the kind of encoding
    seconds, nanoseconds, n_frame = struct.unpack_from(f"{order}III", data)
    place = 12 + n_frame
    place += 0 if is_ros1 else -place % 8
    timebase, _, _, n_points = struct.unpack_from(f"{order}QIII", data, place)
    place += 20
    # ROS 1 packs points, and the first drivers had no tag.
    n_bytes = len(data) - place
    step = n_bytes // max(n_points, 1) if is_ros1 else 20
    if n_points > MAX_POINTS or (is_ros1 and n_points and (step not in (18, 19) or step * n_points != n_bytes)):
        raise ValueError(f"{n_bytes} bytes for {n_points} points")
    numbers = {name: f"{order}f4" for name in "xyz"} | {"reflectivity": "u1", "tag": "u1", "line": "u1"}
    if step == 18:
        del numbers["tag"]
    stored = np.ndarray((n_points,), [("time", f"{order}u4"), *numbers.items()], data, place, (step,))
    records = np.empty(n_points, record_type(["timestamp", *numbers], ["u8", *numbers.values()]))
    for name in numbers:
        records[name] = stored[name]
    records["timestamp"] = stored["time"] + np.uint64(timebase)
    return seconds * 10**9 + nanoseconds, records
