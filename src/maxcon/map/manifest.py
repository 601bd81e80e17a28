# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The manifest of a map: what it is made of, and how that is read and written (D10)."""

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from maxcon.errors import MapError
from maxcon.map.ground import ground_voxels
from maxcon.map.layout import TILE_VOXELS
from maxcon.map.records import CLASSES, GROUND, TILES
from maxcon.map.shard_table import ShardFile, ShardTable
from maxcon.map.sigma import UNKNOWN_SIGMA
from maxcon.map.storage import MapFiles, open_place
from maxcon.map.tile_files import tables_of_tile_files

__all__ = [
    "CELLS",
    "FORMAT",
    "FORMAT_VERSION",
    "MANIFEST",
    "MAP_NAMES",
    "REBUILD",
    "TILE_FILES_VERSION",
    "Manifest",
    "checksum_of_manifest",
    "file_names",
    "read_manifest",
    "write_manifest",
]

FORMAT = "maxcon map"
FORMAT_VERSION = 3
TILE_FILES_VERSION = 2
"""The version in which each tile was a file; such a map can still be read."""
MANIFEST = "manifest.json"
LARGEST_MANIFEST = 2**30
"""Bytes: those of some millions of tiles of version 2."""
LARGEST_INDEX = 2**32
"""Bytes: those of fifty million tiles."""
CELLS = (1e-4, 100.0)
"""Smallest and largest voxel edge of a map, m."""
MAP_NAMES = (MANIFEST, TILES, GROUND, CLASSES)
"""Names of the files and folders in the folder of a map."""
REBUILD = "Build the map again with `maxcon map build`."
SECTION_NAME, FILE_NAME = re.compile(r"[a-z][a-z_]*"), re.compile(r"[0-9A-Za-z_-]+(\.[0-9A-Za-z_-]+)*")


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a map is made of; `maxcon map info` prints it.

    Parameters
    ----------
    cell : float
        Voxel edge, m.
    origin : tuple of 3 float
        Global coordinates of the local frame's origin, m.
    crs : str or None
        WKT.
    is_signed : bool
        Whether normals are turned to the sensor's side.
    sections : mapping
        By name, where the records of each section lie: "tiles", of voxels, and "ground", of the ground grid, without
        records where it is not known; others that were written.
    build : mapping
        How it was made: sources, points read and dropped, the program's version, where sigma is from.
    sigma : float
        Standard deviation of the map's position along any axis, m.
    version : int
        Of the format.
    sha256 : str
        Its checksum, where it was read; empty where it is made.
    """

    cell: float
    origin: tuple[float, float, float]
    crs: str | None
    is_signed: bool
    sections: Mapping[str, ShardTable]
    build: Mapping[str, Any] = field(default_factory=dict)
    sigma: float = UNKNOWN_SIGMA
    version: int = FORMAT_VERSION
    sha256: str = field(default="", compare=False)

    @property
    def tiles(self) -> ShardTable:
        """The tiles of voxels."""
        return self.sections[TILES]

    @property
    def ground(self) -> ShardTable:
        """The tiles of the ground grid."""
        return self.sections[GROUND]

    @property
    def n_points(self) -> int:
        """Points in all voxels."""
        return int(self.tiles.n_points.sum())

    @property
    def n_voxels(self) -> int:
        """Occupied voxels."""
        return int(self.tiles.n_rows.sum())

    @property
    def n_heights(self) -> int:
        """Heights of the ground."""
        return int(self.ground.n_rows.sum())


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the indices of the sections that have records, and the manifest: the last step of a build."""
    sections = {name: _write_index(folder, name, table) for name, table in manifest.sections.items() if len(table)}
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "tile_voxels": TILE_VOXELS,
        "ground_voxels": ground_voxels(manifest.cell),
        "cell": manifest.cell,
        "origin": manifest.origin,
        "crs": manifest.crs,
        "is_signed": manifest.is_signed,
        "sigma": manifest.sigma,
        "build": manifest.build,
        "sections": sections,
    }
    content["sha256"] = checksum_of_manifest(content)
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n")


def _write_index(folder: Path, name: str, table: ShardTable) -> dict[str, Any]:
    """Write the index of a section; return what the manifest says of it. Its name tells it from that of other maps."""
    content = table.to_bytes()
    checksum = hashlib.sha256(content).hexdigest()
    index = f"{name}/index-{checksum[:8]}.arrow"
    (folder / name).mkdir(exist_ok=True)
    (folder / index).write_bytes(content)
    shards = [{"name": file.name, "bytes": file.n_bytes} for file in table.files]
    return {"index": index, "index_bytes": len(content), "index_sha256": checksum, "shards": shards}


def checksum_of_manifest(content: Mapping[str, Any]) -> str:
    """SHA-256 of all entries of a manifest but itself, in a form that spaces and order do not change."""
    entries = {name: value for name, value in content.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def read_manifest(place: str | os.PathLike[str] | MapFiles) -> Manifest:
    """Read the manifest of a map and the indices of its sections.

    Parameters
    ----------
    place : path, str or MapFiles
        Where the map is.

    Raises
    ------
    MapError
        If there is no map, its format version is another, or its manifest or an index is broken.
    """
    files = open_place(place) if isinstance(place, str | os.PathLike) else place
    file, root = files.where(MANIFEST), files.where("")
    content = _read_json(files)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise MapError(f"Expected {file} to say it is a {FORMAT}, but it does not. {REBUILD}")
    version = content.get("format_version")
    if version not in (TILE_FILES_VERSION, FORMAT_VERSION):
        is_newer = isinstance(version, int) and version > FORMAT_VERSION
        raise MapError(
            f"Expected {root} to have map format version {FORMAT_VERSION}, got {version!r}."
            f" {'Update maxcon, or build the map again with this version.' if is_newer else REBUILD}"
        )
    if content.get("sha256") != checksum_of_manifest(content):
        raise MapError(f"Expected {file} to be as it was written, got another checksum. {REBUILD}")
    try:
        return replace(_parse_manifest(content, files), sha256=content["sha256"])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        words = f"no {error}" if isinstance(error, KeyError) else f"a broken entry: {error}"
        raise MapError(f"Expected a whole manifest in {file}, got {words}. {REBUILD}") from None


def file_names(files: MapFiles) -> list[str]:
    """Return the names of the files of a map of this format version, without the manifest, which was read before.

    Raises
    ------
    MapError
        If it cannot be read.
    """
    sections = _read_json(files)["sections"].values()
    return [name for entry in sections for name in (*(shard["name"] for shard in entry["shards"]), entry["index"])]


def _read_json(files: MapFiles) -> Any:
    file = files.where(MANIFEST)
    try:
        return json.loads(bytes(files.read(MANIFEST, LARGEST_MANIFEST)))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MapError(
            f"Expected {files.where('')} to be a map, got {files.what_is_there(MANIFEST, error)}."
            " Build one with `maxcon map build`."
        ) from None
    except OSError as error:
        raise MapError(
            f"Expected to be able to read {file}, got: {error.strerror or error}. Check the path and its permissions."
        ) from None
    except (ValueError, RecursionError) as error:
        raise MapError(f"Expected {file} to be the manifest of a map, got: {error}. {REBUILD}") from None


def _parse_manifest(content: Mapping[str, Any], files: MapFiles) -> Manifest:
    cell, sigma = float(content["cell"]), float(content["sigma"])
    x, y, z = (float(value) for value in content["origin"])
    if not (CELLS[0] <= cell <= CELLS[1] and all(map(math.isfinite, (x, y, z)))):
        raise ValueError(f"cell {cell}, origin {(x, y, z)}")
    if not 0.0 <= sigma < math.inf:
        raise ValueError(f"sigma {sigma}")
    if content["tile_voxels"] != TILE_VOXELS:
        raise ValueError(f"tile_voxels {content['tile_voxels']}")
    crs = content["crs"]
    if not (crs is None or isinstance(crs, str)):
        raise TypeError("crs")
    if not isinstance(content["is_signed"], bool):
        raise TypeError("is_signed")
    build = dict(content["build"])
    _check_sources(build.get("sources", []))
    _check_how_known(build.get("sigma", {"from": "given"}))
    _check_found(build.get("found"))
    _check_updates(build.get("updates", []))
    version = content["format_version"]
    is_of_files = version == TILE_FILES_VERSION
    sections = tables_of_tile_files(content) if is_of_files else _read_sections(content["sections"], files)
    if not len(sections[TILES]):
        raise ValueError("no tiles")
    if len(sections[GROUND]) and content["ground_voxels"] != ground_voxels(cell):
        raise ValueError(f"ground_voxels {content['ground_voxels']}")
    return Manifest(cell, (x, y, z), crs, content["is_signed"], sections, build, sigma, version)


def _read_sections(entries: Mapping[str, Any], files: MapFiles) -> dict[str, ShardTable]:
    sections = {name: _read_section(name, entry, files) for name, entry in entries.items()}
    return {TILES: ShardTable.empty(), GROUND: ShardTable.empty(), **sections}


def _read_section(name: str, entry: Mapping[str, Any], files: MapFiles) -> ShardTable:
    """Read the index of a section.

    Raises
    ------
    MapError
        If it is missing, or is not what was written.
    """
    if not SECTION_NAME.fullmatch(name):
        raise ValueError(f"a section {name[:40]!r}")
    shards = tuple(
        ShardFile(_file_name(name, shard["name"]), _size(shard["bytes"], 2**62)) for shard in entry["shards"]
    )
    index, size = _file_name(name, entry["index"]), _size(entry["index_bytes"], LARGEST_INDEX)
    try:
        content = files.read(index, size)
    except OSError as error:
        raise MapError(
            f"Expected {files.where(index)} to be the index of the map, got: {error.strerror or error}. {files.remedy}"
        ) from None
    if hashlib.sha256(content).hexdigest() != entry["index_sha256"]:
        raise MapError(f"Expected {files.where(index)} to be as it was written, got another checksum. {REBUILD}")
    try:
        return ShardTable.from_bytes(content, shards)
    except ValueError as error:
        raise MapError(f"Expected {files.where(index)} to be the index of the map, got: {error}. {REBUILD}") from None


def _file_name(section: str, name: Any) -> str:
    """Return the name of a file of a section, which lies in its folder."""
    folder, _, file = str(name).partition("/")
    if folder != section or not FILE_NAME.fullmatch(file):
        raise ValueError(f"a file {str(name)[:80]!r}")
    return str(name)


def _size(value: Any, most: int) -> int:
    if not (type(value) is int and 0 <= value < most):
        raise ValueError(f"a size of {str(value)[:40]}")
    return value


def _check_sources(sources: Sequence[Mapping[str, Any]]) -> None:
    for source in sources:
        numbers = [source[name] for name in ("n_points", "n_kept", "n_invalid", "n_without_side")]
        numbers += [source.get(name, 0) for name in ("n_thinned", "n_withheld")]
        numbers += [number for pair in source["n_dropped"].items() for number in (int(pair[0]), pair[1])]
        if not (isinstance(source["name"], str) and isinstance(source["is_classified"], bool)):
            raise TypeError("sources")
        if not all(isinstance(number, int) for number in numbers):
            raise TypeError("sources")


def _check_found(found: Mapping[str, Any] | None) -> None:
    """Refuse what was found of classes if `maxcon map info` could not print it."""
    if found is None:
        return
    for number, n in found["n_points"].items():
        _size(int(number), 256)
        _size(n, 2**62)
    for number in found["dropped"]:
        _size(number, 256)
    if not isinstance(found["temporary"], str):
        raise TypeError("found")


def _check_updates(updates: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a history that `maxcon map info` could not print."""
    names = ("n_judged", "n_now_gone", "n_now_new", "n_back", "n_known", "n_gone", "n_new")
    for update in updates:
        numbers = [update[name] for name in names] + [drive["n_looks"] for drive in update["drives"]]
        words = [drive["name"] for drive in update["drives"]]
        words += [update["parent"]["name"], update["parent"]["sha256"]]
        if not all(type(number) is int for number in numbers):
            raise TypeError("updates")
        if not all(isinstance(word, str) for word in words):
            raise TypeError("updates")


def _check_how_known(known: Mapping[str, Any]) -> None:
    """Refuse words on where sigma is from that `maxcon map info` could not print."""
    match known["from"]:
        case "given" | "alignment":
            is_known = True
        case "assumed":
            is_known = isinstance(known["reason"], str)
        case "passes":
            numbers = (known["n_passes"], known["sigma_of_pass"], known["n_places"])
            is_known = all(isinstance(number, int | float) for number in numbers)
        case _:
            is_known = False
    if not is_known:
        raise ValueError(f"sigma from {known}")
