# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What is read is a file: a FIFO is refused at once, where opening it would wait for ever."""

import os
from pathlib import Path

import pytest

from maxcon._system.regular_file import open_regular
from maxcon.errors import MaxconError
from maxcon.io.clouds import CLOUD_SUFFIXES, open_cloud
from maxcon.io.geographic_priors import read_nmea
from maxcon.io.scans import open_scans
from maxcon.io.text import SCAN_SUFFIXES
from maxcon.io.trajectories import read_prior, read_trajectory


def test_a_file_is_opened_and_nothing_else(tmp_path):
    (tmp_path / "a").write_bytes(b"content")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    for name in ("a", "link"):
        with open_regular(tmp_path / name) as file:
            assert file.read() == b"content"
    os.mkfifo(tmp_path / "fifo")
    for path, words in ((tmp_path, "directory"), (tmp_path / "missing", "No such"), (tmp_path / "fifo", "a FIFO, no")):
        with pytest.raises(OSError, match=words):
            open_regular(path)


def read_scan(path):
    return open_scans(path).read(0)


def read_times(path):
    (path.parent / "scans").mkdir()
    (path.parent / "scans" / "1.bin").write_bytes(bytes(16))
    open_scans(path.parent / "scans", path)


@pytest.mark.parametrize(
    ("read", "suffix"),
    [
        *((open_cloud, suffix) for suffix in CLOUD_SUFFIXES),
        *((read_scan, suffix) for suffix in SCAN_SUFFIXES),
        (read_nmea, ".nmea"),
        *((read, suffix) for read in (read_prior, read_trajectory, read_times) for suffix in (".txt", ".tum", ".csv")),
    ],
)
@pytest.mark.parametrize(
    ("make", "words"),
    [(os.mkfifo, "a FIFO"), (Path.mkdir, "is a directory|scans of one kind"), (lambda path: None, "no such file")],
    ids=["fifo", "folder", "nothing"],
)
def test_what_is_no_file_as_cloud_scan_trajectory_or_times(tmp_path, read, suffix, make, words):
    make(tmp_path / f"1{suffix}")
    with pytest.raises(MaxconError, match=f"(?i){words}"):
        read(tmp_path / f"1{suffix}")
