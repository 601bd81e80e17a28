"""Maps that are not made of clouds: of the scans of a drive, and of another map that is moved."""

import os
from collections.abc import Generator
from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path
from shutil import rmtree

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.atomic import lift
from maxcon._system.engine import Engine
from maxcon.errors import MapError, OptionError, TrajectoryError
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.clouds import Bounds, CloudChunk, CloudHeader, CloudReader
from maxcon.io.raw_scan import Scans
from maxcon.map.ground import ground_voxels
from maxcon.map.layout import NOT_SEARCHED
from maxcon.map.manifest import Manifest, read_manifest, write_manifest
from maxcon.map.storage import open_storage
from maxcon.map.store import map_folder, stored_ground, stored_tiles
from maxcon.map.tile import VoxelTile
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.options import GROUND, UNCLASSIFIED
from maxcon.mapping.georeference import Georeference
from maxcon.mapping.update import LocalizedDrive, UpdateOptions, update_map
from maxcon.scan.trajectory import Trajectory

COUNTED_INTERVAL = 0.1  # s; between scans whose times are whole numbers: they were counted, a turn takes as long
NEVER = 1e6  # log-odds that nothing reaches: whatever the rays hit is in the map already, or was left out on purpose
AS_PLACED = "scans-as-placed"
STEPS = 3  # points along an axis of the surface in a voxel, 2 cm apart at 6 cm: turned voxels have no holes


class PlacedScans(CloudReader):
    """Scans of a drive as one cloud, each where its pose (T_map_sensor) puts it, with the time of the scan.

    Scans without a pose, for which one must be known `margin` (s) before and after, too, are left out;
    TrajectoryError if all are.
    """

    def __init__(
        self, scans: Scans, poses: Trajectory, path: str | os.PathLike[str], *, min_range: float = 1.0,
        max_range: float = 120.0, margin: float = 0.0, poses_path: str | os.PathLike[str] = "",
    ) -> None:  # fmt: skip
        super().__init__()
        self.scans, self.ranges, self.poses_path = scans, (min_range, max_range), Path(poses_path)
        self.poses = dict[int, Pose]()
        for i, time in enumerate(scans.times.tolist()):
            with suppress(TrajectoryError):  # no pose is near: counted, and told
                self.poses[i] = [poses.at(time + offset) for offset in (-margin, margin, 0.0)][-1]
        if not self.poses:
            raise TrajectoryError(
                f"Expected poses at the times of the scans in {path}, {scans.times[0]:.3f} to {scans.times[-1]:.3f} s,"
                f" got some from {poses.times[0]:.3f} to {poses.times[-1]:.3f} s, and none at any of them. Do both use"
                " the same clock? Poses without times, one per scan, are given as KITTI has them: 12 numbers a line."
            )
        # Not from 0 on: LAS files whose times are all 0 have none.
        self._times = COUNTED_INTERVAL * (scans.times + 1.0) if self.are_counted else scans.times
        first = len(scans.read(next(iter(self.poses)), min_range, max_range).points)
        self.header = CloudHeader(Path(path), first * len(self.poses), has_times=True)

    @property
    def are_counted(self) -> bool:
        """Whether the times of the scans are but numbers, 0, 1, 2, not seconds."""
        return len(self.scans) > 1 and bool((self.scans.times % 1.0 == 0.0).all())

    @property
    def words(self) -> str:
        """How many scans have a pose, and how their times were understood, in a line."""
        n_without = len(self.scans) - len(self.poses)
        without = f"; {n_without:,} have no pose at their time, and are left out" if n_without else ""
        counted = f"; their times are whole numbers, taken as {COUNTED_INTERVAL:g} s apart" if self.are_counted else ""
        return f"scans: {len(self.poses):,} of {len(self.scans):,} placed by their poses{without}{counted}"

    @property
    def trajectory(self) -> Trajectory:
        """Where the sensor was at the times of the points."""
        rows = list(self.poses)
        return Trajectory.from_poses(self._times[rows], list(self.poses.values()))

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        points, times = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
        for i, pose in self.poses.items():
            points.append(pose.apply(self.scans.read(i, *self.ranges).points))
            times.append(np.full(len(points[-1]), self._times[i]))
            is_last = i == next(reversed(self.poses))
            if (n := sum(map(len, points))) >= max_points or (is_last and n):  # a scan is not cut
                yield CloudChunk(np.concatenate(points), times=np.concatenate(times))
                points, times = [], []


def map_of_drive(
    placed: PlacedScans, out: str | os.PathLike[str], options: MapOptions | None = None, *, keep_moving: bool = False,
    overwrite: bool = False, n_threads: int | None = None, engine: Engine | None = None,
    progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Build a map of the scans of a drive, as `build_map`; what later rays went through is gone, or stays."""
    options = replace(options or MapOptions(), trajectory=placed.trajectory)
    if options.to_crs is not None:
        raise OptionError("Expected poses in the CRS of the map, got --to-crs with scans. Leave it out; see --crs.")
    if keep_moving:
        return build_map(
            [placed], out, options, overwrite=overwrite, n_threads=n_threads, engine=engine, progress=progress
        )
    drive = LocalizedDrive.of_poses(placed.scans, placed.poses, placed.poses_path)
    judged = UpdateOptions(min_range=placed.ranges[0], max_range=placed.ranges[1], new_at=NEVER)
    with map_folder(out, overwrite=overwrite) as folder:
        before, after = folder / AS_PLACED, folder / "map"
        build_map([placed], before, options, n_threads=n_threads, engine=engine, progress=progress)
        manifest = update_map(before, [drive], after, judged, progress=progress)
        rmtree(before)
        lift(after)
    return manifest


class MovedMap(CloudReader):
    """The surfaces of a map, moved, as a cloud with normals, ground as its own class; what is gone is left out."""

    def __init__(self, path: str | os.PathLike[str], moved: Georeference) -> None:
        super().__init__()
        storage = open_storage(path)
        self.manifest, self._moved = read_manifest(storage), moved
        self._frame = LocalFrame(self.manifest.origin)
        self._tiles = stored_tiles(storage, self.manifest, cache_bytes=0, left_out=NOT_SEARCHED)
        self._ground = stored_ground(storage, self.manifest)
        self.header = CloudHeader(
            Path(path), STEPS**2 * self.manifest.n_voxels, has_normals=True, has_classes=True, has_asprs_classes=True
        )

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        for key in sorted(self._tiles.keys):
            tile, n_most = self._tiles.load(key), max(1, max_points // STEPS**2)
            for first in range(0, len(tile), n_most):
                some = tile.rows(np.arange(first, min(first + n_most, len(tile))))
                yield self._chunk(*surface_points(some, self.manifest.cell), min(UNCLASSIFIED))
        edge = ground_voxels(self.manifest.cell) * self.manifest.cell
        for key in sorted(self._ground.keys):
            heights = self._ground.load(key)
            points = np.concatenate([heights.points(edge, at) for at in product((0.25, 0.75), repeat=2)])
            yield self._chunk(points, np.zeros((len(points), 3)), min(GROUND))

    def _chunk(self, points: NDArray[np.float64], normals: NDArray[np.float64], number: int) -> CloudChunk:
        places = self._moved.apply(self._frame.to_global(points))
        return CloudChunk(places, normals @ self._moved.rotation.T, np.full(len(points), number, np.uint8))


def surface_points(tile: VoxelTile, cell: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points on the plane in each voxel, its mean alone without a normal, and their normals, both (n, 3), m."""
    means, normals = tile.mean_points(cell), tile.normals.astype(np.float64)
    corners = tile.voxels * cell
    steepest = np.argmax(np.abs(normals), axis=1)
    rows, flat = np.arange(len(means)), np.array([[1, 2], [0, 2], [0, 1]])[steepest]
    is_plane = normals.any(axis=1)
    points, of_points = [means[~is_plane]], [normals[~is_plane]]
    for one, other in product((np.arange(STEPS) + 0.5) / STEPS * cell, repeat=2):
        places = means.copy()
        for axis, step in zip(flat.T, (one, other), strict=True):
            places[rows, axis] = corners[rows, axis] + step
        off = ((places - means) * normals).sum(axis=1)
        down = np.divide(off, normals[rows, steepest], out=np.zeros_like(off), where=is_plane)
        places[rows, steepest] -= down
        is_inside = is_plane & (np.abs(places - corners - 0.5 * cell) <= 0.5 * cell).all(axis=1)
        points.append(places[is_inside])
        of_points.append(normals[is_inside])
    return np.concatenate(points), np.concatenate(of_points)


def move_map(
    path: str | os.PathLike[str], moved: Georeference, crs: str, out: str | os.PathLike[str], *,
    overwrite: bool = False, progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Write a map where a georeference puts it, in a CRS; its sigma is that of the map and of the georeference."""
    if Path(path).resolve() == Path(out).resolve():
        raise MapError(f"Expected another folder than the map itself, got {out}. Name another.")
    source = MovedMap(path, moved)
    before = source.manifest
    sigma = round(float(np.hypot(before.sigma, moved.sigma)), 4)
    options = MapOptions(cell=before.cell, normals_have_sides=before.is_signed, crs=crs, sigma=sigma)
    with map_folder(out, overwrite=overwrite) as folder:
        build_map([source], folder / "map", options, progress=progress)
        made = read_manifest(folder / "map")
        parent = {"name": Path(path).name, "sha256": before.sha256}
        kept = {name: before.build[name] for name in ("ground", "spacing") if name in before.build}
        placed = {"sigma": {"from": "georeference"}, "georeference": {**moved.describe(), "parent": parent}}
        build = {**made.build, **kept, **placed}
        write_manifest(folder / "map", replace(made, build=build))
        lift(folder / "map")
    return read_manifest(out)
