# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A simulated dataset on disk: map cloud, scans, reference and priors, in the files real ones come in."""

import itertools
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon import __version__
from maxcon.atomic import atomic_folder, check_replaceable
from maxcon.dataset import DESCRIPTION, Dataset
from maxcon.errors import OptionError
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.trajectories import write_tum
from maxcon.simulation.drive import PriorErrors
from maxcon.simulation.las_classes import LasClass
from maxcon.simulation.map_tiles import MapTiles
from maxcon.simulation.scanners import ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.simulation.world import Epoch, SimulatedWorld
from maxcon.trajectory import Trajectory

__all__ = ["CITY_ORIGIN", "CRS", "simulate"]

CRS = "EPSG:25832"
CITY_ORIGIN = (550_000.0, 5_802_000.0, 60.0)
"""Global coordinates (ETRS89 / UTM 32N, m) of the middle of the crossing."""
TRAJECTORY_STEP = 0.02
"""Between two poses of the mapping vehicle's trajectory, s."""
DATASET_NAMES = (DESCRIPTION, "map", "scans", "reference.txt", "prior.txt")
"""All that the folder of a dataset holds."""


def simulate(
    out: str | os.PathLike[str],
    *,
    n_epochs: int = 40,
    seed: int = 0,
    before: float = 75.0,
    after: float = 50.0,
    mapping_scanners: Sequence[ProfileScanner] | None = None,
    scanner: RotatingScanner | None = None,
    prior_errors: PriorErrors | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Write a seeded dataset: a city is mapped, and driven through on another day.

    Parameters
    ----------
    out : path
        Folder to write; it appears only when everything in it is whole.
    n_epochs : int
        How many scans, evenly spaced in time.
    seed : int
        The same seed gives the same city, drives, scans, priors and map points.
    before, after : float
        How far from the middle of the crossing the scans begin and end, m.
    mapping_scanners : sequence of ProfileScanner, optional
        On the mapping vehicle; two turned by 45 degrees to either side if None.
    scanner : RotatingScanner, optional
        On the car; a VLP-16 if None.
    prior_errors : PriorErrors, optional
        How far the priors are off; up to 2.5 m and 1.8 degrees if None.
    overwrite : bool
        Whether a dataset that stands there is replaced; anything else there is an error.
    progress : callable, optional
        Called with (done, total) after each step.

    Returns
    -------
    Dataset
        Where its parts lie.

    Raises
    ------
    OptionError
        If `n_epochs` is below 1, `seed` is negative or the route is too short.
    MissingExtraError
        If embreex is not installed.
    FileError
        If `out` exists and `overwrite` is False, or cannot be written.

    Notes
    -----
    The default has some 4 million map points within 60 m of the mapping vehicle and 27,000 points per scan.
    """
    if n_epochs < 1:
        raise OptionError(f"Expected at least one epoch, got n_epochs = {n_epochs}. The default is 40.")
    if overwrite:
        check_replaceable(out, "a simulated dataset", DATASET_NAMES)
    with atomic_folder(out, overwrite=overwrite) as folder:
        world = SimulatedWorld.build(seed, before, after)
        epochs = world.epochs(n_epochs, prior_errors or PriorErrors())
        profiles = mapping_scanners or mobile_mapping_scanners()
        tick = _ticker(progress, world.n_pieces(profiles) + n_epochs)
        _write_description(folder, seed, n_epochs)
        _write_map(folder, world, profiles, tick)
        _write_scans(folder, world, epochs, scanner or RotatingScanner(), tick)
    return Dataset.open(out)


def _ticker(progress: Callable[[int, int], None] | None, n_steps: int) -> Callable[[], None]:
    """Return what to call after each step, so that `progress` hears of it."""
    done = itertools.count(1)

    def tick() -> None:
        if progress is not None:
            progress(next(done), n_steps)

    return tick


def _global_frame() -> LocalFrame:
    import pyproj

    return LocalFrame(CITY_ORIGIN, pyproj.CRS.from_user_input(CRS).to_wkt())


def _write_map(
    folder: Path, world: SimulatedWorld, scanners: Sequence[ProfileScanner], tick: Callable[[], None]
) -> None:
    """Write map clouds and the trajectory of the mapping vehicle."""
    frame = _global_frame()
    (folder / "map").mkdir()
    with MapTiles(folder / "map", frame) as tiles:
        for echoes in world.map_echoes(scanners):
            tiles.write(echoes)
            tick()
    times = [np.arange(drive.times[0], drive.times[-1], TRAJECTORY_STEP) for drive in world.map_drives]
    poses = [pose for drive, t in zip(world.map_drives, times, strict=True) for pose in drive.poses(t)]
    _write_trajectory(folder / "map/trajectory.txt", np.concatenate(times), poses, "T_map_vehicle")


def _write_scans(
    folder: Path,
    world: SimulatedWorld,
    epochs: Sequence[Epoch],
    scanner: RotatingScanner,
    tick: Callable[[], None],
) -> None:
    """Write scans with their times, reference and priors."""
    scans = folder / "scans"
    scans.mkdir()
    for epoch in epochs:
        echoes = world.scan(epoch, scanner)
        points_sensor = (echoes.points - epoch.reference.position) @ epoch.reference.rotation
        rows = np.column_stack([points_sensor, echoes.intensities]).astype("<f4")
        (scans / f"{epoch.number:06d}.bin").write_bytes(rows.tobytes())
        tick()
    times = np.array([epoch.time for epoch in epochs])
    (scans / "times.txt").write_text(
        "".join(f"{time:.6f}\n" for time in times), encoding="utf-8", newline="\n"
    )
    _write_trajectory(folder / "reference.txt", times, [epoch.reference for epoch in epochs], "T_map_sensor")
    _write_trajectory(folder / "prior.txt", times, [epoch.prior for epoch in epochs], "T_map_sensor, prior")


def _write_trajectory(path: Path, times: NDArray[np.float64], poses: Sequence[Pose], what: str) -> None:
    """Write `poses` (T_city_sensor) in global coordinates."""
    poses_global = [pose.translated(CITY_ORIGIN) for pose in poses]
    write_tum(path, Trajectory.from_poses(times, poses_global), f"{what}, {CRS}, seconds of the week")


def _write_description(folder: Path, seed: int, n_epochs: int) -> None:
    classes = ", ".join(f"{member.name.lower()} {member.value}" for member in LasClass)
    text = f"""# A dataset simulated by maxcon {__version__}: seed {seed}, {n_epochs} epochs.
# Classes of the map: {classes}.

[map]
clouds = "map/tile_*.laz"
trajectory = "map/trajectory.txt"
crs = "{CRS}"
vehicle_classes = [{LasClass.VEHICLE.value}]

[scans]
folder = "scans"
times = "scans/times.txt"
reference = "reference.txt"

[priors]
uniform = "prior.txt"
"""
    (folder / DESCRIPTION).write_text(text, encoding="utf-8", newline="\n")
