"""Poses for other programs: each format is read back by a program of its own, or by hand."""

import csv
import json
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import laspy
import numpy as np
import pyarrow
import pyarrow.parquet as pq
import pyproj
import pytest

from maxcon import Pose
from maxcon.drive.poses_table import COLUMNS, COVARIANCES, poses_schema
from maxcon.errors import CrsError, FileError, OptionError, TrajectoryError
from maxcon.export import EXPORT_SUFFIXES, export_poses, export_scans, read_rows
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory

CRS = "EPSG:25832"
POSES = [
    Pose(550_000.1234, 5_802_000.5, 61.25, 0.01, -0.02, 0.5),
    None,
    Pose(550_010.0, 5_802_001.0, 61.5, -0.03, 0.004, -3.0),
]
LOCALIZED = [POSES[0], POSES[2]]
POSITIONS = [pose.position for pose in LOCALIZED]


def rows_of_a_drive():
    """Cells of three epochs, the second of which is not localized."""
    for number, pose in enumerate(POSES):
        row = {"time": 10.0 + number, "epoch": number, "ms": 5.0, "status": "ambiguous", "reason": "two, alike"}
        if pose is not None:
            row |= {name: getattr(pose, name) for name in ("x", "y", "z", "roll", "pitch", "heading")}
            row |= {name: 0.0001 if name[4:5] == name[-1:] else 0.0 for name in COVARIANCES}
            row |= {"status": "localized", "score": 12.5, "cov_heading_heading": 1e-06}
            row |= {"protection_along": 0.05, "reason": "", "shift_x": 1.0, "shift_y": -2.0}
        yield row


@pytest.fixture
def table(tmp_path):
    """POSES.csv of the drive."""
    path = tmp_path / "poses.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="")
        writer.writeheader()
        writer.writerows(rows_of_a_drive())
    return path


@pytest.fixture
def parquet(tmp_path):
    """The same rows as the Parquet file of a drive."""
    path = tmp_path / "drive=monday" / "poses.parquet"
    path.parent.mkdir()
    pq.write_table(pyarrow.Table.from_pylist([*rows_of_a_drive()], schema=poses_schema()), path)
    return path


def test_rows_are_read_as_they_were_written_by_a_drive_and_among_many(table, parquet, tmp_path):
    rows = read_rows(table)
    assert [row.status for row in rows] == ["localized", "ambiguous", "localized"]
    assert [row.pose for row in rows] == POSES
    assert (rows[0].numbers["cov_x_x"], rows[1].reason) == (0.0001, "two, alike")
    assert read_rows(parquet) == rows
    for path in (table, parquet):
        export_poses(path, tmp_path / f"{path.suffix}.geojson", CRS)
    assert (tmp_path / ".csv.geojson").read_bytes() == (tmp_path / ".parquet.geojson").read_bytes()


def _with(name, values):
    return lambda table: table.set_column(table.schema.get_field_index(name), name, [values])


@pytest.mark.parametrize(("change", "words"), [
    (lambda table: table.drop_columns(["cov_x_x"]), "no column cov_x_x"),
    (lambda table: table.slice(0, 0), "a row per epoch"), (_with("time", [None, 1.0, 2.0]), "no time"),
    (_with("x", [None, None, 2.0]), "a part of a pose"), (_with("score", [math.inf, None, 2.0]), "inf"),
    (_with("y", ["a", None, "b"]), "'a'"), (_with("status", [1, 2, 3]), "in row 1: 1"),
    (100, "to be a table such as POSES.csv"), ("removed", "No such file"), ("a folder", "Is a directory"),
])  # fmt: skip
def test_a_parquet_file_that_is_none_of_a_drive(parquet, change, words):
    content = parquet.read_bytes()
    if callable(change):
        pq.write_table(change(pq.read_table(parquet, partitioning=None)), parquet)
    elif isinstance(change, str):
        parquet.unlink()
        if change == "a folder":
            parquet.mkdir()
    else:
        parquet.write_bytes(content[:change])
    with pytest.raises(FileError, match=re.escape(words)) as refused:
        read_rows(parquet)
    assert str(parquet) in str(refused.value) and "\n" not in str(refused.value)


def back_in_crs(*lonlats):
    """Positions in the CRS of the poses, from longitude and latitude."""
    transformer = pyproj.Transformer.from_crs("EPSG:4326", CRS, always_xy=True)
    return [transformer.transform(*map(float, lonlat)) for lonlat in lonlats]


def test_geojson(table, tmp_path):
    export_poses(table, tmp_path / "a.geojson", CRS)
    content = json.loads((tmp_path / "a.geojson").read_text())
    assert content["type"] == "FeatureCollection"
    first, second, _ = content["features"]
    np.testing.assert_allclose(back_in_crs(first["geometry"]["coordinates"]), POSITIONS[:1], atol=1e-3)
    assert first["properties"]["cov_x_x"] == 0.0001
    assert first["properties"]["heading_deg"] == pytest.approx(math.degrees(0.5))
    assert first["properties"]["bearing_deg"] == pytest.approx(90.0 - math.degrees(0.5))
    assert second["geometry"] is None
    assert (second["properties"]["status"], second["properties"]["x"]) == ("ambiguous", None)


def test_geopackage(table, tmp_path):
    raw = pytest.importorskip("pyogrio.raw")
    export_poses(table, tmp_path / "a.gpkg", CRS)
    meta, _, points, columns = raw.read(tmp_path / "a.gpkg", layer="poses")
    assert pyproj.CRS.from_user_input(meta["crs"]).to_epsg() == 25832
    named = dict(zip(meta["fields"], columns, strict=True))
    assert named["status"].tolist() == ["localized", "ambiguous", "localized"]
    assert named["cov_x_x"][0] == 0.0001 and np.isnan(named["heading_deg"][1])
    assert points[1] is None
    np.testing.assert_array_equal(np.frombuffer(points[0], "<f8", 3, 5), POSES[0].position)
    _, _, lines, _ = raw.read(tmp_path / "a.gpkg", layer="priors")
    prior, answer = np.frombuffer(lines[0], "<f8", 4, 9).reshape(2, 2)
    np.testing.assert_allclose(answer - prior, [1.0, -2.0])
    _, _, ellipses, _ = raw.read(tmp_path / "a.gpkg", layer="ellipses")
    around = np.frombuffer(ellipses[1], "<f8", 130, 13).reshape(65, 2) - POSES[2].position[:2]
    np.testing.assert_allclose(np.hypot(*around.T), math.sqrt(5.991) * 0.01, rtol=1e-3)


def test_kml(table, tmp_path):
    export_poses(table, tmp_path / "a.kml", CRS)
    root = ElementTree.parse(tmp_path / "a.kml").getroot()
    space = {"k": "http://www.opengis.net/kml/2.2"}
    places = [point.text.split(",") for point in root.findall(".//k:Point/k:coordinates", space)]
    assert len(places) == 2
    assert root.find(".//k:LineString/k:coordinates", space).text.split() == [",".join(place) for place in places]
    np.testing.assert_allclose(back_in_crs(*places), POSITIONS, atol=1e-3)
    modes = {mode.text for mode in root.findall(".//k:altitudeMode", space)}
    assert modes == {"clampToGround"}


def test_mcap(table, tmp_path):
    """Read by mcap alone, as a viewer does: schemas of ROS 2, and everything in frames that are connected."""
    pytest.importorskip("rosbags")
    reader = pytest.importorskip("mcap.reader")
    from rosbags.typesys import Stores, get_typestore

    from maxcon.io.recordings.poses import read_recorded_poses

    export_poses(table, tmp_path / "a.mcap", CRS)
    store = get_typestore(Stores.ROS2_HUMBLE)
    found = {}
    with (tmp_path / "a.mcap").open("rb") as stream:
        opened = reader.make_reader(stream)
        assert opened.get_header().profile == "ros2"
        for schema, channel, message in opened.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            assert b"MSG: " in schema.data
            content = store.deserialize_cdr(message.data, schema.name)
            found.setdefault(channel.topic, []).append((message.log_time, content))
    assert {topic: len(messages) for topic, messages in found.items()} == {
        "/tf_static": 1, "/pose": 2, "/tf": 2, "/fix": 2, "/status": 3,
    }  # fmt: skip
    time, pose = found["/pose"][1]
    assert time == 12_000_000_000 and pose.header.frame_id == "map"
    assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == (10.0, 1.0)
    assert pose.pose.covariance[0] == 0.0001 and pose.pose.covariance[35] == pytest.approx(1e-6)
    _, fix = found["/fix"][0]
    assert 9.0 < fix.longitude < 10.0 and 52.0 < fix.latitude < 53.0 and fix.altitude == 61.25
    poses = read_recorded_poses(tmp_path / "a.mcap", frames=("crs", "sensor")).trajectory
    np.testing.assert_allclose(poses.positions, POSITIONS, atol=1e-9)
    np.testing.assert_allclose(poses.angles, [[p.roll, p.pitch, p.heading] for p in LOCALIZED], atol=1e-9)
    export_poses(table, tmp_path / "b.mcap")  # without a CRS all but the positions on earth
    assert (tmp_path / "b.mcap").exists()


@pytest.mark.parametrize("suffix", [".laz", ".las"])
def test_scans_in_the_map(table, tmp_path, suffix):
    points = np.random.default_rng(0).uniform(-50, 50, (3, 200, 3))
    folder, path = tmp_path / "scans", tmp_path / f"a{suffix}"
    folder.mkdir()
    for number, scan in enumerate(points):
        np.column_stack([scan, np.zeros(200)]).astype("<f4").tofile(folder / f"{number}.bin")
    (folder / "times.txt").write_text("10\n11\n12\n")
    rows, n_points = export_scans(table, path, open_scans(folder), CRS, min_range=5.0, max_range=60.0)
    cloud = laspy.read(path)
    assert len(rows) == 3 and len(cloud.points) == n_points
    assert cloud.header.parse_crs().to_epsg() == 25832
    assert sorted(set(cloud.point_source_id)) == [0, 2]
    for number in (0, 2):
        ranges = np.linalg.norm(points[number], axis=1)
        wanted = POSES[number].apply(points[number][(ranges >= 5.0) & (ranges <= 60.0)])
        is_its = cloud.point_source_id == number
        np.testing.assert_allclose(cloud.xyz[is_its], wanted, atol=6e-4)
        assert set(cloud.gps_time[is_its]) == {10.0 + number}
    export_scans(table, tmp_path / f"none{suffix}", open_scans(folder), None)  # in coordinates of a SLAM program
    assert laspy.read(tmp_path / f"none{suffix}").header.parse_crs() is None
    (folder / "times.txt").write_text("10\n11\n13\n")
    with pytest.raises(TrajectoryError, match=r"a scan of the epoch at 12\.000 s, got the nearest at"):
        export_scans(table, tmp_path / "b.laz", open_scans(folder), CRS)
    assert not list(tmp_path.glob("b*"))


def test_tum_kitti_and_csv_in_degrees(table, tmp_path):
    for suffix in (".tum", ".csv"):
        export_poses(table, tmp_path / f"a{suffix}")
        trajectory = read_trajectory(tmp_path / f"a{suffix}")
        assert trajectory.times.tolist() == [10.0, 12.0]
        np.testing.assert_allclose(trajectory.positions, POSITIONS, atol=1e-4 if suffix == ".csv" else 1e-9)
        np.testing.assert_allclose(trajectory.angles[:, 2], [0.5, -3.0], atol=1e-8)
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert float(rows[2]["bearing_deg"]) == pytest.approx((90.0 + math.degrees(3.0)) % 360.0)
    assert (rows[1]["x"], rows[1]["status"], rows[1]["reason"]) == ("", "ambiguous", "two, alike")
    export_poses(table, tmp_path / "a.kitti")
    matrices = np.loadtxt(tmp_path / "a.kitti").reshape(-1, 3, 4)
    np.testing.assert_allclose(matrices[:, :, 3], POSITIONS, atol=1e-4)
    np.testing.assert_allclose(matrices[:, :, :3], [pose.rotation for pose in LOCALIZED], atol=1e-11)
    assert np.loadtxt(tmp_path / "a.times.txt").tolist() == [10.0, 12.0]


@pytest.mark.parametrize("ends_at", ["write_text", "replace"])
def test_poses_of_kitti_never_stand_beside_the_times_of_others(table, tmp_path, monkeypatch, ends_at):
    """What ends the writing leaves both files as they were; between the two renames, poses without times."""
    files = [tmp_path / "a.kitti", tmp_path / "a.times.txt"]
    for file in files:
        file.write_text("before")
    real = getattr(Path, ends_at)

    def all_but_times(self, *arguments, **options):
        if self.name == "a.times.txt":
            raise KeyboardInterrupt
        return real(self, *arguments, **options)

    monkeypatch.setattr(Path, ends_at, all_but_times)
    with pytest.raises(KeyboardInterrupt):
        export_poses(table, files[0])
    if ends_at == "write_text":
        assert [file.read_text() for file in files] == ["before", "before"]
        assert sorted(tmp_path.glob("*a.*")) == files
    else:
        assert files[0].read_text() != "before" and not files[1].exists()


def test_what_cannot_be_exported_is_said(table, tmp_path):
    for suffix in (".geojson", ".gpkg", ".kml"):
        with pytest.raises(CrsError, match=rf"Expected a CRS for \{suffix}, got none .* Give --crs"):
            export_poses(table, tmp_path / f"a{suffix}")
    with pytest.raises(CrsError, match="metres"):
        export_poses(table, tmp_path / "a.kml", "EPSG:4326")
    with pytest.raises(OptionError, match=re.escape(", ".join(EXPORT_SUFFIXES))):
        export_poses(table, tmp_path / "a.shp", CRS)
    lines = table.read_text().splitlines()
    for content, words in (
        (lines[0], "a row per epoch"),
        ("time,x\n1,2", "2 other columns"),
        ("\n".join([lines[0], lines[1].replace("localized", "localized,")]), "line 2"),
        ("\n".join([lines[0], lines[1].replace("550000", "west")]), "line 2.*'west"),
    ):
        table.write_text(content + "\n")
        with pytest.raises(FileError, match=words):
            export_poses(table, tmp_path / "a.tum")
    table.write_text("\n".join([lines[0], lines[2]]) + "\n")
    with pytest.raises(TrajectoryError, match="got none of 1"):
        export_poses(table, tmp_path / "a.tum")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["poses.csv"]


def test_a_full_disk_is_told_without_sql(table, tmp_path, monkeypatch):
    raw = pytest.importorskip("pyogrio.raw")

    def fail(*arguments, **options):
        raise RuntimeError("sqlite3_exec(CREATE TABLE x) failed: no such table: gpkg_contents")

    monkeypatch.setattr(raw, "write", fail)
    with pytest.raises(FileError, match=r"got: an error of its database\. Is the disk full\?$"):
        export_poses(table, tmp_path / "a.gpkg", CRS)
    assert not list(tmp_path.glob("a*"))
