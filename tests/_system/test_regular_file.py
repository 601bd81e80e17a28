# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What is read is a file: a FIFO under any name is refused at once, where opening it would wait for ever."""

import os

import pytest

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError, MaxconError
from maxcon.io.clouds import CLOUD_SUFFIXES, open_cloud
from maxcon.io.scans import open_scans
from maxcon.io.text import SCAN_SUFFIXES
from maxcon.io.trajectories import read_prior, read_trajectory


@pytest.fixture
def fifo(tmp_path):
    def make(name):
        os.mkfifo(tmp_path / name)
        return tmp_path / name

    return make


def test_a_file_is_opened(tmp_path):
    (tmp_path / "a").write_bytes(b"content")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    for name in ("a", "link"):
        with open_regular(tmp_path / name) as file:
            assert file.read() == b"content"


def test_what_is_no_file_is_not(tmp_path, fifo):
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "missing")
    with pytest.raises(OSError, match="a FIFO, no file"):
        open_regular(fifo("a"))


def read_scan(path):
    return open_scans(path).read(0)


READERS = [*((open_cloud, suffix) for suffix in CLOUD_SUFFIXES), *((read_scan, suffix) for suffix in SCAN_SUFFIXES)]


@pytest.mark.parametrize(("read", "suffix"), READERS)
def test_a_fifo_as_cloud_or_scan(fifo, read, suffix):
    with pytest.raises(FileError, match="a FIFO"):
        read(fifo(f"1{suffix}"))


@pytest.mark.parametrize("suffix", ["txt", "tum", "csv"])
def test_a_fifo_as_trajectory_or_times(fifo, suffix):
    path = fifo(f"a.{suffix}")
    for read in (read_prior, read_trajectory):
        with pytest.raises(FileError, match="a FIFO, no file"):
            read(path)
    (path.parent / "scans").mkdir()
    (path.parent / "scans" / "1.bin").write_bytes(bytes(16))
    with pytest.raises(MaxconError, match="a FIFO, no file"):
        open_scans(path.parent / "scans", path)
