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
    longitude, latitude, _ = json.loads((tmp_path / "a.geojson").read_text())["features"][0]["geometry"]["coordinates"]
    assert 9.0 < longitude < 10.0
    assert 52.0 < latitude < 53.0
    refused(maxcon("export", poses, "-o", tmp_path / "b.kml"), "--map")
    refused(maxcon("export", poses, "-o", tmp_path / "b.kml", "--map", drive.city, "--crs", "EPSG:25832"), "both")
    refused(maxcon("export", poses, "-o", poses), "another file")
    refused(maxcon("export", drive.dataset.prior, "-o", tmp_path / "b.tum"), "POSES.csv")
    refused(maxcon("export", poses, "-o", tmp_path / "b.laz"), "--scans for")
    refused(maxcon("export", poses, "-o", tmp_path / "b.tum", "--scans", drive.dataset.scans), ".laz or .las file")
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
    arguments = ("export", poses, "-o", tmp_path / "a.laz", "--map", drive.city, "--scans", drive.dataset.scans)
    ended = maxcon(*arguments)
    assert (ended.code, ended.err) == (0, "")
    cloud = laspy.read(tmp_path / "a.laz")
    assert f"4 of 4 epochs have a pose, {len(cloud.points):,} points; written to" in ended.out


def test_a_drive_of_many_is_exported_by_its_name(maxcon, refused, poses, drive, tmp_path):
    table, many = tmp_path / "drives.csv", tmp_path / "many"
    scans, prior = drive.dataset.scans, drive.dataset.prior
    table.write_text(f"name,scans,prior\na,{scans},{prior}\n")
    localize = ("localize", drive.city, "--drives", table, "-o", many, "--workers", "1")
    assert maxcon(*localize).code == 0
    assert maxcon("export", many, "-o", tmp_path / "only.csv").out.startswith("4 of 4 epochs")  # there is one
    table.write_text(f"name,scans,prior\na,{scans},{prior}\n0013,{scans},{prior}\n")
    assert maxcon(*localize).code == 0
    (many / "_parts" / "c").mkdir(parents=True)
    export = ("export", many, "--map", drive.city, "-o")
    assert maxcon(*export, tmp_path / "a.geojson", "--drive", "0013").code == 0
    assert maxcon("export", poses, "--map", drive.city, "-o", tmp_path / "b.geojson").code == 0
    places = [
        [feature["geometry"]["coordinates"] for feature in json.loads((tmp_path / name).read_text())["features"]]
        for name in ("a.geojson", "b.geojson")
    ]
    assert places[0] == [pytest.approx(place, abs=1e-3) for place in places[1]]
    refused(maxcon(*export, tmp_path / "c.kml"), "0013, a, got none")
    refused(maxcon(*export, tmp_path / "c.kml", "--drive", "b"), "0013, a, got 'b'", "Name one of them")
    refused(maxcon(*export, tmp_path / "c.kml", "--drive", "c"), "got 'c'", "same localize command")
    refused(maxcon("export", tmp_path, "-o", tmp_path / "c.kml"), "--drives", str(tmp_path))
    refused(maxcon("export", poses, "-o", tmp_path / "c.kml", "--drive", "a"), "a folder of many drives")
    assert not list(tmp_path.glob("c.*"))
    at = (drive.city, scans, many / "drive=a" / "poses.parquet", "-o", tmp_path / "updated.map")
    updated = maxcon("map", "update", *at, "-q")
    assert "drive=a/poses.parquet (" in updated.out, updated
