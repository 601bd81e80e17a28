"""A map on disk: what is written is what is read, tiles as they are asked for; what is damaged or no map is refused."""

import json
import math
import os
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map import TILE_VOXELS
from maxcon.map import manifest as manifests
from maxcon.map.ground import ground_voxels
from maxcon.map.layout import ALL_BUT_KNOWN, NOT_SEARCHED, SurfaceClass
from maxcon.map.manifest import INDEX, Manifest, ShardFile, ShardTable, read_manifest, write_manifest
from maxcon.map.store import MapWriter, classes_record, tile_record
from written_maps import SAID, assert_same_map, damage, edit_index, edit_manifest, said_by, table_of, tile_shard, write

CELL = 0.06
SHARD = {"name": "tiles/00000-0.arrows", "bytes": 350}
JUNK = st.sampled_from(
    [None, True, False, 0, -1, 1.5, 1e400, float("nan"), 10**30, "", "x", "nan", [], [1], [[]], {}, {"a": 1}]
)


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


# --- damage ---
@pytest.fixture(scope="module")
def breakable(tmp_path_factory, in_memory):
    """A map of several shards, to break and put back."""
    folder = tmp_path_factory.mktemp("broken") / "shards.map"
    write(folder, in_memory, shard_bytes=30_000, build={"program": "maxcon", "drop": {"2": "ground"}})
    return folder


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


# --- classes of an updated map ---
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


WHOLE = Manifest(
    cell=0.06, origin=(458_800.0, 5_429_000.0, 100.0), crs="LOCAL", is_signed=True,
    sections={name: table_of(n, name) for name, n in (("tiles", 3), ("ground", 2), ("of_others", 1))},
    build={"program": "maxcon", "sources": [{"name": "a.laz", "n_kept": 20}], "sigma": {"from": "given"}}, sigma=0.0,
)  # fmt: skip


@pytest.fixture
def path(tmp_path):
    """The file of that manifest."""
    write_manifest(tmp_path, WHOLE)
    return tmp_path / manifests.MANIFEST


def test_what_is_written_is_what_is_read(path):
    assert said_by(read_manifest(path.parent)) == said_by(WHOLE)
    assert (WHOLE.n_points, WHOLE.n_voxels) == (63, 33)
    text = path.read_text()
    assert text.endswith("}\n")
    assert '\n "cell": 0.06,\n' in text  # one entry a line, for people
    content = json.loads(text)
    assert (content["tile_voxels"], content["ground_voxels"]) == (TILE_VOXELS, ground_voxels(0.06))
    path.write_text(json.dumps(dict(reversed(content.items())), indent=7))  # spaces and order do not matter
    assert said_by(read_manifest(path.parent)) == said_by(WHOLE)
    sections = {name: section for name, section in content["sections"].items() if name != "ground"}
    edit_manifest(path.parent, crs=None, build={}, sections=sections)
    bare = read_manifest(path.parent)
    assert (bare.crs, bare.build, len(bare.ground)) == (None, {}, 0)


def with_tiles(**changes):
    """Change what the manifest says of the tiles; `...` leaves an entry out."""
    return lambda content: content["sections"]["tiles"].update(changes)


@pytest.mark.parametrize(("changes", "words"), [
    *(({"cell": cell}, "cell") for cell in (0.0, 1e3, ..., "wide")),
    ({"origin": [0.0, 1e300, 0.0]}, "origin"),
    ({"origin": [0.0, 0.0]}, "origin"),
    ({"sigma": -0.01}, "sigma"),
    ({"tile_voxels": 256}, "tile_voxels"),
    ({"ground_voxels": 4}, "ground_voxels"),
    ({"crs": 25832}, "crs"),
    ({"is_signed": "false"}, "is_signed"),  # it must not read as true
    ({"build": None}, "build"),
    ({"sections": {}}, "at least one tile"),
    ({"sections": {"../tiles": {}}}, "sections"),
    *((with_tiles(index=name), "index`") for name in ("../secret", "tiles/../secret", "tiles/", 7, ...)),
    (with_tiles(index_bytes=-1), "index_bytes"),
    (with_tiles(index_sha256=...), "index_sha256"),
    (with_tiles(shards=[{**SHARD, "bytes": 2**70}]), "bytes"),
    *((with_tiles(shards=[{**SHARD, "name": name}]), "name") for name in ("/etc/passwd", "tiles/../a", "a/b\n")),
])  # fmt: skip
def test_an_entry_that_cannot_be_is_named(path, changes, words):
    if callable(changes):
        content = json.loads(path.read_text())
        changes(content)
        tiles = {name: value for name, value in content["sections"]["tiles"].items() if value is not ...}
        changes = {"sections": {**content["sections"], "tiles": tiles}}
    edit_manifest(path.parent, **changes)
    with pytest.raises(MapError) as refused:
        read_manifest(path.parent)
    text = str(refused.value)
    assert text.startswith("Expected ") and str(path) in text and words in text and "\n" not in text
    assert text.endswith("Build the map again with `maxcon map build`.")


@pytest.mark.parametrize(("changes", "words"), [
    *(({"format": wrong}, "to say it is a maxcon map, but it does not") for wrong in ("other", ...)),
    ({"format_version": 2}, "map format version 3, got 2. Build the map again"),
    ({"format_version": 4}, "map format version 3, got 4. Update maxcon"),
    ({"cell": math.nan}, "to be the manifest of a map"),
    *((text, "be the manifest of a map") for text in (b"", b"[" * 100_000, b"\xff\xfe\x00", b"NaN")),
    *((text, "to say it is a maxcon map") for text in (b"[]", b"{}")),
    ((b'"cell": 0.', b'"cell": 1.'), "json to be as it was written, got another checksum"),
], ids=range(12))  # fmt: skip
def test_what_is_no_manifest_of_this_version(path, changes, words):
    if isinstance(changes, dict):
        edit_manifest(path.parent, **changes)
    else:
        path.write_bytes(changes if isinstance(changes, bytes) else path.read_bytes().replace(*changes))
    with pytest.raises(MapError, match=re.escape(words)):
        read_manifest(path.parent)


def test_what_is_no_map_says_what_it_is(tmp_path):
    (tmp_path / "file").write_text("{}")
    (tmp_path / "unreadable" / manifests.MANIFEST).mkdir(parents=True)
    (tmp_path / "fifo").mkdir()
    os.mkfifo(tmp_path / "fifo" / manifests.MANIFEST)
    write(tmp_path / "empty", PointMap.from_points(np.empty((0, 3)), np.empty((0, 3)), 0.06))
    for name, words in (
        ("nothing", "to be a map, got no manifest.json there (No such file or directory). Build one with"),
        ("file", "to be a map, got no manifest.json there (Not a directory)"),
        ("unreadable", "to be the manifest of a map, got: Is a directory"),
        ("fifo", "got: a FIFO, no file"),
        ("empty", "at least one tile"),
    ):
        with pytest.raises(MapError) as refused:
            PointMap.open(tmp_path / name)
        assert words in str(refused.value)


def paths_of(content, path=()):
    """Paths to all values of a JSON document."""
    yield path
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield from paths_of(value, (*path, key))


@given(st.data())
def test_a_manifest_with_anything_in_the_wrong_place_is_read_or_refused(breakable, data):
    path = breakable / "manifest.json"
    whole = path.read_bytes()
    try:
        if data.draw(st.booleans()):
            content = json.loads(whole)
            *parents, last = data.draw(st.sampled_from([p for p in paths_of(content) if p]))
            parent = content
            for key in parents:
                parent = parent[key]
            if data.draw(st.booleans()) and isinstance(parent, dict):
                del parent[last]
            else:
                parent[last] = data.draw(JUNK)
            if last != "sha256" and data.draw(st.booleans()):  # as another program would write it
                content["sha256"] = manifests.checksum_of_manifest(content)
            path.write_text(json.dumps(content))
        else:
            broken = bytearray(whole[: data.draw(st.integers(0, len(whole)))] if data.draw(st.booleans()) else whole)
            for _ in range(data.draw(st.integers(0, 4)) if broken else 0):
                broken[data.draw(st.integers(0, len(broken) - 1))] ^= 1 << data.draw(st.integers(0, 7))
            path.write_bytes(broken)
        opened = PointMap.open(breakable)
        opened.bounds, opened.covers(0.0, 0.0, 10.0)
        opened.tile(min(opened.tile_keys))
    except MapError as error:
        assert str(breakable) in str(error) and "\n" not in str(error)
    finally:
        path.write_bytes(whole)


# --- indices ------------------------------------------------------------------------------------------

FILES = tuple(ShardFile(f"tiles/{number}", 10_000) for number in range(3))
ROWS = st.lists(
    st.tuples(
        st.tuples(st.integers(-(2**21), 2**21), st.integers(-(2**21), 2**21)),
        st.integers(0, 10_000), st.integers(0, 2**61),
        st.integers(0, 2), st.integers(0, 5000), st.integers(1, 5000), st.binary(min_size=32, max_size=32),
    ),
    max_size=40, unique_by=lambda row: row[0],
)  # fmt: skip


@given(ROWS, st.binary(max_size=50))
def test_an_index_comes_back_as_it_was(rows, schema):
    table = ShardTable(schema, FILES, np.array(sorted(rows), INDEX))
    again = ShardTable.from_bytes(table.to_bytes(), FILES)
    assert (again.schema, again.files, len(again)) == (schema, FILES, len(rows))
    assert again.rows.tobytes() == table.rows.tobytes()
    for row in rows:
        assert again.range_of(row[0]) == (f"tiles/{row[3]}", *row[4:6])


@pytest.mark.parametrize("what", ["missing", "cut", "a FIFO", "of another map"])
def test_an_index_that_is_not_the_one_that_was_written(copy, what):
    (path,) = (copy / "tiles").glob("index-*.arrow")
    damage(path, what)
    with pytest.raises(MapError, match=rf"Expected .*{path.name} to be .*, got.*map build"):
        PointMap.open(copy)


def test_an_index_of_other_tiles_is_noticed_when_they_are_read_and_one_of_other_columns_before(copy):
    """Rows that point elsewhere inside of the shard, as another program could write them: no tile comes back."""
    table = read_manifest(copy).tiles
    edit_index(copy, "tiles", **{name: np.roll(table.rows[name], 1) for name in ("offset", "length")})
    opened = PointMap.open(copy)
    for key in opened.tile_keys:
        with pytest.raises(MapError, match="another checksum"):
            opened.tile(key)
    edit_index(copy, "tiles", schema=table.schema.replace(b"normal", b"mormal"))
    with pytest.raises(MapError, match=r"tiles of .* to have columns of types that this version knows"):
        PointMap.open(copy)
