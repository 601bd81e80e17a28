# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scans as a folder of PCD files, each with the times of its points where they are known."""

import os
from pathlib import Path

import numpy as np

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon.io.scans import RawScan, Scans

__all__ = ["write_pcd_folder"]


def write_pcd_folder(path: str | os.PathLike[str], scans: Scans, *, overwrite: bool = False) -> None:
    """Write a binary PCD file for each scan, and the times of the scans beside them.

    Parameters
    ----------
    path : path
        Folder to write.
    scans : Scans
        All their returns are written: x, y, z, m, sensor frame, and as `t` the time of each point where it is known,
        s after that of the scan.
    overwrite : bool
        Whether a folder of PCD scans at `path` is replaced.

    Raises
    ------
    FileError
        If the folder cannot be written, or there is something else at `path`.
    """
    if overwrite:
        check_replaceable(Path(path), "a folder of PCD scans", ("times.txt", "*.pcd"))
    with atomic_folder(Path(path), overwrite=overwrite) as partial:
        for number, raw in enumerate(scans.scans(0.0, np.inf)):
            (partial / f"{number:06d}.pcd").write_bytes(_pcd(raw))
        times = "".join(f"{time:.9f}\n" for time in scans.times)
        (partial / "times.txt").write_text(times, encoding="utf-8", newline="\n")


def _pcd(raw: RawScan) -> bytes:
    columns = {name: raw.points[:, axis] for axis, name in enumerate("xyz")}
    if raw.point_times is not None:
        columns["t"] = raw.point_times
    records = np.empty(len(raw.points), dtype=[(name, "<f4") for name in columns])
    for name, values in columns.items():
        records[name] = values
    n_fields = len(columns)
    header = [
        "VERSION 0.7",
        "FIELDS " + " ".join(columns),
        "SIZE" + " 4" * n_fields,
        "TYPE" + " F" * n_fields,
        "COUNT" + " 1" * n_fields,
        f"WIDTH {len(records)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}",
        "DATA binary",
    ]
    return "\n".join([*header, ""]).encode("ascii") + records.tobytes()
