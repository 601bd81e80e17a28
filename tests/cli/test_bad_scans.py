# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`localize` on scans that cannot be used: one line, and no table."""

import csv
import shutil

import numpy as np
import pytest

PCD = """VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH {n}
HEIGHT 1
POINTS {n}
DATA binary
"""


@pytest.fixture
def scans(drive, tmp_path):
    """A copy of the scans, to be broken."""
    return shutil.copytree(drive.dataset.scans, tmp_path / "scans")


@pytest.fixture
def not_localized(maxcon, refused, drive, tmp_path):
    """Check that localizing scans is refused with these words, and that nothing was written."""

    def check(scans, *words, options=()):
        out = tmp_path / "out"
        out.mkdir(exist_ok=True)
        arguments = ("--prior", drive.dataset.prior, "-o", out / "poses.csv", "--tum", out / "poses.txt")
        refused(maxcon("localize", drive.city, scans, *arguments, *options), *words)
        assert list(out.iterdir()) == []

    return check


def _only(folder, name, content):
    """A folder with one scan, whose time is that of the first epoch."""
    folder.mkdir()
    (folder / name).write_bytes(content)
    (folder / "times.txt").write_text("386400.0\n")
    return folder


def test_no_scans(not_localized, tmp_path, drive):
    (tmp_path / "empty").mkdir()
    not_localized(tmp_path / "missing", tmp_path / "missing", "no such folder or file")
    not_localized(tmp_path / "empty", tmp_path / "empty", ".bin, .pcd", "got none")
    not_localized(drive.dataset.prior, drive.dataset.prior, ".bin, .pcd", "got none")


def test_scans_of_several_kinds(not_localized, scans):
    (scans / "000004.pcd").touch()
    not_localized(scans, scans, ".bin, .pcd", "Put each kind in its own folder")


def test_too_few_and_too_many_times(not_localized, scans):
    times = (scans / "times.txt").read_text().splitlines()
    for lines in (times[:-1], [*times, "999999.0"], []):
        (scans / "times.txt").write_text("\n".join(lines))
        not_localized(scans, "4 times", scans / "times.txt", f"got {len(lines)}")


def test_times_that_are_none(not_localized, scans):
    for line, got in (("noon", "'noon'"), ("nan", "'nan'"), ("386400.0 1", "386400.0 1")):
        (scans / "times.txt").write_text(f"# s\n{line}\n")
        not_localized(scans, f"{scans / 'times.txt'}, line 2", got)
    (scans / "times.txt").write_text("2.0\n1.0\n")
    not_localized(scans, "line 2", "increase")


def test_a_missing_file_of_times(not_localized, scans, tmp_path):
    not_localized(scans, tmp_path / "clock.txt", "no such file", options=("--times", tmp_path / "clock.txt"))


def test_names_that_are_no_times(not_localized, scans):
    (scans / "times.txt").unlink()
    (scans / "000000.bin").rename(scans / "first.bin")
    not_localized(scans, "first.bin", "times.txt")


def test_a_scan_truncated_in_the_middle_of_the_drive_is_a_row_with_its_reason(
    maxcon, drive, scans, truncated, tmp_path
):
    path = truncated(scans / "000002.bin", 0.5001)
    out = tmp_path / "poses.csv"
    ended = maxcon("localize", drive.city, scans, "--prior", drive.dataset.prior, "-o", out, "--quiet")
    assert (ended.code, ended.err) == (1, "")
    assert "3 of 4 epochs localized" in ended.out
    assert "1 unreadable scan" in ended.out
    assert "the first, epoch 2: Expected float32 x, y, z, reflectance" in ended.out
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["localized", "localized", "unreadable scan", "localized"]
    assert str(path) in rows[2]["reason"] and "truncated" in rows[2]["reason"]
    assert (rows[2]["x"], rows[2]["score"]) == ("", "")
    assert float(rows[1]["time"]) < float(rows[2]["time"]) < float(rows[3]["time"])


def test_a_drive_without_a_readable_scan_is_refused(not_localized, scans, truncated):
    paths = [truncated(path, 0.5001) for path in sorted(scans.glob("*.bin"))]
    not_localized(scans, paths[0], "16 bytes per point", "truncated")


@pytest.mark.parametrize("suffix", ["bin", "pcd", "ply", "npz", "las", "laz"])
def test_an_empty_scan(not_localized, tmp_path, suffix):
    folder = _only(tmp_path / "scans", f"000000.{suffix}", b"")
    not_localized(folder, folder / f"000000.{suffix}")


def test_pcds_that_lie_about_their_size(not_localized, tmp_path):
    points = np.ones((10, 3), "<f4").tobytes()
    for n in (11, 10**9, 10**17, 0):
        folder = _only(tmp_path / f"scans{n}", "000000.pcd", PCD.format(n=n).encode() + points)
        not_localized(folder, folder / "000000.pcd")
    text = PCD.format(n=10).replace("POINTS 10", "POINTS 9").encode() + points
    folder = _only(tmp_path / "scans", "000000.pcd", text)
    not_localized(folder, folder / "000000.pcd", "WIDTH times HEIGHT", "9 and 10")


def test_a_ply_with_lists(not_localized, tmp_path):
    content = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nend_header\n1 0\n"
    folder = _only(tmp_path / "scans", "000000.ply", content)
    not_localized(folder, folder / "000000.ply", "list")


def test_a_scan_without_a_finite_point_is_not_localized(maxcon, drive, scans, tmp_path):
    np.full((100, 4), np.nan, "<f4").tofile(scans / "000001.bin")
    ended = maxcon("localize", drive.city, scans, "--prior", drive.dataset.prior, "-o", tmp_path / "poses.csv")
    assert (ended.code, ended.err) == (1, "")
    assert "1 no points: " in ended.out
    assert "left out: 100 points" in ended.out


def test_infinite_coordinates_are_dropped(maxcon, drive, scans, tmp_path):
    points = np.fromfile(scans / "000001.bin", "<f4").reshape(-1, 4)
    points[::50, 0], points[1::50, 2] = np.inf, np.nan
    points.tofile(scans / "000001.bin")
    ended = maxcon("localize", drive.city, scans, "--prior", drive.dataset.prior, "-o", tmp_path / "poses.csv")
    assert (ended.code, ended.err) == (0, "")


def test_a_map_cloud_instead_of_scans(not_localized, drive):
    not_localized(drive.dataset.map_clouds[0].parent, "times.txt")
