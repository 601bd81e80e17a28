# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map on disk: what is written is what is read, tiles as they are asked for, kept within a budget."""

import os
import pickle
from dataclasses import replace

import numpy as np
import pytest
from maxcon.map.records import classes_record

from maxcon import Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import MapError
from maxcon.map.layout import ALL_BUT_KNOWN, NOT_SEARCHED, SurfaceClass
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import Folder
from maxcon.map.store import Section, TileStore
from maxcon.map.writer import MapWriter
from maxcon.search import exhaustive
from written_maps import SAID, tile_shard, write

CELL = 0.06


def store_of(folder, cache_bytes=0):
    return TileStore(Folder(folder), read_manifest(folder), cache_bytes=cache_bytes)


def test_what_is_written_is_what_is_opened(tmp_path, in_memory):
    build = {"program": "maxcon", "sources": []}
    manifest = write(tmp_path / "a.map", in_memory, crs="LOCAL", is_signed=False, build=build)
    assert read_manifest(tmp_path / "a.map") == manifest
    opened = PointMap.open(tmp_path / "a.map")
    assert (opened.cell, opened.is_signed) == (CELL, False)
    assert (opened.frame.origin, opened.frame.crs) == (manifest.origin, "LOCAL")
    assert opened.tile_keys == in_memory.tile_keys
    assert opened.bounds == in_memory.bounds
    for got, wanted in zip(opened.all_voxels(), in_memory.all_voxels(), strict=True):
        np.testing.assert_array_equal(got, wanted)
        assert got.dtype == wanted.dtype
    assert manifest.n_points == 3000
    assert manifest.n_voxels == len(in_memory.all_voxels()[0])


@pytest.mark.parametrize(
    "known",
    [
        {"from": "given"},
        {"from": "assumed", "reason": "one pass only"},
        {"from": "passes", "n_passes": 5, "sigma_of_pass": 0.02, "n_places": 700},
    ],
    ids=lambda known: known["from"],
)
def test_how_well_it_is_known_is_kept(tmp_path, in_memory, known):
    manifest = write(tmp_path / "a.map", in_memory, sigma=0.009, build={"sigma": known})
    assert read_manifest(tmp_path / "a.map") == manifest
    assert PointMap.open(tmp_path / "a.map").sigma == 0.009


def test_the_search_finds_the_same_in_both(whole, in_memory):
    rng = np.random.default_rng(1)
    indices, _, normals = in_memory.all_voxels()
    chosen = rng.integers(0, len(indices), 200)
    prior = Pose(0.3, -0.2, 0.0, 0.0, 0.0, 0.3)
    scan = Scan(((indices[chosen] + 0.5) * CELL - prior.position) @ prior.rotation, normals[chosen] @ prior.rotation)
    space = SearchSpace(0.6, CELL, 1.0, 0.5)
    opened = PointMap.open(whole, cache_bytes=1)
    for multiplicity in ("occupied", "points"):
        wanted = exhaustive(scan, in_memory, prior, space, multiplicity=multiplicity)
        got = exhaustive(scan, opened, prior, space, multiplicity=multiplicity, n_threads=2)
        assert wanted.best_cell(Helmert()) == (2, 10, 10)
        assert (got.moments == wanted.moments).all()


def test_the_arrays_of_a_tile_are_those_of_its_file(whole):
    opened = PointMap.open(whole)
    for tile in opened.tiles_within(0.0, 0.0, 100.0):
        for array in (tile.columns, tile.layers, tile.counts, tile.normals, tile.means):
            assert not array.flags.owndata


def test_an_opened_map_is_pickled_as_its_path(whole):
    opened = PointMap.open(whole)
    opened.all_voxels()
    for point_map in (opened, opened.level(4)):
        content = pickle.dumps(point_map)
        assert len(content) < 1000
        assert str(whole).encode() in content
        again = pickle.loads(content)
        assert again.frame == point_map.frame
        assert again.cell == point_map.cell
        for got, wanted in zip(again.all_voxels(), point_map.all_voxels(), strict=True):
            np.testing.assert_array_equal(got, wanted)


def test_a_map_in_memory_is_pickled_whole(in_memory):
    again = pickle.loads(pickle.dumps(in_memory))
    for got, wanted in zip(again.all_voxels(), in_memory.all_voxels(), strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_opening_reads_no_tile(copy):
    tile_shard(copy).unlink()
    opened = PointMap.open(copy)
    assert opened.covers(0.0, 0.0)
    with pytest.raises(MapError, match=r"tile \(-2, -2\) in .*\.arrows to be of the map, got: .*No such file"):
        opened.all_voxels()


@pytest.mark.parametrize("what", ["truncated", "overwritten", "removed", "a FIFO"])
def test_tiles_in_use_do_not_follow_their_files(copy, what):
    opened = PointMap.open(copy, cache_bytes=2**30)
    before = [array.copy() for array in opened.all_voxels()]
    path = tile_shard(copy)
    if what == "truncated":
        os.truncate(path, 100)
    elif what == "overwritten":
        path.write_bytes(bytes(path.stat().st_size))
    else:
        path.unlink()
        if what == "a FIFO":
            os.mkfifo(path)
    for got, wanted in zip(opened.all_voxels(), before, strict=True):
        np.testing.assert_array_equal(got, wanted)
    with pytest.raises(MapError, match=r"Expected tile .*\.arrows to be .*, got"):
        PointMap.open(copy).all_voxels()


def test_a_tile_that_is_read_again_is_checked_again(copy):
    opened = PointMap.open(copy, cache_bytes=0)
    first, *others = sorted(opened.tile_keys)
    opened.tile(first)
    opened.tile(others[0])  # nothing but the last is kept
    content = bytearray(tile_shard(copy).read_bytes())
    table = read_manifest(copy).tiles
    content[int(table.offsets[0] + table.lengths[0] // 2)] ^= 1
    times = tile_shard(copy).stat()
    tile_shard(copy).write_bytes(content)
    os.utime(tile_shard(copy), ns=(times.st_atime_ns, times.st_mtime_ns))
    with pytest.raises(MapError, match="another checksum"):
        opened.tile(first)


def test_the_cache_is_bounded_and_drops_what_was_used_longest_ago(whole, monkeypatch):
    a, b, c = read_manifest(whole).tiles.keys.tolist()[:3]
    a, b, c = map(tuple, (a, b, c))
    sizes = {key: store_of(whole).load(key).n_bytes for key in (a, b, c)}
    store = store_of(whole, cache_bytes=sum(sizes.values()) - 1)  # two of the three
    read = []
    from_disk = Section.batch
    monkeypatch.setattr(Section, "batch", lambda self, key: read.append(key) or from_disk(self, key))
    store.load(a), store.load(b)
    assert store.load(a) is store.load(a)
    assert read == [a, b]
    store.load(c)  # b was used longest ago
    assert read == [a, b, c]
    store.load(a)
    assert read == [a, b, c]
    store.load(b)
    assert read == [a, b, c, b]


def test_the_cache_keeps_within_its_bytes(whole):
    keys = sorted(store_of(whole).keys)
    sizes = [store_of(whole).load(key).n_bytes for key in keys]
    for limit in (0, max(sizes), 2 * max(sizes) + 1, sum(sizes)):
        store = store_of(whole, cache_bytes=limit)
        for key in [*keys, *keys[::-1], *keys[::2]]:
            store.load(key)
            kept = sum(tile.n_bytes for tile in store._cache.values())
            assert kept <= limit or len(store._cache) == 1
        assert len(store._cache) == len(keys) or limit < sum(sizes)


@pytest.fixture
def classed(tmp_path, in_memory):
    """The map of `in_memory` with every third voxel of its first tile gone, and the next one new."""
    key = min(in_memory.tile_keys)
    folder = tmp_path / "classed.map"
    folder.mkdir()
    with MapWriter(folder) as writer:
        for each in sorted(in_memory.tile_keys):
            writer.add_tile(in_memory.tile(each))
        tile = in_memory.tile(key)
        writer.put(classes_record(replace(tile, classes=(np.arange(len(tile)) % 3).astype(np.uint8))))
        writer.finish(cell=CELL, **SAID)
    return folder, key


def test_classes_of_voxels_are_read_and_decide_what_is_searched(classed, in_memory):
    folder, key = classed
    n = len(in_memory.tile(key))
    everything = PointMap.open(folder, left_out=None).tile(key)
    np.testing.assert_array_equal(everything.classes, np.arange(n) % 3)
    searched, known = (PointMap.open(folder, left_out=out).tile(key) for out in (NOT_SEARCHED, ALL_BUT_KNOWN))
    assert searched.classes is None
    np.testing.assert_array_equal(searched.voxels, everything.voxels[np.arange(n) % 3 != SurfaceClass.GONE])
    np.testing.assert_array_equal(known.voxels, everything.voxels[np.arange(n) % 3 == SurfaceClass.KNOWN])
    assert known.is_in_order
    other = max(in_memory.tile_keys)
    assert PointMap.open(folder).tile(other).classes is None
    copied = pickle.loads(pickle.dumps(PointMap.open(folder, left_out=ALL_BUT_KNOWN)))
    assert len(copied.tile(key)) == len(known)


def test_classes_that_are_none_are_refused(tmp_path, in_memory):
    folder, key = tmp_path / "a.map", min(in_memory.tile_keys)
    for number, classes in enumerate((np.full(len(in_memory.tile(key)), 7, np.uint8), np.zeros(3, np.uint8))):
        folder = tmp_path / f"{number}.map"
        folder.mkdir()
        with MapWriter(folder) as writer:
            writer.add_tile(in_memory.tile(key))
            writer.put(classes_record(replace(in_memory.tile(key), classes=classes)))
            writer.finish(cell=CELL, **SAID)
        with pytest.raises(MapError, match="Expected a class for each"):
            PointMap.open(folder).tile(key)
