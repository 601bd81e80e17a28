# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv of a drive of which every epoch is localized, as numbers."""

import csv

import numpy as np

__all__ = ["localized_poses"]


def localized_poses(path):
    """Time, x, y, z and heading of each row, shape (n, 5)."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert all(row["status"] == "localized" for row in rows)
    return np.array([[float(row[name]) for name in ("time", "x", "y", "z", "heading")] for row in rows])
