# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Real odd files that other programs wrote: each is read rightly, or refused in one line, at once."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

RECORDERS = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "../shared/data")) / "recorders"
FOLDERS = ("las", "copc", "ply", "pcd", "e57")
FILES = sorted(path for folder in FOLDERS for path in (RECORDERS / folder).rglob("*") if path.is_file())
SECONDS = 100.0

# In a process of its own, so that what is printed beside an error, or hangs, is seen.
READ = """
import sys, time
import numpy as np
from pathlib import Path
from maxcon.errors import MaxconError
from maxcon.io.clouds import open_cloud
from maxcon.io.scans.scan_files import read_scan_file

def read(path):
    if path.suffix.lower() == ".pcd":
        points = read_scan_file(path).points
        return len(points), points
    with open_cloud(path) as reader:
        points = np.concatenate([chunk.points for chunk in reader.chunks()])
        return reader.header.n_points, points

for line in sys.stdin:
    path = Path(line.rstrip("\\n"))
    started = time.process_time()
    try:
        n_points, points = read(path)
        words = f"read {n_points} {len(points)} {np.isfinite(points).all(axis=1).sum()}"
    except MaxconError as error:
        words = f"refused {error}"
    print(f"{time.process_time() - started:.3f} {words}", flush=True)
"""

# What is not read, and the words that say why. Everything else must be.
REFUSED = {
    "las/PDAL/las/1.2-with-color-clipped.las": "1065 points in .*, got bytes for 1064: truncated",
    "ply/PDAL/no_vertex.ply": "an element 'vertex'",
    "pcd/PDAL/missingheader.pcd": "header lines VERSION",
    "pcd/pypcd4/ascii_empty.pcd": "ends with DATA",
    "pcd/pypcd4/ascii_with_empty_points.pcd": "1 to 5,000,000 points",
}


@pytest.fixture(scope="module")
def read():
    """Start a reader; it is given one path after the other, and a new one is started where it is stuck."""
    process = subprocess.Popen(
        [sys.executable, "-c", READ],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip

    def read(path):
        process.stdin.write(f"{path}\n")
        process.stdin.flush()
        return process.stdout.readline()

    yield read
    process.kill()
    process.wait()


@pytest.mark.skipif(not FILES, reason="no real files of recorders: set MAXCON_DATA to a folder with recorders/")
def test_every_odd_file_is_read_or_refused_in_one_line(read):
    wrong = []
    for path in FILES:
        name = path.relative_to(RECORDERS).as_posix()
        started = time.monotonic()
        seconds, _, words = read(path).strip().partition(" ")
        assert re.fullmatch(r"\d+\.\d+", seconds), f"{name}: {seconds} {words}"
        assert float(seconds) < SECONDS, f"{name}: {time.monotonic() - started:.1f} s"
        kind, _, rest = words.partition(" ")
        if kind == "read":
            n_claimed, n_read, n_finite = map(int, rest.split())
            is_right = n_claimed == n_read and n_finite > 0 and name not in REFUSED
        elif path.suffix == ".e57":
            is_right = True  # its reader decides
        else:
            is_right = name in REFUSED and re.search(REFUSED[name], rest)
        if not is_right:
            wrong.append(f"{name}: {words}")
    assert not wrong
    assert len(FILES) > 50
