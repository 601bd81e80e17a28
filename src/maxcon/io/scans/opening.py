# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_scans: the scans of a drive, from a folder, a file or a recording."""

from __future__ import annotations

import os

from maxcon.errors import OptionError
from maxcon.io.raw_scan import Scans
from maxcon.io.scans.folder import open_scan_folder

__all__ = ["open_scans"]


def open_scans(
    path: str | os.PathLike[str],
    times: str | os.PathLike[str] | None = None,
    *,
    topic: str | None = None,
    at_stamp: bool = False,
) -> Scans:
    """Return the scans in a folder, a recording, or the one scan in a file; none is read yet.

    Parameters
    ----------
    path : path
        A folder of scans of one kind: .bin (KITTI: float32 x, y, z, reflectance), .pcd, .ply, .npz, .las or
        .laz; or one such file. Files with other suffixes are left alone. Or a recording: .bag, .mcap, .db3, .pcap,
        or the folder of a ROS 2 bag.
    times : path or None
        File with one time per line, s. If None: `times.txt` in the folder if there is one, else the names
        are the times: decimals are seconds, integers of 19, 16, 13 digits are ns, us, ms, others seconds.
    topic : str or None
        Which of several clouds of a recording.
    at_stamp : bool
        Whether the time of a recorded scan is that of its message, and not the middle between its first and its last
        point where these have times.

    Raises
    ------
    FileError
        If there is no scan, scans are of several kinds, times are missing or do not fit the scans, or a recording has
        no cloud, or several and none is asked for.
    MissingExtraError
        If it is a recording, and the extra `recordings` is not installed.
    OptionError
        If times are given for a recording, or a topic for a folder.
    """
    from maxcon.io.recordings.opening import is_recording

    if not is_recording(path):
        if topic is not None or at_stamp:
            raise OptionError(
                f"Expected a topic, or times of messages, to be asked of a recording, got {os.fspath(path)}. Leave"
                " that out."
            )
        return open_scan_folder(path, times)
    if times is not None:
        raise OptionError(
            f"Expected no times beside the recording {os.fspath(path)}: its messages have their own. Leave them out."
        )
    from maxcon.io.recordings.recorded_scans import RecordedScans

    return RecordedScans.open(path, topic, at_stamp=at_stamp)
