# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The tiles of a map as a job: by threads of this process, or by the workers of an engine."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from socket import gethostname
from typing import Any, NoReturn

from maxcon._system.engine import Engine
from maxcon.errors import MapError
from maxcon.mapping.build.found_classes import ClassFinder
from maxcon.mapping.build.sightings import SightingSpill
from maxcon.mapping.build.spill import TileSpill
from maxcon.mapping.build.tiles import MEMORY_BYTES, MadeTile, TileMaker
from maxcon.map import TileKey
from maxcon._system.atomic import atomic_file
from maxcon._system.ordered_map import in_order_of, ordered_map

__all__ = ["TileJob", "TileRound", "TileStep", "TileTask", "by_engine", "by_threads"]


POINTS_OF_TASK, MOST_TILES_OF_TASK = 100_000, 64
"""Tiles with few points go together: handing out a task takes some milliseconds."""


class TileStep(Enum):
    """The steps to a tile, each done for all tiles before the next: it needs the tiles around."""

    GATHER = "gather"
    FIND_CLASSES = "find classes"
    MAKE = "make"


@dataclass(frozen=True, slots=True)
class TileTask:
    """One step of some tiles."""

    step: TileStep
    keys: tuple[TileKey, ...]


TileRound = Callable[[TileStep, Sequence[TileKey]], Iterator[Any]]
"""Does a step for tiles, and yields what came of each, in their order: what the method of `TileMaker` returns."""


@dataclass(frozen=True)
class TileJob:
    """What makes the tiles of a map, wherever it runs: the points and what is made of them is in a folder.

    Parameters
    ----------
    folder : Path
        Of the spills; all workers see it.
    cell : float
        Voxel edge, m.
    has_normals, is_signed, finds_surfaces : bool
        See `TileMaker`.
    drop : frozenset of int, optional
        Classes that are to be found and left out; None if none are to be found.
    """

    folder: Path
    cell: float
    has_normals: bool
    is_signed: bool
    finds_surfaces: bool
    drop: frozenset[int] | None = None
    name: str = "tiles"

    def maker(self, spill: TileSpill, sightings: SightingSpill, *, memory_bytes: int) -> TileMaker:
        """Return what makes tiles of what was spilled."""
        finder = None
        if self.drop is not None:
            finder = ClassFinder(self.folder, self.cell, sightings, self.drop)
        return TileMaker(
            spill, self.folder, self.cell, has_normals=self.has_normals, is_signed=self.is_signed, finder=finder,
            finds_surfaces=self.finds_surfaces, memory_bytes=memory_bytes,
        )  # fmt: skip

    def open(self) -> Callable[[TileTask], list[Any]]:
        """Return what does a task in a worker; everything is in files, as the next task may be another worker's."""
        if not self.folder.is_dir():
            raise MapError(
                f"Expected all workers to see {self.folder}, got one on {gethostname()} that does not. Build the map in"
                " a folder that has the same path for all."
            )
        spill, sightings = TileSpill(self.folder, self.cell), SightingSpill(self.folder, self.cell)
        maker = self.maker(spill, sightings, memory_bytes=0)
        do = _doing(maker) | {TileStep.MAKE: lambda key: self._put_aside(maker.make(key))}
        return lambda task: [do[task.step](key) for key in task.keys]

    def _put_aside(self, made: MadeTile) -> MadeTile:
        """Write what the record of a tile holds into a file: all tiles but one may have to wait for that one."""
        with atomic_file(self._record_path(made.record.key)) as partial:
            partial.write_bytes(made.record.content)
        return replace(made, record=replace(made.record, content=b""))

    def fetched(self, made: MadeTile) -> MadeTile:
        """Return a tile that was put aside, whose file is removed."""
        path = self._record_path(made.record.key)
        content = path.read_bytes()
        path.unlink()
        return replace(made, record=replace(made.record, content=content))

    def _record_path(self, key: TileKey) -> Path:
        return self.folder / f"{key[0]}_{key[1]}.record"

    def split(self, task: TileTask) -> Sequence[TileTask]:
        """Return a task for each tile."""
        return [TileTask(task.step, (key,)) for key in task.keys]

    def lost(self, task: TileTask, reason: str) -> NoReturn:
        """Refuse a map without one of its tiles.

        Raises
        ------
        MapError
            Always.
        """
        ((x, y),) = task.keys
        raise MapError(
            f"Expected to {task.step.value} all tiles of the map, but of tile ({x}, {y}) {reason}. Take a"
            " smaller cell, or workers with more memory."
        )


def _doing(maker: TileMaker) -> dict[TileStep, Callable[[TileKey], Any]]:
    """Return what does each step of a tile."""
    return {
        TileStep.GATHER: maker.gather,
        TileStep.FIND_CLASSES: maker.find_classes,
        TileStep.MAKE: maker.make,
    }


@contextmanager
def by_threads(
    job: TileJob, spill: TileSpill, sightings: SightingSpill, n_threads: int
) -> Iterator[TileRound]:
    """Yield what lets threads of this process make tiles; points and voxels stay in memory as far as they fit."""
    do = _doing(job.maker(spill, sightings, memory_bytes=MEMORY_BYTES))
    if n_threads == 1:
        yield lambda step, keys: map(do[step], keys)
        return
    with ThreadPoolExecutor(n_threads) as pool:
        try:
            yield lambda step, keys: ordered_map(pool, do[step], keys, 2 * n_threads)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


@contextmanager
def by_engine(job: TileJob, engine: Engine, n_points: int, n_tiles: int) -> Iterator[TileRound]:
    """Yield what lets the workers of an engine make tiles; what was spilled is on disk."""
    n_together = min(max(1, POINTS_OF_TASK * n_tiles // n_points), MOST_TILES_OF_TASK)
    with engine.started(-(-n_tiles // n_together)) as run:

        def do_all(step: TileStep, keys: Sequence[TileKey]) -> Iterator[Any]:
            tasks = [
                TileTask(step, tuple(keys[first : first + n_together]))
                for first in range(0, len(keys), n_together)
            ]
            found = (
                of_tile
                for task, of_tiles in run(job, tasks)
                for of_tile in zip(task.keys, of_tiles, strict=True)
            )
            results = in_order_of(keys, found)
            return map(job.fetched, results) if step is TileStep.MAKE else results

        yield do_all
