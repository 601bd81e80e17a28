# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scans of a drive: a folder with one file per epoch, or a recording, and the time of each."""

from maxcon.io.raw_scan import RawScan, Scans, check_range
from maxcon.io.scans.folder import ScanFolder, open_scans

__all__ = ["RawScan", "ScanFolder", "Scans", "check_range", "open_scans"]
