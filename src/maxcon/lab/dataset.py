"""Dataset: a map, scans, their reference and priors, as a small TOML file names them."""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from maxcon._system.checked import checked, read_toml
from maxcon.errors import FileError, OptionError
from maxcon.io.scans import Scans, open_scans
from maxcon.io.trajectories import read_trajectory

if TYPE_CHECKING:
    from maxcon.mapping.build.options import MapOptions
    from maxcon.mapping.update import LocalizedDrive

DESCRIPTION = "dataset.toml"
WHAT, ADVICE = "a dataset's description", f"Write a {DESCRIPTION} (docs/study.md), or simulate a dataset"
_FOR_CLOUDS = ("trajectory", "crs", "drop", "vehicle_classes", "normals_have_sides", "sigma")


@dataclass(frozen=True, slots=True)
class Dataset:
    """Where the parts of a dataset lie; coordinates of map, reference and priors are global, m, poses T_map_sensor."""

    path: Path  # the TOML file; the paths in it are relative to its folder
    map_clouds: tuple[Path, ...]  # clouds to build the map from; empty where the map is built already
    map_path: Path | None  # a map on disk, instead of clouds
    map_trajectory: Path | None  # of the mapping sensor, on the clock of the clouds: turns normals to its side
    crs: str | None  # of all global coordinates, where the clouds do not say
    drop: tuple[str, ...] | None  # classes to leave out of the map; the defaults of a map if None
    vehicle_classes: tuple[int, ...]  # class numbers that mean vehicles
    normals_have_sides: bool  # whether the clouds' own normals are turned to the sensor's side
    map_sigma: float | None  # standard deviation of the map's position along any axis, m; found by the build if None
    scans: Path
    times: Path | None  # of the scans, where they are not with them
    reference: Path  # poses held for true
    priors: dict[str, Path]  # rough poses by name; at least one, none by the name "reference"
    odometry: Path | None = None  # the vehicle's own motion, T_odometry_sensor in any frame, where it was recorded
    changed: float | None = None  # ratio of the returns that would have been elsewhere on the day of the map, if known

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
        """Return the dataset of a TOML file, or of the dataset.toml of a folder; FileError if something is wrong."""
        file = Path(path)
        file = file / DESCRIPTION if file.is_dir() else file
        named = checked(read_toml(file, WHAT, ADVICE), _description(), file, WHAT, "Correct it (docs/study.md)")
        if "reference" in named.priors:
            raise FileError(
                f"Expected a prior's name under [priors] in {file} other than reference: it stands for the reference"
                " itself. Rename it."
            )
        useless = [key for key in _FOR_CLOUDS if getattr(named.map, key) is not None]
        if named.map.path is not None and useless:
            raise FileError(
                f"Expected no {', '.join(useless)} under [map] in {file} beside the path of a built map: it would have"
                " no effect. Remove it."
            )
        if (named.map.path is None) == (not named.map.clouds):
            raise FileError(
                f"Expected {file} to name either clouds or the path of a built map under [map], got"
                f" {'both' if named.map.clouds else 'neither'}. Keep one."
            )

        def part(table: str, key: str, name: str | None) -> Path | None:
            return None if name is None else _existing(file, table, key, name)

        of_map, of_scans = named.map, named.scans
        return cls(
            path=file, map_clouds=_clouds(file, of_map.clouds or ()), map_path=part("map", "path", of_map.path),
            map_trajectory=part("map", "trajectory", of_map.trajectory), crs=of_map.crs, drop=of_map.drop,
            vehicle_classes=of_map.vehicle_classes or (), normals_have_sides=bool(of_map.normals_have_sides),
            map_sigma=of_map.sigma, scans=_existing(file, "scans", "folder", of_scans.folder),
            times=part("scans", "times", of_scans.times), odometry=part("scans", "odometry", of_scans.odometry),
            reference=_existing(file, "scans", "reference", of_scans.reference),
            priors={name: _existing(file, "priors", name, path) for name, path in named.priors.items()},
            changed=of_scans.changed,
        )  # fmt: skip

    def open_scans(self) -> Scans:
        """Open the scans."""
        return open_scans(self.scans, self.times)

    def map_options(self, *, cell: float = 0.06, keep_every: int = 1, keeps_ground: bool = False) -> "MapOptions":
        """Return the options to build the map: voxel edge, m; one of so many points; whether the ground stays."""
        from maxcon.mapping.build.options import DEFAULT_DROP, MapOptions, parse_classes

        drop, ground = self.drop, parse_classes(["ground"])
        if keeps_ground:
            drop = tuple(
                name for name in (DEFAULT_DROP if drop is None else drop) if not parse_classes([name]) <= ground
            )
        return MapOptions(
            cell=cell, drop=drop, vehicle_classes=self.vehicle_classes,
            trajectory=read_trajectory(self.map_trajectory) if self.map_trajectory is not None else None,
            normals_have_sides=self.normals_have_sides, crs=self.crs, keep_every=keep_every, sigma=self.map_sigma,
        )  # fmt: skip


def open_drives(paths: Sequence[str | os.PathLike[str]]) -> list["LocalizedDrive"]:
    """Return the drives of scans and tables of poses in turn: SCANS POSES.csv, SCANS POSES.csv, ...

    A table may be the Parquet file of a drive, `drive=NAME/poses.parquet`, as `maxcon localize --drives` writes it.
    SCANS may be a dataset, which may stand without a table: its reference poses are taken then. OptionError if they
    are not in turn.
    """
    from maxcon.export import PARQUET
    from maxcon.mapping.update import LocalizedDrive

    def is_table(path: Path) -> bool:
        return path.suffix.lower() in (".csv", PARQUET)

    left, drives = [Path(path) for path in paths], list[LocalizedDrive]()
    while left:
        scans = left.pop(0)
        if is_table(scans):
            raise OptionError(
                f"Expected scans before the table {scans}, got it alone. Name drives as SCANS POSES.csv, in turn."
            )
        is_dataset = scans.suffix == ".toml" or (scans / DESCRIPTION).is_file()
        dataset = Dataset.open(scans) if is_dataset else None
        if left and is_table(left[0]):
            drives.append(LocalizedDrive.open(dataset.open_scans() if dataset else scans, left.pop(0)))
        elif dataset:
            drives.append(LocalizedDrive.of_reference(dataset.open_scans(), dataset.reference))
        else:
            raise OptionError(
                f"Expected the table of poses of {scans} behind it (POSES.csv or poses.parquet, as maxcon localize"
                f" writes it), got {left[0] if left else 'nothing'}. Localize the drive first."
            )
    if not drives:
        raise OptionError("Expected at least one drive, got none. Name it as SCANS POSES.csv.")
    return drives


def _description() -> Any:
    """Return the type of what a description may say; msgspec is imported when one is read."""
    from msgspec import Meta, Struct

    class Map(Struct, forbid_unknown_fields=True):
        clouds: str | tuple[str, ...] | None = None
        path: str | None = None
        trajectory: str | None = None
        crs: str | None = None
        drop: tuple[str, ...] | None = None
        vehicle_classes: tuple[int, ...] | None = None
        normals_have_sides: bool | None = None
        sigma: Annotated[float, Meta(ge=0.0, le=1e3)] | None = None

    class ScansTable(Struct, forbid_unknown_fields=True):
        folder: str
        reference: str
        times: str | None = None
        odometry: str | None = None
        changed: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None

    class Description(Struct, forbid_unknown_fields=True):
        map: Map
        scans: ScansTable
        priors: Annotated[dict[str, str], Meta(min_length=1)]

    return Description


def _existing(file: Path, table: str, key: str, name: str) -> Path:
    """Return the path of a part; FileError if it does not exist."""
    path = file.parent / name
    with suppress(OSError):  # too long a name
        if path.exists():
            return path
    raise FileError(
        f"Expected {key} under [{table}] in {file} to name what exists, got {path}. Correct it; paths are relative to"
        " that file."
    )


def _clouds(file: Path, named: str | tuple[str, ...]) -> tuple[Path, ...]:
    """Return the files of one pattern or several, in order; each must find some, in a folder that is named plainly."""
    found: list[Path] = []
    for pattern in (named,) if isinstance(named, str) else named:
        place, files = file.parent / pattern, list[Path]()
        with suppress(OSError, ValueError):  # too long a name; no pattern at all, such as a bare root
            files = [place] if place.is_file() else sorted(filter(Path.is_file, place.parent.glob(place.name)))
        if not files:
            raise FileError(f"Expected clouds under [map] in {file} to name files, got none for {pattern!r}. Mend it.")
        found += files
    return tuple(dict.fromkeys(found))
