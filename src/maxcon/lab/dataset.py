# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Dataset: a map, scans, their reference and priors, as a small TOML file names them."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maxcon._system.checked import read_toml
from maxcon.errors import FileError

__all__ = ["DESCRIPTION", "Dataset"]

DESCRIPTION = "dataset.toml"
_KEYS = {
    "map": {"clouds", "path", "trajectory", "crs", "drop", "vehicle_classes", "normals_have_sides", "sigma"},
    "scans": {"folder", "times", "reference", "odometry"},
}
_FOR_CLOUDS = ("trajectory", "crs", "drop", "vehicle_classes", "normals_have_sides", "sigma")


@dataclass(frozen=True, slots=True)
class Dataset:
    """Where the parts of a dataset lie.

    Parameters
    ----------
    path : Path
        The TOML file; the paths in it are relative to its folder.
    map_clouds : tuple of Path
        Clouds to build the map from, global coordinates, m; empty where the map is built already.
    map_path : Path or None
        A map on disk, instead of clouds.
    map_trajectory : Path or None
        Of the mapping sensor, on the clock of the map clouds: turns normals to its side.
    crs : str or None
        Of all global coordinates, where the clouds do not say.
    drop : tuple of str, or None
        Classes to leave out of the map; the defaults of a map if None.
    vehicle_classes : tuple of int
        Class numbers that mean vehicles.
    normals_have_sides : bool
        Whether the clouds' own normals are turned to the sensor's side.
    map_sigma : float or None
        How well the map is known: standard deviation of its position along any axis, m; found by the build if None.
    scans : Path
        Folder of scans.
    times : Path or None
        Times of the scans, where they are not with them.
    reference : Path
        Poses held for true, T_map_sensor, global coordinates.
    priors : dict of str to Path
        Rough poses by name, T_map_sensor, global coordinates; at least one, none by the name "reference".
    odometry : Path or None
        The vehicle's own motion, T_odometry_sensor in any frame, where it was recorded.
    """

    path: Path
    map_clouds: tuple[Path, ...]
    map_path: Path | None
    map_trajectory: Path | None
    crs: str | None
    drop: tuple[str, ...] | None
    vehicle_classes: tuple[int, ...]
    normals_have_sides: bool
    map_sigma: float | None
    scans: Path
    times: Path | None
    reference: Path
    priors: dict[str, Path]
    odometry: Path | None = None

    @property
    def folder(self) -> Path:
        """The folder that the TOML file is in."""
        return self.path.parent

    @property
    def prior(self) -> Path:
        """The first of the priors."""
        return next(iter(self.priors.values()))

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> "Dataset":
        """Return the dataset of a TOML file, or of the dataset.toml of a folder.

        Raises
        ------
        FileError
            If there is none, a key is unknown, missing or of the wrong kind, or a part does not exist.
        """
        file = Path(path)
        file = file / DESCRIPTION if file.is_dir() else file
        named = read_toml(
            file, "a dataset's description", f"Write a {DESCRIPTION} (docs/study.md), or simulate a dataset"
        )
        _check_keys(file, named)
        table = _Table(file, named)
        dataset = cls(
            path=file,
            map_clouds=table.clouds(),
            map_path=table.path("map", "path"),
            map_trajectory=table.path("map", "trajectory"),
            crs=table.value("map", "crs", str, None),
            drop=table.tuple_of("map", "drop", str),
            vehicle_classes=table.tuple_of("map", "vehicle_classes", int) or (),
            normals_have_sides=bool(table.value("map", "normals_have_sides", bool, False)),
            map_sigma=table.length("map", "sigma"),
            scans=table.needed_path("scans", "folder"),
            times=table.path("scans", "times"),
            reference=table.needed_path("scans", "reference"),
            odometry=table.path("scans", "odometry"),
            priors={name: table.needed_path("priors", name) for name in named["priors"]},
        )
        useless = [key for key in _FOR_CLOUDS if key in named["map"]]
        if dataset.map_path is not None and useless:
            raise FileError(
                f"Expected no {', '.join(useless)} under [map] in {file} beside the path of a built map: it would have"
                " no effect. Remove it."
            )
        if (dataset.map_path is None) == (not dataset.map_clouds):
            raise FileError(
                f"Expected {file} to name either clouds or the path of a built map under [map], got"
                f" {'both' if dataset.map_clouds else 'neither'}. Keep one."
            )
        return dataset


def _check_keys(file: Path, named: Mapping[str, Any]) -> None:
    """Refuse tables and keys that would have no effect."""
    for key in ("map", "scans", "priors"):
        if not isinstance(named.get(key), dict) or not named[key]:
            raise FileError(f"Expected a table [{key}] in {file}, got none. Add it (docs/study.md).")
    if "reference" in named["priors"]:
        raise FileError(
            f"Expected a prior's name under [priors] in {file} other than reference: it stands for the reference"
            " itself. Rename it."
        )
    unknown_tables = sorted(set(named) - {"map", "scans", "priors"})
    if unknown_tables:
        raise FileError(
            f"Expected the tables [map], [scans] and [priors] in {file}, got {', '.join(unknown_tables)}."
            " Put it into the table it belongs to, or remove it."
        )
    for table, known in _KEYS.items():
        unknown = sorted(set(named[table]) - known)
        if unknown:
            raise FileError(
                f"Expected the keys {', '.join(sorted(known))} under [{table}] in {file}, got"
                f" {', '.join(unknown)}. Correct or remove it."
            )


@dataclass(frozen=True, slots=True)
class _Table:
    """Typed access to what a description says."""

    file: Path
    named: Mapping[str, Any]

    def value(self, table: str, key: str, kind: type, default: Any) -> Any:
        value = self.named[table].get(key, default)
        if value is not default and not isinstance(value, kind):
            raise FileError(
                f"Expected {key} under [{table}] in {self.file} to be a {kind.__name__}, got {value!r}. Correct it."
            )
        return value

    def tuple_of(self, table: str, key: str, kind: type) -> tuple[Any, ...] | None:
        values = self.value(table, key, list, None)
        if values is None:
            return None
        if not all(isinstance(value, kind) and not isinstance(value, bool) for value in values):
            raise FileError(
                f"Expected {key} under [{table}] in {self.file} to be a list of {kind.__name__}, got {values!r}."
                " Correct it."
            )
        return tuple(values)

    def length(self, table: str, key: str) -> float | None:
        value = self.named[table].get(key)
        if value is None:
            return None
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (is_number and 0.0 <= value < math.inf):
            raise FileError(
                f"Expected {key} under [{table}] in {self.file} to be a number of metres >= 0, got {value!r}."
                " Correct it."
            )
        return float(value)

    def needed_path(self, table: str, key: str) -> Path:
        if key not in self.named[table]:
            raise FileError(f"Expected {key} under [{table}] in {self.file}, got none. Add it (docs/study.md).")
        return self._existing(table, key, self.value(table, key, str, None))

    def path(self, table: str, key: str) -> Path | None:
        name = self.value(table, key, str, None)
        return None if name is None else self._existing(table, key, name)

    def _existing(self, table: str, key: str, name: str) -> Path:
        path = self.file.parent / name
        try:
            is_there = path.exists()
        except OSError as error:  # too long a name
            raise self._cannot_open(key, table, name, error) from error
        if not is_there:
            raise FileError(
                f"Expected {key} under [{table}] in {self.file} to name what exists, got {path}."
                " Correct it; paths are relative to that file."
            )
        return path

    def _cannot_open(self, key: str, table: str, name: str, error: OSError) -> FileError:
        return FileError(
            f"Expected {key} under [{table}] in {self.file} to name what exists, got {name[:80]!r}: {error.strerror}."
            " Correct it; paths are relative to that file."
        )

    def clouds(self) -> tuple[Path, ...]:
        """Files of one pattern or a list of them, in order; each pattern must find some."""
        named = self.named["map"].get("clouds")
        patterns = (named,) if isinstance(named, str) else self.tuple_of("map", "clouds", str) or ()
        found: list[Path] = []
        for pattern in patterns:
            try:
                files = _matching(self.file.parent, pattern)
            except OSError as error:
                raise self._cannot_open("clouds", "map", pattern, error) from error
            if not files:
                raise FileError(
                    f"Expected clouds under [map] in {self.file} to name files, got none for {pattern!r}. Correct it."
                )
            found += files
        return tuple(dict.fromkeys(found))


def _matching(folder: Path, pattern: str) -> list[Path]:
    """Return the files of a pattern whose folder part is plain and whose name may have wildcards."""
    place = folder / pattern
    if place.is_file():
        return [place]
    try:
        return sorted(file for file in place.parent.glob(place.name) if file.is_file())
    except ValueError:  # no pattern at all, such as a bare root
        return []
