"""A car is gone, another is new, a third passes, and the wall stays: what an update makes of a street."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from maxcon import PointMap
from maxcon.cli import app
from maxcon.errors import FileError, MapError, OptionError
from maxcon.export import PoseRow
from maxcon.lab.dataset import open_drives
from maxcon.map.layout import SurfaceClass
from maxcon.map.manifest import read_manifest
from maxcon.mapping.update import LocalizedDrive, UpdateOptions, update_map
from street_of_boxes import CAR, CELL, OTHER_CAR, WALL, DriveOfBoxes, inside, map_of
from written_maps import run, stored_voxels, write


def parked(*boxes):
    return lambda seconds: boxes


def with_passing_car(seconds):
    """A car on the other lane, at 8 m/s."""
    return (OTHER_CAR, ((8.0 * seconds - 4.0, -3.6, 0.2), (8.0 * seconds, -1.9, 1.5)))


def drive(boxes_at, **changes):
    scans = DriveOfBoxes(boxes_at, **changes)
    return LocalizedDrive(scans, scans.rows(), "poses.csv", "0" * 64)


def checksums(folder):
    return {p: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(Path(folder).rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """The map of a day when CAR was there."""
    folder = tmp_path_factory.mktemp("street") / "street.map"
    point_map = map_of(WALL, CAR)
    write(folder, point_map, origin=(0.0, 0.0, 0.0))
    return folder


@pytest.fixture(scope="module")
def updated(street, tmp_path_factory):
    out = tmp_path_factory.mktemp("updated") / "next.map"
    update_map(street, [drive(with_passing_car)], out)
    return out


def voxels_of(folder, which):
    means, _, _, classes = stored_voxels(folder)
    return means[classes == which]


def test_what_was_missed_is_gone_what_was_hit_is_new_and_a_search_does_not_meet_it(street, updated):
    was = voxels_of(street, SurfaceClass.KNOWN)
    known, gone, new = (voxels_of(updated, each) for each in (SurfaceClass.KNOWN, SurfaceClass.GONE, SurfaceClass.NEW))
    assert inside(gone, CAR).all() and len(gone) > 0.9 * (len(gone) + inside(known, CAR).sum())
    assert inside(known, WALL).sum() == inside(was, WALL).sum()
    assert len(known) + len(gone) == len(was) and len(new) > 1000
    assert inside(new, OTHER_CAR).all()  # and not of the car that passed
    assert (new[:, 2] > 0.2).all()  # nor of the road
    opened = PointMap.open(updated)
    tiles = [opened.tile(key) for key in opened.tile_keys]
    points = np.concatenate([tile.mean_points(CELL) for tile in tiles])
    assert inside(points, CAR, margin=0.0).sum() <= 0.1 * len(gone) and tiles[0].classes is None
    (said,) = read_manifest(updated).build["updates"]
    assert said["parent"]["sha256"] == json.loads((street / "manifest.json").read_text())["sha256"]
    assert said["drives"][0]["n_looks"] == 40
    assert (said["n_gone"], said["n_new"]) == (len(gone), len(new))


def test_a_car_that_comes_back_is_new_again(street, updated, tmp_path):
    before = checksums(updated)
    update_map(updated, [drive(parked(CAR), start=5000.0)], tmp_path / "third.map")
    assert checksums(updated) == before
    third = tmp_path / "third.map"
    back = voxels_of(third, SurfaceClass.NEW)
    assert inside(back, CAR).sum() > 1000
    n_before = inside(voxels_of(updated, SurfaceClass.NEW), OTHER_CAR).sum()
    assert inside(back, OTHER_CAR).sum() < 0.1 * n_before  # it has left meanwhile
    said = read_manifest(third).build["updates"]
    assert [len(each["drives"]) for each in said] == [1, 1] and said[1]["n_back"] > 1000
    assert said[1]["parent"]["sha256"] == json.loads((updated / "manifest.json").read_text())["sha256"]


def with_rows(of, change):
    """The same drive with other poses."""
    rows = tuple((i, PoseRow(row.time, change(row.pose), "localized", "", {})) for i, row in of.rows)
    return LocalizedDrive(of.scans, rows, "poses.csv", "")


def test_the_same_street_does_not_change_and_one_place_says_nothing_however_long(street, tmp_path):
    """A vehicle that stands sees the same again and again: one look."""
    standing = drive(parked(OTHER_CAR))
    place = standing.rows[10][1].pose
    drives = (drive(parked(CAR), n=20), with_rows(standing, lambda pose: place))
    for number, (one, least) in enumerate(zip(drives, (5_000, 0), strict=True)):
        update_map(street, [one], tmp_path / f"{number}.map")
        said = read_manifest(tmp_path / f"{number}.map").build["updates"][0]
        assert (said["n_gone"], said["n_new"]) == (0, 0) and said["n_judged"] > least


def test_tiles_come_and_go_from_memory_without_a_trace(street, updated, tmp_path, monkeypatch):
    """Looks one by one, the tiles of each read for it: the same bytes as all at once."""
    monkeypatch.setattr("maxcon.mapping.update.evidence.MOST_VOXELS", 1)
    update_map(street, [drive(with_passing_car)], tmp_path / "next.map")
    assert list(checksums(tmp_path / "next.map").values()) == list(checksums(updated).values())


def test_what_cannot_be_is_refused(street, tmp_path):
    one, out = drive(parked(), n=40), tmp_path / "x.map"
    far = with_rows(one, lambda pose: pose.translated((1e5, 0, 0)))
    for drives, target, kind, words in (
        ([one], street, OptionError, "another folder"),
        ([], out, OptionError, "at least one drive"),
        ([far], out, MapError, "no pose comes near"),
    ):
        with pytest.raises(kind, match=words):
            update_map(street, drives, target, overwrite=True)
    assert not out.exists()
    for wrong in ({"reach": 0.0}, {"least_looks": 0}, {"hit": np.nan}):
        with pytest.raises(OptionError, match="options of an update"):
            UpdateOptions(**wrong)


def test_drives_are_named_in_turn(tmp_path):
    scans, poses = DriveOfBoxes(parked(), n=3).write(tmp_path)
    (one,) = open_drives([scans, poses])
    assert (len(one.scans), len(one.rows), one.name) == (3, 3, "poses.csv")
    for wrong, words in (([scans], "behind it"), ([poses], "got it alone"), ([], "at least one")):
        with pytest.raises(OptionError, match=words):
            open_drives(wrong)
    with pytest.raises(FileError, match="no such"):
        open_drives([tmp_path / "none", poses])
    lines = poses.read_text().splitlines()
    poses.write_text("\n".join([lines[0], *(line.replace("localized", "weak") for line in lines[1:])]) + "\n")
    with pytest.raises(FileError, match="Expected a localized epoch"):
        open_drives([scans, poses])
    (tmp_path / "scans/times.txt").write_text("1\n2\n3\n")
    with pytest.raises(FileError, match="when there is no"):
        open_drives([scans, poses])


def test_the_command_updates_a_map_that_tells_its_history(street, tmp_path):
    scans, poses = DriveOfBoxes(parked(OTHER_CAR)).write(tmp_path)
    run("map", "update", street, scans, poses, "-o", tmp_path / "b.map")
    said = CliRunner().invoke(app, ["map", "info", str(tmp_path / "b.map"), "--check"]).output
    assert "update       1 of street.map" in said and "poses.csv (40 looks)" in said
    last = read_manifest(tmp_path / "b.map").build["updates"][-1]
    assert f"{last['n_gone']:,} voxels" in said and min(last["n_gone"], last["n_new"]) > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.map", "poses.csv", "scans"]
    with pytest.raises(FileError, match="exist"):
        run("map", "update", street, scans, poses, "-o", tmp_path / "b.map")
