# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MapWriter: records into shards, their index, and the manifest last (docs/map_format.md); and copies of a map."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Self

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.progress import Progress
from maxcon.errors import FileError, MapError, OptionError
from maxcon.map.layout import TileKey
from maxcon.map.manifest import (
    GROUND,
    MANIFEST,
    MAP_NAMES,
    TILES,
    Manifest,
    ShardFile,
    ShardTable,
    file_names,
    read_manifest,
    write_manifest,
)
from maxcon.map.storage import Folder, MapStorage, Remote, address_of, open_storage
from maxcon.map.store import END_OF_STREAM, Record, Section

SHARD_BYTES = 2**27
"""Largest size of a shard of several records."""


class MapWriter:
    """Writes a map into a folder: `put` the records of its tiles, then `finish`.

    The files are the same if records come in the same order, whoever made them. Before `finish` there is no manifest,
    and the folder is no map: fill it under `atomic_folder`.

    folder: an empty folder.
    shard_bytes: largest size of a file of several records.
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

    def put(self, record: Record) -> None:
        """Write a record into its section; a MapError if it has one of this tile already, or another schema."""
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
        self._rows: list[tuple[Any, ...]] = []
        self._keys: set[TileKey] = set()
        self._shard: BinaryIO | None = None
        self._n_bytes = 0
        self._checksums = hashlib.sha256()
        (folder / first.section).mkdir()

    def put(self, record: Record) -> None:
        if record.key in self._keys or record.schema != self._schema:
            what = "one record of each tile" if record.key in self._keys else "records of one schema"
            raise MapError(f"Expected {what} in section {self._name}, got another of tile {record.key}. Put it once.")
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


PREFETCHED = 16
"""Records that are prefetched while one is copied."""


def copy_map(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Manifest:
    """Copy a map to a folder, or from a folder to an address; every record is checked on its way.

    At an address the manifest is written last, so that nobody sees half a map; files of a map that was there before
    stay, for those who are still reading it.

    Parameters
    ----------
    source, target : path or str
        A folder, or `s3://bucket/prefix`; a source may be `http://` or `https://` too. One of both is a folder.
    overwrite : bool
        Whether a map that is there is replaced.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Manifest
        Of the map that was copied.

    Raises
    ------
    FileError: if a map is there, or it cannot be written.
    MapError: if the source is no map, or one of its records is not what was written.
    """
    report = progress or (lambda step, done, total: None)
    address = address_of(target)
    if address is not None and not address.startswith("s3://"):
        raise OptionError(f"Expected a folder or s3:// to copy to, got {address}: a web server is only read.")
    storage = open_storage(source)
    manifest = read_manifest(storage)
    if address is None:
        if overwrite:
            check_replaceable(target, "a map", MAP_NAMES)
        with atomic_folder(target, overwrite=overwrite) as folder, MapWriter(folder) as writer:
            for record in _records(storage, manifest, "copying tiles", report):
                writer.put(record)
            return writer.finish(
                cell=manifest.cell, origin=manifest.origin, crs=manifest.crs, is_signed=manifest.is_signed,
                sigma=manifest.sigma, build=manifest.build,
            )  # fmt: skip
    if not isinstance(storage, Folder):
        raise FileError(
            f"Expected a map in a folder, to copy it to {address}, got {source}. Copy it to a folder first."
        )
    for _ in _records(storage, manifest, "checking tiles", report):
        pass
    _publish(storage, address, overwrite, report)
    return manifest


def _records(storage: MapStorage, manifest: Manifest, step: str, report: Progress) -> Iterator[Record]:
    """Yield all records of a map, checked, in the order in which they lie in the shards."""
    sections = [Section(storage, manifest, name) for name in manifest.sections]
    n_records, done = sum(len(section.keys) for section in sections), 0
    for section in sections:
        keys = section.keys_in_order()
        for number, key in enumerate(keys):
            section.prefetch(keys[number : number + PREFETCHED])
            yield section.record(key)
            done += 1
            report(step, done, n_records)


def _publish(storage: Folder, address: str, overwrite: bool, report: Progress) -> None:
    """Write the files of a map to an address, without those that are there already, and the manifest last."""
    remote = Remote(address)
    paths = {name: Path(storage.where(name)) for name in file_names(storage)}
    try:
        sizes = {name: path.stat().st_size for name, path in paths.items()}
        if not overwrite and remote.size(MANIFEST) is not None:
            raise FileError(
                f"Expected no map at {address} yet, but there is one. Name another place, or allow"
                " replacing it (--overwrite)."
            )
        done = 0
        for name, path in paths.items():
            if remote.size(name) != sizes[name]:
                remote.write(name, path)
            done += sizes[name]
            report("copying bytes", done, sum(sizes.values()))
        remote.write(MANIFEST, Path(storage.where(MANIFEST)).read_bytes())
    except OSError as error:
        raise FileError(
            f"Expected to be able to write to {address}, got: {error.strerror or error}. What was written is no map"
            " yet; the same command goes on with it."
        ) from None
