"""Everything that reads a file from outside: what is called with each mutated one, by name."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from maxcon import PointMap, open_scans, read_recorded_poses, read_trajectory
from maxcon.errors import MaxconError
from maxcon.export import read_rows
from maxcon.io.clouds import Bounds, open_cloud
from maxcon.io.geographic_priors import is_geographic, read_geographic_prior
from maxcon.io.scans import describe
from maxcon.io.trajectories import read_poses_of_scans, read_prior
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.run import Study
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import Folder
from maxcon.map.store import stored_ground
from maxcon.mapping.georeference import read_control_points
from maxcon.scan.mounting import read_mounting

Reader = Callable[[bytes, str, Path, Path], None]
"""Given the mutated bytes, the name of the file, an empty folder, and that of the seeds. Raises what it raises."""


def _of_file(*calls: Callable[[Path], object]) -> Reader:
    """Return a reader that writes the file and calls all, whatever the first says; the first refusal is raised."""

    def read(data: bytes, name: str, folder: Path, seeds: Path) -> None:
        path = folder / name
        path.write_bytes(data)
        # Packets have no poses.
        _each(*(partial(call, path) for call in (calls[:2] if name.endswith(".pcap") else calls)))

    return read


def _each(*calls: Callable[[], object]) -> None:
    """Call all, whatever the first says; the first refusal is raised in the end."""
    refusals = []
    for call in calls:
        try:
            call()
        except MaxconError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]


def _cloud(path: Path) -> None:
    with open_cloud(path) as reader:
        for _ in reader.chunks(100_000):
            pass


def _part(path: Path) -> None:
    with open_cloud(path) as reader:
        for _ in reader.chunks(100_000, Bounds(1.0, 1.0, 15.0, 15.0)):
            pass


def _scans(path: Path) -> None:
    list(open_scans(path).scans())


def _times(path: Path) -> None:
    for name in ("0.bin", "1.bin"):
        (path.parent / name).write_bytes(bytes(16))
    _scans(path.parent)


def _positions(path: Path) -> None:
    """What is not recognised as latitudes and longitudes is refused by the reader of poses."""
    if is_geographic(path):
        read_geographic_prior(path, "EPSG:25832")
    else:
        read_prior(path)


def _manifest(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    there = folder / "city.map"
    shutil.copytree(seeds / "city.map", there)
    (there / name).write_bytes(data)
    point_map = PointMap.open(there)
    ground = stored_ground(Folder(there), read_manifest(there))
    keys = sorted(ground.keys)[:9]
    _each(partial(point_map.tiles_within, 0.0, 0.0, 100.0), *(partial(ground.load, key) for key in keys))


def _dataset(path: Path) -> None:
    (path.parent / "scans").mkdir()
    for part in ("reference.txt", "prior.txt", "cloud.laz"):
        (path.parent / part).write_bytes(b"0")
    Dataset.open(path)


READERS: dict[str, Reader] = {
    "cloud": _of_file(_cloud, _scans),
    "survey": _of_file(_cloud),  # clouds of a map only: no scan comes so
    "scan": _of_file(_scans),
    "part": _of_file(_part),
    "times": _of_file(_times),
    "trajectory": _of_file(read_trajectory, read_prior),
    "poses of scans": _of_file(partial(read_poses_of_scans, times=np.arange(4.0))),
    "control points": _of_file(read_control_points),
    "positions": _of_file(_positions),
    "poses": _of_file(read_rows),
    "mounting": _of_file(read_mounting),
    "recording": _of_file(
        describe, _scans, partial(read_recorded_poses, crs="EPSG:25832"), partial(read_recorded_poses, is_odometry=True)
    ),
    "transforms": _of_file(partial(read_recorded_poses, frames=("map", "base_link"), sensor_frame="sensor")),
    "manifest": _manifest,
    "dataset": _of_file(_dataset),
    "study": _of_file(lambda path: Study.open(path.parent)),
}
