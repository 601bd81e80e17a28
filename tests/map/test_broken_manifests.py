# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Manifests that are not what was written: a map is read as it was, or refused in a line."""

import json
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map import TILE_VOXELS
from maxcon.map import manifest as manifests
from maxcon.map.manifest import FORMAT_VERSION, read_manifest
from written_maps import edit_manifest, write


@pytest.mark.parametrize("version", [1, FORMAT_VERSION + 1, 99, "1", None])
def test_another_format_version_is_refused_with_both_numbers(copy, version):
    edit_manifest(copy, format_version=version)
    remedy = "Update maxcon" if version in (FORMAT_VERSION + 1, 99) else "map build"
    with pytest.raises(MapError, match=rf"map format version {FORMAT_VERSION}, got {version!r}\..*{remedy}"):
        PointMap.open(copy)


def test_what_is_no_map_is_refused(tmp_path):
    with pytest.raises(MapError, match=r"nothing\.map to be a map, got no such folder\. Build one with"):
        PointMap.open(tmp_path / "nothing.map")
    with pytest.raises(MapError, match=r"got no manifest\.json in it"):
        PointMap.open(tmp_path)
    (tmp_path / "file.map").write_text("{}")
    with pytest.raises(MapError, match=r"file\.map to be a map, got .*Build one with `maxcon map build`"):
        PointMap.open(tmp_path / "file.map")
    (tmp_path / "folder.map" / "manifest.json").mkdir(parents=True)
    with pytest.raises(MapError, match=r"Expected .*manifest\.json.*, got: .*[Ii]s a directory"):
        PointMap.open(tmp_path / "folder.map")
    for content in ("", "{", "[]", "null", "1", '{"format": "other"}', "\x00", "[" * 100_000):
        (tmp_path / "manifest.json").write_text(content)
        with pytest.raises(MapError, match=r"manifest\.json"):
            PointMap.open(tmp_path)
    (tmp_path / "manifest.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MapError, match="to be the manifest of a map"):
        PointMap.open(tmp_path)


JUNK = st.sampled_from(
    [None, True, False, 0, -1, 1.5, 1e400, float("nan"), 10**30, "", "x", "nan", [], [1], [[]], {}, {"a": 1}]
)


def places(content, path=()):
    """Paths to all values of a JSON document."""
    yield path
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield from places(value, (*path, key))


@pytest.fixture(scope="module")
def manifest_folder(tmp_path_factory, in_memory):
    folder = tmp_path_factory.mktemp("broken") / "small.map"
    source = {
        "name": "a.laz", "n_points": 3000, "n_kept": 3000, "n_invalid": 0, "n_without_side": 0,
        "n_dropped": {"2": 7}, "is_classified": True,
    }  # fmt: skip
    write(folder, in_memory, build={"program": "maxcon", "drop": {"2": "ground"}, "sources": [source]})
    return folder


@given(st.data())
@settings(max_examples=200)
def test_a_manifest_with_anything_in_the_wrong_place_is_read_or_refused(manifest_folder, data):
    path = manifest_folder / "manifest.json"
    text = path.read_text()
    content = json.loads(text)
    try:
        place = data.draw(st.sampled_from([p for p in places(content) if p]))
        parent = content
        for key in place[:-1]:
            parent = parent[key]
        if data.draw(st.booleans()) and isinstance(parent, dict):
            del parent[place[-1]]
        else:
            parent[place[-1]] = data.draw(JUNK)
        if place != ("sha256",) and data.draw(st.booleans()):  # as another program would write it
            content["sha256"] = manifests.checksum_of_manifest(content)
        path.write_text(json.dumps(content))
        try:
            opened = PointMap.open(manifest_folder)
            opened.bounds, opened.covers(0.0, 0.0, 10.0)
            opened.all_voxels()
        except MapError as error:
            assert str(manifest_folder) in str(error)
            assert "\n" not in str(error)
    finally:
        path.write_text(text)


@given(st.data())
@settings(max_examples=100)
def test_a_manifest_of_broken_bytes_is_read_or_refused(manifest_folder, data):
    path = manifest_folder / "manifest.json"
    whole = path.read_bytes()
    try:
        broken = bytearray(whole[: data.draw(st.integers(0, len(whole)))] if data.draw(st.booleans()) else whole)
        for _ in range(data.draw(st.integers(0, 4))):
            if broken:
                broken[data.draw(st.integers(0, len(broken) - 1))] ^= 1 << data.draw(st.integers(0, 7))
        path.write_bytes(broken)
        try:
            PointMap.open(manifest_folder).all_voxels()
        except MapError as error:
            assert str(manifest_folder) in str(error)
    finally:
        path.write_bytes(whole)


def test_a_changed_digit_is_noticed(copy):
    path = copy / "manifest.json"
    path.write_text(path.read_text().replace('"cell": 0.', '"cell": 1.'))
    with pytest.raises(MapError, match=r"manifest\.json to be as it was written, got another checksum"):
        PointMap.open(copy)


def test_tile_edge_of_another_program_is_refused(copy):
    edit_manifest(copy, tile_voxels=2 * TILE_VOXELS)
    with pytest.raises(MapError, match=r"broken entry: .*tile_voxels 1024"):
        PointMap.open(copy)


@pytest.mark.parametrize("value", ["false", 0, None])
def test_whether_normals_have_sides_is_said_plainly(copy, value):
    """A text "false" must not read as true: it would silently drop every match seen from behind."""
    edit_manifest(copy, is_signed=value)
    with pytest.raises(MapError, match=r"broken entry: .*is_signed"):
        PointMap.open(copy)


@pytest.mark.parametrize("name", ["n_points", "n_kept", "n_thinned", "n_withheld"])
def test_counts_that_are_none(copy, name):
    counts = {"n_points": 1, "n_kept": 1, "n_invalid": 0, "n_without_side": 0, "n_dropped": {}}
    source = {"name": "a", "is_classified": True, **counts}
    edit_manifest(copy, build={"sources": [source]})
    read_manifest(copy)
    edit_manifest(copy, build={"sources": [{**source, name: "many"}]})
    with pytest.raises(MapError, match="broken entry: sources"):
        read_manifest(copy)


def test_a_fifo_as_manifest(copy):
    (copy / "manifest.json").unlink()
    os.mkfifo(copy / "manifest.json")
    with pytest.raises(MapError, match="got: a FIFO, no file"):
        PointMap.open(copy)


def test_an_empty_tile_list_is_no_map(tmp_path):
    nothing = np.empty((0, 3))
    write(tmp_path / "empty.map", PointMap.from_points(nothing, nothing, 0.06))
    with pytest.raises(MapError, match="no tiles"):
        PointMap.open(tmp_path / "empty.map")
