# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Shards and indices that are not what was written are refused, and no other tile comes back."""

import hashlib
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map.manifest import read_manifest
from written_maps import edit_index, tile_shard, write


def test_one_flipped_bit_anywhere_in_a_record_is_noticed(copy):
    path, table = tile_shard(copy), read_manifest(copy).tiles
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
    path = tile_shard(copy)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(MapError, match=rf"Expected tile .*{path.name} .*maxcon map build"):
        PointMap.open(copy).all_voxels()


def test_the_record_of_another_tile_is_noticed(copy):
    """Two records change places: each is whole, and neither is the one that was asked for."""
    table = read_manifest(copy).tiles
    content = tile_shard(copy).read_bytes()
    (a, b), (n_a, n_b) = table.offsets[:2].tolist(), table.lengths[:2].tolist()
    assert b == a + n_a
    swapped = content[:a] + content[b : b + n_b] + content[a:b] + content[b + n_b :]
    tile_shard(copy).write_bytes(swapped)
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
    table, path = read_manifest(copy).tiles, tile_shard(copy)
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
