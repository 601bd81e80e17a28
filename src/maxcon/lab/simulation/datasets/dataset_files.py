# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The files of a simulated dataset: map clouds, scans, trajectories and their description."""

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.version import __version__
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.trajectories import write_tum
from maxcon.lab.dataset import DESCRIPTION
from maxcon.lab.simulation.datasets.map_tiles import MapTiles
from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.sensing.scanners import Echoes, ProfileScanner
from maxcon.lab.simulation.worlds.mapping_drives import MappingDrives
from maxcon.lab.simulation.worlds.scan_epochs import ScanEpoch
from maxcon.scan.trajectory import Trajectory

__all__ = [
    "CITY_ORIGIN",
    "CRS",
    "ODOMETRY",
    "PRIORS",
    "dataset_folder",
    "ticker",
    "write_description",
    "write_epochs",
    "write_map",
    "write_odometry",
    "write_scans",
    "write_trajectory",
]

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
