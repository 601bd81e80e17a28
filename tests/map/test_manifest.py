# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The manifest of a map and the indices of its sections: they come back as written, or are refused in a line."""

import json
import math
import os
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map import TILE_VOXELS
from maxcon.map import manifest as manifests
from maxcon.map.ground import ground_voxels
from maxcon.map.manifest import INDEX, Manifest, ShardFile, ShardTable, read_manifest, write_manifest
from written_maps import damage, edit_index, edit_manifest, said_by, table_of, write

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


SHARD = {"name": "tiles/00000-0.arrows", "bytes": 350}


def with_tiles(**changes):
    """Change what the manifest says of the tiles; `...` leaves an entry out."""
    return lambda content: content["sections"]["tiles"].update(changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
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
    ],
)  # fmt: skip
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


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        *(({"format": wrong}, "to say it is a maxcon map, but it does not") for wrong in ("other", ...)),
        ({"format_version": 2}, "map format version 3, got 2. Build the map again"),
        ({"format_version": 4}, "map format version 3, got 4. Update maxcon"),
        ({"cell": math.nan}, "to be the manifest of a map"),
        *((text, "be the manifest of a map") for text in (b"", b"[" * 100_000, b"\xff\xfe\x00", b"NaN")),
        *((text, "to say it is a maxcon map") for text in (b"[]", b"{}")),
        ((b'"cell": 0.', b'"cell": 1.'), "json to be as it was written, got another checksum"),
    ],
    ids=range(12),
)  # fmt: skip
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


JUNK = st.sampled_from(
    [None, True, False, 0, -1, 1.5, 1e400, float("nan"), 10**30, "", "x", "nan", [], [1], [[]], {}, {"a": 1}]
)


def paths_of(content, path=()):
    """Paths to all values of a JSON document."""
    yield path
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield from paths_of(value, (*path, key))


@pytest.fixture(scope="module")
def small(tmp_path_factory, in_memory):
    """A map in a folder whose manifest a test breaks, and puts back."""
    folder = tmp_path_factory.mktemp("broken") / "small.map"
    write(folder, in_memory, build={"program": "maxcon", "drop": {"2": "ground"}})
    return folder


@given(st.data())
def test_a_manifest_with_anything_in_the_wrong_place_is_read_or_refused(small, data):
    path = small / "manifest.json"
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
        opened = PointMap.open(small)
        opened.bounds, opened.covers(0.0, 0.0, 10.0)
        opened.tile(min(opened.tile_keys))
    except MapError as error:
        assert str(small) in str(error) and "\n" not in str(error)
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


def test_records_of_other_columns_are_refused(copy):
    schema = read_manifest(copy).tiles.schema.replace(b"normal", b"mormal")
    edit_index(copy, "tiles", schema=schema)
    with pytest.raises(MapError, match=r"tiles of .* to have columns of types that this version knows"):
        PointMap.open(copy)


def test_an_index_of_other_tiles_is_noticed_when_they_are_read(copy):
    """Rows that point elsewhere inside of the shard, as another program could write them: no tile comes back."""
    table = read_manifest(copy).tiles
    edit_index(copy, "tiles", **{name: np.roll(table.rows[name], 1) for name in ("offset", "length")})
    opened = PointMap.open(copy)
    for key in opened.tile_keys:
        with pytest.raises(MapError, match="another checksum"):
            opened.tile(key)
