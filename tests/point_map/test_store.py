# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map on disk: what is written is what is read, and what is broken is refused."""

import json
import os
import pickle
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import MapError
from maxcon.point_map import TILE_VOXELS
from maxcon.point_map import manifest as manifests
from maxcon.point_map.manifest import FORMAT_VERSION, Manifest, read_manifest, write_manifest
from maxcon.point_map.store import TileStore, write_tile
from maxcon.search import exhaustive

CELL = 0.06


def some_map(n=3000, spread=40.0, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-spread, spread, (n, 3)) * [1, 1, 0.05]
    return PointMap.from_points(points, normals, CELL)


def write(folder, point_map, **changes):
    folder.mkdir()
    entries = [write_tile(folder, point_map._tiles.load(key)) for key in sorted(point_map.tile_keys)]
    given = {
        "origin": (458_800.0, 5_429_000.0, 100.0),
        "crs": None,
        "is_signed": True,
        "build": {},
        **changes,
    }
    manifest = Manifest(cell=point_map.cell, tiles=tuple(entries), **given)
    write_manifest(folder, manifest)
    return manifest


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


def first_tile(folder):
    return sorted((folder / "tiles").iterdir())[0]


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


@pytest.mark.parametrize("what", ["truncated", "overwritten", "removed", "a FIFO"])
def test_tiles_in_use_do_not_follow_their_files(copy, what):
    opened = PointMap.open(copy, cache_bytes=2**30)
    before = [array.copy() for array in opened.all_voxels()]
    for path in (copy / "tiles").iterdir():
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
    with pytest.raises(MapError, match=r"Expected .*\.arrow to be .*, got"):
        PointMap.open(copy).all_voxels()


def test_a_tile_that_is_read_again_is_checked_again(copy):
    opened = PointMap.open(copy, cache_bytes=0)
    first, *others = sorted(opened.tile_keys)
    opened.tile(first)
    opened.tile(others[0])  # nothing but the last is kept
    path = copy / "tiles" / f"{first[0]}_{first[1]}.arrow"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    times = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    with pytest.raises(MapError, match="another checksum"):
        opened.tile(first)


def test_a_file_larger_than_its_tile_is_not_read(copy):
    path = first_tile(copy)
    os.truncate(path, 2**40)  # a hole: it takes no room, and would take a terabyte of memory
    with pytest.raises(MapError, match=r"1,099,511,627,776 bytes, more than its voxels take"):
        PointMap.open(copy).all_voxels()


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
    content["sha256"] = manifests._checksum(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content["tiles"][0].update(key=[10**19, 0]),
        lambda content: content["tiles"][0].update(key=[2**40, 0]),
        lambda content: content["tiles"][0].update(key=["1", 0]),
        lambda content: content["tiles"][0].update(key=[1]),
        lambda content: content["tiles"][0].update(n_voxels="many"),
        lambda content: content["tiles"][0].update(n_voxels=-1),
        lambda content: content["tiles"][0].update(n_points=1e300),
        lambda content: content.update(cell=1e308),
        lambda content: content.update(cell=1e-300),
        lambda content: content.update(cell="0.06"),
        lambda content: content.update(cell=[1]),
        lambda content: content.update(tiles={"key": 1}),
        lambda content: content.update(tiles=None),
        lambda content: content.update(build=7),
        lambda content: content.update(
            ground=[{"key": [0, 10**19], "n_heights": 1, "sha256": ""}], ground_voxels=8
        ),
        lambda content: content.update(
            ground=[{"key": [0, 0], "n_heights": "1", "sha256": ""}], ground_voxels=8
        ),
    ],
)
def test_numbers_that_no_map_has(copy, change):
    edit(copy, change)
    try:
        opened = PointMap.open(copy)
    except MapError as error:
        assert "manifest.json" in str(error)
        assert "\n" not in str(error)
    else:
        assert opened.cell == CELL  # a number as a word


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


def test_opening_reads_no_tile(copy):
    shutil.rmtree(copy / "tiles")
    opened = PointMap.open(copy)
    assert opened.covers(0.0, 0.0)
    with pytest.raises(MapError, match=r"to be a tile of the map, got: .*No such file"):
        opened.all_voxels()


def test_an_empty_tile_list_is_no_map(tmp_path):
    nothing = np.empty((0, 3))
    write(tmp_path / "empty.map", PointMap.from_points(nothing, nothing, CELL))
    with pytest.raises(MapError, match="no tiles"):
        PointMap.open(tmp_path / "empty.map")


# --- the cache ----------------------------------------------------------------------------------------


def test_the_cache_is_bounded_and_drops_what_was_used_longest_ago(whole, monkeypatch):
    manifest = read_manifest(whole)
    a, b, c = sorted(tile.key for tile in manifest.tiles)[:3]
    sizes = {key: TileStore(whole, manifest, cache_bytes=0).load(key).n_bytes for key in (a, b, c)}
    store = TileStore(whole, manifest, cache_bytes=sum(sizes.values()) - 1)  # two of the three
    read = []
    from_disk = TileStore._read
    monkeypatch.setattr(
        TileStore, "_read", lambda self, entry: read.append(entry.key) or from_disk(self, entry)
    )
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
    manifest = read_manifest(whole)
    keys = sorted(tile.key for tile in manifest.tiles)
    sizes = [TileStore(whole, manifest, cache_bytes=0).load(key).n_bytes for key in keys]
    for limit in (0, max(sizes), 2 * max(sizes) + 1, sum(sizes)):
        store = TileStore(whole, manifest, cache_bytes=limit)
        for key in [*keys, *keys[::-1], *keys[::2]]:
            store.load(key)
            kept = sum(tile.n_bytes for tile in store._cache.values())
            assert kept <= limit or len(store._cache) == 1
        assert len(store._cache) == len(keys) or limit < sum(sizes)


# --- broken tiles -------------------------------------------------------------------------------------


def test_one_flipped_bit_anywhere_in_a_tile_is_noticed(copy):
    path = first_tile(copy)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    positions = np.unique(np.r_[0, 1, len(whole) - 1, len(whole) - 8, rng.integers(0, len(whole), 60)])
    for position in positions:
        broken = bytearray(whole)
        broken[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        with pytest.raises(MapError) as caught:
            PointMap.open(copy).all_voxels()
        assert str(path) in str(caught.value)
        assert "maxcon map build" in str(caught.value)
    path.write_bytes(whole)
    PointMap.open(copy).all_voxels()


@pytest.mark.parametrize("size", [0, 1, 8, 100, -1, -9])
def test_a_truncated_tile_is_noticed(copy, size):
    path = first_tile(copy)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(MapError, match=rf"Expected .*{path.name} .*maxcon map build"):
        PointMap.open(copy).all_voxels()


def test_a_missing_tile_is_named(copy):
    path = first_tile(copy)
    path.unlink()
    with pytest.raises(
        MapError, match=rf"Expected .*{path.name} to be a tile of the map, got: .*No such file"
    ):
        PointMap.open(copy).all_voxels()


def test_the_tile_of_another_place_is_noticed(copy):
    one, other = sorted((copy / "tiles").iterdir())[:2]
    shutil.copy(other, one)
    with pytest.raises(
        MapError, match=rf"Expected .*{one.name} to be as it was written, got another checksum"
    ):
        PointMap.open(copy).all_voxels()


# --- broken manifests ---------------------------------------------------------------------------------


def rewrite(folder, **changes):
    """Change entries of a manifest, with a checksum that fits: as another program would write it."""
    path = folder / "manifest.json"
    content = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({**content, "sha256": manifests._checksum(content)}))


@pytest.mark.parametrize("version", [FORMAT_VERSION - 1, FORMAT_VERSION + 1, 99, "1", None])
def test_another_format_version_is_refused_with_both_numbers(copy, version):
    rewrite(copy, format_version=version)
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
    content["tiles"] = content["tiles"][:2]
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
            content["sha256"] = manifests._checksum(content)
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
