# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Building a map on disk from point clouds: read, drop, sort into tiles, fit normals, write (D10)."""

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from shutil import rmtree

import numpy as np
from numpy.typing import NDArray

from maxcon._system.engine import Engine
from maxcon.errors import ArrayError, MapError, OptionError
from maxcon.geometry.frame import INDEX_LIMIT
from maxcon.io.clouds import CloudHeader
from maxcon.mapping.build.classes import NOISE, class_name
from maxcon.mapping.build.found_classes import FOUND, FoundClasses
from maxcon.mapping.build.ground import GroundMaker
from maxcon.mapping.build.map_options import MapOptions
from maxcon.mapping.build.map_sigma import aligned_sigma, map_sigma
from maxcon.mapping.build.place_sample import PlaceSample
from maxcon.mapping.build.placement import Placement, placements
from maxcon.mapping.build.sightings import SightingSpill
from maxcon.mapping.build.sources import (
    SidedPoints,
    SourceCounts,
    check_sides,
    common_crs,
    first_point,
    open_headers,
    read_source,
)
from maxcon.mapping.build.spill import GroundSpill, TileSpill
from maxcon.mapping.build.tile_job import TileJob, TileRound, TileStep, by_engine, by_threads
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.manifest import MAP_NAMES, Manifest
from maxcon.map.store import ground_record
from maxcon.map.writer import MapWriter
from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.progress import Progress
from maxcon._system.version import __version__

__all__ = ["build_map"]

# Each thread holds a part of a tile's points and its voxels, about 0.25 GiB: more threads only on demand.
MOST_THREADS = 4
# Threads are in each other's way at tiles with fewer points: what is compiled has little to do there.
LEAST_POINTS_TO_SHARE = 500
# A street has some 100,000 points in a tile of 30 m, an aeroplane some 10,000. So few in so many are another unit.
MOST_SPARSE_TILES, LEAST_POINTS_OF_TILE = 20_000, 200


def build_map(
    sources: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    options: MapOptions | None = None,
    *,
    overwrite: bool = False,
    n_threads: int | None = None,
    engine: Engine | None = None,
    progress: Progress | None = None,
) -> Manifest:
    """Build a map on disk; memory is bounded by the tiles, not by the sources.

    Parameters
    ----------
    sources : sequence of path
        Point clouds of any kind that `open_cloud` reads.
    out : path
        Folder of the map; it appears when all is done.
    options : MapOptions, optional
        How; the defaults if None.
    overwrite : bool
        Whether a map that stands there is replaced; anything else there is an error.
    n_threads : int, optional
        Tiles made at the same time in this process; the number of processors, but at most 4, if None, and one where
        tiles have few points. Each takes about 0.25 GiB. The map does not depend on it.
    engine : Engine, optional
        Whose workers make the tiles instead, or one thread if it has no other than this process; the map does not
        depend on it. They find points and voxels in files beside `out`, which has the same path for all.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Manifest
        What the map is made of.

    Raises
    ------
    FileError, CrsError, OptionError, TrajectoryError, MapError
        If a source, an option or their combination cannot be used, or `out` cannot be written.
    """
    options = options or MapOptions()
    report = progress or (lambda step, done, total: None)
    headers = open_headers(sources)
    if options.classes_are_asprs:
        headers = [replace(header, has_asprs_classes=header.has_classes) for header in headers]
    crs, placed = _placed(headers, options)
    drop = options.dropped_classes()
    _check_contents(headers, options)
    aligned = aligned_sigma([header.path for header in headers]) if options.sigma is None else None
    if overwrite:
        check_replaceable(out, "a map", MAP_NAMES)
    with atomic_folder(out, overwrite=overwrite) as folder:
        spill_folder = folder.absolute() / "points"
        spill_folder.mkdir()
        spill, ground_spill = TileSpill(spill_folder, options.cell), GroundSpill(spill_folder, options.cell)
        sightings = SightingSpill(spill_folder, options.cell)
        has_sides = options.trajectory is not None or options.normals_have_sides
        use_normals = has_sides and options.to_crs is None and all(header.has_normals for header in headers)
        origin = _origin(headers, placed, options)
        sample = PlaceSample()
        counts = _sort_into_tiles(
            headers, placed, origin, spill, ground_spill, sightings, sample, options, use_normals, report
        )
        sigma, how_known = map_sigma(options.sigma, sample, aligned)
        del sample
        is_signed = options.trajectory is not None or use_normals
        found, drop_found = None, options.dropped_found_classes()
        if options.may_find_classes and _is_unclassified(counts, options):
            found = FoundClasses(has_times=bool(sightings.n_tiles), drop=drop_found)
        ground_maker = GroundMaker(ground_spill, options.cell, found)
        job = TileJob(
            spill_folder,
            options.cell,
            has_normals=use_normals,
            is_signed=is_signed,
            finds_surfaces=ground_maker.needs_surfaces,
            drop=None if found is None else drop_found,
        )
        with MapWriter(folder) as writer:
            n_points = sum(source.n_kept for source in counts)
            with _workers(job, spill, sightings, n_points, engine, n_threads) as do:
                _write_tiles(writer, do, spill.keys, found, ground_maker, report)
            for tile in ground_maker.tiles():
                writer.put(ground_record(tile))
            build = {
                **_description(counts, placed, drop, use_normals, ground_maker.origin),
                "sigma": how_known,
            }
            if found is not None:
                build["found"] = found.describe()
            rmtree(spill_folder)
            return writer.finish(
                cell=options.cell, origin=origin, crs=crs, is_signed=is_signed, sigma=sigma, build=build
            )


def _workers(
    job: TileJob,
    spill: TileSpill,
    sightings: SightingSpill,
    n_points: int,
    engine: Engine | None,
    n_threads: int | None,
) -> AbstractContextManager[TileRound]:
    """Those who make the tiles, with what was spilled where they find it."""
    if engine is not None and not engine.is_in_process:
        spill.complete(to_disk=True)
        sightings.complete(to_disk=True)
        return by_engine(job, engine, n_points, len(spill.keys))
    spill.complete()
    sightings.complete()
    if n_threads is None:
        is_thin = n_points < LEAST_POINTS_TO_SHARE * len(spill.keys)
        n_threads = 1 if is_thin or engine is not None else min(MOST_THREADS, os.cpu_count() or 1)
    return by_threads(job, spill, sightings, n_threads)


def _check_contents(headers: Sequence[CloudHeader], options: MapOptions) -> None:
    """Refuse sources without what the options speak of: it would silently have no effect."""
    for header in headers:
        if options.normals_have_sides and not header.has_normals:
            raise OptionError(
                f"Expected normals in {header.path}, said to be turned to the sensor, but it has none."
                " Leave out --signed-normals."
            )
        if options.classes_are_asprs and not header.has_classes:
            raise OptionError(
                f"Expected classes in {header.path}, said to be those of the ASPRS, but it has none. Leave out"
                " --asprs-classes, or classify it."
            )
        may_be_found = options.may_find_classes and options.dropped_found_classes() <= FOUND
        if options.drop and not (header.has_classes or may_be_found):
            raise OptionError(
                f"Expected classes in {header.path} to drop {', '.join(options.drop)}, but it has none."
                " Leave out --drop, or classify it."
            )


def _placed(headers: Sequence[CloudHeader], options: MapOptions) -> tuple[str | None, list[Placement]]:
    """The CRS of the map, and where the points of each source are in it."""
    if options.to_crs is None:
        return common_crs(headers, options.crs), [Placement(None, options.area)] * len(headers)
    return placements(headers, options.crs, options.to_crs, options.area)


def _origin(
    headers: Sequence[CloudHeader], placed: Sequence[Placement], options: MapOptions
) -> tuple[float, float, float]:
    """Return the origin of the local frame: a tile's corner near the points, whatever the order of the sources.

    Origins are whole tiles apart, so that maps of one cell edge share their voxels.
    """
    edge = TILE_VOXELS * options.cell
    lowest = np.min([first_point(*source) for source in zip(headers, placed, strict=True)], axis=0)
    if options.area is not None:
        lowest[:2] = options.area.x_min, options.area.y_min
    x, y, z = (np.floor(lowest / edge) * edge if np.isfinite(lowest).all() else np.zeros(3)).tolist()
    return x, y, z


def _sort_into_tiles(
    headers: Sequence[CloudHeader],
    placed: Sequence[Placement],
    origin: tuple[float, float, float],
    spill: TileSpill,
    ground: GroundSpill,
    sightings: SightingSpill,
    sample: PlaceSample,
    options: MapOptions,
    use_normals: bool,
    report: Progress,
) -> list[SourceCounts]:
    """Read all sources into the spill, and some of their points into the sample; return what was read."""
    counts = [SourceCounts(header.path.name) for header in headers]
    n_total = sum(header.n_points for header in headers)
    for header, placement, counted in zip(headers, placed, counts, strict=True):
        drop = options.dropped_classes(are_asprs=header.has_asprs_classes)
        if options.classify == "always":
            drop &= NOISE | options.vehicle_numbers
        counted.has_known_classes = header.has_asprs_classes or options.drop is not None or bool(drop)
        for part in read_source(
            header,
            counted,
            drop,
            options.trajectory,
            use_normals=use_normals,
            keep_every=options.keep_every,
            placement=placement,
        ):
            points = part.points - origin
            if options.classify == "always":
                part = replace(part, ground=part.ground[:0])
            _add(spill, ground, points, part, origin, header, options.cell)
            _check_density(spill, counts, header, options.cell)
            if options.may_find_classes and _is_unclassified(counts, options):
                sightings.add(points, part.times)
            if options.sigma is None:
                sample.add(points, part.times)
            report("reading points", sum(source.n_points for source in counts), n_total)
    ground.complete()
    if not spill.keys:
        n_read = sum(source.n_points for source in counts)
        n_read -= sum(source.n_thinned for source in counts)
        n_outside = sum(source.n_outside for source in counts)
        outside = f"{n_outside:,} lie outside of the area, " if options.area is not None else ""
        n_invalid = sum(source.n_invalid for source in counts)
        raise MapError(
            f"Expected points for the map, but none of the {n_read:,} points in"
            f" {', '.join(source.name for source in counts)} is left: {outside}{n_invalid:,} have no finite"
            f" coordinates, {n_read - n_invalid - n_outside:,} are of classes that are dropped. Check the files, or"
            " keep more classes."
        )
    if options.trajectory is not None:
        check_sides(counts, options.trajectory)
    return counts


def _is_unclassified(counts: Sequence[SourceCounts], options: MapOptions) -> bool:
    """Whether no source has had a class that counts so far."""
    return options.classify == "always" or not any(source.is_classified for source in counts)


def _add(
    spill: TileSpill,
    ground: GroundSpill,
    points: NDArray[np.float64],
    part: SidedPoints,
    origin: tuple[float, float, float],
    header: CloudHeader,
    cell: float,
) -> None:
    try:
        spill.add(points, part.sides)
        ground.add(part.ground - origin)
    except ArrayError as error:
        raise MapError(
            f"Expected all points within {INDEX_LIMIT * cell:.3g} m ({INDEX_LIMIT:,} voxels) of the first, got"
            f" one in {header.path} farther away. Remove it from the cloud, or enlarge the cell."
        ) from error


def _check_density(
    spill: TileSpill, counts: Sequence[SourceCounts], header: CloudHeader, cell: float
) -> None:
    """Refuse points so far apart that hardly two share a tile: a map of them would be made for ever."""
    n_points, n_tiles = sum(source.n_kept for source in counts), spill.n_tiles
    if n_tiles > MOST_SPARSE_TILES and n_points < LEAST_POINTS_OF_TILE * n_tiles:
        raise MapError(
            f"Expected a dense cloud in metres, got {n_points:,} points in {n_tiles:,} squares of"
            f" {TILE_VOXELS * cell:g} m, the last in {header.path}. Are its coordinates in millimetres? Scale them."
        )


def _write_tiles(
    writer: MapWriter,
    do: TileRound,
    keys: Sequence[TileKey],
    found: FoundClasses | None,
    ground: GroundMaker,
    report: Progress,
) -> None:
    """Make every tile, several at a time, in rounds: a tile's classes and normals need its neighbours.

    Tiles are written in order.
    """
    n_done, n_steps = 0, (2 if found is None else 3) * len(keys)

    def one_more(n_more: int = 1) -> None:
        nonlocal n_done
        n_done += n_more
        report("making tiles", n_done, n_steps)

    for _ in do(TileStep.GATHER, keys):
        one_more()
    kept = keys
    if found is not None:
        kept = []
        for of_tile in do(TileStep.FIND_CLASSES, keys):
            found.add(of_tile)
            kept += [of_tile.key] if of_tile.keeps_any else []
            one_more()
        one_more(len(keys) - len(kept))
    if not kept:
        raise MapError(
            "Expected points for the map, but all of them were found to be ground, vegetation or temporary. Keep them:"
            " --classify off."
        )
    for key, made in zip(kept, do(TileStep.MAKE, kept), strict=True):
        writer.put(made.record)
        if made.surfaces is not None:
            ground.take(key, made.surfaces)
        one_more()


def _description(
    counts: Sequence[SourceCounts],
    placed: Sequence[Placement],
    drop: frozenset[int],
    use_normals: bool,
    ground: str,
) -> dict[str, object]:
    """What the manifest says of how the map was made."""
    return {
        "program": f"maxcon {__version__}",
        "normals": "of the sources" if use_normals else "from neighbourhoods",
        "ground": ground,
        "drop": {str(number): class_name(number) for number in sorted(drop)},
        "sources": [
            {
                "name": source.name,
                "n_points": source.n_points,
                "n_kept": source.n_kept,
                "n_thinned": source.n_thinned,
                "n_outside": source.n_outside,
                "transform": placement.transform.words if placement.transform is not None else "",
                "n_invalid": source.n_invalid,
                "n_withheld": source.n_withheld,
                "n_without_side": source.n_without_side,
                "n_dropped": {str(number): n for number, n in sorted(source.n_dropped.items())},
                "is_classified": source.is_classified,
            }
            for source, placement in zip(counts, placed, strict=True)
        ],
    }
