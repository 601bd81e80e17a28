# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ScanFile: what a file holds of a scan, before a range is chosen and times are understood."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maxcon.io.point_times import Column

__all__ = ["ScanFile"]


@dataclass(frozen=True, slots=True, eq=False)
class ScanFile:
    """All points of one scan file, and the fields that may be their times.

    Parameters
    ----------
    points : array, shape (n, 3), float64
        Sensor frame, m; points without a return (not finite, or at the origin) are still among them.
    times : dict of str to (str, array of shape (n,))
        By the name of the field: its type as NumPy names it, and its values as stored. Read from PCD files only.
    fields : str
        Names and types of all fields of a point; likewise, else empty.
    """

    points: NDArray[np.float64]
    times: dict[str, Column] = field(default_factory=dict)
    fields: str = ""
