# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps of format version 2 open as they did, and what is broken in them is refused."""

import json
import os

import numpy as np
import pytest
from maxcon.map.records import TILES, tile_record, tile_schema

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map.ground import GroundInMemory
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import Folder
from maxcon.map.store import Section
from written_maps import write, write_content, write_tile_files

CELL = 0.06
RNG = np.random.default_rng(3)
POINTS = RNG.uniform(-20.0, 20.0, (500, 3)) * [1, 1, 0.05]
VOXELS = PointMap.from_points(POINTS, np.tile([0.0, 1.0, 0.0], (500, 1)), CELL)
HEIGHTS = GroundInMemory.of_points(POINTS, CELL)


@pytest.fixture
def old(tmp_path):
    write_tile_files(tmp_path / "old.map", VOXELS, HEIGHTS)
    return tmp_path / "old.map"


def test_an_old_map_is_the_same_map(tmp_path, old):
    new = tmp_path / "new.map"
    written = write(new, VOXELS, HEIGHTS)
    manifest = read_manifest(old)
    assert (manifest.version, written.version) == (2, 3)
    for name in ("n_points", "n_voxels", "n_heights", "cell", "origin", "sigma"):
        assert getattr(manifest, name) == getattr(written, name)
    for got, wanted in zip(PointMap.open(old).all_voxels(), PointMap.open(new).all_voxels(), strict=True):
        np.testing.assert_array_equal(got, wanted)
    for got, wanted in zip(
        *(PointMap.open(path).ground_around(0.0, 0.0, 9.0).heights for path in (old, new)), strict=True
    ):
        np.testing.assert_array_equal(got, wanted)


def test_the_records_of_an_old_map_are_those_that_are_written_now(old):
    section = Section(Folder(old), read_manifest(old), TILES, tile_schema())
    for key in section.keys:
        assert section.record(key) == tile_record(VOXELS.tile(key))


def first_tile(folder):
    return sorted((folder / "tiles").iterdir())[0]


@pytest.mark.parametrize("what", ["flipped", "cut", "larger", "removed", "a FIFO", "another's"])
def test_a_file_that_is_not_what_was_written(old, what):
    path = first_tile(old)
    whole = bytearray(path.read_bytes())
    if what in ("flipped", "cut", "another's"):
        whole[len(whole) // 2] ^= 1
        other = sorted((old / "tiles").iterdir())[1].read_bytes()
        path.write_bytes({"flipped": whole, "cut": whole[:-9], "another's": other}[what])
    elif what == "larger":
        os.truncate(path, 2**40)  # a hole: it takes no room, and would take a terabyte of memory
    else:
        path.unlink()
        if what == "a FIFO":
            os.mkfifo(path)
    with pytest.raises(MapError, match=rf"Expected .*{path.name} to be .*maxcon map build") as refused:
        PointMap.open(old).all_voxels()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"key": [10**19, 0]}, "a tile at [1000"),
        ({"key": [2**21 + 1, 0]}, "a tile at [2097153, 0]"),
        ({"key": ["1", 0]}, "a tile at"),
        ({"key": [1]}, "unpack"),
        ({"n_voxels": "many"}, "a count of many"),
        ({"n_voxels": -1}, "a count of -1"),
        ({"n_points": 1e300}, "a count of 1e+300"),
        ({"n_points": ...}, "no 'n_points'"),
        ({"sha256": "ff"}, "a checksum"),
        ({"sha256": "x"}, "hexadecimal"),
        ({"sha256": None}, "broken entry"),
        ({"key": [-1, 0]}, "two entries of a tile"),
    ],
)
def test_an_entry_that_cannot_be_is_named(old, entry, words):
    content = json.loads((old / "manifest.json").read_text())
    for name, value in entry.items():
        content["tiles"][0].pop(name) if value is ... else content["tiles"][0].update({name: value})
    write_content(old, {name: value for name, value in content.items() if name != "sha256"})
    with pytest.raises(MapError, match=r"Expected a whole manifest in") as refused:
        read_manifest(old)
    assert words in str(refused.value)


@pytest.mark.parametrize("tiles", [None, [], 7, {"key": 1}])
def test_a_list_of_tiles_that_is_none(old, tiles):
    content = {**json.loads((old / "manifest.json").read_text()), "tiles": tiles}
    del content["sha256"]
    write_content(old, content)
    with pytest.raises(MapError, match=r"Expected a whole manifest in"):
        read_manifest(old)
