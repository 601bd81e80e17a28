# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MapWriter: records into shards, their index, and the manifest last (docs/map_format.md)."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Self

from maxcon.errors import MapError
from maxcon.map.ground import GroundTile
from maxcon.map.layout import TileKey
from maxcon.map.manifest import Manifest, write_manifest
from maxcon.map.records import END_OF_STREAM, GROUND, TILES, Record, ground_record, tile_record
from maxcon.map.shard_table import Row, ShardFile, ShardTable
from maxcon.map.tile import VoxelTile

__all__ = ["SHARD_BYTES", "MapWriter"]

SHARD_BYTES = 2**27
"""Largest size of a shard of several records."""


class MapWriter:
    """Writes a map into a folder: `add_tile` and `add_ground`, or `put` of records made elsewhere, then `finish`.

    The files are the same if records come in the same order, whoever made them. Before `finish` there is no manifest,
    and the folder is no map: fill it under `atomic_folder`.

    Parameters
    ----------
    folder : Path
        An empty folder.
    shard_bytes : int
        Largest size of a file of several records.
    """

    def __init__(self, folder: Path, *, shard_bytes: int = SHARD_BYTES) -> None:
        self._folder = folder
        self._shard_bytes = shard_bytes
        self._sections: dict[str, _SectionWriter] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for section in self._sections.values():
            section.close()

    def add_tile(self, tile: VoxelTile) -> None:
        """Write the voxels of a tile."""
        self.put(tile_record(tile))

    def add_ground(self, tile: GroundTile) -> None:
        """Write the ground of a tile."""
        self.put(ground_record(tile))

    def put(self, record: Record) -> None:
        """Write a record into its section, behind those that were put before.

        Raises
        ------
        MapError
            If the section has a record of this tile already, or records of another schema.
        """
        if record.section not in self._sections:
            self._sections[record.section] = _SectionWriter(self._folder, record, self._shard_bytes)
        self._sections[record.section].put(record)

    def finish(
        self,
        *,
        cell: float,
        origin: tuple[float, float, float],
        crs: str | None,
        is_signed: bool,
        sigma: float,
        build: Mapping[str, Any],
    ) -> Manifest:
        """Complete the shards, write their indices and the manifest, and return it; see `Manifest` for what it says."""
        sections = {name: ShardTable.empty() for name in (TILES, GROUND)}
        sections |= {name: section.finish() for name, section in self._sections.items()}
        manifest = Manifest(cell, origin, crs, is_signed, sections, build, sigma)
        write_manifest(self._folder, manifest)
        return manifest


class _SectionWriter:
    """Writes the shards of one section, whose records have the schema of the first."""

    def __init__(self, folder: Path, first: Record, shard_bytes: int) -> None:
        self._folder = folder
        self._name = first.section
        self._schema = first.schema
        self._shard_bytes = shard_bytes
        self._files: list[ShardFile] = []
        self._rows: list[Row] = []
        self._keys: set[TileKey] = set()
        self._shard: BinaryIO | None = None
        self._n_bytes = 0
        self._checksums = hashlib.sha256()
        (folder / first.section).mkdir()

    def put(self, record: Record) -> None:
        if record.key in self._keys or record.schema != self._schema:
            what = "one record of each tile" if record.key in self._keys else "records of one schema"
            raise MapError(f"Expected {what} in section {self._name}, got another of tile {record.key}.")
        if self._n_bytes + len(record.content) + len(END_OF_STREAM) > self._shard_bytes:
            self._complete()
        shard = self._shard or self._begin()
        place = (len(self._files), self._n_bytes, len(record.content), record.sha256)
        self._n_bytes += shard.write(record.content)
        self._checksums.update(record.sha256)
        self._rows.append((record.key, record.n_rows, record.n_points, *place))
        self._keys.add(record.key)

    def finish(self) -> ShardTable:
        """Return the table of all records."""
        self._complete()
        return ShardTable.of_rows(self._schema, tuple(self._files), self._rows)

    def close(self) -> None:
        """Close what is open, after an error too."""
        if self._shard is not None:
            self._shard.close()

    @property
    def _partial(self) -> Path:
        return self._folder / self._name / "partial"

    def _begin(self) -> BinaryIO:
        self._shard = self._partial.open("wb")
        self._n_bytes = self._shard.write(self._schema)
        self._checksums = hashlib.sha256(self._schema)
        return self._shard

    def _complete(self) -> None:
        """Give the shard its name, of its number and its checksums: shards of two maps have different names."""
        if self._shard is None:
            return
        self._n_bytes += self._shard.write(END_OF_STREAM)
        self._shard.close()
        self._shard = None
        name = f"{self._name}/{len(self._files):05}-{self._checksums.hexdigest()[:8]}.arrows"
        self._partial.rename(self._folder / name)
        self._files.append(ShardFile(name, self._n_bytes))
