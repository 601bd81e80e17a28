# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Folders of scans: order, times, kinds, and what is dropped from a scan."""

import laspy
import numpy as np
import pytest

from maxcon.errors import FileError, OptionError
from maxcon.io.scans import open_scans
from maxcon.io.scans import scan_files as scan_points

POINTS = np.array(
    [[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 130.0, 0.0], [np.nan, 1.0, 1.0], [3.0, 4.0, 0.0]]
)


def write_bin(path, points=POINTS):
    np.column_stack([points, np.ones(len(points))]).astype("<f4").tofile(path)


def fill(folder, *names):
    folder.mkdir(exist_ok=True)
    for name in names:
        write_bin(folder / name)
    return folder


def test_a_scan_and_what_is_dropped_from_it(tmp_path):
    folder = open_scans(fill(tmp_path / "s", "10.bin", "9.bin"))
    assert len(folder) == 2
    raw = folder.read(0)
    np.testing.assert_array_equal(raw.points, [[5, 0, 0], [3, 4, 0]])
    assert (raw.time, raw.name, raw.n_returns, raw.n_dropped_invalid, raw.n_dropped_range) == (9.0, "9.bin", 6, 2, 2)
    assert raw.points.dtype == np.float64
    assert [scan.name for scan in folder.scans()] == ["9.bin", "10.bin"]


def test_ranges_can_be_chosen_and_must_make_sense(tmp_path):
    folder = open_scans(fill(tmp_path / "s", "1.bin"))
    assert len(folder.read(0, min_range=0.0, max_range=200.0).points) == 4
    assert len(folder.read(0, min_range=5.0, max_range=5.1).points) == 2
    empty = folder.read(0, min_range=60.0, max_range=61.0)
    assert empty.points.shape == (0, 3)
    assert empty.n_dropped_range == 4
    for low, high in ((5.0, 5.0), (-1.0, 5.0), (np.nan, 5.0), (1.0, np.nan)):
        with pytest.raises(OptionError, match="0 <= min_range < max_range"):
            folder.read(0, low, high)


def test_every_kind_of_file_gives_the_same_points(tmp_path):
    points = POINTS[[0, 3, 5]]
    write_bin(tmp_path / "1.bin", points)
    np.savez(tmp_path / "1.npz", points=points)
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    props = "property float x\nproperty float y\nproperty float z\n"
    (tmp_path / "1.ply").write_text(f"ply\nformat ascii 1.0\nelement vertex 3\n{props}end_header\n{rows}")
    (tmp_path / "1.pcd").write_text(f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 3\nHEIGHT 1\nDATA ascii\n{rows}")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [0.001] * 3
    las = laspy.LasData(header)
    las.xyz = points
    las.write(tmp_path / "1.las")
    las.write(tmp_path / "1.LAZ")
    for name in ("1.bin", "1.npz", "1.ply", "1.pcd", "1.las", "1.LAZ"):
        folder = open_scans(tmp_path / name)
        raw = folder.read(0, max_range=200.0)
        np.testing.assert_allclose(raw.points, points, atol=1e-9)
        assert (len(folder), raw.time, raw.n_returns) == (1, 1.0, 3)


@pytest.mark.parametrize(
    ("names", "times"),
    [
        (["2.bin", "10.bin", "1.bin"], [1, 2, 10]),
        (["000010.bin", "000011.bin"], [10, 11]),
        (["1.5.bin", "1.25.bin", "2.bin"], [1.25, 1.5, 2]),
        (["1700000000.100000.bin", "1700000000.05.bin"], [1700000000.05, 1700000000.1]),
        (["1700000000050000000.bin", "1700000000150000000.bin"], [1700000000.05, 1700000000.15]),
        (["1700000000050000.bin", "1700000000150000.bin"], [1700000000.05, 1700000000.15]),
        (["1700000000050.bin", "1700000000150.bin"], [1700000000.05, 1700000000.15]),
    ],
)
def test_times_from_names(tmp_path, names, times):
    folder = open_scans(fill(tmp_path / "s", *names))
    np.testing.assert_allclose(folder.times, times, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["scan_1.bin"], r"a time as the name of each scan, or a times\.txt .*got scan_1\.bin.*Write a times\.txt"),
        (["1.bin", "1.0.bin"], r"names of increasing times .*got .*1\.0\.bin"),
        (["999999999999.bin", "1000000000000.bin"], "names of the same unit"),
        ([], r"scans with suffix \.bin, \.pcd, \.las, \.laz, \.ply, \.npz in .*got none"),
        (["1.bin", "2.pcd"], r"scans of one kind in .*got \.bin, \.pcd"),
    ],
)
def test_folders_that_cannot_be_read_are_refused(tmp_path, names, words):
    with pytest.raises(FileError, match=words):
        open_scans(fill(tmp_path / "s", *names))


def test_times_from_the_file_beside_the_scans(tmp_path):
    folder = fill(tmp_path / "s", "scan_2.bin", "scan_10.bin", "scan_1.bin")
    (folder / "times.txt").write_text("# s\n10.5\n\n10.75 # the second\n11.0\n")
    (folder / "notes.md").write_text("left alone")
    (folder / "._scan_1.bin").write_text("left alone")
    scans = open_scans(folder)
    assert [path.name for path in scans.paths] == ["scan_1.bin", "scan_2.bin", "scan_10.bin"]
    np.testing.assert_array_equal(scans.times, [10.5, 10.75, 11.0])
    (tmp_path / "other.txt").write_text("1\n2\n3\n")
    np.testing.assert_array_equal(open_scans(folder, tmp_path / "other.txt").times, [1, 2, 3])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("1\n", r"Expected 2 times in .*times\.txt, one per scan, got 1"),
        ("", "Expected 2 times in .*got 0"),
        ("1\n2\n3\n", "Expected 2 times in .*got 3"),
        ("1\n1\n", r"times\.txt, line 2: Expected times that increase"),
        ("1\nx\n", r"times\.txt, line 2: Expected one time in seconds, got 'x'"),
        ("1 2\n", r"line 1: Expected one time in seconds, got '1 2'"),
        ("nan\n2\n", "line 1: Expected one time in seconds, got 'nan'"),
    ],
)
def test_times_that_do_not_fit_are_refused(tmp_path, content, words):
    folder = fill(tmp_path / "s", "1.bin", "2.bin")
    (folder / "times.txt").write_text(content)
    with pytest.raises(FileError, match=words):
        open_scans(folder)


def test_paths_that_are_not_there(tmp_path):
    with pytest.raises(FileError, match="no such folder or file"):
        open_scans(tmp_path / "missing")
    with pytest.raises(FileError, match=r"times of scans at .*no such file"):
        open_scans(fill(tmp_path / "s", "1.bin"), tmp_path / "missing.txt")
    with pytest.raises(FileError, match="scans with suffix"):
        open_scans(tmp_path)


@pytest.mark.parametrize("n_bytes", [0, 1, 15, 17, 95])
def test_an_empty_or_truncated_bin_is_refused(tmp_path, n_bytes):
    path = tmp_path / "1.bin"
    write_bin(path)
    path.write_bytes(path.read_bytes()[:n_bytes])
    with pytest.raises(FileError, match=rf"reflectance in .*1\.bin, 16 bytes per point, got {n_bytes} bytes"):
        open_scans(path).read(0)


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".npz", ".las", ".laz"])
def test_an_empty_file_of_any_kind_is_refused(tmp_path, suffix):
    (tmp_path / f"1{suffix}").touch()
    with pytest.raises(FileError, match=rf"1\{suffix}"):
        open_scans(tmp_path / f"1{suffix}").read(0)


def test_a_scan_that_vanishes_is_refused(tmp_path):
    folder = open_scans(fill(tmp_path / "s", "1.bin"))
    folder.paths[0].unlink()
    with pytest.raises(FileError, match=r"able to read .*1\.bin"):
        folder.read(0)


def test_a_map_is_not_a_scan(tmp_path, monkeypatch):
    monkeypatch.setattr(scan_points, "MAX_SCAN_POINTS", 5)
    np.savez(tmp_path / "1.npz", points=POINTS)
    write_bin(tmp_path / "1.bin")
    for name in ("1.npz", "1.bin"):
        with pytest.raises(FileError, match=r"at most 5 points, got 6 in .*Is it a map"):
            open_scans(tmp_path / name).read(0)
