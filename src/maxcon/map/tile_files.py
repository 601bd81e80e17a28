# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps of format version 2, whose tiles are a file each: what their manifest says of them, and how one is read."""

from collections.abc import Mapping, Sequence
from typing import Any

from maxcon.map.layout import TileKey
from maxcon.map.records import GROUND, TILES, ground_schema, tile_schema
from maxcon.map.shard_table import MOST_KEY, ShardFile, ShardTable

__all__ = ["batch_of_file", "most_bytes", "tables_of_tile_files"]

ROW_BYTES = 27
"""Bytes of a voxel; a height has fewer."""
FORMAT_BYTES = 2**16
"""Most bytes of a tile's file beside those of its voxels: the schema twice, offsets of columns, padding."""


def tables_of_tile_files(content: Mapping[str, Any]) -> dict[str, ShardTable]:
    """Return the sections of a manifest of version 2, with a file for each record, of its largest possible size.

    Raises
    ------
    KeyError, TypeError, ValueError
        If an entry is broken.
    """
    voxels, heights = content["tiles"], content.get("ground", ())
    return {
        TILES: _table(TILES, tile_schema(), voxels, "n_voxels"),
        GROUND: _table(GROUND, ground_schema(), heights, "n_heights"),
    }


def _table(section: str, schema: Any, entries: Sequence[Mapping[str, Any]], rows: str) -> ShardTable:
    files, table = [], []
    for number, entry in enumerate(entries):
        key, n_rows = _key(entry["key"]), _count(entry[rows], 2**31)
        n_points = _count(entry["n_points"], 2**62) if section == TILES else 0
        checksum = bytes.fromhex(entry["sha256"])
        if len(checksum) != 32:
            raise ValueError("a checksum that is none")
        files.append(ShardFile(f"{section}/{key[0]}_{key[1]}.arrow", most_bytes(n_rows)))
        table.append((key, n_rows, n_points, number, 0, files[-1].n_bytes, checksum))
    if len({row[0] for row in table}) < len(table):
        raise ValueError("two entries of a tile")
    return ShardTable.of_rows(schema.serialize().to_pybytes(), tuple(files), table)


def most_bytes(n_rows: int) -> int:
    """Return how large the file of a tile with so many rows can be."""
    return ROW_BYTES * n_rows + FORMAT_BYTES


def batch_of_file(content: Any) -> Any:
    """Return the record batch of a file's bytes, as views of them."""
    import pyarrow as pa

    return pa.ipc.open_file(content).get_batch(0)


def _key(values: Sequence[Any]) -> TileKey:
    """Return the key of a tile: of voxels whose indices a map can have."""
    x, y = values
    if not all(type(value) is int and -MOST_KEY <= value <= MOST_KEY for value in (x, y)):
        raise ValueError(f"a tile at {str(values)[:40]}")
    return x, y


def _count(value: Any, most: int) -> int:
    if not (type(value) is int and 0 <= value < most):
        raise ValueError(f"a count of {str(value)[:40]}")
    return value
