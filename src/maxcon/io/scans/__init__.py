# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scans from files: a folder with one file per epoch, and the time of each."""

from maxcon.io.scans.folder import RawScan, ScanFolder, check_range, open_scans

__all__ = ["RawScan", "ScanFolder", "check_range", "open_scans"]
