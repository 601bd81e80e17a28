# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map on disk: what is written is what is read, tiles as they are asked for; what is damaged is refused."""

import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map.layout import ALL_BUT_KNOWN, NOT_SEARCHED, SurfaceClass
from maxcon.map.manifest import Manifest, read_manifest
from maxcon.map.store import MapWriter, classes_record, tile_record
from written_maps import SAID, assert_same_map, damage, said_by, tile_shard, write

CELL = 0.06


def test_what_is_written_is_what_is_opened(tmp_path, in_memory):
    build = {"program": "maxcon", "sources": []}
    manifest = write(tmp_path / "a.map", in_memory, crs="LOCAL", is_signed=False, sigma=0.009, build=build)
    assert said_by(read_manifest(tmp_path / "a.map")) == said_by(manifest)
    opened = PointMap.open(tmp_path / "a.map")
    assert (opened.cell, opened.is_signed, opened.sigma) == (CELL, False, 0.009)
    assert (opened.frame.origin, opened.frame.crs) == (manifest.origin, "LOCAL")
    assert opened.bounds == in_memory.bounds
    assert_same_map(opened, in_memory)
    assert (manifest.n_points, manifest.n_voxels) == (3000, len(in_memory.all_voxels()[0]))


def test_a_map_is_pickled_by_its_path_or_whole(whole, in_memory):
    opened = PointMap.open(whole)
    for point_map in (opened, opened.level(4)):
        content = pickle.dumps(point_map)
        assert len(content) < 1000 and str(whole).encode() in content
        again = pickle.loads(content)
        assert (again.frame, again.cell) == (point_map.frame, point_map.cell)
        assert_same_map(again, point_map)
    assert_same_map(pickle.loads(pickle.dumps(in_memory)), in_memory)


@pytest.mark.parametrize("what", ["cut", "of another map", "removed", "a FIFO"])
def test_opening_reads_no_tile_and_tiles_in_use_do_not_follow_their_files(copy, what):
    opened, unused, forgetful = (PointMap.open(copy, cache_bytes=n_bytes) for n_bytes in (2**30, 2**30, 0))
    before = [array.copy() for array in opened.all_voxels()]
    forgetful.all_voxels()  # nothing but the last tile is kept
    for tile in opened.tiles_within(0.0, 0.0, 100.0):  # views of what was read, not copies
        assert not any(array.flags.owndata for array in (tile.columns, tile.layers, tile.counts, tile.normals))
    damage(tile_shard(copy), what)
    for got, wanted in zip(opened.all_voxels(), before, strict=True):
        np.testing.assert_array_equal(got, wanted)
    for each in (unused, forgetful, PointMap.open(copy)):
        assert each.covers(0.0, 0.0)
        with pytest.raises(MapError, match=r"Expected tile \(-2, -2\) in .*\.arrows to be .*, got"):
            each.all_voxels()


# --- damage -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def breakable(tmp_path_factory, shards):
    """A copy of a map of several shards, to break and put back."""
    return shutil.copytree(shards, tmp_path_factory.mktemp("broken") / "shards.map")


@given(st.data())
def test_whatever_happens_to_a_shard_or_its_index_no_other_tile_comes_back(breakable, in_memory, data):
    path = data.draw(st.sampled_from(sorted((breakable / "tiles").iterdir())))
    whole = path.read_bytes()
    broken = bytearray(whole)
    match data.draw(st.sampled_from(["bits", "cut", "longer", "moved"])):
        case "bits":
            for _ in range(data.draw(st.integers(1, 5))):
                broken[data.draw(st.integers(0, len(broken) - 1))] ^= 1 << data.draw(st.integers(0, 7))
        case "cut":
            del broken[data.draw(st.integers(0, len(broken))) :]
        case "longer":
            broken += data.draw(st.binary(max_size=100))
        case "moved":
            at, n = data.draw(st.integers(0, len(broken))), data.draw(st.integers(1, 100))
            broken[at:at] = bytes(n)
    try:
        path.write_bytes(broken)
        try:
            opened = PointMap.open(breakable)
        except MapError as error:
            assert "index" in str(error) and "\n" not in str(error)
            return
        assert opened.tile_keys == in_memory.tile_keys
        for key in opened.tile_keys:
            try:
                tile = opened.tile(key)
            except MapError as error:
                assert str(path) in str(error) and "\n" not in str(error)
            else:
                np.testing.assert_array_equal(tile.voxels, in_memory.tile(key).voxels)
                np.testing.assert_array_equal(tile.normals, in_memory.tile(key).normals)
    finally:
        path.write_bytes(whole)


def test_voxels_in_another_order_are_refused(tmp_path, in_memory):
    tile = in_memory.tile(min(in_memory.tile_keys))
    with MapWriter(tmp_path) as writer:
        writer.put(tile_record(tile.rows(np.arange(len(tile))[::-1])))
        writer.finish(Manifest(cell=CELL, sections={}, **SAID))
    with pytest.raises(MapError, match="in the order of the search, got another"):
        PointMap.open(tmp_path).tile(tile.key)


# --- classes of an updated map ------------------------------------------------------------------------


def test_classes_of_voxels_are_read_and_decide_what_is_searched(tmp_path, in_memory):
    folder, key = tmp_path / "classed.map", min(in_memory.tile_keys)
    tile = in_memory.tile(key)
    classes = (np.arange(len(tile)) % 3).astype(np.uint8)
    write(folder, in_memory, records=[classes_record(replace(tile, classes=classes))])
    everything = PointMap.open(folder, left_out=None).tile(key)
    np.testing.assert_array_equal(everything.classes, classes)
    searched, known = (PointMap.open(folder, left_out=out).tile(key) for out in (NOT_SEARCHED, ALL_BUT_KNOWN))
    assert searched.classes is None and known.is_in_order
    np.testing.assert_array_equal(searched.voxels, tile.voxels[classes != SurfaceClass.GONE])
    np.testing.assert_array_equal(known.voxels, tile.voxels[classes == SurfaceClass.KNOWN])
    assert PointMap.open(folder).tile(max(in_memory.tile_keys)).classes is None
    copied = pickle.loads(pickle.dumps(PointMap.open(folder, left_out=ALL_BUT_KNOWN)))
    assert len(copied.tile(key)) == len(known)


@pytest.mark.parametrize(("n_missing", "number"), [(1, 0), (0, 7)])
def test_classes_that_are_none_are_refused(tmp_path, in_memory, n_missing, number):
    tile = in_memory.tile(min(in_memory.tile_keys))
    classes = np.full(len(tile) - n_missing, number, np.uint8)
    write(tmp_path / "a.map", in_memory, records=[classes_record(replace(tile, classes=classes))])
    with pytest.raises(MapError, match="Expected a class for each"):
        PointMap.open(tmp_path / "a.map").tile(tile.key)
