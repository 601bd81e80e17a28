# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Many drives: a table of drives, each localized in a map, becomes one Parquet dataset of poses."""

from maxcon.drive.many.job import ManyDrivesJob, OpenedDrive
from maxcon.drive.many.poses_dataset import PosesDataset, poses_schema, table_of_drive
from maxcon.drive.many.run import Localized, localize_drives
from maxcon.drive.many.table import DriveEntry, read_drives

__all__ = [
    "DriveEntry",
    "Localized",
    "ManyDrivesJob",
    "OpenedDrive",
    "PosesDataset",
    "localize_drives",
    "poses_schema",
    "read_drives",
    "table_of_drive",
]
