# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon export` of what `maxcon localize` wrote."""

import json

import pytest


@pytest.fixture
def poses(maxcon, drive, tmp_path):
    out = tmp_path / "poses.csv"
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", out)
    assert maxcon(*arguments).code == 0
    return out


def test_a_drive_is_exported_in_the_crs_of_its_map(maxcon, refused, poses, drive, tmp_path):
    ended = maxcon("export", poses, "-o", tmp_path / "a.geojson", "--map", drive.city)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out == f"4 of 4 epochs have a pose; written to {tmp_path / 'a.geojson'}\n"
    longitude, latitude, _ = json.loads((tmp_path / "a.geojson").read_text())["features"][0]["geometry"][
        "coordinates"
    ]
    assert 9.0 < longitude < 10.0
    assert 52.0 < latitude < 53.0
    refused(maxcon("export", poses, "-o", tmp_path / "b.kml"), "--map")
    refused(
        maxcon("export", poses, "-o", tmp_path / "b.kml", "--map", drive.city, "--crs", "EPSG:25832"), "both"
    )
    refused(maxcon("export", poses, "-o", poses), "another file")
    refused(maxcon("export", drive.dataset.prior, "-o", tmp_path / "b.tum"), "POSES.csv")
    refused(maxcon("export", poses, "-o", tmp_path / "b.laz"), "--scans for")
    refused(
        maxcon("export", poses, "-o", tmp_path / "b.tum", "--scans", drive.dataset.scans), ".laz or .las file"
    )
    assert not list(tmp_path.glob("b.*"))


def test_a_file_is_replaced_only_if_asked(maxcon, refused, poses, tmp_path):
    for name in ("a.tum", "a.kitti"):
        assert maxcon("export", poses, "-o", tmp_path / name).code == 0
        refused(maxcon("export", poses, "-o", tmp_path / name), "not to exist yet", "--overwrite")
        assert maxcon("export", poses, "-o", tmp_path / name, "--overwrite").code == 0


def test_another_map_is_noticed(maxcon, refused, poses, drive, tmp_path):
    moved = tmp_path / "moved.csv"
    rows = [line.split(",") for line in poses.read_text().splitlines()]
    for row in rows[1:]:
        row[1] = str(float(row[1]) + 5000.0)
    moved.write_text("".join(",".join(row) + "\n" for row in rows))
    ended = maxcon("export", moved, "-o", tmp_path / "a.kml", "--map", drive.city)
    refused(ended, "the map in which", "4 of its 4 poses")


def test_scans_lie_in_the_map(maxcon, poses, drive, tmp_path):
    laspy = pytest.importorskip("laspy")
    arguments = (
        "export",
        poses,
        "-o",
        tmp_path / "a.laz",
        "--map",
        drive.city,
        "--scans",
        drive.dataset.scans,
    )
    ended = maxcon(*arguments)
    assert (ended.code, ended.err) == (0, "")
    cloud = laspy.read(tmp_path / "a.laz")
    assert f"4 of 4 epochs have a pose, {len(cloud.points):,} points; written to" in ended.out
