# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Section: the records of one kind of a map, read when asked for and checked against their checksums (D10)."""

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from maxcon.errors import MapError
from maxcon.map.layout import TileKey
from maxcon.map.manifest import REBUILD, TILE_FILES_VERSION, Manifest
from maxcon.map.record_claims import check_claims
from maxcon.map.records import Record, record_of
from maxcon.map.shard_table import ShardTable
from maxcon.map.storage import MapFiles, RecordPlace
from maxcon.map.tile_files import batch_of_file

__all__ = ["Section"]


class Section:
    """The records of one section of a map.

    Parameters
    ----------
    files : MapFiles
        The map's files.
    manifest : Manifest
        Its manifest.
    name : str
        Of the section; one that the map does not have has no records.
    schema : Arrow schema, optional
        Columns that its records must have; those that the map names if None.

    Raises
    ------
    MapError
        If the records are of another schema.
    """

    def __init__(self, files: MapFiles, manifest: Manifest, name: str, schema: Any = None) -> None:
        import pyarrow as pa

        self.name = name
        self._files = files
        self._table = manifest.sections.get(name) or ShardTable.empty()
        self._is_of_files = manifest.version == TILE_FILES_VERSION
        self._rows = self._table.rows_by_key()
        self._keys = frozenset(self._rows)
        self._schema = schema
        if not self._rows:
            return
        try:
            written = pa.ipc.read_schema(pa.py_buffer(self._table.schema))
        except (EOFError, OSError, pa.ArrowException):
            written = None
        self._schema = written if schema is None else schema
        if written is None or not written.equals(self._schema):
            raise MapError(
                f"Expected the {name} of {files.where('')} to have columns of types that this version knows, but they"
                f" have not. {REBUILD}"
            )

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles that have a record."""
        return self._keys

    def announce(self, keys: Iterable[TileKey]) -> None:
        """Announce records that will be read soon: those of a map on a network are fetched in the background."""
        if not self._is_of_files:
            self._files.announce([self._place(self._rows[key]) for key in keys if key in self._rows])

    def keys_in_order(self) -> list[TileKey]:
        """Return the keys in the order in which the records lie in the shards."""
        order = np.lexsort((self._table.offsets, self._table.shards))
        return [(x, y) for x, y in self._table.keys[order].tolist()]

    def where(self, key: TileKey) -> str:
        """Return where a record lies, for messages."""
        file = self._files.where(self._table.files[self._table.shards[self._rows[key]]].name)
        return file if self._is_of_files else f"tile {key} in {file}"

    def batch(self, key: TileKey) -> Any:
        """Return the record batch of a tile, in private memory: later changes of the file do no harm.

        Raises
        ------
        MapError
            If its file is missing, or is not what was written.
        """
        import pyarrow as pa

        content, n_rows = self._content(key), int(self._table.n_rows[self._rows[key]])
        try:
            buffer = pa.py_buffer(content)
            if self._is_of_files:
                batch = batch_of_file(buffer)
            else:
                check_claims(content)
                batch = pa.ipc.read_record_batch(buffer, self._schema)
            batch.validate()
        except (EOFError, OSError, ValueError, pa.ArrowException) as error:
            raise self._is_none(key, str(error).partition("\n")[0]) from None
        if not batch.schema.equals(self._schema) or batch.num_rows != n_rows:
            raise MapError(f"Expected {n_rows} rows in {self.where(key)}, got {batch.num_rows}. {REBUILD}")
        return batch

    def record(self, key: TileKey) -> Record:
        """Return the record of a tile, checked, to write it into another map.

        Raises
        ------
        MapError
            As `batch`.
        """
        row = self._rows[key]
        n_points = int(self._table.n_points[row])
        if self._is_of_files:
            return record_of(self.name, key, self.batch(key), n_points)
        content, n_rows = bytes(self._content(key)), int(self._table.n_rows[row])
        sha256 = self._table.checksums[row].tobytes()
        return Record(self.name, key, n_rows, n_points, self._table.schema, content, sha256)

    def _content(self, key: TileKey) -> memoryview:
        """Return the bytes of a record."""
        table, row = self._table, self._rows[key]
        name, length = table.files[table.shards[row]].name, int(table.lengths[row])
        try:
            content = self._files.read(name, length) if self._is_of_files else self._files.read_record(self._place(row))
        except OSError as error:
            raise self._is_none(key, error.strerror or str(error)) from None
        if hashlib.sha256(content).digest() != table.checksums[row].tobytes():
            raise MapError(f"Expected {self.where(key)} to be as it was written, got another checksum. {REBUILD}")
        return content

    def _place(self, row: int) -> RecordPlace:
        table = self._table
        name = table.files[table.shards[row]].name
        return RecordPlace(name, int(table.offsets[row]), int(table.lengths[row]), table.checksums[row].tobytes())

    def _is_none(self, key: TileKey, words: str) -> MapError:
        return MapError(f"Expected {self.where(key)} to be of the map, got: {words}. {self._files.remedy}")
