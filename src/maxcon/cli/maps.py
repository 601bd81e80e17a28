"""`maxcon map build`, `align`, `georeference`, `update`, `info`, `copy` and `export`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from maxcon.cli.flags import GroupedCommand, OptionGroup, argument, check_exclusive, flag, flags
from maxcon.cli.georeference import georeference
from maxcon.cli.options import AllowInexactCrs, IsJson, MappingDrive, Quiet, RangeOptions, Scheduler, ViewOptions
from maxcon.cli.terminal import compiling_told, print_json, print_rows, step_bars, warn
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon._system.engine import Engine
    from maxcon.map.manifest import Manifest

app = typer.Typer(
    help="Build a map from point clouds, align them before, update it by drives, say what is in it, copy or export it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


class UpdateFiles(OptionGroup):
    """The map, the drives, and what it takes to see a change.

    drives: Scans and the table of their poses in turn: SCANS POSES.csv SCANS POSES.csv ... Scans as `maxcon localize`
        takes them, or a dataset.toml, whose reference poses are taken if no table follows. Of many drives a table is
        FOLDER/drive=NAME/poses.parquet.
    """

    map_folder: Path = argument(..., "Map made by `maxcon map build`.", "MAP")
    drives: list[Path] = argument(..., None, "DRIVES...")
    out: Path = flag(..., "Folder of the new version.", "--out", "-o", metavar="MAP2")
    reach: float = flag(30.0, "Surfaces farther from the sensor are not judged, m.", metavar="M")
    least_looks: int = flag(2, "Looks from places at least 0.5 m apart that it takes to call a change.", metavar="N")
    overwrite: bool = flag(False, "Replace MAP2 if there is one.")


@app.command(short_help="Write a new version of a map: what is gone, what is new.")
@flags
def update(files: UpdateFiles, ranges: RangeOptions, quiet: Quiet = False) -> None:
    """Write a new version of a map, in which what drives saw through is gone, and what they saw newly is new.

    Only epochs with the status localized count. Searches in MAP2 leave out what is gone. MAP is not touched.
    """
    from maxcon.cli.map_words import rows_of_updates
    from maxcon.lab.dataset import open_drives
    from maxcon.mapping.update import UpdateOptions, update_map

    options = UpdateOptions(reach=files.reach, least_looks=files.least_looks, **vars(ranges))
    drives = open_drives(files.drives)
    with step_bars(quiet) as report, compiling_told(quiet):
        manifest = update_map(files.map_folder, drives, files.out, options, overwrite=files.overwrite, progress=report)
    typer.echo(f"{files.out}")
    print_rows(rows_of_updates(manifest.build.get("updates", [])))


class CloudOptions(OptionGroup, title="Inputs"):
    """Which points are taken, and where they are.

    clouds: LAS, LAZ, COPC, PLY, PCD, NPZ, E57, or text files with x, y, z (.xyz, .csv, .txt); or folders of clouds
        (there .csv and .txt are left alone).
    trajectory: Where the mapping sensor was at the points' gps_time: turns normals to its side.
    to_crs: CRS of the map, in metres: points in any other, in feet or degrees too, are transformed into it. The
        trajectory has to be in it.
    area: Take only points in this rectangle, in the CRS of the map.
    """

    clouds: list[Path] | None = argument(None, None, "[CLOUD...]")
    trajectory: Path | None = flag(None, metavar="TUM|CSV")
    signed_normals: bool = flag(False, "The clouds' own normals are turned to the sensor already.")
    crs: str | None = flag(None, "CRS of clouds that name none themselves.", metavar="EPSG:N|WKT")
    to_crs: str | None = flag(None, metavar="EPSG:N|WKT")
    allow_inexact_crs: AllowInexactCrs = False
    area: str | None = flag(None, metavar="X_MIN,Y_MIN,X_MAX,Y_MAX")
    keep_every: int = flag(1, "Take only every N-th point of each cloud: a thinner map.", metavar="N", min=1)


class ClassOptions(OptionGroup, title="Classes"):
    """Which classes of points are left out.

    drop: Class to leave out, by name or number; repeatable. Default for classified LAS: ground, vegetation, noise,
        temporal-exclusion, and the vehicle classes.
    vehicle_class: Class number that means vehicles in these files: left out too; repeatable.
    classify: Find ground, vegetation and what is not there in every pass: where no cloud has classes (auto), always, or
        not at all (off). Found ground and temporary objects are left out, unless --drop names others.
    """

    drop: list[str] | None = flag(None, metavar="CLASS")
    keep_all: bool = flag(False, "Drop no class.")
    vehicle_class: list[int] | None = flag(None, metavar="NUMBER")
    asprs_classes: bool = flag(False, "Class numbers are those of LAS in other clouds too: drop ground, vegetation.")
    classify: Literal["auto", "always", "off"] = flag("auto")


class MapOutput(OptionGroup, title="Output"):
    """The map to write.

    cell: Voxel edge, and cell edge of the search, in m. Default: by how far apart the points lie; 0.06 in dense clouds,
        a multiple of it in thinned ones.
    sigma: How well the map is known: standard deviation of its position along any axis, in m. Default: from the
        differences between passes, told apart by gps_time; 0.02 where there is only one.
    """

    out: Path = flag(..., "Folder of the map to write.", "--out", "-o", metavar="MAP")
    overwrite: bool = flag(False, "Replace the map if there is one.")
    cell: float | None = flag(None, metavar="M", rich_help_panel="Map")
    sigma: float | None = flag(None, metavar="M", rich_help_panel="Map")


class TileWorkers(OptionGroup, title="How it is done"):
    """Who makes the tiles."""

    threads: int | None = flag(None, "Tiles made at once here, 0.25 GiB each. Default: processors, at most 4.", min=1)
    workers: int | None = flag(None, "Let N processes make the tiles instead.", metavar="N", min=1)
    scheduler: Scheduler = None

    def engine(self) -> "Engine | None":
        """Return the processes that make the tiles; None for the threads of this one."""
        from maxcon._system.engine import Engine

        check_exclusive({"--threads": self.threads}, {"--workers": self.workers, "--scheduler": self.scheduler})
        is_here = (self.workers, self.scheduler) == (None, None)
        return None if is_here else Engine(self.workers, self.scheduler, warn)


@app.command(cls=GroupedCommand)
@flags
def build(
    cloud: CloudOptions, drive: MappingDrive, classes: ClassOptions, worker: TileWorkers, output: MapOutput,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Build a map of clouds, or of scans and their poses: drop classes, find normals, rasterize into voxels."""
    from maxcon.cli.map_words import print_manifest
    from maxcon.io.trajectories import read_trajectory
    from maxcon.map.storage import address_of
    from maxcon.mapping.build import Area, MapOptions, build_map
    from maxcon.mapping.derived_maps import map_of_drive

    if address := address_of(output.out):
        raise OptionError(
            f"Expected a folder to build the map in, got {address}. Build it in a folder, then"
            f" `maxcon map copy FOLDER {address}`."
        )
    if output.cell is not None and 1.0 < output.cell <= 100.0:
        raise OptionError(f"Expected --cell in metres, up to 1, got {output.cell:g}. In centimetres? 0.06 is usual.")
    check_exclusive(
        {"--keep-all": classes.keep_all}, {"--drop": classes.drop, "--vehicle-class": classes.vehicle_class}
    )
    of_clouds = {
        "clouds": cloud.clouds, "--trajectory": cloud.trajectory, "--signed-normals": cloud.signed_normals,
        "--to-crs": cloud.to_crs, "--asprs-classes": classes.asprs_classes,
    }  # fmt: skip
    check_exclusive({"--scans": drive.scans}, of_clouds)
    engine = worker.engine()
    options = MapOptions(
        cell=output.cell, drop=() if classes.keep_all else classes.drop or None,
        vehicle_classes=tuple(classes.vehicle_class or ()),
        trajectory=read_trajectory(cloud.trajectory) if cloud.trajectory is not None else None,
        normals_have_sides=cloud.signed_normals, crs=cloud.crs, keep_every=cloud.keep_every, sigma=output.sigma,
        to_crs=cloud.to_crs, allow_inexact_crs=cloud.allow_inexact_crs, classes_are_asprs=classes.asprs_classes,
        classify=classes.classify, area=Area.parse(cloud.area) if cloud.area is not None else None,
    )  # fmt: skip
    make: Callable[..., Manifest] = partial(build_map, cloud.clouds or [])
    if drive.scans is not None and drive.poses is not None:
        from maxcon.cli.drive_inputs import placed_scans

        placed = placed_scans(drive, drive.scans, drive.poses, quiet)
        typer.echo(placed.words, err=True)
        make = partial(map_of_drive, placed, keep_moving=drive.keep_moving)
    with step_bars(quiet) as report, compiling_told(quiet):
        manifest = make(
            output.out, options, overwrite=output.overwrite, n_threads=worker.threads, engine=engine, progress=report
        )
    typer.echo(f"{output.out}")
    print_manifest(manifest)


class PassFiles(OptionGroup, title="Inputs"):
    """The clouds of all passes, and what is known of them.

    trajectory: Where the mapping sensor was at the points' times: corrected as they are; repeatable.
    drop: Class that is not matched, by name or number; repeatable. Default: vegetation, noise, temporal-exclusion.
    vehicle_class: Class number that means vehicles: not matched; repeatable.
    threads: Places matched at once, 0.4 GiB each. Default: processors, at most 4.
    """

    clouds: list[Path] = argument(..., "LAS or LAZ files of all passes, in tiles or whole.", "CLOUD...")
    trajectory: list[Path] | None = flag(None, metavar="TUM|CSV")
    crs: str | None = flag(None, "CRS of clouds that name none themselves.", metavar="EPSG:N|WKT")
    threads: int | None = flag(None, min=1, rich_help_panel="How it is done")
    drop: list[str] | None = flag(None, metavar="CLASS", rich_help_panel="Classes")
    vehicle_class: list[int] | None = flag(None, metavar="NUMBER", rich_help_panel="Classes")
    out: Path = flag(..., "Folder to write.", "--out", "-o", metavar="FOLDER", rich_help_panel="Output")
    overwrite: bool = flag(False, "Replace the alignment if there is one.", rich_help_panel="Output")


class PassOptions(OptionGroup, title="Passes"):
    """How passes are told apart, and how well each is known.

    passes_by: What tells passes apart: pauses in gps_time, point source ids, or files.
    georeference_sigma: How well each pass is georeferenced: standard deviation along any axis, in m.
    drift_sigma: How a pass's errors change within it: sigma, m; 0: rigid. Default: as its matches ask.
    """

    passes_by: str = flag("time", None, "--passes", metavar="time|source|file")
    pause: float = flag(20.0, "Seconds without a point between two passes, by time.", metavar="S")
    georeference_sigma: float = flag(0.1, metavar="M")
    georeference_sigma_deg: float = flag(0.05, "The same of its roll, pitch and heading, in degrees.", metavar="DEG")
    drift_sigma: float | None = flag(None, metavar="M")
    knot_spacing: float = flag(10.0, "Corrections that drift are free every so many seconds.", "--knots", metavar="S")


@app.command(cls=GroupedCommand, short_help="Bring passes together before a map is built of them.")
@flags
def align(files: PassFiles, passes: PassOptions, quiet: Quiet = False) -> None:
    """Bring passes of a mapping campaign together: match them, adjust them, write corrected clouds."""
    from maxcon.cli.map_words import print_alignment
    from maxcon.mapping.align import AlignmentOptions, align_files

    options = AlignmentOptions(
        **vars(passes), drop=files.drop or None, vehicle_classes=tuple(files.vehicle_class or ()), crs=files.crs
    )
    with step_bars(quiet) as report, compiling_told(quiet):
        found = align_files(
            files.clouds, files.out, options, trajectories=files.trajectory or (), overwrite=files.overwrite,
            n_threads=files.threads, progress=report,
        )  # fmt: skip
    typer.echo(f"{files.out}")
    print_alignment(found)


app.command(short_help="Give a map its coordinates: by a receiver, or control points.")(georeference)


@app.command()
@flags
def info(
    path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder, or address: s3://, http://, https://.")],
    view: ViewOptions,
    check: Annotated[bool, typer.Option("--check", help="Also read every tile and verify its checksum.")] = False,
    is_json: IsJson = False,
) -> None:
    """Print what a map is made of, and show it."""
    from maxcon.cli.map_words import facts_of, print_manifest
    from maxcon.map.manifest import read_manifest
    from maxcon.map.storage import open_storage
    from maxcon.map.store import stored_ground, stored_tiles

    view.check()
    files = open_storage(path)
    manifest = read_manifest(files)
    if is_json:
        print_json(facts_of(manifest))
    else:
        print_manifest(manifest)
    if view.is_wanted:
        from maxcon.export.scene import with_rerun
        from maxcon.map import PointMap

        with_rerun().show_map(PointMap.open(path), view.save)
    if check:
        tiles = stored_tiles(files, manifest, cache_bytes=0)
        for each in (tiles, stored_ground(files, manifest)):
            for key in sorted(each.keys):
                each.load(key)
        if not is_json:  # exit code 0 says it
            typer.echo(f"checked      all {len(tiles.keys)} tiles are as they were written")


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
    from maxcon.map.store import copy_map

    with step_bars(quiet) as report:
        copy_map(source, target, overwrite=overwrite, progress=report)
    typer.echo(target)


@app.command()
def export(
    path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a map, or its address.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="File to write: .laz, .las or .ply.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file, if it is there.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write a map as points for CloudCompare, QGIS and others: means of voxels, normals, counts, changes, ground."""
    from maxcon.cli.export import check_out
    from maxcon.export import export_map

    check_out(path, out, overwrite=overwrite)
    with step_bars(quiet) as report:
        n_voxels, n_heights = export_map(path, out, progress=report)
    typer.echo(f"{n_voxels:,} voxels and {n_heights:,} heights of the ground written to {out}")
