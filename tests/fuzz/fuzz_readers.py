# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Everything that reads a file from outside: what is called with each mutated one, by name."""

import shutil
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path

from maxcon import PointMap, open_scans, read_recorded_poses, read_trajectory
from maxcon.errors import MaxconError
from maxcon.export import read_rows
from maxcon.io.clouds import open_cloud
from maxcon.io.geographic_priors import is_geographic, read_geographic_prior
from maxcon.io.recordings.point_cloud2 import CloudRecord, FieldDescription, decode_cloud
from maxcon.io.scans.description import describe
from maxcon.io.trajectories import read_prior
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.run import Study
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import Folder
from maxcon.map.store import GroundStore
from maxcon.scan.mounting import read_mounting

__all__ = ["READERS", "Reader", "record_as_bytes"]

Reader = Callable[[bytes, str, Path, Path], None]
"""Given the mutated bytes, the name of the file, an empty folder, and that of the seeds. Raises what it raises."""


def _written(data: bytes, name: str, folder: Path) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


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


def _cloud(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    path = _written(data, name, folder)

    _each(lambda: _read_cloud(path), lambda: list(open_scans(path).scans()))


def _survey(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    """Clouds of a map only: no scan comes so."""
    _read_cloud(_written(data, name, folder))


def _read_cloud(path: Path) -> None:
    with open_cloud(path) as reader:
        for _ in reader.chunks(100_000):
            pass


def _scan(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    path = _written(data, name, folder)
    _each(lambda: list(open_scans(path).scans()))


def _times(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    (folder / "0.bin").write_bytes(bytes(16))
    (folder / "1.bin").write_bytes(bytes(16))
    _written(data, name, folder)
    list(open_scans(folder).scans())


def _trajectory(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    path = _written(data, name, folder)
    _each(lambda: read_trajectory(path), lambda: read_prior(path))


def _positions(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    """What is not recognised as latitudes and longitudes is refused by the reader of poses."""
    path = _written(data, name, folder)
    if is_geographic(path):
        read_geographic_prior(path, "EPSG:25832")
    else:
        read_prior(path)


def _poses(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    read_rows(_written(data, name, folder))


def _mounting(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    read_mounting(_written(data, name, folder))


def _recording(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    path = _written(data, name, folder)
    calls = [lambda: describe(path), lambda: list(open_scans(path).scans())]
    if not name.endswith(".pcap"):
        calls += [
            lambda: read_recorded_poses(path, crs="EPSG:25832"),
            lambda: read_recorded_poses(path, is_odometry=True),
        ]
    _each(*calls)


def _transforms(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    path = _written(data, name, folder)
    read_recorded_poses(path, frames=("map", "base_link"), sensor_frame="sensor")


def _manifest(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    shutil.copytree(seeds / "city.map", folder / "city.map")
    _written(data, name, folder / "city.map")
    _read_map(folder / "city.map")


def _read_map(folder: Path) -> None:
    point_map = PointMap.open(folder)
    ground = GroundStore(Folder(folder), read_manifest(folder))
    _each(
        lambda: point_map.tiles_within(0.0, 0.0, 100.0), *(partial(ground.load, key) for key in sorted(ground.keys)[:9])
    )


def _dataset(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    (folder / "scans").mkdir()
    for part in ("reference.txt", "prior.txt", "cloud.laz"):
        (folder / part).write_bytes(b"0")
    Dataset.open(_written(data, name, folder))


def _study(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    _written(data, name, folder)
    Study.open(folder)


HEAD_OF_FIELD, HEAD_OF_RECORD = struct.Struct("<12sIBI"), struct.Struct("<IIII?q")


def record_as_bytes(record: CloudRecord) -> bytes:
    """Return a cloud message as bytes whose mutations are messages."""
    fields = [HEAD_OF_FIELD.pack(f.name.encode(), f.offset, f.datatype, f.count) for f in record.fields]
    head = HEAD_OF_RECORD.pack(
        record.width, record.height, record.point_step, record.row_step, record.is_big_endian, record.stamp
    )
    return bytes([len(fields)]) + b"".join(fields) + head + bytes(record.data)


def _message(data: bytes, name: str, folder: Path, seeds: Path) -> None:
    n_fields = data[0] % 16 if data else 0
    at = 1 + n_fields * HEAD_OF_FIELD.size
    if len(data) < at + HEAD_OF_RECORD.size:
        return
    fields = []
    for number in range(n_fields):
        text, offset, datatype, count = HEAD_OF_FIELD.unpack_from(data, 1 + number * HEAD_OF_FIELD.size)
        label = text.rstrip(b"\0").decode("latin-1")
        fields.append(FieldDescription(label, offset, datatype, count))
    head = HEAD_OF_RECORD.unpack_from(data, at)
    rest = data[at + HEAD_OF_RECORD.size :]
    decode_cloud(CloudRecord(tuple(fields), *head[:5], rest, head[5]))


READERS: dict[str, Reader] = {
    "cloud": _cloud,
    "survey": _survey,
    "scan": _scan,
    "times": _times,
    "trajectory": _trajectory,
    "positions": _positions,
    "poses": _poses,
    "mounting": _mounting,
    "recording": _recording,
    "transforms": _transforms,
    "manifest": _manifest,
    "dataset": _dataset,
    "study": _study,
    "message": _message,
}
