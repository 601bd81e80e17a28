"""Folders of scans: order, times, kinds, what is dropped from a scan, and .bin of three floats or four."""

import numpy as np
import pytest

from maxcon.errors import FileError, OptionError
from maxcon.io import scans as scan_folder
from maxcon.io.scans import describe, open_scans, read_scan_file
from written_las import write_las

POINTS = np.array(
    [[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 130.0, 0.0], [np.nan, 1.0, 1.0], [3.0, 4.0, 0.0]]
)


def write_bin(path, points=POINTS):
    np.column_stack([points, np.ones(len(points))]).astype("<f4").tofile(path)


@pytest.fixture
def fill(tmp_path):
    def write(*names):
        (tmp_path / "s").mkdir(exist_ok=True)
        for name in names:
            write_bin(tmp_path / "s" / name)
        return tmp_path / "s"

    return write


def test_a_scan_and_what_is_dropped_from_it(fill):
    folder = open_scans(fill("10.bin", "9.bin"))
    assert [scan.name for scan in folder.scans()] == ["9.bin", "10.bin"]
    raw = folder.read(0)
    np.testing.assert_array_equal(raw.points, [[5, 0, 0], [3, 4, 0]])
    assert (raw.time, raw.name, raw.n_returns, raw.n_dropped_invalid, raw.n_dropped_range) == (9.0, "9.bin", 6, 2, 2)
    assert raw.points.dtype == np.float64
    for low, high, n_kept in ((0.0, 200.0, 4), (5.0, 5.1, 2), (60.0, 61.0, 0)):
        raw = folder.read(0, low, high)
        assert raw.points.shape == (n_kept, 3) and raw.n_dropped_range == 4 - n_kept
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
    for name in ("1.las", "1.LAZ"):
        write_las(tmp_path / name, points)
    for name in ("1.bin", "1.npz", "1.ply", "1.pcd", "1.las", "1.LAZ"):
        scans = open_scans(tmp_path / name)
        assert len(scans) == 1 and scans.times.tolist() == [1.0]
        np.testing.assert_allclose(scans.read(0, 0.0, 200.0).points, points, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(("names", "times"), [
    (["2.bin", "10.bin", "1.bin"], [1, 2, 10]),
    (["000010.bin", "000011.bin"], [10, 11]),
    (["1.5.bin", "1.25.bin", "2.bin"], [1.25, 1.5, 2]),
    (["1700000000.100000.bin", "1700000000.05.bin"], [1700000000.05, 1700000000.1]),
    (["1700000000050000000.bin", "1700000000150000000.bin"], [1700000000.05, 1700000000.15]),
    (["1700000000050000.bin", "1700000000150000.bin"], [1700000000.05, 1700000000.15]),
    (["1700000000050.bin", "1700000000150.bin"], [1700000000.05, 1700000000.15]),
])  # fmt: skip
def test_times_from_names(fill, names, times):
    np.testing.assert_allclose(open_scans(fill(*names)).times, times, rtol=0, atol=1e-6)


def test_times_from_the_file_beside_the_scans(fill, tmp_path):
    folder = fill("scan_2.bin", "scan_10.bin", "scan_1\udce4.bin")
    (folder / "times.txt").write_text("# s\n10.5\n\n10.75 # the second\n11.0\n")
    (folder / "notes.md").write_text("left alone")
    (folder / "._scan_1.bin").write_text("left alone")
    scans = open_scans(folder)
    assert [scan.name for scan in scans.scans()] == ["scan_1?.bin", "scan_2.bin", "scan_10.bin"]
    np.testing.assert_array_equal(scans.times, [10.5, 10.75, 11.0])
    (tmp_path / "other.txt").write_text("1\n2\n3\n")
    np.testing.assert_array_equal(open_scans(folder, tmp_path / "other.txt").times, [1, 2, 3])


@pytest.mark.parametrize(("names", "times", "words"), [
    (["scan_1.bin"], None, r"a time as the name of each scan, or a times\.txt .*got scan_1\.bin.*Write a times"),
    (["1.bin", "1.0.bin"], None, r"names of increasing times of the same unit .*got .*1\.0\.bin"),
    (["999999999999.bin", "1000000000000.bin"], None, "of the same unit"),
    ([], None, r"scans of one kind \(\.bin, \.pcd, \.las, \.laz, \.ply, \.npz\) in .*got none"),
    (["1.bin", "2.pcd"], None, r"scans of one kind .*got \.bin, \.pcd"),
    (["1.bin", "2.bin"], "1\n2\n3\n", "Expected 2 times in .*got 3"),
    (["1.bin", "2.bin"], "1\n1\n", r"times\.txt, line 2: Expected one .*, later than the one before, got '1'"),
    (["1.bin", "2.bin"], "1\nx\n", r"times\.txt, line 2: Expected one time in seconds, .*got 'x'"),
    (["1.bin", "2.bin"], "nan\n2\n", "line 1: Expected one time in seconds, .*got 'nan'"),
])  # fmt: skip
def test_folders_that_cannot_be_read_are_refused(fill, names, times, words):
    folder = fill(*names)
    if times is not None:
        (folder / "times.txt").write_text(times)
    with pytest.raises(FileError, match=words):
        open_scans(folder)


def test_files_that_are_empty_or_truncated(fill):
    folder = open_scans(fill("1.bin"))
    whole = folder.paths[0].read_bytes()
    for n_bytes in (0, 1, 12, 15, 17, 60, 95):
        folder.paths[0].write_bytes(whole[:n_bytes])
        with pytest.raises(FileError, match=rf"reflectance in .*1\.bin, 16 bytes per point, got {n_bytes} bytes"):
            folder.read(0)


def test_a_map_is_not_a_scan(tmp_path, monkeypatch):
    monkeypatch.setattr(scan_folder, "MAX_SCAN_POINTS", 5)
    np.savez(tmp_path / "1.npz", points=POINTS)
    write_bin(tmp_path / "1.bin")
    for name in ("1.npz", "1.bin"):
        with pytest.raises(FileError, match=r"at most 5 points, got 6 in .*Is it a map"):
            open_scans(tmp_path / name).read(0)


def assert_widths_are_told(rows, path):
    """Check a scan (x, y, z, reflectance), written with four floats and with three, of sizes that divide by either."""
    for n_left_out in range(4):
        part = rows[: len(rows) - n_left_out]
        part.tofile(path)
        np.testing.assert_array_equal(read_scan_file(path).points, part[:, :3])
        np.ascontiguousarray(part[:, :3]).tofile(path)
        np.testing.assert_array_equal(read_scan_file(path).points, part[:, :3])


def test_real_scans_of_three_floats_are_told_from_those_of_four(real_data, tmp_path):
    """Files of three floats were read as four where their size allows that, and localized."""
    for drive in ("kitti-0013", "kitti360-suburb", "second-pass"):
        paths = sorted(real_data(drive).rglob("*.bin"))
        assert len(paths) > 20
        for path in paths[:: len(paths) // 4]:
            assert_widths_are_told(np.fromfile(path, "<f4").reshape(-1, 4), tmp_path / "1.bin")


def test_three_floats_are_told_from_four(tmp_path):
    rng = np.random.default_rng(5)
    headings, z = rng.uniform(-np.pi, np.pi, 3000), rng.uniform(-1.7, 2.0, 3000)
    rows = np.column_stack([9 * np.cos(headings), 30 * np.sin(headings), z, rng.uniform(0, 1, 3000)]).astype("<f4")
    for reflectance in (rows[:, 3], 0.0, 255 * rows[:, 3]):
        rows[:, 3] = reflectance
        assert_widths_are_told(rows, tmp_path / "1.bin")
    rows[:, :3].tofile(tmp_path / "1.bin")
    assert describe(tmp_path / "1.bin").scanners[0].words["fields"] == "x float32, y float32, z float32"
    for n in (1, 3, 6, 30, 300):  # of few points, or where columns do not differ, the size decides
        same = rng.uniform(-9, 9, (n, 4)).astype("<f4")
        same.tofile(tmp_path / "1.bin")
        np.testing.assert_array_equal(read_scan_file(tmp_path / "1.bin").points, same[:, :3])
    for width in (3, 4):
        rows[:, :width].astype("<f8").tofile(tmp_path / "1.bin")
        with pytest.raises(FileError, match="float64"):
            read_scan_file(tmp_path / "1.bin")
    rows[:, :4].tofile(tmp_path / "1.bin")
    (tmp_path / "1.bin").write_bytes((tmp_path / "1.bin").read_bytes()[: 12 * 2999])
    with pytest.raises(FileError, match="truncated"):  # four floats, cut where three would fit
        read_scan_file(tmp_path / "1.bin")
