# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Small good files of every kind that is read: what mutations begin with. Others from a folder are added."""

import csv
import io
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
import pyarrow
import pyarrow.parquet
import pye57
from fuzz_readers import record_as_bytes
from pyproj import CRS

from maxcon import Pose, Trajectory, open_scans
from maxcon.drive.poses_dataset import poses_schema
from maxcon.drive.poses_table import COLUMNS
from maxcon.io.clouds import CLOUD_SUFFIXES
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, RECORDING_SUFFIXES
from maxcon.io.recordings.point_cloud2 import CloudRecord, FieldDescription
from maxcon.io.recordings.writing import Entry, RecordingKind, RecordingWriter, bag_writer, header_of, open_writer
from maxcon.io.trajectories import write_csv, write_tum
from maxcon.lab.simulation.recordings import drive_messages
from maxcon.mapping.build import MapOptions, build_map

__all__ = ["Seed", "make_seeds", "seeds_of"]

N_POINTS = 60
LARGEST = 150_000
"""Bytes of a file of others: larger ones take longer than they tell."""
RNG = np.random.default_rng(0)
POINTS = np.round(RNG.uniform(2.0, 9.0, (N_POINTS, 3)), 3)
CONFIGURATION = {
    "version": "1",
    "dataset": "dataset.toml",
    "parts": {"reference": "ab"},
    "n_scans": 3,
    "options": {"min_range": 1.0},
    "methods": {"helmert": {"method": {}, "map": "standard", "starts": "from the prior"}},
    "maps": {"standard": {}},
    "runs": [{"methods": ["helmert"], "priors": ["gnss"], "n_epochs": 3, "n_workers": 1, "n_rows": 3}],
}
MOUNTING = """[prior]
position = [-0.45, 0.30, 1.62]
[scanner.front]
topic = "/points"
pitch_deg = 2.5
[scanner.rear]
scans = "rear.bag"
"""
DATASET = """[map]
clouds = "*.laz"
crs = "EPSG:25832"
vehicle_classes = [64]
drop = ["ground"]
sigma = 0.01

[scans]
folder = "scans"
reference = "reference.txt"

[priors]
gnss = "prior.txt"
"""


class Seed(NamedTuple):
    """A good file."""

    label: str
    reader: str
    name: str
    data: bytes


def make_seeds(folder: Path, others: Path | None = None) -> list[Seed]:
    """Write what seeds need into an empty folder, and return them; the same ones each time.

    Parameters
    ----------
    folder : Path
        For good.
    others : Path, optional
        A folder whose small files are seeds, too: real ones.
    """
    made = [
        *_clouds(),
        *_surveys(folder),
        *_scans(),
        *_trajectories(folder),
        *_positions(),
        *_recordings(folder),
        *_maps(folder),
        *_others_of_ours(folder),
        *_poses(),
    ]
    return made + ([] if others is None else list(seeds_of(others)))


def seeds_of(folder: Path) -> Iterator[Seed]:
    """Yield the files of a folder that some reader is for."""
    readers = {**dict.fromkeys(CLOUD_SUFFIXES, "cloud"), ".pcd": "scan"}
    readers |= dict.fromkeys((*RECORDING_SUFFIXES, CAPTURE_SUFFIX), "recording")
    for path in sorted(folder.rglob("*")):
        suffix = path.suffix.lower()
        if suffix in readers and path.is_file() and 0 < path.stat().st_size <= LARGEST:
            yield Seed(str(path.relative_to(folder)), readers[suffix], f"1.5{suffix}", path.read_bytes())


def _clouds() -> Iterator[Seed]:
    for point_format, version in ((1, "1.2"), (3, "1.2"), (6, "1.4"), (8, "1.4")):
        las = laspy.LasData(laspy.LasHeader(point_format=point_format, version=version))
        las.header.offsets, las.header.scales = POINTS[0], np.full(3, 1e-3)
        las.x, las.y, las.z = POINTS.T
        las.classification[:] = 6
        las.header.add_crs(CRS.from_epsg(25832))
        for suffix in ("las", "laz"):
            stream = io.BytesIO()
            las.write(stream, do_compress=suffix == "laz")
            yield Seed(f"{suffix} {point_format}", "cloud", f"1.5.{suffix}", _content(stream))
    arrays = {"points": POINTS, "normals": np.tile([0.0, 0.0, 1.0], (N_POINTS, 1)), "classes": np.full(N_POINTS, 6)}
    for label, save in (("npz", np.savez), ("npz compressed", np.savez_compressed)):
        stream = io.BytesIO()
        save(stream, **arrays)
        yield Seed(label, "cloud", "1.5.npz", stream.getvalue())
    rows = "\n".join(f"{x} {y} {z} 0 0 1" for x, y, z in POINTS)
    for kind, body in (
        ("ascii", rows.encode()),
        ("binary_little_endian", np.hstack([POINTS, arrays["normals"]]).astype("<f4").tobytes()),
        ("binary_big_endian", np.hstack([POINTS, arrays["normals"]]).astype(">f4").tobytes()),
    ):
        properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        head = f"ply\nformat {kind} 1.0\ncomment by hand\nelement vertex {N_POINTS}\n{properties}end_header\n"
        yield Seed(f"ply {kind}", "cloud", "1.5.ply", head.encode() + body)


def _surveys(folder: Path) -> Iterator[Seed]:
    file = pye57.E57(str(folder / "two.e57"), mode="w")
    for translation in ([0.0, 0.0, 0.0], [550_000.0, 5_802_000.0, 60.0]):
        columns = {f"cartesian{axis}": POINTS[:, i].copy() for i, axis in enumerate("XYZ")}
        columns["cartesianInvalidState"] = np.zeros(N_POINTS, np.int8)
        pose = {"rotation": np.array([1.0, 0.0, 0.0, 0.0]), "translation": np.array(translation)}
        file.write_scan_raw(columns, **pose)
    file.close()
    yield Seed("e57", "survey", "1.5.e57", (folder / "two.e57").read_bytes())
    rows = "".join(f"{x} {y} {z} 6\n" for x, y, z in POINTS)
    yield Seed("xyz", "survey", "1.5.xyz", rows.encode())
    named = "X,Y,Z,classification\n" + rows.replace(" ", ",")
    yield Seed("csv cloud", "survey", "1.5.csv", named.encode())


def _content(stream: io.BytesIO) -> bytes:
    stream.seek(0)
    return stream.read()


def _scans() -> Iterator[Seed]:
    single = POINTS.astype("<f4")
    yield Seed("kitti", "scan", "1.5.bin", np.hstack([single, single[:, :1]]).tobytes())
    rows = "\n".join(f"{x} {y} {z}" for x, y, z in POINTS).encode()
    for kind, body in (("ascii", rows), ("binary", single.tobytes())):
        head = (
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {N_POINTS}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {N_POINTS}\nDATA {kind}\n"
        )
        yield Seed(f"pcd {kind}", "scan", "1.5.pcd", head.encode() + body)
    yield Seed("times", "times", "times.txt", b"1.5\n2.5\n")
    fields = tuple(FieldDescription(name, 4 * i, 7) for i, name in enumerate(("x", "y", "z", "t")))
    data = np.hstack([single, np.linspace(0.0, 0.1, N_POINTS, dtype="<f4")[:, None]]).tobytes()
    record = CloudRecord(fields, N_POINTS, 1, 16, 16 * N_POINTS, False, data, 1_500_000_000)
    yield Seed("message", "message", "", record_as_bytes(record))


def _drive() -> Trajectory:
    poses = [Pose(550_000.0 + 2.0 * i, 5_802_000.0 + 0.1 * i, 50.0, 0.0, 0.0, 0.05 * i) for i in range(6)]
    covariances = np.tile(np.diag([1.0, 1.0, 1e-3]), (6, 1, 1))
    return Trajectory.from_poses(np.arange(6.0), poses, covariances)


def _trajectories(folder: Path) -> Iterator[Seed]:
    write_tum(folder / "tum.txt", _drive(), "by hand")
    write_csv(folder / "prior.csv", _drive())
    sigmas = "time,x,y,z,roll_deg,pitch_deg,heading_deg,sigma_x,sigma_y,sigma_heading_deg\n"
    sigmas += "".join(f"{i},{550000 + i},5802000,50,0,0,{i},1.5,1.5,2\n" for i in range(6))
    yield Seed("tum", "trajectory", "a.txt", (folder / "tum.txt").read_bytes())
    yield Seed("csv", "trajectory", "a.csv", (folder / "prior.csv").read_bytes())
    yield Seed("csv with sigmas", "trajectory", "a.csv", sigmas.encode())


NMEA = (
    "GNGGA,120000.00,5220.0000000,N,00944.0000000,E,4,12,0.8,60.1,M,46.2,M,,",
    "GNRMC,120000.00,A,5220.0000000,N,00944.0000000,E,1.0,84.4,221126,,,A",
    "GNGST,120000.00,0.9,0.6,0.4,12.0,0.5,0.5,0.9",
    "GNHDT,84.4,T",
    "GNZDA,120000.00,22,11,2026,00,00",
    "GNGGA,120001.00,5220.0010000,N,00944.0100000,E,4,12,0.8,60.2,M,46.2,M,,",
)
POSITIONS = """time,latitude,longitude,ellipsoidal_height,heading_deg,sigma_x,sigma_y
100,52.0,9.7300,60.5,84.4,0.5,0.6
101,52.0,9.7301,60.5,84.4,0.5,0.6
102,52.0,9.7302,60.6,84.4,0.5,0.6
"""
PARTS = """[sensor]
position = [1.1, 0.2, 1.9]
roll_deg = 1.0
[prior]
position = [-0.4, 0.3, 1.6]
heading_deg = 90.0
[odometry]
position = [0.0, 0.0, 0.0]
"""


def _positions() -> Iterator[Seed]:
    log = "".join(f"${body}*{reduce(xor, body.encode()):02X}\r\n" for body in NMEA)
    yield Seed("nmea", "positions", "gnss.nmea", log.encode())
    yield Seed("latitudes", "positions", "gnss.csv", POSITIONS.encode())
    yield Seed("mounting", "mounting", "mounting.toml", PARTS.encode())


def _recordings(folder: Path) -> Iterator[Seed]:
    (folder / "scans").mkdir()
    for i in range(3):
        (folder / "scans" / f"{i}.5.bin").write_bytes(np.hstack([POINTS, POINTS[:, :1]]).astype("<f4").tobytes())
    scans = open_scans(folder / "scans")
    for kind in (*RecordingKind, None):
        path = folder / ("drive" if kind is None else f"drive.{kind}")
        with _ros2_writer(path) if kind is None else open_writer(path, kind) as writer:
            for entry in drive_messages(scans, _drive(), "EPSG:25832", odometry=_drive()):
                writer.write(entry)
        for file in [path] if path.is_file() else sorted(path.glob("*.db3")):
            yield Seed(file.suffix, "recording", f"drive{file.suffix}", file.read_bytes())
    yield Seed("pcap", "recording", "drive.pcap", _capture())
    for kind in RecordingKind:
        path = folder / f"tf.{kind}"
        _write_transforms(path, kind)
        yield Seed(f"tf {kind}", "transforms", path.name, path.read_bytes())


@contextmanager
def _ros2_writer(path: Path) -> Iterator[RecordingWriter]:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        yield bag_writer(store, bag, store.serialize_cdr)


def _write_transforms(path: Path, kind: RecordingKind) -> None:
    """Write a way of a vehicle in a map, and a scanner on it, as transforms."""
    turn, place = dict(x=0.0, y=0.0, z=0.0, w=1.0), dict(x=1.0, y=2.0, z=0.0)
    with open_writer(path, kind) as writer:
        for time, topic, parent, child in (
            (1.0, "/tf_static", "base_link", "sensor"),
            (1.0, "/tf", "map", "odom"),
            (1.0, "/tf", "odom", "base_link"),
            (2.0, "/tf", "map", "odom"),
            (2.0, "/tf", "odom", "base_link"),
        ):
            transform = {"translation": place, "rotation": turn}
            content = {
                "transforms": [{"header": header_of(time, parent), "child_frame_id": child, "transform": transform}]
            }
            writer.write(Entry(time, topic, "tf2_msgs/msg/TFMessage", content))


def _capture() -> bytes:
    """Return packets of a VLP-16 in a packet capture."""
    packets = [struct.pack("<IHHIIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for number in range(80):
        blocks = b""
        for block in range(12):
            azimuth = (number * 12 + block) * 40 % 36000
            blocks += struct.pack("<HH", 0xEEFF, azimuth) + struct.pack("<HB", 2500, 9) * 32
        payload = blocks + struct.pack("<IBB", number * 1327, 0x37, 0x22)
        udp = struct.pack(">HHHH", 2368, 2368, 8 + len(payload), 0) + payload
        addresses = bytes([192, 168, 1, 201]) + bytes([255] * 4)
        packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses + udp
        frame = bytes([255] * 6) + bytes(6) + b"\x08\x00" + packet
        packets.append(struct.pack("<IIII", 1_600_000_000, number * 1327, len(frame), len(frame)) + frame)
    return b"".join(packets)


def _maps(folder: Path) -> Iterator[Seed]:
    along, up = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 6.0, 0.1), np.arange(0.0, 3.0, 0.1)))
    wall = np.column_stack([along, np.full_like(along, 2.0), up])
    ground = np.column_stack([along, 2.0 * up, np.zeros_like(along)])
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales = np.full(3, 1e-3)
    las.x, las.y, las.z = np.concatenate([wall, ground]).T
    las.classification = np.repeat([6, 2], len(along)).astype(np.uint8)
    las.write(folder / "street.las")
    build_map([folder / "street.las"], folder / "city.map", MapOptions(cell=0.24))
    yield Seed("manifest.json", "manifest", "manifest.json", (folder / "city.map" / "manifest.json").read_bytes())


def _others_of_ours(folder: Path) -> Iterator[Seed]:
    yield Seed("scanners", "mounting", "mounting.toml", MOUNTING.encode())
    yield Seed("dataset.toml", "dataset", "dataset.toml", DATASET.encode())
    yield Seed("study.json", "study", "study.json", json.dumps(CONFIGURATION, indent=1).encode())


def _poses() -> Iterator[Seed]:
    """A localized epoch and one that is not, as POSES.csv and as the Parquet file of a drive."""
    rows: list[dict[str, Any]] = [{name: 0.01 for name in COLUMNS} | {"status": "localized", "reason": ""}]
    rows.append({"time": 1.5, "ms": 20.0, "status": "ambiguous", "reason": "two, alike"})
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, restval="")
    writer.writeheader()
    writer.writerows(rows)
    yield Seed("POSES.csv", "poses", "poses.csv", text.getvalue().encode())
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows, poses_schema()), stream, compression="zstd")
    yield Seed("poses.parquet", "poses", "poses.parquet", stream.getvalue())
