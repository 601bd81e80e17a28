# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map build`, `update`, `info` and `copy`; `map align` is in cli.alignment."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli import alignment
from maxcon.cli.flags import GroupedCommand, OptionGroup, flag, flags
from maxcon.cli.map_update import rows_of_updates, update
from maxcon.cli.options import Quiet, Scheduler
from maxcon.cli.terminal import compiling_told, step_bars, warn
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon._system.engine import Engine
    from maxcon.map.manifest import Manifest

__all__ = ["app"]


class Classify(StrEnum):
    """When classes are found: `MapOptions.classify`."""

    AUTO = "auto"
    ALWAYS = "always"
    OFF = "off"


@dataclass(frozen=True, slots=True)
class OutputFolder(OptionGroup):
    """The map to write."""

    title = "Output"
    out: Path = flag(..., "Folder of the map to write.", "--out", "-o", metavar="MAP")
    overwrite: bool = flag(False, "Replace the map if there is one.", "--overwrite")


app = typer.Typer(
    help="Build a map from point clouds, align them before, update it by drives, say what is in it, or copy it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command("update", short_help="Write a new version of a map: what is gone, what is new.")(update)


@dataclass(frozen=True, slots=True)
class CloudOptions(OptionGroup):
    """Which points are taken, and where they are."""

    title = "Inputs"
    trajectory: Path | None = flag(
        None,
        "Where the mapping sensor was, matched by the points' gps_time: turns normals to its side.",
        metavar="TUM|CSV",
    )
    signed_normals: bool = flag(False, "The clouds' own normals are turned to the sensor already.", "--signed-normals")
    crs: str | None = flag(None, "CRS of clouds that name none themselves.", metavar="EPSG:N|WKT")
    to_crs: str | None = flag(
        None,
        "CRS of the map, in metres: points in any other, in feet or degrees too, are transformed into it. The"
        " trajectory has to be in it.",
        metavar="EPSG:N|WKT",
    )
    area: str | None = flag(
        None, "Take only points in this rectangle, in the CRS of the map.", metavar="X_MIN,Y_MIN,X_MAX,Y_MAX"
    )
    keep_every: int = flag(1, "Take only every N-th point of each cloud: a thinner map.", metavar="N", min=1)


@dataclass(frozen=True, slots=True)
class ClassOptions(OptionGroup):
    """Which classes of points are left out."""

    title = "Classes"
    drop: list[str] | None = flag(
        None,
        "Class to leave out, by name or number; repeatable. Default for classified LAS: ground, vegetation, noise,"
        " temporal-exclusion, and the vehicle classes.",
        metavar="CLASS",
    )
    keep_all: bool = flag(False, "Drop no class.", "--keep-all")
    vehicle_class: list[int] | None = flag(
        None, "Class number that means vehicles in these files: left out too; repeatable.", metavar="NUMBER"
    )
    asprs_classes: bool = flag(
        False, "Class numbers are those of LAS in other clouds too: ground, vegetation are dropped.", "--asprs-classes"
    )
    classify: Classify = flag(
        Classify.AUTO,
        "Find ground, vegetation and what is not there in every pass: where no cloud has classes (auto), always, or"
        " not at all (off). Found ground and temporary objects are left out, unless --drop names others.",
    )

    def check(self) -> None:
        """Refuse classes to drop where none is: OptionError."""
        if self.keep_all and (self.drop or self.vehicle_class):
            other = "--drop" if self.drop else "--vehicle-class"
            raise OptionError(f"Expected either {other} or --keep-all, got both. Leave one out.")


@dataclass(frozen=True, slots=True)
class VoxelOptions(OptionGroup):
    """What the map is."""

    title = "Map"
    cell: float = flag(0.06, "Voxel edge, and cell edge of the search, in m.", metavar="M")
    sigma: float | None = flag(
        None,
        "How well the map is known: standard deviation of its position along any axis, in m. Default: from the"
        " differences between passes, told apart by gps_time; 0.02 where there is only one.",
        metavar="M",
        show_default=False,
    )


@dataclass(frozen=True, slots=True)
class TileWorkers(OptionGroup):
    """Who makes the tiles."""

    title = "How it is done"
    threads: int | None = flag(
        None, "Tiles made at once in this process, 0.25 GiB each. Default: processors, at most 4.", min=1
    )
    workers: int | None = flag(None, "Let N processes make the tiles instead.", metavar="N", min=1)
    scheduler: Scheduler = None

    def engine(self) -> "Engine | None":
        """Return the processes that make the tiles; None for the threads of this one. OptionError if both are given."""
        from maxcon._system.engine import Engine

        if (self.workers, self.scheduler) == (None, None):
            return None
        if self.threads is not None:
            raise OptionError(
                "Expected either threads of this process or others that make the tiles, got both. Leave out --threads,"
                " or --workers and --scheduler."
            )
        return Engine(self.workers, self.scheduler, warn)


@app.command(cls=GroupedCommand)
@flags
def build(
    clouds: Annotated[
        list[Path],
        typer.Argument(
            metavar="CLOUD...", help="LAS, LAZ, COPC, PLY, NPZ, E57, or text files with x, y, z (.xyz, .csv, .txt)."
        ),
    ],
    cloud: CloudOptions,
    classes: ClassOptions,
    voxel: VoxelOptions,
    worker: TileWorkers,
    output: OutputFolder,
    quiet: Quiet = False,
) -> None:
    """Build a map: drop classes, find normals, rasterize into voxels, write tiles."""
    from maxcon.io.trajectories import read_trajectory
    from maxcon.map.storage import address_of
    from maxcon.mapping.build import Area, MapOptions, build_map

    address = address_of(output.out)
    if address is not None:
        raise OptionError(
            f"Expected a folder to build the map in, got {address}. Build it in a folder, then"
            f" `maxcon map copy FOLDER {address}`."
        )
    classes.check()
    engine = worker.engine()
    options = MapOptions(
        cell=voxel.cell,
        drop=() if classes.keep_all else classes.drop or None,
        vehicle_classes=tuple(classes.vehicle_class or ()),
        trajectory=read_trajectory(cloud.trajectory) if cloud.trajectory is not None else None,
        normals_have_sides=cloud.signed_normals,
        crs=cloud.crs,
        keep_every=cloud.keep_every,
        sigma=voxel.sigma,
        to_crs=cloud.to_crs,
        classes_are_asprs=classes.asprs_classes,
        classify=classes.classify.value,
        area=Area.parse(cloud.area) if cloud.area is not None else None,
    )
    with step_bars("", quiet) as report, compiling_told(quiet):
        manifest = build_map(
            clouds, output.out, options, overwrite=output.overwrite, n_threads=worker.threads, engine=engine,
            progress=report,
        )  # fmt: skip
    typer.echo(f"{output.out}")
    _describe(manifest)


app.command("align", cls=GroupedCommand, short_help="Bring rounds together before a map is built of them.")(
    alignment.align
)


@app.command()
def info(
    path: Annotated[
        Path, typer.Argument(metavar="MAP", help="Folder of a map, or its address: s3://, http://, https://.")
    ],
    check: Annotated[bool, typer.Option("--check", help="Also read every tile and verify its checksum.")] = False,
) -> None:
    """Print what a map is made of."""
    from maxcon.map.manifest import read_manifest
    from maxcon.map.storage import open_storage
    from maxcon.map.store import GroundStore, TileStore

    files = open_storage(path)
    manifest = read_manifest(files)
    _describe(manifest)
    if check:
        store, ground = TileStore(files, manifest, cache_bytes=0), GroundStore(files, manifest)
        for key in sorted(store.keys):
            store.load(key)
        for key in sorted(ground.keys):
            ground.load(key)
        typer.echo(f"checked      all {len(store.keys)} tiles are as they were written")


@app.command()
def copy(
    source: Annotated[str, typer.Argument(metavar="MAP", help="Folder of a map, or its address.")],
    target: Annotated[
        str, typer.Argument(metavar="PLACE", help="Folder to write, or s3://bucket/prefix; one of both is a folder.")
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the map if there is one.")] = False,
    quiet: Quiet = False,
) -> None:
    """Copy a map to a folder or an object store, every tile checked; it is there once all of it is.

    Credentials and server of s3:// are those of the usual variables: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY,
    AWS_REGION, AWS_ENDPOINT_URL.
    """
    from maxcon.map.writer import copy_map

    with step_bars("", quiet) as report:
        copy_map(source, target, overwrite=overwrite, progress=report)
    typer.echo(target)


def _describe(manifest: "Manifest") -> None:
    from maxcon.io.crs import crs_name
    from maxcon.map import TILE_VOXELS

    edge = TILE_VOXELS * manifest.cell
    keys = manifest.tiles.keys
    x_low, y_low = keys.min(axis=0) * edge + manifest.origin[:2]
    x_high, y_high = (keys.max(axis=0) + 1) * edge + manifest.origin[:2]
    signed = "turned to the sensor's side" if manifest.is_signed else "unsigned (no sensor side: w = |cos|)"
    rows = [
        ("voxels", f"{manifest.n_voxels:,} of {manifest.cell:g} m, from {manifest.n_points:,} points"),
        ("tiles", f"{len(keys):,} of {edge:g} m, {_describe_files(manifest)}"),
        ("extent", f"x {x_low:.1f} to {x_high:.1f}, y {y_low:.1f} to {y_high:.1f} m"),
        ("origin", ", ".join(f"{value:.12g}" for value in manifest.origin) + " m"),
        ("CRS", crs_name(manifest.crs)),
        ("normals", f"{manifest.build.get('normals', 'unknown')}, {signed}"),
        ("ground", _describe_ground(manifest)),
        *_describe_found(manifest),
        ("sigma", _describe_sigma(manifest)),
        ("made by", str(manifest.build.get("program", "unknown"))),
        *rows_of_updates(manifest.build.get("updates", [])),
    ]
    for name, text in rows:
        typer.echo(f"{name:<12} {text}")
    for source in manifest.build.get("sources", []):
        typer.echo(f"{'source':<12} {_describe_source(source, is_found='found' in manifest.build)}")


def _describe_files(manifest: "Manifest") -> str:
    """In how many files the map lies, and of which format they are."""
    from maxcon.map.manifest import FORMAT_VERSION

    n_files = sum(len(section.files) for section in manifest.sections.values())
    return f"in {n_files:,} file{'s' if n_files > 1 else ''} of format version {FORMAT_VERSION}"


def _describe_ground(manifest: "Manifest") -> str:
    """What is known of the ground, in words."""
    from maxcon.map.ground import ground_voxels

    if not len(manifest.ground):
        return "not known: heights and tilts of priors are taken as they are"
    origin = manifest.build.get("ground", "unknown")
    return f"{manifest.n_heights:,} heights in cells of {ground_voxels(manifest.cell) * manifest.cell:g} m, {origin}"


def _describe_found(manifest: "Manifest") -> list[tuple[str, str]]:
    """Return a row on the classes that the build found, if it found some: shares of the points."""
    from maxcon.mapping.build.classes import found_ratios

    found = manifest.build.get("found")
    if found is None:
        return []
    shares = found_ratios(found["n_points"], found["dropped"])
    text = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares)
    if found["temporary"]:
        text += f"; temporary objects cannot be found: {found['temporary']}"
    return [("found", text)]


def _describe_sigma(manifest: "Manifest") -> str:
    """How well the map is known, and from what."""
    known = manifest.build.get("sigma", {"from": "it does not say from what"})
    if known["from"] == "passes":
        return (
            f"{manifest.sigma:.3f} m, from {known['n_passes']} passes of {known['sigma_of_pass']:.3f} m each,"
            f" compared at {known['n_places']:,} places"
        )
    if known["from"] == "assumed":
        return f"{manifest.sigma:g} m, assumed: {known['reason']}; say it with --sigma"
    if known["from"] == "alignment":
        return f"{manifest.sigma:g} m, from alignment.json beside the clouds: aligned rounds agree better than that"
    return f"{manifest.sigma:g} m, {known['from']}"


def _describe_source(source: dict[str, object], *, is_found: bool = False) -> str:
    from maxcon.mapping.build.classes import class_name

    text = f"{source['name']}: {source['n_points']:,} points, {source['n_kept']:,} kept"
    dropped = source["n_dropped"]
    if isinstance(dropped, dict) and dropped:
        text += "; dropped " + ", ".join(f"{n:,} {class_name(int(key))}" for key, n in dropped.items())
    if source["n_invalid"]:
        text += f"; dropped {source['n_invalid']:,} without finite coordinates"
    if source.get("n_outside"):
        text += f"; {source['n_outside']:,} outside of the area"
    if source.get("transform"):
        text += f"; {source['transform']}"
    if source.get("n_thinned"):
        text += f"; {source['n_thinned']:,} thinned out"
    if source.get("n_withheld"):
        text += f"; {source['n_withheld']:,} marked as withheld"
    if source["n_without_side"]:
        text += f"; {source['n_without_side']:,} without a pose near their time"
    if not (source["is_classified"] or is_found):
        text += "; no ASPRS classes: ground, vegetation and vehicles were not dropped"
    return text
