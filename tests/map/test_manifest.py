# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The manifest alone: what it keeps, and which entries it refuses although its checksum fits."""

import json
import math
from dataclasses import FrozenInstanceError, replace

import pytest

from maxcon.errors import MapError
from maxcon.map import TILE_VOXELS
from maxcon.map import manifest as manifests
from maxcon.map.ground import ground_voxels
from maxcon.map.manifest import Manifest, ShardTable, read_manifest, write_manifest
from written_maps import table_of, write_content

SOURCE = {
    "name": "a.laz", "n_points": 30, "n_kept": 20, "n_invalid": 1, "n_without_side": 2, "n_dropped": {"2": 7},
    "is_classified": True,
}  # fmt: skip
WHOLE = Manifest(
    cell=0.06,
    origin=(458_800.0, 5_429_000.0, 100.0),
    crs="LOCAL",
    is_signed=True,
    sections={name: table_of(n, name) for name, n in (("tiles", 3), ("ground", 2), ("of_others", 1))},
    build={"program": "maxcon", "sources": [SOURCE], "sigma": {"from": "given"}},
    sigma=0.0,
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
        write_content(tmp_path, content)
        return tmp_path

    return change


def test_what_is_written_is_what_is_read(tmp_path):
    write_manifest(tmp_path, WHOLE)
    assert read_manifest(tmp_path) == WHOLE
    assert (WHOLE.n_points, WHOLE.n_voxels) == (63, 33)
    assert WHOLE.n_heights == 21
    text = (tmp_path / manifests.MANIFEST).read_text()
    assert text.endswith("}\n")
    assert '\n "cell": 0.06,\n' in text  # one entry a line, for people
    content = json.loads(text)
    assert (content["tile_voxels"], content["ground_voxels"]) == (TILE_VOXELS, ground_voxels(0.06))


def test_entries_do_not_change():
    for noun, name in ((WHOLE, "cell"), (WHOLE.tiles, "keys"), (WHOLE.tiles.files[0], "name")):
        with pytest.raises(FrozenInstanceError):
            setattr(noun, name, None)


def test_spaces_and_order_do_not_change_what_is_read(tmp_path):
    write_manifest(tmp_path, WHOLE)
    path = tmp_path / manifests.MANIFEST
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(content.items())), indent=7))
    assert read_manifest(tmp_path) == WHOLE


def test_what_may_be_left_out(changed):
    bare = read_manifest(changed(crs=None, build={}))
    assert (bare.crs, bare.build) == (None, {})


def test_a_map_without_ground(tmp_path):
    write_manifest(tmp_path, replace(WHOLE, sections={"tiles": table_of(3), "ground": ShardTable.empty()}))
    assert len(read_manifest(tmp_path).ground) == 0


def test_a_map_without_tiles_is_none(tmp_path):
    write_manifest(tmp_path, replace(WHOLE, sections={"tiles": ShardTable.empty(), "ground": table_of(2, "ground")}))
    with pytest.raises(MapError, match="broken entry: no tiles"):
        read_manifest(tmp_path)


SHARD = {"name": "tiles/00000-0.arrows", "bytes": 350}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"index": "../secret"}, "a file '../secret'"),
        ({"index": "tiles/../secret"}, "a file 'tiles/../secret'"),
        ({"index": "ground/index.arrow"}, "a file 'ground/index.arrow'"),
        ({"index": "tiles/a/b"}, "a file 'tiles/a/b'"),
        ({"index": "tiles/"}, "a file 'tiles/'"),
        ({"index": "tiles/.."}, "a file 'tiles/..'"),
        ({"index": 7}, "a file '7'"),
        ({"index": ...}, "no 'index'"),
        ({"index_bytes": -1}, "a size of -1"),
        ({"index_bytes": 2**40}, "a size of 1099"),
        ({"index_bytes": "many"}, "a size of many"),
        ({"index_sha256": ...}, "no 'index_sha256'"),
        ({"shards": None}, "broken entry"),
        ({"shards": [7]}, "broken entry"),
        ({"shards": [{**SHARD, "bytes": 1.5}]}, "a size of 1.5"),
        ({"shards": [{**SHARD, "bytes": 2**70}]}, "a size of 1180"),
        ({"shards": [{**SHARD, "name": "/etc/passwd"}]}, "a file '/etc/passwd'"),
        ({"shards": [{"name": "tiles/0"}]}, "no 'bytes'"),
    ],
)
def test_a_section_that_cannot_be_is_named(changed, changes, words):
    folder = changed()
    content = json.loads((folder / manifests.MANIFEST).read_text())
    for name, value in changes.items():
        content["sections"]["tiles"].pop(name) if value is ... else content["sections"]["tiles"].update({name: value})
    with pytest.raises(MapError) as refused:
        read_manifest(changed(sections=content["sections"]))
    assert words in str(refused.value)


@pytest.mark.parametrize("name", ["", "Tiles", "../tiles", "a/b", "tiles\n"])
def test_names_of_sections_are_names_of_folders(changed, name):
    content = json.loads((changed() / manifests.MANIFEST).read_text())["sections"]
    with pytest.raises(MapError, match="a section"):
        read_manifest(changed(sections={**content, name: content["tiles"]}))


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
        ({"ground_voxels": 4}, "ground_voxels 4"),
        ({"sections": {}}, "no tiles"),
        ({"sections": None}, "broken entry"),
        ({"sections": ...}, "no 'sections'"),
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
        ({"build": {"found": {"n_points": {"2": -1}, "dropped": [], "temporary": ""}}}, "a size of -1"),
        ({"build": {"found": {"n_points": {"two": 1}, "dropped": [], "temporary": ""}}}, "two"),
        ({"build": {"found": {"n_points": {"2": 1}, "dropped": ["2"], "temporary": ""}}}, "a size of 2"),
        ({"build": {"found": {"n_points": {"2": 1}, "dropped": [2], "temporary": 1}}}, "found"),
        ({"build": {"found": {"n_points": {"2": 1}, "dropped": [2]}}}, "no 'temporary'"),
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
    for version, remedy in ((manifests.FORMAT_VERSION + 1, "Update maxcon"), ("4", "Build"), (1, "Build")):
        with pytest.raises(MapError, match=rf"version 3, got {version!r}\. {remedy}"):
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
    path.write_text(path.read_text().replace('"bytes": 350', '"bytes": 351'))
    with pytest.raises(MapError, match="to be as it was written, got another checksum"):
        read_manifest(tmp_path)
