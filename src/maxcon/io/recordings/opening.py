# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_recording: which kind of recording a path is."""

import os
from pathlib import Path

from maxcon.errors import FileError
from maxcon.io.file_names import SCAN_SUFFIXES, in_natural_order
from maxcon.io.recordings.bags import Ros1Bag, SqliteBag
from maxcon.io.recordings.base import Recording
from maxcon.io.recordings.mcap_files import McapFiles

__all__ = ["CAPTURE_SUFFIX", "RECORDING_SUFFIXES", "existing_file", "is_recording", "open_recording"]

RECORDING_SUFFIXES = (".bag", ".mcap", ".db3")
CAPTURE_SUFFIX = ".pcap"
BAG_FOLDER = "metadata.yaml"


def is_recording(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a recording by its suffix, or the folder of a ROS 2 bag."""
    place = Path(path)
    if os.path.isdir(place):  # noqa: PTH112  (a name that is too long is no folder, not an error)
        return _is_bag(place)
    return place.suffix.lower() in (*RECORDING_SUFFIXES, CAPTURE_SUFFIX)


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return a path that is a file.

    Raises
    ------
    FileError
        If it is none: not there, a folder, or a pipe, which would be waited for.
    """
    place = Path(path)
    if not os.path.isfile(place):  # noqa: PTH113
        got = "which is no file" if os.path.lexists(place) else "no such file or folder"
        raise FileError(f"Expected a recording at {place}, got {got}. Check the path.")
    return place


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Return an open recording; its index is read, no message.

    Parameters
    ----------
    path : path
        A .bag (ROS 1), a .mcap, a .db3, or the folder of a ROS 2 bag with .mcap or .db3 files.

    Raises
    ------
    FileError
        If there is none, or it is broken.
    MissingExtraError
        If the extra `recordings` is not installed.
    """
    place = Path(path)
    suffix = place.suffix.lower()
    if os.path.lexists(place) and (suffix == CAPTURE_SUFFIX or not is_recording(place)):
        raise FileError(
            f"Expected a recording with suffix {', '.join(RECORDING_SUFFIXES)}, or the folder of a ROS 2 bag, got"
            f" {place}. Check the path."
        )
    if os.path.isdir(place):  # noqa: PTH112
        files = _mcap_files(place)
        return McapFiles(place, files) if files else SqliteBag(place)
    file = existing_file(place)
    if suffix == ".bag":
        return Ros1Bag(file)
    return McapFiles(file, [file]) if suffix == ".mcap" else SqliteBag(file)


def _is_bag(folder: Path) -> bool:
    """Whether a folder has what a ROS 2 bag has, and no scans in files."""
    try:
        files = [file for file in folder.iterdir() if file.is_file()]
    except OSError:
        return False
    suffixes = {file.suffix.lower() for file in files}
    is_bag = BAG_FOLDER in {file.name for file in files} or ".mcap" in suffixes
    return is_bag and suffixes.isdisjoint(SCAN_SUFFIXES)


def _mcap_files(folder: Path) -> list[Path]:
    """List the MCAP files of a bag, which are numbered, in their order."""
    return in_natural_order([file for file in folder.glob("*.mcap") if file.is_file()])
