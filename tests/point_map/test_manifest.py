# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The manifest alone: what it keeps, and which entries it refuses although its checksum fits."""

import json
import math
from dataclasses import FrozenInstanceError

import pytest

from maxcon.errors import MapError
from maxcon.point_map import TILE_VOXELS
from maxcon.point_map import manifest as manifests
from maxcon.point_map.ground import ground_voxels
from maxcon.point_map.manifest import GroundEntry, Manifest, TileEntry, read_manifest, write_manifest

SOURCE = {
    "name": "a.laz", "n_points": 30, "n_kept": 20, "n_invalid": 1, "n_without_side": 2, "n_dropped": {"2": 7},
    "is_classified": True,
}  # fmt: skip
WHOLE = Manifest(
    cell=0.06,
    origin=(458_800.0, 5_429_000.0, 100.0),
    crs="LOCAL",
    is_signed=True,
    tiles=(TileEntry((-1, 2), 30, 400, "a"), TileEntry((0, 2), 12, 50, "b")),
    build={"program": "maxcon", "sources": [SOURCE], "sigma": {"from": "given"}},
    sigma=0.0,
    ground=(GroundEntry((-1, 2), 99, "c"),),
)


@pytest.fixture
def changed(tmp_path):
    """Write the manifest with some entries changed, and a checksum that fits: as another program would."""
    write_manifest(tmp_path, WHOLE)
    path = tmp_path / manifests.MANIFEST

    def change(**changes):
        content = json.loads(path.read_text())
        for name, value in changes.items():
            content.pop(name) if value is ... else content.update({name: value})
        path.write_text(json.dumps({**content, "sha256": manifests._checksum(content)}))
        return tmp_path

    return change


def test_what_is_written_is_what_is_read(tmp_path):
    write_manifest(tmp_path, WHOLE)
    assert read_manifest(tmp_path) == WHOLE
    assert (WHOLE.n_points, WHOLE.n_voxels) == (450, 42)
    text = (tmp_path / manifests.MANIFEST).read_text()
    assert text.endswith("}\n")
    assert '\n "cell": 0.06,\n' in text  # one entry a line, for people
    content = json.loads(text)
    assert (content["tile_voxels"], content["ground_voxels"]) == (TILE_VOXELS, ground_voxels(0.06))


def test_entries_do_not_change():
    for noun, name in ((WHOLE, "cell"), (WHOLE.tiles[0], "key"), (WHOLE.ground[0], "key")):
        with pytest.raises(FrozenInstanceError):
            setattr(noun, name, None)


def test_spaces_and_order_do_not_change_what_is_read(tmp_path):
    write_manifest(tmp_path, WHOLE)
    path = tmp_path / manifests.MANIFEST
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(content.items())), indent=7))
    assert read_manifest(tmp_path) == WHOLE


def test_the_farthest_tiles_there_can_be(changed):
    keys = [(-(2**21), 2**21), (2**21, -(2**21))]
    entries = [{"key": key, "n_voxels": 1, "n_points": 1, "sha256": ""} for key in keys]
    assert [tile.key for tile in read_manifest(changed(tiles=entries)).tiles] == keys


def test_what_may_be_left_out(changed):
    bare = read_manifest(changed(ground=..., crs=None, build={}))
    assert (bare.ground, bare.crs, bare.build) == ((), None, {})
    assert read_manifest(changed(ground=[], ground_voxels=1)).ground == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cell": 0.0}, "cell 0.0"),
        ({"cell": -0.06}, "cell -0.06"),
        ({"cell": math.inf}, "cell inf"),
        ({"cell": math.nan}, "cell nan"),
        ({"cell": ...}, "no 'cell'"),
        ({"cell": "wide"}, "wide"),
        ({"origin": [0.0, math.inf, 0.0]}, "origin"),
        ({"origin": [0.0, 0.0]}, "unpack"),
        ({"origin": None}, "broken entry"),
        ({"sigma": -0.01}, "sigma -0.01"),
        ({"sigma": math.inf}, "sigma inf"),
        ({"sigma": math.nan}, "sigma nan"),
        ({"tile_voxels": 256}, "tile_voxels 256"),
        ({"crs": 25832}, "crs"),
        ({"is_signed": 1}, "is_signed"),
        ({"is_signed": "true"}, "is_signed"),
        ({"tiles": []}, "no tiles"),
        ({"tiles": [{"key": [0, 0, 0], "n_voxels": 1, "n_points": 1, "sha256": ""}]}, "unpack"),
        ({"tiles": [{"key": [0, 0], "n_points": 1, "sha256": ""}]}, "no 'n_voxels'"),
        ({"tiles": [{"key": [0, 0], "n_voxels": "x", "n_points": 1, "sha256": ""}]}, "a count of x"),
        ({"tiles": [{"key": [2**21 + 1, 0], "n_voxels": 1, "n_points": 1, "sha256": ""}]}, "a tile at [2097153, 0]"),
        ({"tiles": [{"key": [0, -(2**21) - 1], "n_voxels": 1, "n_points": 1, "sha256": ""}]}, "at [0, -2097153]"),
        ({"ground": [{"key": [10**30, 0], "n_heights": 1, "sha256": ""}]}, "a tile at [1000"),
        ({"ground_voxels": 4}, "ground_voxels 4"),
        ({"ground": [{"key": [0], "n_heights": 1, "sha256": ""}]}, "unpack"),
        ({"build": None}, "broken entry"),
        ({"build": {"sources": [{**SOURCE, "n_kept": "20"}]}}, "sources"),
        ({"build": {"sources": [{**SOURCE, "n_points": 1.5}]}}, "sources"),
        ({"build": {"sources": [{**SOURCE, "n_invalid": None}]}}, "sources"),
        ({"build": {"sources": [{**SOURCE, "n_without_side": []}]}}, "sources"),
        ({"build": {"sources": [{**SOURCE, "n_dropped": {"ground": 7}}]}}, "ground"),
        ({"build": {"sources": [{**SOURCE, "n_dropped": {"2": "7"}}]}}, "sources"),
        ({"build": {"sources": [{**SOURCE, "name": 7}]}}, "sources"),
        ({"build": {"sources": [{**SOURCE, "is_classified": 1}]}}, "sources"),
        ({"build": {"sources": [SOURCE, {}]}}, "no 'n_points'"),
        ({"build": {"sigma": {"from": "assumed"}}}, "no 'reason'"),
        ({"build": {"sigma": {"from": "assumed", "reason": 3}}}, "sigma from"),
        ({"build": {"sigma": {"from": "passes", "n_passes": 2, "sigma_of_pass": 0.02}}}, "no 'n_places'"),
        ({"build": {"sigma": {"from": "passes", "n_passes": 2, "sigma_of_pass": "x", "n_places": 7}}}, "sigma from"),
        ({"build": {"sigma": {"from": "guessed"}}}, "sigma from"),
        ({"build": {"sigma": {}}}, "no 'from'"),
    ],
)  # fmt: skip
def test_an_entry_that_cannot_be_is_named(changed, changes, words):
    folder = changed(**changes)
    with pytest.raises(MapError) as refused:
        read_manifest(folder)
    assert str(refused.value).startswith(f"Expected a whole manifest in {folder}")
    assert words in str(refused.value)
    assert str(refused.value).endswith("Build the map again with `maxcon map build`.")


@pytest.mark.parametrize(
    "known",
    [
        {"from": "assumed", "reason": "one pass only"},
        {"from": "passes", "n_passes": 5, "sigma_of_pass": 0.02, "n_places": 700},
    ],
)
def test_where_sigma_is_from_is_kept(changed, known):
    assert read_manifest(changed(build={"sigma": known})).build == {"sigma": known}


def test_a_newer_version_asks_for_a_newer_program(changed):
    for version, remedy in ((manifests.FORMAT_VERSION + 1, "Update maxcon"), ("3", "Build"), (1, "Build")):
        with pytest.raises(MapError, match=rf"version 2, got {version!r}\. {remedy}"):
            read_manifest(changed(format_version=version))


def test_what_is_no_manifest_of_a_map(changed):
    for wrong in ("other", None, ...):
        with pytest.raises(MapError, match="to say it is a maxcon map, but it does not"):
            read_manifest(changed(format=wrong))


def test_what_is_no_map_says_what_it_is(tmp_path):
    (tmp_path / "file").write_text("{}")
    (tmp_path / "unreadable" / manifests.MANIFEST).mkdir(parents=True)
    for name, words in (
        ("nothing", "to be a map, got no such folder"),
        ("file", "to be a map, got a file"),
        ("", "to be a map, got no manifest.json in it"),
        ("unreadable", "Expected to be able to read"),
    ):
        with pytest.raises(MapError) as refused:
            read_manifest(tmp_path / name)
        assert words in str(refused.value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\x00"])
def test_what_is_no_json_is_no_manifest(tmp_path, text):
    (tmp_path / manifests.MANIFEST).write_text(text)
    with pytest.raises(MapError, match="to be the manifest of a map"):
        read_manifest(tmp_path)


@pytest.mark.parametrize("text", ["[]", "null", "1", "{}"])
def test_other_json_is_no_manifest(tmp_path, text):
    (tmp_path / manifests.MANIFEST).write_text(text)
    with pytest.raises(MapError, match="to say it is a maxcon map"):
        read_manifest(tmp_path)


def test_a_manifest_that_was_changed_by_hand_is_noticed(tmp_path):
    write_manifest(tmp_path, WHOLE)
    path = tmp_path / manifests.MANIFEST
    path.write_text(path.read_text().replace('"n_points": 400', '"n_points": 401'))
    with pytest.raises(MapError, match="to be as it was written, got another checksum"):
        read_manifest(tmp_path)
