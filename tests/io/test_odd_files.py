# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Real odd files that other programs wrote: each is read rightly, or refused in one line, and nothing is printed."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from maxcon.errors import MaxconError
from maxcon.io.scans.folder import read_scan_file
from read_clouds import read_cloud

RECORDERS = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "../shared/data")) / "recorders"
FOLDERS = ("las", "copc", "ply", "pcd")  # e57: beside its reader

# What is not read, and the words that say why. Everything else must be.
REFUSED = {
    "las/PDAL/las/1.2-with-color-clipped.las": "1065 points in .*, got bytes for 1064: truncated",
    "ply/PDAL/no_vertex.ply": "an element 'vertex'",
    "pcd/PDAL/missingheader.pcd": "header lines VERSION",
    "pcd/pypcd4/ascii_empty.pcd": "ends with DATA",
    "pcd/pypcd4/ascii_with_empty_points.pcd": "1 to 5,000,000 points",
}


def _points(path):
    return (read_scan_file(path) if path.suffix.lower() == ".pcd" else read_cloud(path)).points


@pytest.mark.skipif(not RECORDERS.is_dir(), reason="no real files of recorders: set MAXCON_DATA to a folder with them")
@pytest.mark.parametrize("folder", FOLDERS)
def test_every_odd_file_is_read_or_refused_in_one_line(folder, capfd):
    files = sorted(path for path in (RECORDERS / folder).rglob("*") if path.is_file())
    assert len(files) >= 3
    for path in files:
        name = path.relative_to(RECORDERS).as_posix()
        try:
            points = _points(path)
        except MaxconError as error:
            assert name in REFUSED and re.fullmatch(f".*{REFUSED[name]}.*", str(error)), error
        else:
            assert name not in REFUSED and np.isfinite(points).all(axis=1).any(), name
    printed = capfd.readouterr()
    assert not printed.out and not printed.err
