# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps on disk of what is in memory: of this format version, and of the one before."""

import hashlib
import json
from dataclasses import replace

import pyarrow as pa
from maxcon.map.records import GROUND, TILES, ground_record, tile_record

from maxcon.map import manifest as manifests
from maxcon.map.manifest import Manifest, ShardFile, ShardTable
from maxcon.map.writer import SHARD_BYTES, MapWriter

SAID = {"origin": (458_800.0, 5_429_000.0, 100.0), "crs": None, "is_signed": True, "sigma": 0.02, "build": {}}


def write(folder, point_map, ground=None, *, shard_bytes=SHARD_BYTES, **said) -> Manifest:
    """Write the voxels of a map, and ground of another source, if given."""
    folder.mkdir()
    with MapWriter(folder, shard_bytes=shard_bytes) as writer:
        for key in sorted(point_map.tile_keys):
            writer.add_tile(point_map.tile(key))
        for key in sorted(ground.keys) if ground is not None else ():
            writer.add_ground(ground.load(key))
        return writer.finish(**{"cell": point_map.cell, **SAID, **said})


def write_tile_files(folder, point_map, ground=None, **said):
    """Write the same as format version 2 had it: a file for each tile, and all of them in the manifest."""
    entries = {TILES: [], GROUND: []}
    records = [tile_record(point_map.tile(key)) for key in sorted(point_map.tile_keys)]
    records += [ground_record(ground.load(key)) for key in sorted(ground.keys)] if ground is not None else []
    for record in records:
        path = folder / record.section / f"{record.key[0]}_{record.key[1]}.arrow"
        path.parent.mkdir(parents=True, exist_ok=True)
        schema = pa.ipc.read_schema(pa.py_buffer(record.schema))
        batch = pa.ipc.read_record_batch(pa.py_buffer(record.content), schema)
        with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, schema) as writer:
            writer.write_batch(batch)
        counts = (
            {"n_voxels": record.n_rows, "n_points": record.n_points}
            if record.section == TILES
            else {"n_heights": record.n_rows}
        )
        checksum = hashlib.sha256(path.read_bytes()).hexdigest()
        entries[record.section].append({"key": record.key, **counts, "sha256": checksum})
    content = {
        "format": "maxcon map", "format_version": 2, "tile_voxels": 512,
        "ground_voxels": manifests.ground_voxels(point_map.cell), "cell": point_map.cell, **SAID, **said, **entries,
    }  # fmt: skip
    write_content(folder, content)


def write_content(folder, content):
    """Write a manifest with a checksum that fits: as another program would write it."""
    content = {**content, "sha256": manifests.checksum_of_manifest(content)}
    (folder / "manifest.json").write_text(json.dumps(content))


def edit_manifest(folder, **changes):
    """Change entries of a manifest, with a checksum that fits."""
    write_content(folder, {**json.loads((folder / "manifest.json").read_text()), **changes})


def edit_index(folder, section, **changes):
    """Change columns of the index of a section, and all checksums that depend on it."""
    manifest = manifests.read_manifest(folder)
    table = replace(manifest.sections[section], **changes)
    manifests.write_manifest(folder, replace(manifest, sections={**manifest.sections, section: table}))


def table_of(n, section=TILES, schema=b"some schema"):
    """Return the table of n records that lie behind each other in one file."""
    rows = [((k, -k), 10 + k, 20 + k, 0, 100 + 50 * k, 50, bytes([k % 256]) * 32) for k in range(n)]
    return ShardTable.of_rows(schema, (ShardFile(f"{section}/00000-0.arrows", 200 + 50 * n),), rows)


def tile_shard(folder):
    """Return the only file of a small map that holds its tiles."""
    (path,) = (folder / "tiles").glob("*.arrows")
    return path
