"""Building a map on disk from point clouds: read, drop, sort into tiles, fit normals, write (D10)."""

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import rmtree

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.engine import Engine
from maxcon._system.version import __version__
from maxcon.errors import ArrayError, MapError, OptionError
from maxcon.geometry.pose import INDEX_LIMIT
from maxcon.io.clouds import CloudHeader, CloudReader
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import GroundTile, ground_of_points, ground_voxels
from maxcon.map.manifest import Manifest
from maxcon.map.store import MapWriter, ground_record, map_folder
from maxcon.mapping.build.found_classes import OBSERVATION, FoundInTile, describe_found, observation_records
from maxcon.mapping.build.ground import GROUND_POINT, ground_among, ground_records
from maxcon.mapping.build.options import FOUND, MapOptions, class_name
from maxcon.mapping.build.point_statistics import LARGEST_CELL, PlaceSample, aligned_sigma, map_sigma, point_spacing
from maxcon.mapping.build.sources import SidedPoints, Source, check_sides, open_headers, read_source, sources_in_crs
from maxcon.mapping.build.tile_points import POINT, TileBuckets, point_records
from maxcon.mapping.build.tiles import TileJob, TileStep, TileSteps, tile_steps

# A street has some 100,000 points in a tile of 30 m, an aeroplane some 10,000. So few in so many are another unit.
MOST_SPARSE_TILES, LEAST_POINTS_OF_TILE = 20_000, 200


def build_map(
    sources: Sequence[str | os.PathLike[str] | CloudReader], out: str | os.PathLike[str],
    options: MapOptions | None = None, *, overwrite: bool = False, n_threads: int | None = None,
    engine: Engine | None = None, progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Build a map on disk of clouds, files or readers; memory is bounded by the tiles, not by the sources.

    `n_threads` tiles, of 0.25 GiB each, are made at the same time (at most 4 if None, one where tiles have few points),
    or by the workers of `engine`, who find points in files beside `out`. The map does not depend on either.
    """
    options = options or MapOptions()
    report = progress or (lambda step, done, total: None)
    headers = open_headers(sources)
    if options.classes_are_asprs:
        headers = [replace(header, has_asprs_classes=header.has_classes) for header in headers]
    crs, read = sources_in_crs(headers, options)
    _check_contents(headers, options)
    aligned = aligned_sigma([header.path for header in headers]) if options.sigma is None else None
    with map_folder(out, overwrite=overwrite) as folder:
        has_sides = options.trajectory is not None or options.normals_have_sides
        use_normals = has_sides and options.to_crs is None and all(header.has_normals for header in headers)
        is_signed = options.trajectory is not None or use_normals
        sort = partial(_sorted_into_tiles, folder.absolute() / "points", use_normals=use_normals, report=report)
        buckets = sort(read, options)
        are_scans = any(header.reader is not None for header in headers)
        spacing = point_spacing(buckets.points, options.edge, are_scans=are_scans)
        if options.cell is None and spacing is not None and spacing.cell != options.edge:
            rmtree(buckets.folder)
            options = replace(options, cell=spacing.cell)
            _, read = sources_in_crs(headers, options)
            buckets = sort(read, options)
        for source in read:
            source.check_operation(options, options.edge)
        sigma, how_known = map_sigma(options.sigma, buckets.sample, aligned)
        finds_classes, drop = buckets.may_find_classes(read), options.dropped_found_classes() & FOUND
        ground = "found by a morphological filter" if finds_classes else "of level surfaces"
        ground = "of its classes" if buckets.ground.keys else ground
        job = TileJob(
            buckets.folder, options.edge, use_normals, is_signed,
            finds_surfaces=ground == "of level surfaces", drop=drop if finds_classes else None,
        )  # fmt: skip
        with MapWriter(folder) as writer:
            n_points = sum(source.n_kept for source in read)
            with tile_steps(job, buckets.points, buckets.observations, n_points, engine, n_threads) as do:
                surfaces, found = _write_tiles(writer, do, job, buckets.points.keys, report)
            for tile in [each.ground for each in found] or _ground_tiles(buckets, surfaces):
                if tile.n_heights:
                    writer.put(ground_record(tile))
            build = {
                "program": f"maxcon {__version__}",
                "normals": "of the sources" if use_normals else "from neighbourhoods", "ground": ground,
                "drop": {str(number): class_name(number) for number in sorted(options.dropped_classes())},
                "sources": [source.describe() for source in read], "sigma": how_known,
            }  # fmt: skip
            if spacing is not None:
                build["spacing"] = spacing.describe()
            if finds_classes:
                build["found"] = describe_found(found, drop, has_times=bool(buckets.observations.keys))
            rmtree(buckets.folder)
            return writer.finish(Manifest(options.edge, buckets.origin, crs, is_signed, {}, build, sigma))


def _check_contents(headers: Sequence[CloudHeader], options: MapOptions) -> None:
    """Refuse options about normals or classes that a source does not have: they would silently have no effect."""
    may_be_found = options.may_find_classes and options.dropped_found_classes() <= FOUND
    for header in headers:
        for is_asked, has, what, flag in (
            (options.normals_have_sides, header.has_normals, "normals", "--signed-normals"),
            (options.classes_are_asprs, header.has_classes, "classes", "--asprs-classes"),
            (bool(options.drop), header.has_classes or may_be_found, "classes", "--drop"),
        ):
            if is_asked and not has:
                raise OptionError(f"Expected {what} in {header.path}, got none. Leave out {flag}, or add them.")


def _origin(sources: Sequence[Source], options: MapOptions) -> tuple[float, float, float]:
    """Return the origin of the local frame: whole tiles apart, so that maps of one cell edge share their voxels."""
    edge = TILE_VOXELS * options.edge
    lowest = np.min([source.first_point() for source in sources], axis=0)
    if options.area is not None:
        lowest[:2] = options.area.x_min, options.area.y_min
    x, y, z = (np.floor(lowest / edge) * edge if np.isfinite(lowest).all() else np.zeros(3)).tolist()
    return x, y, z


class _Buckets:
    """All points of the sources, sorted into tiles in a folder, for voxels, ground, classes and sigma."""

    def __init__(self, folder: Path, origin: tuple[float, float, float], options: MapOptions) -> None:
        folder.mkdir()
        self.folder, self.origin, self.options = folder, origin, options
        self.points = TileBuckets(folder, POINT, "points")
        self.ground = TileBuckets(folder, GROUND_POINT, "ground")
        self.observations = TileBuckets(folder, OBSERVATION, "seen")
        self.sample = PlaceSample()

    def may_find_classes(self, sources: Sequence[Source]) -> bool:
        """Whether classes are to be found as far as the sources have been read: no point has had one that counts."""
        is_unclassified = self.options.classify == "always" or not any(source.is_classified for source in sources)
        return self.options.may_find_classes and is_unclassified

    def add(self, part: SidedPoints, sources: Sequence[Source]) -> None:
        """Take points; ArrayError if one is too far from the origin."""
        cell, points = self.options.edge, part.points - self.origin
        self.points.add(*point_records(points, part.sides, cell))
        self.ground.add(*ground_records(part.ground - self.origin, cell))
        if part.times is not None:
            if self.may_find_classes(sources):
                self.observations.add(*observation_records(points, part.times, cell))
            if self.options.sigma is None:
                self.sample.add(points, part.times)


def _sorted_into_tiles(
    folder: Path, sources: Sequence[Source], options: MapOptions, *, use_normals: bool, report: Progress
) -> _Buckets:
    """Read all sources into buckets in a folder."""
    buckets = _Buckets(folder, _origin(sources, options), options)
    n_total = sum(source.header.n_points for source in sources)
    for source in sources:  # by the first points, before all are read
        source.check_operation(options, options.cell or LARGEST_CELL)
    for source in sources:
        for part in read_source(source, options, use_normals=use_normals):
            try:
                buckets.add(part, sources)
            except ArrayError as error:
                raise MapError(
                    f"Expected all points within {INDEX_LIMIT * options.edge:.3g} m ({INDEX_LIMIT:,} voxels) of the"
                    f" first, got one in {source.header.path} farther away. Remove it from the cloud, or enlarge the"
                    " cell."
                ) from error
            n_points, n_tiles = sum(each.n_kept for each in sources), len(buckets.points.keys)
            if n_tiles > MOST_SPARSE_TILES and n_points < LEAST_POINTS_OF_TILE * n_tiles:
                raise MapError(
                    f"Expected a dense cloud in metres, got {n_points:,} points in {n_tiles:,} squares of"
                    f" {TILE_VOXELS * options.edge:g} m, the last in {source.header.path}. Are its coordinates in"
                    " millimetres? Scale them."
                )
            report("reading points", sum(each.n_points for each in sources), n_total)
    buckets.ground.complete()
    if not buckets.points.keys:
        left_out = sum((source.left_out for source in sources), Counter[str]())
        n_read = sum(source.n_points for source in sources) - left_out["thinned"]
        outside = f"{left_out['outside']:,} lie outside of the area, " if options.area is not None else ""
        n_dropped = sum(source.n_dropped.total() for source in sources)
        names = ", ".join(source.header.path.name for source in sources)
        raise MapError(
            f"Expected points for the map, but none of the {n_read:,} points in {names} is left: {outside}"
            f"{left_out['invalid']:,} have no finite coordinates, {n_dropped:,} are of classes that are dropped. Check"
            f" {'--area and the CRS' if 0 < n_read == left_out['outside'] else 'the files, or keep more classes'}."
        )
    if options.trajectory is not None:
        check_sides(sources, options.trajectory)
    buckets.points.complete()
    buckets.observations.complete()
    return buckets


def _write_tiles(
    writer: MapWriter, do: TileSteps, job: TileJob, keys: Sequence[TileKey], report: Progress
) -> tuple[dict[TileKey, NDArray[np.float32]], list[FoundInTile]]:
    """Make every tile, step by step, and write them in order; return level surfaces and classes, if asked for."""
    found, kept, surfaces = list[FoundInTile](), keys, {}
    n_done, n_steps = 0, (2 if job.drop is None else 3) * len(keys)

    def one_more(n_more: int = 1) -> None:
        nonlocal n_done
        n_done += n_more
        report("making tiles", n_done, n_steps)

    for _ in do(TileStep.GATHER, keys):
        one_more()
    if job.drop is not None:
        for of_tile in do(TileStep.FIND_CLASSES, keys):
            found.append(of_tile)
            one_more()
        kept = [of_tile.ground.key for of_tile in found if of_tile.keeps_any]
        one_more(len(keys) - len(kept))
    if not kept:
        raise MapError(
            "Expected points for the map, but all of them were found to be ground, vegetation or temporary. Keep them:"
            " --classify off."
        )
    for key, made in zip(kept, do(TileStep.MAKE, kept), strict=True):
        writer.put(made.record)
        if made.surfaces is not None and np.isfinite(made.surfaces).any():
            surfaces[key] = made.surfaces
        one_more()
    return surfaces, found


def _ground_tiles(buckets: _Buckets, surfaces: dict[TileKey, NDArray[np.float32]]) -> Iterable[GroundTile]:
    """Ground of all tiles: of points that are classified as ground, or else among level surfaces."""
    cell = buckets.options.edge
    for key in buckets.ground.keys:
        records = buckets.ground.load(key)
        buckets.ground.remove(key)
        n = TILE_VOXELS // ground_voxels(cell)
        yield GroundTile(key, ground_of_points(records["column"], records["height"], n))
    if not buckets.ground.keys:
        for key in sorted(surfaces):
            yield ground_among(surfaces, key, cell)
