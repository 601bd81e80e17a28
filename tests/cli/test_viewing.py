"""Drives recorded for viewers: what was logged is read back and held against the table of poses, scans and map."""

import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxcon import Helmert, MaximumConsensus, Pose
from maxcon.drive.localize import scan_of
from maxcon.errors import FileError
from maxcon.export import read_rows
from maxcon.export.pose_rows import covariance_of
from maxcon.io.scans import open_scans
from maxcon.map import PointMap

pytest.importorskip("rerun")
from read_recordings import logged, shown_views

ELLIPSE_NAME, SCORES = "/ellipse_of_95_percent_100_times_as_large", "/scores_of_cells"


def origin_of(found):
    """Origin of the coordinates, as the recording tells it."""
    ((_, _, (words,)),) = found["/about", "text"]
    assert "at most 10,000 points" in words and "100 times as large" in words and "EPSG:25832" in words
    return np.array([float(words.split(f" m {axis}")[0].split()[-1]) for axis in ("east", "north", "up")])


def by_epoch(found, entity, component):
    return {epoch: np.array(value) for epoch, _, value in found.get((entity, component), [])}


def assert_is_of_table(found, table, city):
    """Answers, ellipses, levels, statuses and the map of a recording are those of a table of poses."""
    rows, origin = read_rows(table), origin_of(found)
    localized = {number: row for number, row in enumerate(rows) if row.pose is not None}
    answers, ellipses = by_epoch(found, "/answers", "positions"), by_epoch(found, ELLIPSE_NAME, "strips")
    levels, turns = by_epoch(found, "/protection/along", "scalars"), by_epoch(found, "/answer", "quaternion")
    scans = by_epoch(found, "/answer/scan", "positions")
    assert all(set(each) == set(localized) for each in (answers, ellipses, levels, turns, scans))
    for number, row in localized.items():
        np.testing.assert_allclose(answers[number][0] + origin, row.pose.position, atol=2e-4)
        np.testing.assert_allclose(Rotation.from_quat(turns[number][0]).as_matrix(), row.pose.rotation, atol=1e-6)
        offsets = (ellipses[number][0] + origin - row.pose.position)[:, :2] / 100.0
        inverse = np.linalg.inv(covariance_of(row)[:2, :2])
        np.testing.assert_allclose(np.einsum("ij,jk,ik->i", offsets, inverse, offsets), 5.991, rtol=1e-3)
        assert levels[number][0] == pytest.approx(row.numbers["protection_along"], abs=1e-4)
    told = [(number, round(row.time * 1e9), row) for number, row in enumerate(rows)]
    assert found["/status", "state"] == [(number, stamp, [row.status]) for number, stamp, row in told]
    assert found["/log", "text"] == [(number, stamp, [row.words]) for number, stamp, row in told]
    tiles = [entity for entity, component in found if entity.startswith("/map/") and component == "positions"]
    points = np.concatenate([found[tile, "positions"][0][2] for tile in tiles])
    assert_are_of_map(points + origin, city)


def assert_are_of_map(points, city):
    """Points, global coordinates, are those of the map's voxels of 24 cm, and of the ground below."""
    point_map = PointMap.open(city)
    level, local = point_map.level(4), point_map.frame.to_local(points)
    voxels = np.concatenate([level.tile(key).voxels for key in level.tile_keys])
    is_voxel = np.isin(_numbered(np.floor(local / level.cell)), _numbered(voxels))
    middle, reach = local[:, :2].mean(axis=0), np.abs(local[:, :2]).max() + 100.0
    heights = np.unique(point_map.ground_around(*middle, reach).points()[:, 2])
    nearest = heights[np.searchsorted(heights, local[:, 2]).clip(1, len(heights) - 1)]
    assert is_voxel.sum() > 1000 and (~is_voxel).sum() > 100
    assert np.abs(nearest - local[:, 2])[~is_voxel].max() < 0.02


def _numbered(voxels):
    return voxels.astype(np.int64) @ [2**40, 2**20, 1]


def assert_is_thinned(points, scan):
    """At most 5,000 points of a scan, as they were read."""
    raw = scan.points.astype(np.float32)
    assert len(points) == min(5000, len(raw))
    assert set(map(tuple, points.astype(np.float32).tolist())) <= set(map(tuple, raw.tolist()))


@pytest.mark.parametrize("options", [(), ("--workers", "1", "--threads", "2"), ("--track",)])
def test_a_drive_is_recorded_while_it_is_localized(localize, drive, tmp_path, prior_rows, options):
    prior = tmp_path / "prior.txt"
    prior.write_text("\n".join(" ".join(row) for row in prior_rows[:-1]))  # the last epoch has none
    ended = localize("--save", tmp_path / "drive.rrd", *options, prior=prior)
    assert (ended.code, ended.err) == (1, "")
    found = logged(tmp_path / "drive.rrd")
    assert_is_of_table(found, tmp_path / "poses.csv", drive.city)
    origin, scans = origin_of(found), open_scans(drive.dataset.scans)
    places, shown = by_epoch(found, "/prior", "translation"), by_epoch(found, "/prior/scan", "positions")
    assert set(places) == set(shown) >= {0, 1, 2} and (3 in places) == ("--track" in options)
    np.testing.assert_allclose(places[0][0] + origin, [float(cell) for cell in prior_rows[0][1:4]], atol=0.3)
    for number, points in shown.items():
        assert_is_thinned(points, scans.read(number, 1.0, 120.0))
    assert shown_views(tmp_path / "drive.rrd")["3D"].startswith("Map (grey)")
    assert set(shown_views(tmp_path / "drive.rrd")) == {"3D", "StateTimeline", "TimeSeries", "TextLog", "TextDocument"}
    assert len(found["/share", "scalars"]) >= 3


def test_scores_of_cells_are_shown_if_asked(maxcon, localize, poses, drive, tmp_path):
    """At their places, those of a search of all cells; the highest lies at the answer. A table is searched likewise."""
    save = {name: tmp_path / f"{name}.rrd" for name in ("drive", "table", "none")}
    assert localize("--save", save["drive"], "--scores").code == 0
    inputs = ("--map", drive.city, "--scans", drive.dataset.scans, "-o")
    assert maxcon("export", poses, *inputs, save["table"], "--scores").code == 0
    assert maxcon("export", poses, *inputs, save["none"]).code == 0
    assert not any("scores" in entity for entity, _ in logged(save["none"]))
    point_map, scans = PointMap.open(drive.city), open_scans(drive.dataset.scans)
    for name in ("drive", "table"):
        found = logged(save[name])
        origin, scores = origin_of(found), by_epoch(found, SCORES, "score")
        places, answers = (by_epoch(found, entity, "positions") for entity in (SCORES, "/answers"))
        colors, priors = by_epoch(found, SCORES, "colors"), by_epoch(found, "/prior", "translation")
        assert set(places) == {0, 1, 2, 3}
        for number, place in places.items():
            best = np.argmax(scores[number])
            assert np.abs(place[best] - answers[number][0])[:2].max() < 0.5
            assert colors[number][best] == 0xF0F921FF and np.unique(place[:, 0]).size == 50
        raw = scan_of(scans.read(2, 1.0, 120.0))
        turn = Rotation.from_quat(by_epoch(found, "/prior", "quaternion")[2][0]).as_euler("xyz")
        at = Pose(*(priors[2][0] + origin), *turn)
        searched = MaximumConsensus().accumulate(raw, point_map, point_map.frame.pose_to_local(at)).score(Helmert())
        np.testing.assert_allclose(scores[2], searched.max(axis=0).ravel(), rtol=0.05, atol=0.02 * searched.max())


def test_a_map_is_shown(maxcon, drive, tmp_path):
    ended = maxcon("map", "info", drive.city, "--save", tmp_path / "map.rrd")
    assert (ended.code, ended.err, ended.out.startswith("voxels ")) == (0, "", True)
    found, point_map = logged(tmp_path / "map.rrd"), PointMap.open(drive.city)
    tiles = {entity: rows[0][2] for (entity, component), rows in found.items() if component == "positions"}
    assert set(tiles) == {f"/map/tile_{x}_{y}" for x, y in point_map.tile_keys}
    assert_are_of_map(np.concatenate(list(tiles.values())) + origin_of(found), drive.city)
    assert set(shown_views(tmp_path / "map.rrd")) == {"3D", "TextDocument"}


def test_scans_found_anywhere_are_recorded(maxcon, drive, tmp_path):
    out = ("-o", tmp_path / "poses.csv", "--save", tmp_path / "found.rrd")
    ended = maxcon("relocalize", drive.city, drive.dataset.scans, *out)
    assert ended.err == ""
    found = logged(tmp_path / "found.rrd")
    assert_is_of_table(found, tmp_path / "poses.csv", drive.city)
    assert ("/prior", "translation") not in found


def test_a_table_is_exported_with_map_and_scans(maxcon, poses, drive, tmp_path, prior_rows):
    inputs, table = ("--map", drive.city, "--scans", drive.dataset.scans), tmp_path / "slanting.csv"
    with poses.open(newline="") as source, table.open("w", newline="") as target:
        writer = csv.DictWriter(target, (reader := csv.DictReader(source)).fieldnames)
        writer.writeheader()
        writer.writerows(row | {"cov_x_x": "0.0009", "cov_x_y": "0.0002"} for row in reader)
    assert maxcon("export", table, "-o", tmp_path / "a.rrd", *inputs).code == 0
    found = logged(tmp_path / "a.rrd")
    assert_is_of_table(found, table, drive.city)
    for number, place in by_epoch(found, "/prior", "translation").items():
        np.testing.assert_allclose(place[0, :2] + origin_of(found)[:2], np.float64(prior_rows[number][1:3]), atol=1e-3)
    assert len(by_epoch(found, "/prior/scan", "positions")) == 4
    header, _, others = poses.read_text().split("\n", 2)
    table.write_text(f"{header}\n{others}")
    assert maxcon("export", table, "-o", tmp_path / "others.rrd").code == 0
    assert min(by_epoch(logged(tmp_path / "others.rrd"), "/answers", "positions")) == 1


def test_mcap_shows_map_and_scans(maxcon, poses, drive, tmp_path):
    """Placed by the transforms of the file, scans lie on the map of the file."""
    reader = pytest.importorskip("mcap.reader")
    typesys = pytest.importorskip("rosbags.typesys")
    inputs = ("--map", drive.city, "--scans", drive.dataset.scans)
    assert maxcon("export", poses, "-o", tmp_path / "a.mcap", *inputs).code == 0
    store, found = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE), {}
    with (tmp_path / "a.mcap").open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            found.setdefault(channel.topic, []).append(store.deserialize_cdr(message.data, schema.name))
    rows = read_rows(poses)
    assert {topic: len(messages) for topic, messages in found.items()} == {
        "/tf_static": 1, "/map": 1, "/pose": 4, "/tf": 4, "/scan": 4, "/fix": 4, "/status": 4,
    }  # fmt: skip
    assert [message.msg for message in found["/status"]] == [row.words for row in rows]
    clouds = {topic: [_points_of(message) for message in found[topic]] for topic in ("/map", "/scan")}
    at = found["/tf_static"][0].transforms[0].transform.translation
    assert (found["/map"][0].header.frame_id, found["/scan"][0].header.frame_id) == ("map", "sensor")
    assert_are_of_map(clouds["/map"][0] + [at.x, at.y, at.z], drive.city)
    scans = open_scans(drive.dataset.scans)
    for number, points in enumerate(clouds["/scan"]):
        assert_is_thinned(points, scans.read(number, 1.0, 120.0))
        assert found["/scan"][number].header.stamp == found["/tf"][number].transforms[0].header.stamp


def _points_of(message):
    assert [(field.name, field.offset) for field in message.fields] == [("x", 0), ("y", 4), ("z", 8)]
    return message.data.view("<f4").reshape(-1, 3)


def test_it_is_shown_live(localize, drive, tmp_path, monkeypatch):
    """The viewer is started before the first epoch; here a file takes its place."""
    import rerun as rr

    calls = []
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(rr, "spawn", lambda **how: calls.append(how["executable_path"]))
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda stream: stream.save(tmp_path / "live.rrd"))
    ended = localize("--view")
    assert (ended.code, ended.err, len(calls)) == (0, "", 1)
    assert_is_of_table(logged(tmp_path / "live.rrd"), tmp_path / "poses.csv", drive.city)


def test_what_cannot_be_shown_is_said_before_the_work(maxcon, refused, localize, tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    drive = tmp_path / "drive.rrd"
    refused(localize("--view"), "a display for --view", "--save drive.rrd")
    refused(localize("--save", tmp_path / "drive.html"), "a recording .rrd", "drive.html")
    refused(localize("--save", drive, "--view"), "both")
    refused(localize("--scores"), "--scores together with --view or --save")
    refused(maxcon("map", "info", drive, "--save", tmp_path / "map.html"), "a recording .rrd", "map.html")
    refused(maxcon("export", drive, "-o", drive, "--scores"), "--scores together with --map")
    refused(localize("--save", drive, "--resume"), "both")
    refused(maxcon("localize", "--drives", drive, "-o", drive, "--save", drive), "--view or --save")
    assert list(tmp_path.iterdir()) == []


def test_a_drive_that_fails_leaves_no_recording(localize, refused, tmp_path, monkeypatch):
    from maxcon.export.rerun_recording import _Shown

    show = _Shown.show

    def fail(self, epoch):
        if epoch.number == 2:
            raise FileError("Expected that it fails.")
        show(self, epoch)

    monkeypatch.setattr(_Shown, "show", fail)
    refused(localize("--save", tmp_path / "drive.rrd"), "Expected that it fails.")
    assert [path.name for path in tmp_path.iterdir()] == ["poses.csv"]
