"""What `maxcon map build`, `info` and `copy` say of a map, in a folder and on an S3 server."""

import json

import numpy as np
import pytest

from localized_poses import rows_of
from maxcon.map.manifest import read_manifest, write_manifest


@pytest.fixture
def build(maxcon, out):
    """Build `city.map`; the lines that are printed, by their first word."""

    def run(*arguments):
        ended = maxcon("map", "build", *arguments, "-o", out / "city.map", "--overwrite", "-q")
        assert (ended.code, ended.err) == (0, ""), ended
        assert ended.out == f"{out / 'city.map'}\n{maxcon('map', 'info', out / 'city.map').out}"
        return {line.split()[0]: line for line in ended.out.splitlines()[1:]}

    return run


def test_what_is_taken_of_a_cloud_and_what_not(build, write_las, street, tmp_path):
    cloud = write_las()
    street[:7, 0], street[7:10, 2] = np.nan, np.inf
    np.savez(tmp_path / "more.npz", points=street)
    said = build(cloud, tmp_path / "more.npz", "--crs", "EPSG:25832")
    assert "from 5,990 points" in said["voxels"] and "warning" not in said["CRS"]
    assert said["normals"].endswith("of unknown side: --trajectory tells it")
    dropped = "3,000 points, 2,990 kept; dropped 10 without finite coordinates"
    assert said["source"].endswith(
        f"more.npz: {dropped}; no ASPRS classes: ground, vegetation and vehicles were not dropped"
    )


def test_of_a_cloud_outside_of_the_area_nothing_is_said_of_classes(build, write_las, street, tmp_path):
    np.savez(tmp_path / "more.npz", points=street + [9000.0, 0.0, 0.0])
    area = ",".join(f"{bound:.0f}" for bound in (*(street[:, :2].min(axis=0) - 1), *(street[:, :2].max(axis=0) + 1)))
    said = build(write_las(), tmp_path / "more.npz", "--crs", "EPSG:25832", "--area", area)
    assert said["source"].endswith("more.npz: 3,000 points, 0 kept; 3,000 outside of the area")


def test_what_is_found_of_clouds_without_classes_is_told_in_ratios(build, tmp_path):
    x, y = (at.ravel() for at in np.meshgrid(np.arange(0.0, 10.0, 0.05), np.arange(0.0, 10.0, 0.05)))
    floor, wall = (np.column_stack([x, y, np.zeros(x.size)]), np.column_stack([x, np.full(x.size, 9.0), y / 2.0]))
    np.savez(tmp_path / "a.npz", points=np.concatenate([floor, wall]))
    said = build(tmp_path / "a.npz")
    assert "ground 5" in said["found"] and "vegetation 0 %, temporary 0 %, kept 4" in said["found"]
    assert "temporary objects cannot be found: the clouds have no times to tell passes apart by" in said["found"]
    assert "no ASPRS classes" not in said["source"]
    said = build(tmp_path / "a.npz", "--classify", "off", "--crs", "EPSG:25832")
    assert "warning: x 15, y 15 is outside of its area of use. Are coordinates local" in said["CRS"]
    assert "found" not in said and "no ASPRS classes" in said["source"]


def test_how_well_a_map_is_known_and_from_what(build, maxcon, refused, street_npz, out, tmp_path):
    rng = np.random.default_rng(1)  # walls across a street of 30 m, passed twice at 0.25 m/s, with 0.02 m between
    along = np.repeat(np.arange(0.0, 30.0, 1.1), 4000)
    wall = np.column_stack([along, *rng.uniform(0.0, 3.0, (2, len(along)))])
    points, times = np.concatenate([wall, wall + [0.02, 0.0, 0.0]]), np.concatenate([4 * along, 300 + 4 * along])
    (tmp_path / "passes").mkdir()
    passes, file = tmp_path / "passes" / "a.npz", tmp_path / "passes" / "alignment.json"
    np.savez(passes, points=points, times=times)
    words = build(street_npz)["sigma"]
    assert words == "sigma        0.02 m, assumed: no planes of points with times; say it with --sigma"
    manifest = read_manifest(out / "city.map")
    del manifest.build["sigma"]
    write_manifest(out / "city.map", manifest)
    assert "sigma        0.02 m, it does not say from what\n" in maxcon("map", "info", out / "city.map").out
    assert build(street_npz, "--sigma", "0.0075")["sigma"] == "sigma        0.0075 m, given"
    words = build(passes)["sigma"]
    assert words.startswith("sigma        0.010 m, from 2 passes of 0.014 m each, compared at ")
    file.write_text(json.dumps({"sigma": {"of_map": 0.0125}, "n_passes": 2, "n_ties": 100}))
    assert build(passes)["sigma"].startswith("sigma        0.0125 m, from alignment.json beside the clouds")
    file.write_text("{")
    refused(maxcon("map", "build", passes, "-o", out / "b.map"), "alignment.json", "--sigma")


def test_what_map_info_says_is_there_as_json(maxcon, drive):
    ended = maxcon("map", "info", drive.city, "--check", "--json")
    facts, manifest = json.loads(ended.out), read_manifest(drive.city)
    assert (ended.code, ended.err, facts["crs"], facts["build"]) == (0, "", "EPSG:25832", manifest.build)
    assert (facts["cell"], facts["n_voxels"], facts["n_tiles"]) == (0.06, manifest.n_voxels, len(manifest.tiles))
    x_low, y_low, x_high, y_high = facts["extent"]
    said = maxcon("map", "info", drive.city).out
    assert f"x {x_low:.1f} to {x_high:.1f}, y {y_low:.1f} to {y_high:.1f} m" in said
    assert f"{facts['n_ground_heights']:,} heights" in said and facts["n_ground_heights"] > 1000


def test_a_map_is_exported_once(maxcon, refused, drive, tmp_path):
    ended = maxcon("map", "export", drive.city, "-o", tmp_path / "city.laz", "-q")
    assert (ended.code, ended.err) == (0, "") and "voxels and" in ended.out
    refused(maxcon("map", "export", drive.city, "-o", tmp_path / "city.laz"), "city.laz", "--overwrite")
    assert maxcon("map", "export", drive.city, "-o", tmp_path / "city.laz", "--overwrite").code == 0
    refused(maxcon("map", "export", drive.city, "-o", tmp_path / "city.xyz"), ".laz, .las, .ply")


# --- on a server ---
def test_a_copy_on_a_server_gives_the_same_poses(maxcon, localize, drive, poses, bucket, tmp_path, refused, street_npz):
    city = f"{bucket}/city"
    assert maxcon("map", "copy", drive.city, city).out == f"{city}\n"
    assert maxcon("map", "info", city, "--check").out == maxcon("map", "info", drive.city, "--check").out
    assert localize(city=city).code == 0 and rows_of(tmp_path / "poses.csv") == rows_of(poses)
    refused(maxcon("map", "info", f"{bucket}/none"), f"{bucket}/none", "no manifest.json there")
    refused(maxcon("map", "build", street_npz, "-o", f"{bucket}/a"), f"map copy FOLDER {bucket}/a")


@pytest.mark.parametrize(("spacing", "options", "cell", "words"), [
    (0.21, (), 0.24, "90 % of them within 0.210 m: voxels of 0.24 m have few holes"),
    (0.21, ("--cell", "0.06"), 0.06, "surfaces have holes in voxels of 0.06 m; --cell 0.24 suits them"),
    (0.7, (), 0.6, "more than a tenth of them 0.5 m or more: too sparse for surfaces, few scans will match"),
])  # fmt: skip
def test_how_far_apart_the_points_of_a_map_lie(build, tmp_path, spacing, options, cell, words):
    at = np.arange(0.0, 20.0, spacing)
    points = np.stack([*(axis.ravel() for axis in np.meshgrid(at, at)), np.zeros(at.size**2)], axis=1)
    np.savez(tmp_path / "a.npz", points=points)
    said = build(tmp_path / "a.npz", "--classify", "off", *options)
    assert f" of {cell:g} m" in said["voxels"] and said["spacing"].endswith(words)
