"""Tiles of a map made from sorted points, step by step: by threads of this process, or by the workers of an engine."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from itertools import product
from pathlib import Path
from socket import gethostname
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon._system.engine import Engine, in_order_of, in_threads
from maxcon.errors import MapError
from maxcon.map import TILE_VOXELS, TileKey, VoxelTile
from maxcon.map.store import Record, tile_record
from maxcon.map.voxelize import mean_normals, mean_steps, tile_of_voxels
from maxcon.mapping.build.found_classes import NEIGHBOUR_VOXELS, OBSERVATION, FoundInTile, each_once, found_in_tile
from maxcon.mapping.build.ground import level_surfaces, lowest_heights
from maxcon.mapping.build.tile_points import HALO_VOXELS, POINT, TileArrays, TileBuckets, VoxelMoments, plane_normals

MEMORY_BYTES = 128 * 2**20  # of the arrays of tiles kept in memory, between steps done by threads
# Each thread holds a part of a tile's points and its voxels, about 0.25 GiB: more threads only on demand.
MOST_THREADS = 4
# Threads are in each other's way at tiles with fewer points: what is compiled has little to do there.
LEAST_POINTS_TO_SHARE = 500
# Tiles with few points go together: handing out a task takes some milliseconds.
POINTS_OF_TASK, MOST_TILES_OF_TASK = 100_000, 64


class TileStep(Enum):
    """Steps of making a tile, each done for all tiles before the next: it needs the tiles around."""

    GATHER = "gather"
    FIND_CLASSES = "find classes"
    MAKE = "make"


TileTask = tuple[TileStep, tuple[TileKey, ...]]  # one step of some tiles
# Does a step for tiles, and yields what the method of `TileMaker` returns for each, in their order.
TileSteps = Callable[[TileStep, Sequence[TileKey]], Iterator[Any]]


class MadeTile(NamedTuple):
    """Record of a tile, and its `level_surfaces`, shape (n, n), m, if they were asked for."""

    record: Record
    surfaces: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class TileJob:
    """How the tiles of a map are made, wherever it runs: all data lies in a folder."""

    folder: Path  # Of the buckets; all workers see it, and the caller removes it
    cell: float  # Voxel edge, m
    has_normals: bool  # Whether the points' sides are their normals; otherwise planes are fitted
    is_signed: bool  # Whether normals are turned to the points' sides
    finds_surfaces: bool = False  # Whether the level surfaces of tiles are asked for
    drop: frozenset[int] | None = None  # Classes that are to be found and left out; None if none are to be found

    def open(self) -> Callable[[TileTask], list[Any]]:
        """Return what does a task in a worker; all data is in files, as another worker may do the next step."""
        if not self.folder.is_dir():
            raise MapError(
                f"Expected all workers to see {self.folder}, got one on {gethostname()} that does not. Build the map in"
                " a folder that has the same path for all."
            )
        points, seen = (TileBuckets(self.folder, *kind) for kind in ((POINT, "points"), (OBSERVATION, "seen")))
        maker = TileMaker(self, points, seen)
        do = maker.steps | {TileStep.MAKE: lambda key: self._put_aside(maker.make(key))}
        return lambda task: [do[task[0]](key) for key in task[1]]

    def _put_aside(self, made: MadeTile) -> MadeTile:
        """Write the content of a record into a file: all tiles but one may have to wait for that one."""
        with atomic_file(self._record_path(made.record.key)) as partial:
            partial.write_bytes(made.record.content)
        return made._replace(record=replace(made.record, content=b""))

    def fetched(self, made: MadeTile) -> MadeTile:
        """Return a tile that was put aside, whose file is removed."""
        path = self._record_path(made.record.key)
        content = path.read_bytes()
        path.unlink()
        return made._replace(record=replace(made.record, content=content))

    def _record_path(self, key: TileKey) -> Path:
        return self.folder / f"{key[0]}_{key[1]}.record"

    def split(self, task: TileTask) -> Sequence[TileTask]:
        """Return a task for each tile."""
        return [(task[0], (key,)) for key in task[1]]

    def lost(self, task: TileTask, reason: str) -> NoReturn:
        """Raise MapError: no map is made without one of its tiles."""
        raise MapError(
            f"Expected to {task[0].value} all tiles of the map, but of tile {task[1][0]} {reason}. Take a"
            " smaller cell, or workers with more memory."
        )


class TileMaker:
    """Makes tiles of sorted points: `gather` all, `find_classes` of all if the job drops some, then `make` any."""

    def __init__(self, job: TileJob, points: TileBuckets, observations: TileBuckets, *, memory_bytes: int = 0) -> None:
        self._job, self._points, self._observations = job, points, observations
        self._arrays = TileArrays(job.folder, memory_bytes)

    @property
    def steps(self) -> dict[TileStep, Callable[[TileKey], Any]]:
        """The method that does each step of a tile."""
        return {TileStep.GATHER: self.gather, TileStep.FIND_CLASSES: self.find_classes, TileStep.MAKE: self.make}

    def gather(self, key: TileKey) -> None:
        """Sum the points of a tile into its voxels, and keep these instead; FileNotFoundError if there are none."""
        try:
            moments = VoxelMoments.from_records(self._points.records(key))
        except FileNotFoundError:
            if self._arrays.has(key, "moments"):  # by a process that ended before it could say so
                return
            raise
        self._arrays.put(key, "moments", **moments.arrays)
        if self._job.drop is not None:
            self._arrays.put(key, "lowest", heights=lowest_heights(moments, self._job.cell))
            self._arrays.put(key, "observed", records=each_once(self._observations.load(key)))
        self._points.remove(key)

    def find_classes(self, key: TileKey) -> FoundInTile:
        """Find and keep the class of each voxel of a tile; it and the tiles around it have been gathered."""

        def of_tiles(kind: str, name: str) -> Callable[[TileKey], NDArray[Any] | None]:
            return lambda near: self._arrays.get(near, kind)[name] if self._arrays.has(near, kind) else None

        lowest, observed = of_tiles("lowest", "heights"), of_tiles("observed", "records")
        own, halo = self.moments(key), self._halo(key, NEIGHBOUR_VOXELS, self.moments)
        drop = self._job.drop or frozenset()
        classes, found = found_in_tile(own, halo, lowest, observed, key, self._job.cell, drop)
        self._arrays.put(key, "classes", classes=classes)
        return found

    def make(self, key: TileKey) -> MadeTile:
        """Return a tile; it and the tiles around it have been gathered, and their classes found."""
        own = self._kept(key)
        if self._job.has_normals:
            normals = mean_normals(own.sides, own.counts)
        else:
            halo = self._halo(key, HALO_VOXELS, self._kept)
            moments = VoxelMoments.concatenate([own, *halo]) if halo else own
            is_own = moments.is_own
            fitted = plane_normals(moments, self._job.cell, is_own, is_signed=self._job.is_signed)
            normals = fitted[is_own].astype(np.float32)
        tile = voxel_tile(key, own, normals, self._job.cell)
        surfaces = level_surfaces(tile, self._job.cell) if self._job.finds_surfaces else None
        return MadeTile(tile_record(tile), surfaces)

    def moments(self, key: TileKey) -> VoxelMoments:
        """Return the voxels of a gathered tile."""
        return VoxelMoments(**self._arrays.get(key, "moments"))

    def classes(self, key: TileKey) -> NDArray[np.uint8]:
        """Return the class of each voxel of a tile, as it was found."""
        return self._arrays.get(key, "classes")["classes"]

    def _kept(self, key: TileKey) -> VoxelMoments:
        """Voxels of a gathered tile that are for the map."""
        moments = self.moments(key)
        if self._job.drop is None:
            return moments
        return moments.select(~np.isin(self.classes(key), sorted(self._job.drop)))

    def _halo(self, key: TileKey, reach: int, load: Callable[[TileKey], VoxelMoments]) -> list[VoxelMoments]:
        """Voxels of the tiles around, at most `reach` away; x and y from this tile's corner."""
        halo = []
        for dx, dy in product((-1, 0, 1), repeat=2):
            neighbour = (key[0] + dx, key[1] + dy)
            if (dx, dy) != (0, 0) and self._arrays.has(neighbour, "moments"):
                moments, shift = load(neighbour), (dx * TILE_VOXELS, dy * TILE_VOXELS)
                columns = moments.indices[:, :2] + np.array(shift)
                is_near = ((columns >= -reach) & (columns < TILE_VOXELS + reach)).all(axis=1)
                halo += [moments.select(is_near, shift)] if is_near.any() else []
        return halo


def voxel_tile(key: TileKey, moments: VoxelMoments, normals: NDArray[np.float32], cell: float) -> VoxelTile:
    """Return the tile of voxels with these moments and normals, shape (n, 3)."""
    return tile_of_voxels(
        key, moments.indices[:, :2].astype(np.int16), np.ascontiguousarray(moments.indices[:, 2]),
        moments.counts.astype(np.int32), normals, mean_steps(moments.sums, moments.counts, cell),
    )  # fmt: skip


@contextmanager
def tile_steps(
    job: TileJob, points: TileBuckets, observations: TileBuckets, n_points: int, engine: Engine | None,
    n_threads: int | None,
) -> Iterator[TileSteps]:  # fmt: skip
    """Yield what makes tiles: threads of this process, or the workers of an engine, who find all points on disk."""
    n_tiles = len(points.keys)
    for buckets in (points, observations):
        buckets.complete(to_disk=engine is not None and not engine.is_in_process)
    if engine is None or engine.is_in_process:
        is_thin = n_points < LEAST_POINTS_TO_SHARE * n_tiles
        usual = 1 if is_thin or engine is not None else min(MOST_THREADS, os.cpu_count() or 1)
        do = TileMaker(job, points, observations, memory_bytes=MEMORY_BYTES).steps
        yield lambda step, keys: in_threads(do[step], keys, usual if n_threads is None else n_threads)
        return
    n_together = min(max(1, POINTS_OF_TASK * n_tiles // n_points), MOST_TILES_OF_TASK)
    with engine.started(-(-n_tiles // n_together)) as run:

        def do_all(step: TileStep, keys: Sequence[TileKey]) -> Iterator[Any]:
            starts = range(0, len(keys), n_together)
            tasks = [(step, tuple(keys[first : first + n_together])) for first in starts]
            done = (each for task, results in run(job, tasks) for each in zip(task[1], results, strict=True))
            results = in_order_of(keys, done)
            return map(job.fetched, results) if step is TileStep.MAKE else results

        yield do_all
