# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Files of a simulated dataset: map tiles, scans, trajectories, description."""

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.version import __version__
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.trajectories import write_tum
from maxcon.lab.dataset import DESCRIPTION
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.scanners import Echoes, ProfileScanner
from maxcon.lab.simulation.world import MappingDrives, ScanEpoch
from maxcon.scan.trajectory import Trajectory

TILE_EDGE = 50.0
RESOLUTION = 0.001
"""Of the stored coordinates, m."""


class MapTiles:
    """Open LAZ files (LAS 1.4, point format 6), one per square of 50 m, named by its lower left corner.

    folder: where the files go; must exist.
    frame: from city metres to global coordinates; its CRS must be known and is written into every file.
    """

    def __init__(self, folder: Path, frame: LocalFrame) -> None:
        import laspy
        import pyproj

        self._laspy = laspy
        self._crs = pyproj.CRS.from_user_input(frame.crs)
        self._folder = folder
        self._frame = frame
        self._writers: dict[tuple[int, int], Any] = {}
        self._open_files = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with laz_as_os_error():
            self._open_files.close()

    def write(self, echoes: Echoes) -> None:
        """Append `echoes` to the files they fall in."""
        points = self._frame.to_global(echoes.points)
        tiles = np.floor(points[:, :2] / TILE_EDGE).astype(np.int64)
        order = np.lexsort((tiles[:, 1], tiles[:, 0]))
        starts = np.flatnonzero(np.any(np.diff(tiles[order], axis=0, prepend=-1), axis=1))
        for rows in np.split(order, starts[1:]) if len(order) else []:
            rows.sort()
            self._append((int(tiles[rows[0], 0]), int(tiles[rows[0], 1])), points, echoes, rows)

    def _append(
        self, tile: tuple[int, int], points: NDArray[np.float64], echoes: Echoes, rows: NDArray[np.int64]
    ) -> None:
        writer = self._writers.get(tile)
        if writer is None:
            writer = self._writers[tile] = self._open(tile)
        record = self._laspy.ScaleAwarePointRecord.zeros(len(rows), header=writer.header)
        record.x, record.y, record.z = points[rows].T
        record.intensity = (echoes.intensities[rows] * 65535.0).astype(np.uint16)
        record.classification = echoes.classes[rows]
        record.gps_time = echoes.times[rows]
        record.return_number[:] = 1
        record.number_of_returns[:] = 1
        with laz_as_os_error():
            writer.write_points(record)

    def _open(self, tile: tuple[int, int]) -> Any:
        east, north = (round(index * TILE_EDGE) for index in tile)
        header = self._laspy.LasHeader(point_format=6, version="1.4")
        header.scales = np.full(3, RESOLUTION)
        header.offsets = np.array([east, north, 0.0])
        header.add_crs(self._crs)
        path = self._folder / f"tile_{east}_{north}.laz"
        # Opened here: laspy leaves a file of its own open when the disk is full, and Python warns of that much later.
        stream = self._open_files.enter_context(path.open("w+b"))
        writer = self._laspy.open(stream, mode="w", header=header, do_compress=True, closefd=False)
        return self._open_files.enter_context(writer)


CRS = "EPSG:25832"
CITY_ORIGIN = (550_000.0, 5_802_000.0, 60.0)
"""Global coordinates (ETRS89 / UTM 32N, m) of the middle of the crossing."""
SURVEYED = tuple(member for member in LasClass if member is not LasClass.UNCLASSIFIED)
"""Classes of a map in which every point is classified."""

PRIORS = {"gnss": "prior_gnss.txt", "uniform": "prior_uniform.txt"}
"""File of each prior by its name, in datasets with two priors."""

ODOMETRY = "odometry.txt"
"""File of the odometry of a dataset that has one."""

DATASET_NAMES = (
    DESCRIPTION, "map", "scans", "reference.txt", "prior.txt", "prior_*.txt", ODOMETRY,
    "drive.bag", "drive.mcap",
)  # fmt: skip
"""All that the folder of a simulated dataset may hold; what holds anything else is not overwritten."""


@contextmanager
def dataset_folder(out: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """Yield an empty folder to write a dataset to; it becomes `out` when the block ends well and vanishes otherwise."""
    if overwrite:
        check_replaceable(out, "a simulated dataset", DATASET_NAMES)
    with atomic_folder(out, overwrite=overwrite) as folder:
        yield folder


def ticker(progress: Callable[[int, int], None] | None, n_steps: int) -> Callable[[], None]:
    """Return a function to call after each of `n_steps` steps, which reports it to `progress`."""
    done = itertools.count(1)

    def tick() -> None:
        if progress is not None:
            progress(next(done), n_steps)

    return tick


def write_map(
    folder: Path, mapping: MappingDrives, scanners: Sequence[ProfileScanner], tick: Callable[[], None]
) -> None:
    """Measure the map, and stream it to the LAZ files of `folder`/map; the vehicle's trajectory stands beside them.

    folder: of the dataset.
    mapping: the drives of the mapping vehicle.
    scanners: on the mapping vehicle.
    tick: called after each piece, `mapping.n_pieces(scanners)` times.
    """
    import pyproj

    frame = LocalFrame(CITY_ORIGIN, pyproj.CRS.from_user_input(CRS).to_wkt())
    (folder / "map").mkdir()
    with MapTiles(folder / "map", frame) as tiles:
        for echoes in mapping.echoes(scanners):
            tiles.write(echoes)
            tick()
    write_trajectory(folder / "map/trajectory.txt", *mapping.poses(), "T_map_vehicle")


def write_scans(
    folder: Path,
    times: NDArray[np.float64],
    references: Sequence[Pose],
    scans: Iterable[Echoes],
    tick: Callable[[], None],
) -> None:
    """Stream scans to `folder`/scans, in the sensor frame, with their times and reference poses.

    folder: of the dataset.
    times: shape (n,); s.
    references: T_city_sensor, one per scan.
    scans: in city metres, one per scan.
    tick: called after each scan.
    """
    place = folder / "scans"
    place.mkdir()
    for number, (reference, echoes) in enumerate(zip(references, scans, strict=True)):
        points_sensor = (echoes.points - reference.position) @ reference.rotation
        rows = np.column_stack([points_sensor, echoes.intensities]).astype("<f4")
        (place / f"{number:06d}.bin").write_bytes(rows.tobytes())
        tick()
    (place / "times.txt").write_text("".join(f"{time:.6f}\n" for time in times), encoding="utf-8", newline="\n")
    write_trajectory(folder / "reference.txt", times, references, "T_map_sensor")


def write_epochs(
    folder: Path,
    epochs: Sequence[ScanEpoch],
    scans: Iterable[Echoes],
    priors: Mapping[str, Sequence[Pose]],
    tick: Callable[[], None],
) -> None:
    """Write scans with their times and reference poses, and the priors.

    folder: of the dataset.
    epochs: one per scan.
    scans: in city metres, one per scan.
    priors: T_city_sensor, one per scan, by a name of `PRIORS`.
    tick: called after each scan.
    """
    times = np.array([epoch.time for epoch in epochs])
    write_scans(folder, times, [epoch.reference for epoch in epochs], scans, tick)
    for name, poses in priors.items():
        write_trajectory(folder / PRIORS[name], times, poses, f"T_map_sensor, prior {name}")


def write_trajectory(path: Path, times: NDArray[np.float64], poses: Sequence[Pose], what: str) -> None:
    """Write `poses`, T_city_x, in global coordinates as a TUM file; `what` they are goes into its comment."""
    poses_global = [pose.translated(CITY_ORIGIN) for pose in poses]
    write_tum(path, Trajectory.from_poses(times, poses_global), f"{what}, {CRS}, seconds of the week")


def write_odometry(folder: Path, times: NDArray[np.float64], poses: Sequence[Pose]) -> None:
    """Write odometry, T_odometry_sensor, as a TUM file; its frame is not georeferenced."""
    write_tum(folder / ODOMETRY, Trajectory.from_poses(times, poses), "T_odometry_sensor, seconds of the week")


def write_description(
    folder: Path,
    words: str,
    priors: Mapping[str, str],
    classes: Iterable[LasClass] = SURVEYED,
    *,
    has_odometry: bool = False,
    map_sigma: float | None = None,
) -> None:
    """Write the description of the dataset in `folder`.

    folder: of the dataset.
    words: what it is, for the comment at the top: seed and number of epochs.
    priors: file in `folder` by the name of the prior.
    classes: those that points of the map have.
    has_odometry: whether the dataset has odometry, as `write_odometry` writes it.
    map_sigma: standard deviation of the map's position, m; if None it is left to be estimated from its rounds.
    """
    odometry = f'odometry = "{ODOMETRY}"\n' if has_odometry else ""
    sigma = "" if map_sigma is None else f"sigma = {map_sigma}\n"
    classes_named = ", ".join(f"{member.name.lower()} {member.value}" for member in classes)
    named = "\n".join(f'{name} = "{file}"' for name, file in priors.items())
    text = f"""# A dataset simulated by maxcon {__version__}: {words}.
# Classes of the map: {classes_named}.

[map]
clouds = "map/tile_*.laz"
trajectory = "map/trajectory.txt"
crs = "{CRS}"
vehicle_classes = [{LasClass.VEHICLE.value}]
{sigma}
[scans]
folder = "scans"
times = "scans/times.txt"
reference = "reference.txt"
{odometry}
[priors]
{named}
"""
    (folder / DESCRIPTION).write_text(text, encoding="utf-8", newline="\n")
