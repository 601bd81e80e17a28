# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Small good files of every kind that is read: what mutations begin with. Others from a folder are added."""

import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from fuzz_readers import record_as_bytes
from pyproj import CRS

from maxcon import Pose, Trajectory, open_scans
from maxcon.io.clouds import CLOUD_SUFFIXES
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, RECORDING_SUFFIXES
from maxcon.io.recordings.point_cloud2 import CloudRecord, FieldDescription
from maxcon.io.trajectories import write_csv, write_tum
from maxcon.mapping import MapOptions, build_map
from maxcon.simulation.recordings import RECORDING_NAMES, RecordingKind, record_drive

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
        *_scans(),
        *_trajectories(folder),
        *_recordings(folder),
        *_maps(folder),
        *_others_of_ours(folder),
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
    arrays = {
        "points": POINTS,
        "normals": np.tile([0.0, 0.0, 1.0], (N_POINTS, 1)),
        "classes": np.full(N_POINTS, 6),
    }
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


def _recordings(folder: Path) -> Iterator[Seed]:
    (folder / "scans").mkdir()
    for i in range(3):
        (folder / "scans" / f"{i}.5.bin").write_bytes(
            np.hstack([POINTS, POINTS[:, :1]]).astype("<f4").tobytes()
        )
    scans = open_scans(folder / "scans")
    for kind in RecordingKind:
        path = folder / RECORDING_NAMES[kind]
        record_drive(path, kind, scans, _drive(), "EPSG:25832", odometry=_drive())
        for file in [path] if path.is_file() else sorted(path.glob("*.db3")):
            yield Seed(file.suffix, "recording", f"drive{file.suffix}", file.read_bytes())
    yield Seed("pcap", "recording", "drive.pcap", _capture())


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
    for file in ("manifest.json", *(f"{part}/{_first(folder, part)}" for part in ("tiles", "ground"))):
        reader = "manifest" if file == "manifest.json" else "tile"
        yield Seed(file, reader, file, (folder / "city.map" / file).read_bytes())


def _first(folder: Path, part: str) -> str:
    """Name of the file of the first entry in the manifest."""
    x, y = json.loads((folder / "city.map" / "manifest.json").read_text())[part][0]["key"]
    return f"{x}_{y}.arrow"


def _others_of_ours(folder: Path) -> Iterator[Seed]:
    yield Seed("dataset.toml", "dataset", "dataset.toml", DATASET.encode())
    yield Seed("study.json", "study", "study.json", json.dumps(CONFIGURATION, indent=1).encode())
