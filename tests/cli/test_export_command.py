"""`maxcon export` of what `maxcon localize` wrote."""

import json
import re
import shutil

import laspy
import numpy as np
import pytest


def places_of(path):
    return [feature["geometry"]["coordinates"] for feature in json.loads(path.read_text())["features"]]


def test_a_drive_is_exported_in_the_crs_of_its_map(maxcon, poses, drive, tmp_path):
    ended = maxcon("export", poses, "-o", tmp_path / "a.geojson", "--map", drive.city)
    assert ended.code == 0 and re.fullmatch("warning: longitudes and .* ETRS89 to WGS 84 .*, exact to 1 m\n", ended.err)
    assert ended.out == f"4 of 4 epochs have a pose; written to {tmp_path / 'a.geojson'}\n"
    longitude, latitude, _ = places_of(tmp_path / "a.geojson")[0]
    assert 9.0 < longitude < 10.0 and 52.0 < latitude < 53.0
    assert maxcon("export", poses, "-o", tmp_path / "b.geojson").code == 0  # the table says the CRS, too
    assert places_of(tmp_path / "b.geojson") == places_of(tmp_path / "a.geojson")
    ended = maxcon("export", poses, "-o", tmp_path / "a.laz", "--map", drive.city, "--scans", drive.dataset.scans)
    n_points = len(laspy.read(tmp_path / "a.laz").points)
    assert f"4 of 4 epochs have a pose, {n_points:,} points; written to" in ended.out


def test_what_cannot_be_exported_is_one_line(maxcon, refused, poses, drive, tmp_path):
    for options, words in (
        (("-o", tmp_path / "b.kml", "--map", drive.city, "--crs", "EPSG:25832"), ["both"]),
        (("-o", poses), ["another file"]),
        (("-o", tmp_path / "b.laz"), ["--scans for"]),
        (("-o", tmp_path / "b.shp", "--scans", drive.dataset.scans), [".gpkg", ".laz or .las", "'.shp'"]),
        (("-o", tmp_path / "b.tum", "--scans", drive.dataset.scans), [".laz or .las or .mcap or .rrd file"]),
        (("-o", tmp_path / "b.kml", "--drive", "a"), ["a folder of many drives"]),
    ):
        refused(maxcon("export", poses, *options), *words)
    refused(maxcon("export", drive.dataset.prior, "-o", tmp_path / "b.tum"), "POSES.csv")
    refused(maxcon("export", tmp_path, "-o", tmp_path / "b.kml"), "--drives", str(tmp_path))
    moved = tmp_path / "moved.csv"
    moved.write_text(re.sub(r"(?m)^([\d.]+,\d,[^,]+),5", r"\1,9", poses.read_text()))  # x from 550 km to 950 km
    ended = maxcon("export", moved, "-o", tmp_path / "b.kml", "--map", drive.city)
    refused(ended, "the map in which", "4 of its 4 poses")
    assert not list(tmp_path.glob("b.*"))


@pytest.mark.parametrize("name", ["a.tum", "a.kitti"])
def test_a_file_is_replaced_only_if_asked(maxcon, refused, poses, tmp_path, name):
    export = ("export", poses, "-o", tmp_path / name)
    assert maxcon(*export).code == 0
    refused(maxcon(*export), "not to exist yet", "--overwrite")
    assert maxcon(*export, "--overwrite").code == 0


def test_scans_lie_in_the_map(maxcon, poses, drive, tmp_path):
    ended = maxcon("export", poses, "-o", tmp_path / "a.laz", "--map", drive.city, "--scans", drive.dataset.scans)
    assert (ended.code, ended.err) == (0, "")
    cloud = laspy.read(tmp_path / "a.laz")
    assert f"4 of 4 epochs have a pose, {len(cloud.points):,} points; written to" in ended.out
    matched, distances = np.asarray(cloud["matched"]), np.asarray(cloud["distance"])
    assert 0.3 < matched.mean() < 0.99 and set(matched.tolist()) == {0, 1}
    assert np.array_equal(np.isfinite(distances), matched == 1)
    assert np.median(distances[matched == 1]) < 0.05


def test_a_drive_of_many_is_exported_by_its_name(maxcon, refused, poses, drive, tmp_path):
    table, many = tmp_path / "drives.csv", tmp_path / "many"
    table.write_text(f"name,scans,prior\na,{drive.dataset.scans},{drive.dataset.prior}\n")
    assert maxcon("localize", drive.city, "--drives", table, "-o", many, "--workers", "1").code == 0
    assert maxcon("export", many, "-o", tmp_path / "only.csv").out.startswith("4 of 4 epochs")  # there is one
    shutil.copytree(many / "drive=a", many / "drive=0013")
    (many / "_parts" / "c").mkdir(parents=True)
    export = ("export", many, "--map", drive.city, "-o")
    assert maxcon(*export, tmp_path / "a.geojson", "--drive", "0013").code == 0
    assert maxcon("export", poses, "--map", drive.city, "-o", tmp_path / "b.geojson").code == 0
    wanted = [pytest.approx(place, abs=1e-3) for place in places_of(tmp_path / "b.geojson")]
    assert places_of(tmp_path / "a.geojson") == wanted
    refused(maxcon(*export, tmp_path / "c.kml"), "with 0013, a, and no NAME")
    refused(maxcon(*export, tmp_path / "c.kml", "--drive", "c"), "with 0013, a, and c", "Name one of them")
    assert not list(tmp_path.glob("c.*"))
    at = (drive.city, drive.dataset.scans, many / "drive=a" / "poses.parquet", "-o", tmp_path / "updated.map")
    updated = maxcon("map", "update", *at, "-q")
    assert "drive=a/poses.parquet (" in updated.out, updated
