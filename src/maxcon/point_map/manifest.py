# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The manifest of a map on disk: what it is made of, and how that is read and written (D10)."""

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from maxcon.errors import MapError
from maxcon.geometry.voxels import INDEX_LIMIT
from maxcon.point_map.ground import ground_voxels
from maxcon.point_map.layout import TILE_VOXELS, TileKey
from maxcon.point_map.sigma import UNKNOWN_SIGMA
from maxcon.regular_file import read_regular

__all__ = [
    "CELLS",
    "FORMAT",
    "FORMAT_VERSION",
    "MAP_NAMES",
    "REBUILD",
    "GroundEntry",
    "Manifest",
    "TileEntry",
    "read_manifest",
    "write_manifest",
]

FORMAT = "maxcon map"
FORMAT_VERSION = 2
MANIFEST = "manifest.json"
LARGEST_MANIFEST = 2**30
"""Bytes: those of some millions of tiles."""
CELLS = (1e-4, 100.0)
"""Voxel edges, m, between which sizes of tiles and numbers of voxels are numbers of a map."""
MAP_NAMES = (MANIFEST, "tiles", "ground")
"""All that the folder of a map holds."""
REBUILD = "Build the map again with `maxcon map build`."


@dataclass(frozen=True, slots=True)
class TileEntry:
    """What the manifest knows of a tile."""

    key: TileKey
    n_voxels: int
    n_points: int
    sha256: str


@dataclass(frozen=True, slots=True)
class GroundEntry:
    """What the manifest knows of the ground of a tile."""

    key: TileKey
    n_heights: int
    sha256: str


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
    tiles : tuple of TileEntry
        One per tile file.
    build : mapping
        How it was made: sources, points read and dropped, the program's version, where sigma is from.
    sigma : float
        Standard deviation of the map's position along any axis, m.
    ground : tuple of GroundEntry
        One per file of the ground grid; none where the ground is not known.
    """

    cell: float
    origin: tuple[float, float, float]
    crs: str | None
    is_signed: bool
    tiles: tuple[TileEntry, ...]
    build: Mapping[str, Any] = field(default_factory=dict)
    sigma: float = UNKNOWN_SIGMA
    ground: tuple[GroundEntry, ...] = ()

    @property
    def n_points(self) -> int:
        """Points in all voxels."""
        return sum(tile.n_points for tile in self.tiles)

    @property
    def n_voxels(self) -> int:
        """Occupied voxels."""
        return sum(tile.n_voxels for tile in self.tiles)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest: the last step of a build."""
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "tile_voxels": TILE_VOXELS,
        "ground_voxels": ground_voxels(manifest.cell),
        **asdict(manifest),
    }
    content["sha256"] = _checksum(content)
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n")


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of all entries of a manifest but itself, in a form that spaces and order do not change."""
    entries = {name: value for name, value in content.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def read_manifest(path: str | os.PathLike[str]) -> Manifest:
    """Read the manifest of a map.

    Raises
    ------
    MapError
        If `path` is not a map, its format version is another, or its manifest is broken.
    """
    file = Path(path) / MANIFEST
    try:
        content = json.loads(read_regular(file, LARGEST_MANIFEST))
        checksum = _checksum(content) if isinstance(content, dict) else None
    except (FileNotFoundError, NotADirectoryError):
        what = "a file" if Path(path).is_file() else "no such folder"
        what = f"no {MANIFEST} in it" if Path(path).is_dir() else what
        raise MapError(
            f"Expected {path} to be a map, got {what}. Build one with `maxcon map build`."
        ) from None
    except OSError as error:
        raise MapError(
            f"Expected to be able to read {file}, got: {error.strerror}. Check the path and its permissions."
        ) from None
    except (ValueError, RecursionError) as error:
        raise MapError(f"Expected {file} to be the manifest of a map, got: {error}. {REBUILD}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise MapError(f"Expected {file} to say it is a {FORMAT}, but it does not. {REBUILD}")
    version = content.get("format_version")
    if version != FORMAT_VERSION:
        is_newer = isinstance(version, int) and version > FORMAT_VERSION
        raise MapError(
            f"Expected {path} to have map format version {FORMAT_VERSION}, got {version!r}."
            f" {'Update maxcon, or build the map again with this version.' if is_newer else REBUILD}"
        )
    if content.get("sha256") != checksum:
        raise MapError(f"Expected {file} to be as it was written, got another checksum. {REBUILD}")
    try:
        return _parse_manifest(content)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        words = f"no {error}" if isinstance(error, KeyError) else f"a broken entry: {error}"
        raise MapError(f"Expected a whole manifest in {file}, got {words}. {REBUILD}") from None


def _parse_manifest(content: Mapping[str, Any]) -> Manifest:
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
    tiles = []
    for entry in content["tiles"]:
        n_voxels, n_points = _count(entry["n_voxels"], 2**31), _count(entry["n_points"], 2**62)
        tiles.append(TileEntry(_key(entry["key"]), n_voxels, n_points, str(entry["sha256"])))
    if not tiles:
        raise ValueError("no tiles")
    build = dict(content["build"])
    _check_sources(build.get("sources", []))
    _check_how_known(build.get("sigma", {"from": "given"}))
    ground = _parse_ground(content, cell)
    return Manifest(cell, (x, y, z), crs, bool(content["is_signed"]), tuple(tiles), build, sigma, ground)


def _parse_ground(content: Mapping[str, Any], cell: float) -> tuple[GroundEntry, ...]:
    """Entries of the ground grid; none in a map without."""
    entries = []
    for entry in content.get("ground", ()):
        n_heights = _count(entry["n_heights"], 2**31)
        entries.append(GroundEntry(_key(entry["key"]), n_heights, str(entry["sha256"])))
    if entries and content["ground_voxels"] != ground_voxels(cell):
        raise ValueError(f"ground_voxels {content['ground_voxels']}")
    return tuple(entries)


def _key(values: Sequence[Any]) -> TileKey:
    """Return the key of a tile: of voxels whose indices a map can have."""
    x, y = values
    most = INDEX_LIMIT // TILE_VOXELS
    if not all(type(value) is int and -most <= value <= most for value in (x, y)):
        raise ValueError(f"a tile at {str(values)[:40]}")
    return x, y


def _count(value: Any, most: int) -> int:
    if not (type(value) is int and 0 <= value < most):
        raise ValueError(f"a count of {str(value)[:40]}")
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


def _check_how_known(known: Mapping[str, Any]) -> None:
    """Refuse words on where sigma is from that `maxcon map info` could not print."""
    match known["from"]:
        case "given":
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
