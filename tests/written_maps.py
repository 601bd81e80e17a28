"""Maps on disk of what is in memory, and ways to change them with checksums that fit, as another program would."""

import json
import os
from dataclasses import replace

import numpy as np
from typer.testing import CliRunner

from maxcon.cli import app
from maxcon.errors import MaxconError
from maxcon.map import PointMap
from maxcon.map import manifest as manifests
from maxcon.map.manifest import INDEX, TILES, Manifest, ShardFile, ShardTable
from maxcon.map.store import SHARD_BYTES, MapWriter, ground_record, tile_record

SAID = {"origin": (458_800.0, 5_429_000.0, 100.0), "crs": None, "is_signed": True, "sigma": 0.02, "build": {}}


def run(*words, codes=(0,)):
    """Run a command and return what it says; raise an error of ours, and check the exit code."""
    done = CliRunner().invoke(app, [*map(str, words), "-q"])
    if isinstance(done.exception, MaxconError):
        raise done.exception
    assert done.exit_code in codes, done.output
    return done.output


def write(folder, point_map, *, shard_bytes=SHARD_BYTES, records=(), **said) -> Manifest:
    """Write the voxels and the ground of a map in memory, and more records."""
    folder.mkdir()
    ground = point_map._ground
    with MapWriter(folder, shard_bytes=shard_bytes) as writer:
        for key in sorted(point_map.tile_keys):
            writer.put(tile_record(point_map.tile(key)))
        for key in sorted(ground.keys):
            writer.put(ground_record(ground.load(key)))
        for record in records:
            writer.put(record)
        return writer.finish(Manifest(**{"cell": point_map.cell, "sections": {}, **SAID, **said}))


def said_by(manifest):
    """Everything in a manifest, to compare it with another."""
    names = ("cell", "origin", "crs", "is_signed", "build", "sigma")
    sections = {name: (table.to_bytes(), table.files) for name, table in manifest.sections.items()}
    return sections, *(getattr(manifest, name) for name in names)


def stored_voxels(path):
    """Means in global coordinates, counts, normals and surface classes of all voxels of a map on disk."""
    opened = PointMap.open(path, left_out=None)
    tiles = [opened.tile(key) for key in sorted(opened.tile_keys)]
    means = opened.frame.to_global(np.concatenate([tile.mean_points(opened.cell) for tile in tiles]))
    names = ("counts", "normals", "surface_classes")
    return means, *(np.concatenate([getattr(tile, name) for tile in tiles]) for name in names)


def assert_same_map(got, wanted):
    """Check that two maps hold the same tiles and ground."""
    assert got.tile_keys == wanted.tile_keys
    for one, other in zip(got.all_voxels(), wanted.all_voxels(), strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
    heights = (each.ground_around(0.0, 0.0, 30.0).heights for each in (got, wanted))
    np.testing.assert_array_equal(*heights)


def edit_manifest(folder, **changes):
    """Change entries of a manifest, `...` removes one, with a checksum that fits."""
    path = folder / manifests.MANIFEST
    content = {**json.loads(path.read_text()), **changes}
    content = {name: value for name, value in content.items() if value is not ...}
    path.write_text(json.dumps({**content, "sha256": manifests.checksum_of_manifest(content)}))


def edit_index(folder, section, schema=None, **columns):
    """Change columns of the index of a section, or its schema, and all checksums that depend on it."""
    manifest = manifests.read_manifest(folder)
    table = manifest.sections[section]
    for name, values in columns.items():
        table.rows[name] = values
    table = replace(table, schema=schema or table.schema)
    manifests.write_manifest(folder, replace(manifest, sections={**manifest.sections, section: table}))


def table_of(n, section=TILES, schema=b"some schema"):
    """Return the table of n records that lie behind each other in one file."""
    rows = [((k, -k), 10 + k, 20 + k, 0, 100 + 50 * k, 50, bytes([k % 256]) * 32) for k in range(n)]
    return ShardTable(schema, (ShardFile(f"{section}/00000-0.arrows", 200 + 50 * n),), np.array(rows, INDEX))


def damage(path, what):
    """Make of a file what another program left: one that is cut, of another map, a FIFO, or none."""
    if what == "cut":
        os.truncate(path, 100)
    elif what == "of another map":
        path.write_bytes(bytes(path.stat().st_size))
    else:
        path.unlink()
        if what == "a FIFO":
            os.mkfifo(path)


def tile_shard(folder):
    """Return the only file of a small map that holds its tiles."""
    (path,) = (folder / "tiles").glob("*.arrows")
    return path
