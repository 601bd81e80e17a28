# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map on disk: what is written is what is read, and what is broken is refused."""

import hashlib
import json
import os
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import MapError
from maxcon.point_map import TILE_VOXELS
from maxcon.point_map import manifest as manifests
from maxcon.point_map.manifest import FORMAT_VERSION, read_manifest
from maxcon.point_map.records import classes_record
from maxcon.point_map.section import Section
from maxcon.point_map.store import TileStore
from maxcon.point_map.surface_class import ALL_BUT_KNOWN, NOT_SEARCHED, SurfaceClass
from maxcon.point_map.writer import MapWriter
from maxcon.search import exhaustive
from maxcon.storage import Folder
from written_maps import SAID, edit_index, write

CELL = 0.06


def some_map(n=3000, spread=40.0, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-spread, spread, (n, 3)) * [1, 1, 0.05]
    return PointMap.from_points(points, normals, CELL)


@pytest.fixture(scope="module")
def in_memory():
    return some_map()


@pytest.fixture(scope="module")
def whole(tmp_path_factory, in_memory):
    folder = tmp_path_factory.mktemp("maps") / "whole.map"
    write(folder, in_memory)
    return folder


@pytest.fixture
def copy(tmp_path, whole):
    return shutil.copytree(whole, tmp_path / "copy.map")


def shard(folder):
    (path,) = (folder / "tiles").glob("*.arrows")
    return path


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
    scan = Scan(
        ((indices[chosen] + 0.5) * CELL - prior.position) @ prior.rotation, normals[chosen] @ prior.rotation
    )
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


def edit(folder, change):
    """Change the manifest, with a checksum that fits: as another program would write it."""
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    change(content)
    content["sha256"] = manifests.checksum_of_manifest(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("name", ["n_points", "n_kept", "n_thinned", "n_withheld"])
def test_counts_that_are_none(copy, name):
    counts = {"n_points": 1, "n_kept": 1, "n_invalid": 0, "n_without_side": 0, "n_dropped": {}}
    source = {"name": "a", "is_classified": True, **counts}
    edit(copy, lambda content: content["build"].update(sources=[source]))
    read_manifest(copy)
    edit(copy, lambda content: content["build"]["sources"][0].update({name: "many"}))
    with pytest.raises(MapError, match="broken entry: sources"):
        read_manifest(copy)


def test_a_fifo_as_manifest(copy):
    (copy / "manifest.json").unlink()
    os.mkfifo(copy / "manifest.json")
    with pytest.raises(MapError, match="got: a FIFO, no file"):
        PointMap.open(copy)


def test_an_empty_tile_list_is_no_map(tmp_path):
    nothing = np.empty((0, 3))
    write(tmp_path / "empty.map", PointMap.from_points(nothing, nothing, CELL))
    with pytest.raises(MapError, match="no tiles"):
        PointMap.open(tmp_path / "empty.map")


def test_opening_reads_no_tile(copy):
    shard(copy).unlink()
    opened = PointMap.open(copy)
    assert opened.covers(0.0, 0.0)
    with pytest.raises(
        MapError, match=r"tile \(-2, -2\) in .*\.arrows to be of the map, got: .*No such file"
    ):
        opened.all_voxels()


@pytest.mark.parametrize("what", ["truncated", "overwritten", "removed", "a FIFO"])
def test_tiles_in_use_do_not_follow_their_files(copy, what):
    opened = PointMap.open(copy, cache_bytes=2**30)
    before = [array.copy() for array in opened.all_voxels()]
    path = shard(copy)
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
    content = bytearray(shard(copy).read_bytes())
    table = read_manifest(copy).tiles
    content[int(table.offsets[0] + table.lengths[0] // 2)] ^= 1
    times = shard(copy).stat()
    shard(copy).write_bytes(content)
    os.utime(shard(copy), ns=(times.st_atime_ns, times.st_mtime_ns))
    with pytest.raises(MapError, match="another checksum"):
        opened.tile(first)


# --- the cache ----------------------------------------------------------------------------------------


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


# --- broken shards ------------------------------------------------------------------------------------


def test_one_flipped_bit_anywhere_in_a_record_is_noticed(copy):
    path, table = shard(copy), read_manifest(copy).tiles
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    positions = np.r_[table.offsets, table.offsets + table.lengths - 1, rng.integers(0, len(whole), 60)]
    for position in np.unique(positions).tolist():
        broken = bytearray(whole)
        broken[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        inside = (table.offsets <= position) & (position < table.offsets + table.lengths)
        if not inside.any():  # the schema in front, the end behind: nothing is taken from there
            PointMap.open(copy).all_voxels()
            continue
        opened, hit = PointMap.open(copy), tuple(table.keys[inside][0].tolist())
        with pytest.raises(MapError) as caught:
            opened.all_voxels()
        assert f"tile {hit} in {path}" in str(caught.value)
        assert "maxcon map build" in str(caught.value)
        for key in opened.tile_keys - {hit}:
            opened.tile(key)
    path.write_bytes(whole)
    PointMap.open(copy).all_voxels()


@pytest.mark.parametrize("size", [0, 1, 8, 100, -10, -1000])
def test_a_truncated_shard_is_noticed(copy, size):
    path = shard(copy)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(MapError, match=rf"Expected tile .*{path.name} .*maxcon map build"):
        PointMap.open(copy).all_voxels()


def test_the_record_of_another_tile_is_noticed(copy):
    """Two records change places: each is whole, and neither is the one that was asked for."""
    table = read_manifest(copy).tiles
    content = shard(copy).read_bytes()
    (a, b), (n_a, n_b) = table.offsets[:2].tolist(), table.lengths[:2].tolist()
    assert b == a + n_a
    swapped = content[:a] + content[b : b + n_b] + content[a:b] + content[b + n_b :]
    shard(copy).write_bytes(swapped)
    for key in map(tuple, table.keys[:2].tolist()):
        with pytest.raises(MapError, match="to be as it was written, got another checksum"):
            PointMap.open(copy).tile(key)


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_whatever_happens_to_a_shard_or_its_index_no_other_tile_comes_back(broken_folder, in_memory, data):
    path = data.draw(st.sampled_from(sorted((broken_folder / "tiles").iterdir())))
    whole = path.read_bytes()
    try:
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
        path.write_bytes(broken)
        try:
            opened = PointMap.open(broken_folder)
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


@pytest.fixture(scope="module")
def broken_folder(tmp_path_factory, in_memory):
    folder = tmp_path_factory.mktemp("broken") / "shards.map"
    write(folder, in_memory, shard_bytes=30_000)
    assert len(read_manifest(folder).tiles.files) > 2
    return folder


@pytest.mark.parametrize(
    ("column", "change", "words"),
    [
        ("keys", lambda a: a + 2**30, "a tile beyond"),
        ("keys", lambda a: a[::-1], "tiles that do not ascend"),
        ("keys", lambda a: a * 0, "tiles that do not ascend"),
        ("n_rows", lambda a: a * 0 - 1, "a count that is none"),
        ("n_rows", lambda a: a * 0 + (2**31 - 1), "more rows than its bytes can hold"),
        ("n_points", lambda a: a - 10**6, "a count that is none"),
        ("n_points", lambda a: a + 2**62, "a count that is none"),
        ("shards", lambda a: a + 1, "a file that there is not"),
        ("shards", lambda a: a - 1, "a file that there is not"),
        ("offsets", lambda a: a * 0 - 1, "beyond the end of its file"),
        ("offsets", lambda a: a + 2**62, "beyond the end of its file"),
        ("lengths", lambda a: a * 0, "beyond the end of its file"),
        ("lengths", lambda a: a * 0 + 2**62, "beyond the end of its file"),
    ],
)
def test_an_index_that_cannot_be_is_refused(copy, column, change, words):
    edit_index(copy, "tiles", **{column: change(getattr(read_manifest(copy).tiles, column).copy())})
    with pytest.raises(MapError, match=rf"index-.*\.arrow to be the index of the map, got: .*{words}"):
        PointMap.open(copy)


def test_an_index_of_other_tiles_is_noticed_when_they_are_read(copy):
    """Rows that point elsewhere inside of the shard, as another program could write them: no tile comes back."""
    table = read_manifest(copy).tiles
    edit_index(copy, "tiles", offsets=np.roll(table.offsets, 1), lengths=np.roll(table.lengths, 1))
    opened = PointMap.open(copy)
    for key in opened.tile_keys:
        with pytest.raises(MapError, match="another checksum"):
            opened.tile(key)


def test_counts_of_an_index_that_are_not_those_of_the_records(copy):
    edit_index(copy, "tiles", n_rows=read_manifest(copy).tiles.n_rows + 1)
    with pytest.raises(MapError, match=r"Expected \d+ rows in tile .*, got \d+\."):
        PointMap.open(copy).all_voxels()


@pytest.mark.parametrize("written", [b"", b"\0" * 8, b"\xff\xff\xff\xff\0\0\0\0", b"no message of Arrow's"])
def test_records_that_are_no_batch_although_their_checksum_fits(copy, written):
    table, path = read_manifest(copy).tiles, shard(copy)
    content = bytearray(path.read_bytes())
    at, length = int(table.offsets[0]), int(table.lengths[0])
    content[at : at + length] = written + bytes(length - len(written))
    path.write_bytes(content)
    checksums = table.checksums.copy()
    checksums[0] = np.frombuffer(hashlib.sha256(content[at : at + length]).digest(), np.uint8)
    edit_index(copy, "tiles", checksums=checksums)
    with pytest.raises(MapError, match=r"Expected tile .* to be of the map, got: .*map build"):
        PointMap.open(copy).tile(tuple(table.keys[0].tolist()))


def test_records_of_other_columns_are_refused(copy):
    edit_index(copy, "tiles", schema=b"another")
    with pytest.raises(MapError, match=r"tiles of .* to have columns of types that this version knows"):
        PointMap.open(copy)


@pytest.mark.parametrize("what", ["missing", "cut", "larger", "a FIFO", "of another map"])
def test_an_index_that_is_not_the_one_that_was_written(copy, what):
    (path,) = (copy / "tiles").glob("index-*.arrow")
    if what == "cut":
        os.truncate(path, 100)
    elif what == "larger":
        os.truncate(path, 2**40)  # a hole: it takes no room, and would take a terabyte of memory
    elif what == "of another map":
        path.write_bytes(bytes(path.stat().st_size))
    else:
        path.unlink()
        if what == "a FIFO":
            os.mkfifo(path)
    with pytest.raises(MapError, match=rf"Expected .*{path.name} to be .*, got.*map build"):
        PointMap.open(copy)


# --- broken manifests ---------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [1, FORMAT_VERSION + 1, 99, "1", None])
def test_another_format_version_is_refused_with_both_numbers(copy, version):
    rewrite(copy, format_version=version)
    remedy = "Update maxcon" if version in (FORMAT_VERSION + 1, 99) else "map build"
    with pytest.raises(MapError, match=rf"map format version {FORMAT_VERSION}, got {version!r}\..*{remedy}"):
        PointMap.open(copy)


def rewrite(folder, **changes):
    """Change entries of a manifest, with a checksum that fits: as another program would write it."""
    path = folder / "manifest.json"
    content = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({**content, "sha256": manifests.checksum_of_manifest(content)}))


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
    items = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
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
        broken = bytearray(
            whole[: data.draw(st.integers(0, len(whole)))] if data.draw(st.booleans()) else whole
        )
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
    rewrite(copy, tile_voxels=2 * TILE_VOXELS)
    with pytest.raises(MapError, match=r"broken entry: .*tile_voxels 1024"):
        PointMap.open(copy)


@pytest.mark.parametrize("value", ["false", 0, None])
def test_whether_normals_have_sides_is_said_plainly(copy, value):
    """A text "false" must not read as true: it would silently drop every match seen from behind."""
    rewrite(copy, is_signed=value)
    with pytest.raises(MapError, match=r"broken entry: .*is_signed"):
        PointMap.open(copy)


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
