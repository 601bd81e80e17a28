# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps that are none, are broken, or are in the way."""

import hashlib
import json
import shutil

import pytest

from maxcon.map.manifest import read_manifest


@pytest.fixture
def city(drive, tmp_path):
    """A copy of the map, to be broken."""
    return shutil.copytree(drive.city, tmp_path / "city.map")


@pytest.fixture
def not_localized(maxcon, refused, drive, tmp_path):
    """Check that localizing in a map is refused with these words, and that nothing was written."""

    def check(city, *words):
        out = tmp_path / "out"
        out.mkdir(exist_ok=True)
        arguments = ("--prior", drive.dataset.prior, "-o", out / "poses.csv", "--plot", out / "pictures")
        refused(maxcon("localize", city, drive.dataset.scans, *arguments), *words)
        assert list(out.iterdir()) == []

    return check


def _edit(city, **entries):
    """Change entries of the manifest, with a checksum that fits: as another program would write it."""
    path = city / "manifest.json"
    content = {**json.loads(path.read_text()), **entries}
    del content["sha256"]
    checksum = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    path.write_text(json.dumps({**content, "sha256": checksum}))


def test_no_map(not_localized, maxcon, refused, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "notes.txt").touch()
    for name, got in (("missing.map", "no such folder"), ("photos", "no manifest.json"), ("notes.txt", "got a file")):
        not_localized(tmp_path / name, tmp_path / name, got, "maxcon map build")
        refused(maxcon("map", "info", tmp_path / name), tmp_path / name, got)


def test_a_name_too_long(maxcon, refused):
    refused(maxcon("map", "info", "a" * 300), "too long")


def test_another_format_version(not_localized, maxcon, refused, city):
    for version, advice in ((4, "Update maxcon, or build the map again"), (1, "Build the map again")):
        _edit(city, format_version=version)
        words = (city, f"format version 3, got {version}", advice)
        not_localized(city, *words)
        refused(maxcon("map", "info", city), *words)


def test_a_manifest_that_was_changed_by_hand(not_localized, city):
    path = city / "manifest.json"
    path.write_text(path.read_text().replace('"cell": 0.06', '"cell": 0.07'))
    not_localized(city, path, "another checksum", "Build the map again")


def test_another_program_s_manifest(not_localized, city):
    (city / "manifest.json").write_text('{"name": "web app"}')
    not_localized(city, city / "manifest.json", "maxcon map")


@pytest.mark.parametrize("content", ["", "{", "[]", "null", "\x00\x01", '"text"'])
def test_manifests_that_are_none(maxcon, refused, city, content):
    (city / "manifest.json").write_text(content)
    refused(maxcon("map", "info", city), city / "manifest.json", "Build the map again")


def test_a_manifest_that_is_no_text(maxcon, refused, city):
    (city / "manifest.json").write_bytes(b"\xff\xfe\x00" * 20)
    refused(maxcon("map", "info", city), city / "manifest.json", "Build the map again")


SOURCE = {
    "name": "a.laz", "n_points": 1, "n_kept": 1, "n_invalid": 0, "n_without_side": 0, "n_dropped": {},
    "is_classified": True,
}  # fmt: skip


@pytest.mark.parametrize(
    "entries",
    [
        {"cell": 0},
        {"cell": "wide"},
        {"cell": float("nan")},
        {"origin": [0, 0]},
        {"origin": [0, 0, float("inf")]},
        {"tile_voxels": 256},
        {"crs": 25832},
        {"crs": "nonsense"},
        {"sections": []},
        {"sections": {"tiles": {}}},
        {"sections": 7},
        {"sections": {"tiles": {"index": "/etc/passwd"}, "ground": {}}},
        {"build": 7},
        {"build": {"sources": [{"name": "a.laz"}]}},
        {"build": {"sources": [SOURCE | {"n_dropped": {"many": 3}}]}},
        {"build": {"sources": [SOURCE | {"n_dropped": []}]}},
        {"build": {"sources": [SOURCE | {"n_points": "1"}]}},
        {"sigma": -0.01},
        {"sigma": "small"},
        {"sigma": float("nan")},
        {"build": {"sigma": 0.02}},
        {"build": {"sigma": {}}},
        {"build": {"sigma": {"from": "hearsay"}}},
        {"build": {"sigma": {"from": "assumed", "reason": 7}}},
        {"build": {"sigma": {"from": "passes", "n_passes": 5, "sigma_of_pass": "2 cm", "n_places": 700}}},
    ],
    ids=str,
)
def test_manifests_with_a_broken_entry(maxcon, city, entries):
    _edit(city, **entries)
    ended = maxcon("map", "info", city)
    assert ended.code == 2, ended
    assert ended.err.startswith("maxcon: Expected") and ended.err.count("\n") == 1, ended.err
    assert "checksum" not in ended.err


def test_a_flipped_bit(not_localized, maxcon, refused, city):
    (shard,) = (city / "tiles").glob("*.arrows")
    content, table = bytearray(shard.read_bytes()), read_manifest(city).tiles
    for middle in (table.offsets + table.lengths // 2).tolist():
        content[middle] ^= 1
    shard.write_bytes(content)
    not_localized(city, shard, "tile (", "checksum", "Build the map again")
    assert maxcon("map", "info", city).code == 0
    ended = maxcon("map", "info", city, "--check")
    assert ended.code == 2 and "checksum" in ended.err and "as they were written" not in ended.out


def test_a_missing_and_a_truncated_shard(not_localized, city, truncated):
    (shard,) = (city / "tiles").glob("*.arrows")
    truncated(shard)
    not_localized(city, "checksum")
    shard.unlink()
    not_localized(city, city / "tiles", "No such file", "Build the map again")


def test_a_missing_index(not_localized, maxcon, refused, city):
    (index,) = (city / "tiles").glob("index-*.arrow")
    index.unlink()
    not_localized(city, index, "No such file", "Build the map again")
    refused(maxcon("map", "info", city), index)


def test_an_existing_map_is_kept_without_overwrite(maxcon, refused, street_npz, city):
    before = (city / "manifest.json").read_bytes()
    refused(maxcon("map", "build", street_npz, "-o", city), city, "not to exist", "--overwrite")
    assert (city / "manifest.json").read_bytes() == before


def test_an_existing_map_is_replaced_with_overwrite(maxcon, street_npz, city):
    ended = maxcon("map", "build", street_npz, "-o", city, "--overwrite")
    assert (ended.code, ended.err) == (0, "")
    assert "street.npz" in maxcon("map", "info", city, "--check").out
    assert sorted(path.name for path in city.parent.iterdir()) == ["city.map", "street.npz"]


def test_a_build_that_fails_keeps_the_old_map(maxcon, refused, city, tmp_path):
    before = (city / "manifest.json").read_bytes()
    refused(maxcon("map", "build", tmp_path / "none.laz", "-o", city, "--overwrite"), "none.laz")
    assert (city / "manifest.json").read_bytes() == before


def test_overwrite_replaces_nothing_but_a_map(maxcon, refused, street_npz, city, tmp_path):
    home = tmp_path / "home"
    (home / "tiles").mkdir(parents=True)
    arguments = ("map", "build", street_npz, "--overwrite", "-o")
    refused(maxcon(*arguments, home), home, "a map", "manifest.json")
    (home / "thesis.tex").touch()
    refused(maxcon(*arguments, home), home, "thesis.tex")
    refused(maxcon(*arguments, street_npz), street_npz, "Not a directory")
    (city / "notes.txt").touch()
    refused(maxcon(*arguments, city), city, "notes.txt", "Move that away")
    assert (home / "thesis.tex").exists() and street_npz.exists() and (city / "notes.txt").exists()


def test_overwrite_where_nothing_is(maxcon, street_npz, tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("new", "empty"):
        assert maxcon("map", "build", street_npz, "--overwrite", "-o", tmp_path / name).code == 0
        assert (tmp_path / name / "manifest.json").exists()


def test_threads_here_or_workers_elsewhere_make_the_tiles(maxcon, refused, street_npz, tmp_path):
    for others in (("--workers", "2"), ("--scheduler", "tcp://127.0.0.1:1")):
        ended = maxcon("map", "build", street_npz, "-o", tmp_path / "a.map", "--threads", "2", *others)
        refused(ended, "either threads of this process or others that make the tiles", "Leave out --threads")
    assert not (tmp_path / "a.map").exists()
