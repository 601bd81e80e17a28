"""POSES.csv as rows of text, and, of a drive of which every epoch is localized, as numbers."""

import csv

import numpy as np


def rows_of(path):
    """Rows by the names of the columns, without the milliseconds."""
    with path.open(newline="") as file:
        return [row | {"ms": ""} for row in csv.DictReader(file)]


def localized_poses(path):
    """Time, x, y, z and heading of each row, shape (n, 5)."""
    rows = rows_of(path)
    assert all(row["status"] == "localized" for row in rows)
    return np.array([[float(row[name]) for name in ("time", "x", "y", "z", "heading")] for row in rows])
