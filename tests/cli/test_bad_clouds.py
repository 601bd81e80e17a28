# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`map build` on clouds that cannot be used: one line, and no map."""

import numpy as np
import pytest

PLY = """ply
format ascii 1.0
element vertex {n}
property float x
property float y
property float z
end_header
"""


@pytest.fixture
def build(maxcon, tmp_path):
    """Build `city.map` in an empty folder."""
    folder = tmp_path / "out"
    folder.mkdir()

    def run(*arguments):
        return maxcon("map", "build", *arguments, "-o", folder / "city.map")

    run.folder = folder
    return run


@pytest.fixture
def not_built(build, refused):
    """Check that building is refused with these words, and that nothing was written."""

    def check(*arguments, words=()):
        refused(build(*arguments), *words)
        assert list(build.folder.iterdir()) == []

    return check


@pytest.mark.parametrize("suffix", ["las", "laz", "ply", "npz"])
def test_an_empty_file(not_built, tmp_path, suffix):
    path = tmp_path / f"empty.{suffix}"
    path.touch()
    not_built(path, words=[path, "Expected", "got"])


@pytest.mark.parametrize("suffix", ["las", "laz", "ply", "npz"])
def test_a_file_of_another_kind(not_built, tmp_path, suffix):
    path = tmp_path / f"other.{suffix}"
    path.write_bytes(b"\x7fELF" + bytes(range(256)) * 20)
    not_built(path, words=[path])


def test_a_truncated_laz(not_built, write_las, truncated):
    path = truncated(write_las("cut.laz"))
    not_built(path, words=[path, "Copy it again"])


def test_a_truncated_las(not_built, write_las, truncated):
    path = truncated(write_las("cut.las"))
    not_built(path, words=[path, "3000 points", "truncated", "Copy it again"])


def test_a_truncated_npz(not_built, street_npz, truncated):
    not_built(truncated(street_npz), words=[street_npz, "Copy it again"])


def test_a_truncated_ply(not_built, tmp_path):
    path = tmp_path / "cut.ply"
    path.write_text(PLY.format(n=3) + "0 0 0\n1 1 1\n")
    not_built(path, words=[path, "3 vertices", "truncated"])


def test_the_second_of_two_clouds_breaks_half_way(not_built, street_npz, write_las):
    path = write_las("second.laz", crs=None)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 2000] = bytes(2000)
    path.write_bytes(content)
    not_built(street_npz, path, words=[path])


def test_wrong_suffix(not_built, tmp_path):
    path = tmp_path / "cloud.dxf"
    path.write_bytes(b"0")
    not_built(path, words=[path, ".las, .laz, .ply, .npz", "Convert it"])


def test_a_missing_file(not_built, tmp_path):
    for name in ("missing.laz", "missing", "a" * 300 + ".laz"):
        not_built(tmp_path / name, words=[name, "no such file" if len(name) < 255 else "too long"])


def test_a_folder_of_clouds(not_built, tmp_path):
    not_built(tmp_path, words=["got the folder", tmp_path, "Name the files in it"])


def test_a_cloud_named_twice(not_built, street_npz):
    not_built(street_npz, street_npz.parent / "." / street_npz.name, words=[street_npz.name, "more than once"])


def test_points_without_finite_coordinates_are_dropped_and_counted(build, tmp_path, street):
    street[:7, 0] = np.nan
    street[7:10, 2] = np.inf
    np.savez(tmp_path / "holes.npz", points=street)
    ended = build(tmp_path / "holes.npz")
    assert (ended.code, ended.err) == (0, "")
    assert "3,000 points, 2,990 kept; dropped 10 without finite coordinates" in ended.out


def test_no_finite_point_at_all(not_built, tmp_path):
    path = tmp_path / "nan.npz"
    np.savez(path, points=np.full((10, 3), np.nan))
    not_built(path, words=["nan.npz", "none of the 10 points", "10 have no finite coordinates", "Check"])


def test_a_lone_point_far_away_is_no_map(not_built, tmp_path, street):
    street[5] = 1e300
    np.savez(tmp_path / "far.npz", points=street)
    not_built(tmp_path / "far.npz", words=[tmp_path / "far.npz", "farther away", "Remove it"])


def test_a_ply_with_lists_in_its_vertices(not_built, tmp_path):
    path = tmp_path / "mesh.ply"
    path.write_text(PLY.format(n=1).replace("end_header", "property list uchar int parts\nend_header") + "0 0 0 1 1\n")
    not_built(path, words=[path, "list"])


def test_a_ply_of_a_mesh_without_coordinates(not_built, tmp_path):
    path = tmp_path / "flat.ply"
    path.write_text(PLY.format(n=1).replace("property float z\n", "") + "0 0\n")
    not_built(path, words=[path, "'z'", "Export the points with x, y, z"])


def test_an_npz_of_another_shape(not_built, tmp_path):
    path = tmp_path / "flat.npz"
    np.savez(path, points=np.zeros((10, 4)))
    not_built(path, words=[path, "(n, 3)", "(10, 4)"])


def test_an_npz_with_objects_is_not_unpickled(not_built, tmp_path):
    path = tmp_path / "objects.npz"
    np.savez(path, points=np.array([[print, 1, 2]], dtype=object))
    not_built(path, words=[path, "object"])


def test_unknown_class(not_built, write_las):
    not_built(write_las(), "--drop", "foo", words=["'foo'", "ground", "vegetation", "--vehicle-class 64"])
    not_built(write_las(), "--drop", "256", words=["0 to 255", "256"])
    not_built(write_las(), "--drop", "9" * 5000, words=["0 to 255"])
    not_built(write_las(), "--vehicle-class", "-1", words=["0 to 255", "-1"])
    not_built(write_las(), "--drop", "vehicle", words=["--vehicle-class"])


def test_drop_and_keep_all(not_built, write_las):
    not_built(write_las(), "--drop", "ground", "--keep-all", words=["--drop or --keep-all"])


def test_classes_to_drop_from_a_cloud_without(not_built, street_npz):
    words = [street_npz, "Leave out --drop"]
    not_built(street_npz, "--drop", "building", words=[*words, "building"])  # nothing finds buildings
    not_built(street_npz, "--drop", "ground", "--classify", "off", words=[*words, "ground"])


def test_everything_is_dropped(not_built, write_las):
    not_built(write_las(classes=2), words=["street.laz", "none of the 3,000 points", "3,000 are of classes"])
    not_built(write_las(), "--drop", "building", words=["none of the 3,000 points"])


def test_clouds_in_different_crs(not_built, write_las):
    first, second = write_las("a.laz"), write_las("b.laz", crs="EPSG:25833")
    not_built(first, second, words=[first, second, "different", "Reproject"])


def test_a_cloud_with_a_crs_and_one_without(not_built, write_las):
    first, second = write_las("a.laz"), write_las("b.laz", crs=None)
    not_built(first, second, words=[first, second, "names none", "--crs"])


def test_another_crs_than_the_cloud_names(not_built, write_las):
    path = write_las()
    not_built(path, "--crs", "EPSG:25833", words=[path, "EPSG:25833", "leave out --crs"])


@pytest.mark.parametrize("crs", ["EPSG:99999999", "nonsense", "", "PROJCS[\n", "EPSG:25832\nEPSG:25833"])
def test_unknown_crs(not_built, street_npz, crs):
    not_built(street_npz, "--crs", crs, words=["EPSG:25832"])


def test_a_geographic_crs(not_built, write_las, street_npz):
    not_built(write_las(crs="EPSG:4326"), words=["WGS 84", "degree", "Reproject"])
    not_built(street_npz, "--crs", "EPSG:4326", words=["WGS 84", "degree", "Reproject"])


@pytest.mark.parametrize("cell", ["0", "-0.06", "nan", "inf"])
def test_cells_that_are_none(not_built, street_npz, cell):
    not_built(street_npz, "--cell", cell, words=["positive voxel edge", "0.06"])


def test_cells_too_small(not_built, street_npz):
    not_built(street_npz, "--cell", "1e-9", words=["voxel edge", "0.0001 to 100 m"])


def test_a_trajectory_for_a_cloud_without_times(not_built, street_npz, tmp_path):
    (tmp_path / "drive.txt").write_text("100 550000 5802000 60 0 0 0 1\n")
    not_built(street_npz, "--trajectory", tmp_path / "drive.txt", words=[street_npz, "gps_time"])


def test_a_trajectory_of_another_time(not_built, write_las, tmp_path):
    (tmp_path / "drive.txt").write_text("5000 550000 5802000 60 0 0 0 1\n5001 550000 5802000 60 0 0 0 1\n")
    not_built(write_las(), "--trajectory", tmp_path / "drive.txt", words=["5000.000", "5001.000", "same clock"])


def test_a_missing_trajectory(not_built, write_las, tmp_path):
    not_built(write_las(), "--trajectory", tmp_path / "none.txt", words=[tmp_path / "none.txt", "no such file"])


def test_several_clouds_at_once_and_a_crs_by_option(build, write_las, street, tmp_path):
    np.savez(tmp_path / "more.npz", points=street)
    ended = build(write_las(), tmp_path / "more.npz", "--crs", "EPSG:25832")
    assert (ended.code, ended.err) == (0, "")
    assert "from 6,000 points" in ended.out
    assert "more.npz: 3,000 points, 3,000 kept; no ASPRS classes: ground, vegetation" in ended.out


def test_what_is_found_of_clouds_without_classes_is_told_in_shares(build, maxcon, tmp_path):
    x, y = (at.ravel() for at in np.meshgrid(np.arange(0.0, 10.0, 0.05), np.arange(0.0, 10.0, 0.05)))
    floor, wall = (np.column_stack([x, y, np.zeros(x.size)]), np.column_stack([x, np.full(x.size, 9.0), y / 2.0]))
    np.savez(tmp_path / "a.npz", points=np.concatenate([floor, wall]))
    ended = build(tmp_path / "a.npz")
    row = next(line for line in ended.out.splitlines() if line.startswith("found "))
    assert "ground 5" in row and "vegetation 0 %, temporary 0 %, kept 4" in row
    assert "temporary objects cannot be found: the clouds have no times to tell passes apart by" in row
    assert "no ASPRS classes" not in ended.out
    assert row in maxcon("map", "info", build.folder / "city.map").out
    assert "no ASPRS classes" in build(tmp_path / "a.npz", "--classify", "off", "--overwrite").out


@pytest.mark.parametrize("sigma", ["-0.01", "nan", "inf"])
def test_a_sigma_that_is_none(not_built, write_las, sigma):
    not_built(write_las(), f"--sigma={sigma}", words=["sigma", ">= 0 m", sigma, "Leave it out"])


def test_a_sigma_without_a_number(build, write_las):
    ended = build(write_las(), "--sigma", "small")
    assert ended.code == 2 and "--sigma" in ended.err


def test_an_area_that_is_none_and_one_without_points(not_built, street_npz):
    not_built(street_npz, "--area", "1,2,3", words=["x_min,y_min,x_max,y_max", "1,2,3"])
    not_built(street_npz, "--area", "0,0,1,1", words=["lie outside of the area", street_npz.name])


def test_points_of_no_known_crs_are_not_transformed(not_built, street_npz):
    not_built(street_npz, "--to-crs", "EPSG:25832", words=[street_npz, "--crs"])
