"""Small good files of every kind that is read: what mutations begin with. Others from a folder are added."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow
import pyarrow.parquet
import pye57
import pypcd4

from maxcon import Pose, Trajectory
from maxcon.drive.poses_table import COLUMNS, poses_schema
from maxcon.io.clouds import CLOUD_SUFFIXES
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, RECORDING_SUFFIXES
from maxcon.io.recordings.recording import Entry, header_of
from maxcon.io.trajectories import write_csv, write_tum
from maxcon.mapping.build import MapOptions, build_map
from nmea_sentences import clock, gga, rmc, sentence, zda
from recorded_drives import NAMES, MadeScans, made_prior, record_drive, write_capture, write_entries
from written_copc import SIDE, write_copc
from written_las import write_las

N_POINTS = 60
LARGEST = 150_000
"""Bytes of a file of others: larger ones take longer than they tell."""
POINTS = np.round(np.random.default_rng(0).uniform(2.0, 9.0, (N_POINTS, 3)), 3)
CONFIGURATION = {
    "version": "1", "dataset": "dataset.toml", "parts": {"reference": "ab"}, "n_scans": 3,
    "options": {"min_range": 1.0},
    "methods": {"helmert": {"method": {}, "map": "standard", "starts": "from the prior"}}, "maps": {"standard": {}},
    "runs": [{"methods": ["helmert"], "priors": ["gnss"], "n_epochs": 3, "n_workers": 1, "n_rows": 3}],
}  # fmt: skip
MOUNTING = """[prior]
position = [-0.45, 0.30, 1.62]
heading_deg = 90.0
[odometry]
position = [0.0, 0.0, 0.0]
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


def _of_file(label: str, reader: str, file: Path) -> Seed:
    return Seed(label, reader, file.name, file.read_bytes())


def make_seeds(folder: Path, others: Path | None = None) -> list[Seed]:
    """Write what seeds need into an empty folder, and return them; the same ones each time, and small `others`."""
    made = [
        *_clouds(folder), *_surveys(folder), *_scans(folder), *_trajectories(folder), *_texts(), *_recordings(folder),
        *_maps(folder), *_poses(folder),
    ]  # fmt: skip
    return made + ([] if others is None else list(_seeds_of(others)))


def _seeds_of(folder: Path) -> Iterator[Seed]:
    """Yield the files of a folder that some reader is for."""
    readers = dict.fromkeys(CLOUD_SUFFIXES, "cloud")
    readers |= dict.fromkeys((*RECORDING_SUFFIXES, CAPTURE_SUFFIX), "recording")
    for path in sorted(folder.rglob("*")):
        suffix = path.suffix.lower()
        if suffix in readers and path.is_file() and 0 < path.stat().st_size <= LARGEST:
            yield Seed(str(path.relative_to(folder)), readers[suffix], f"1.5{suffix}", path.read_bytes())


def _clouds(folder: Path) -> Iterator[Seed]:
    """Clouds of maps and scans; "survey" are those that no scan comes in."""
    for point_format, version in ((1, "1.2"), (3, "1.2"), (6, "1.4"), (8, "1.4")):
        for suffix in ("las", "laz"):
            path = folder / f"1.5.{suffix}"
            write_las(path, POINTS, crs="EPSG:25832", point_format=point_format, version=version)
            yield _of_file(f"{suffix} {point_format}", "cloud", path)
    arrays = {"points": POINTS, "normals": np.tile([0.0, 0.0, 1.0], (N_POINTS, 1)), "classes": np.full(N_POINTS, 6)}
    for label, save in (("npz", np.savez), ("npz compressed", np.savez_compressed)):
        save(folder / "1.5.npz", **arrays)
        yield _of_file(label, "cloud", folder / "1.5.npz")
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
    file = pye57.E57(str(folder / "1.5.e57"), mode="w")
    for translation in ([0.0, 0.0, 0.0], [550_000.0, 5_802_000.0, 60.0]):
        columns = {f"cartesian{axis}": POINTS[:, i].copy() for i, axis in enumerate("XYZ")}
        columns["cartesianInvalidState"] = np.zeros(N_POINTS, np.int8)
        pose = {"rotation": np.array([1.0, 0.0, 0.0, 0.0]), "translation": np.array(translation)}
        file.write_scan_raw(columns, **pose)
    file.close()
    yield _of_file("e57", "survey", folder / "1.5.e57")
    rows = "".join(f"{x} {y} {z} 6\n" for x, y, z in POINTS)
    yield Seed("xyz", "survey", "1.5.xyz", rows.encode())
    named = "X,Y,Z,classification\n" + rows.replace(" ", ",")
    yield Seed("csv cloud", "survey", "1.5.csv", named.encode())


def _scans(folder: Path) -> Iterator[Seed]:
    single = POINTS.astype("<f4")
    yield Seed("kitti", "scan", "1.5.bin", np.hstack([single, single[:, :1]]).tobytes())
    rows = "\n".join(f"{x} {y} {z}" for x, y, z in POINTS).encode()
    for kind, body in (("ascii", rows), ("binary", single.tobytes())):
        head = (
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            f"WIDTH {N_POINTS}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {N_POINTS}\nDATA {kind}\n"
        )
        yield Seed(f"pcd {kind}", "cloud", "1.5.pcd", head.encode() + body)
    few = np.round(single / 4.0)  # what does not compress, pypcd4 writes uncompressed
    compressed = pypcd4.PointCloud.from_xyz_points(few)
    compressed.save(folder / "1.5.pcd", encoding=pypcd4.Encoding.BINARY_COMPRESSED)
    yield _of_file("pcd compressed", "cloud", folder / "1.5.pcd")
    yield _of_file("copc", "part", write_copc(folder / "1.5.copc.laz", np.tile(10.0 * POINTS, (4, 1)) % SIDE))


def _trajectories(folder: Path) -> Iterator[Seed]:
    poses = [Pose(550_000.0 + 2.0 * i, 5_802_000.0 + 0.1 * i, 50.0, 0.0, 0.0, 0.05 * i) for i in range(6)]
    drive = Trajectory.from_poses(np.arange(6.0), poses, np.tile(np.diag([1.0, 1.0, 1e-3]), (6, 1, 1)))
    write_tum(folder / "a.txt", drive, "by hand")
    write_csv(folder / "a.csv", drive)
    sigmas = "time,x,y,z,roll_deg,pitch_deg,heading_deg,sigma_x,sigma_y,sigma_heading_deg\n"
    sigmas += "".join(f"{i},{550000 + i},5802000,50,0,0,{i},1.5,1.5,2\n" for i in range(6))
    yield _of_file("tum", "trajectory", folder / "a.txt")
    yield _of_file("csv", "trajectory", folder / "a.csv")
    yield Seed("csv with sigmas", "trajectory", "a.csv", sigmas.encode())


POSITIONS = """time,latitude,longitude,ellipsoidal_height,heading_deg,sigma_x,sigma_y
100,52.0,9.7300,60.5,84.4,0.5,0.6
101,52.0,9.7301,60.5,84.4,0.5,0.6
102,52.0,9.7302,60.6,84.4,0.5,0.6
"""
KITTI = "".join(f"1 0 0 {i}.5 0 1 0 2.25 0 0 1 0.125\n" for i in range(4))
CONTROL = "name,x,y,z,east,north,height,sigma\na,1,2,3,550001,5802002,53,0.02\nb,4,5,6,550004,5802005,56,\n"
TEXTS = (
    ("kitti", "poses of scans", "kitti.txt", KITTI), ("control", "control points", "control.csv", CONTROL),
    ("scanners", "mounting", "mounting.toml", MOUNTING),
    ("mounting", "mounting", "mounting.toml", MOUNTING.replace("scanner.front", "sensor").partition("topic")[0]),
    ("dataset.toml", "dataset", "dataset.toml", DATASET),
    ("study.json", "study", "study.json", json.dumps(CONFIGURATION, indent=1)),
    ("latitudes", "positions", "gnss.csv", POSITIONS), ("times", "times", "times.txt", "1.5\n2.5\n"),
)  # fmt: skip


def _texts() -> Iterator[Seed]:
    time = 1_795_345_200.0
    lines = [gga(time, 52.3, 9.7, 60.1, 46.2), rmc(time), sentence("GNHDT", 84.4, "T"), zda(time)]
    lines += [sentence("GNGST", clock(time)[0], 0.9, 0.6, 0.4, 12.0, 0.5, 0.5, 0.9), gga(time + 1, 52.3, 9.7001, 60.2)]
    log = "".join(f"{line}\r\n" for line in lines)
    yield Seed("nmea", "positions", "gnss.nmea", log.encode())
    for label, reader, name, text in TEXTS:
        yield Seed(label, reader, name, text.encode())


def _recordings(folder: Path) -> Iterator[Seed]:
    scans = MadeScans(3, N_POINTS)
    for path in (folder / name for name in NAMES.values()):
        record_drive(path, scans, odometry=made_prior(scans.times))
        for file in [path] if path.is_file() else sorted(path.glob("*.db3")):
            yield _of_file(file.suffix, "recording", file)
    turn = np.random.default_rng(1).uniform(2.0, 90.0, (1, 1800, 16))
    yield _of_file("pcap", "recording", write_capture(folder / "drive.pcap", turn, [1_600_000_000.0]))
    for name in ("tf.bag", "tf.mcap"):
        yield _of_file(name, "transforms", write_entries(folder / name, _transforms()))
    yield _of_file("livox.bag", "scan", write_entries(folder / "livox.bag", [_livox()]))


def _livox() -> Entry:
    """A message of Livox's driver."""
    points = [dict(offset_time=250_000 * i, x=3.0 + i, y=float(i), z=1.0, line=i % 4) for i in range(N_POINTS)]
    content = {"timebase": 10**9, "point_num": N_POINTS, "rsvd": np.zeros(3, np.uint8), "points": points}
    return Entry(1.0, "/livox/lidar", "livox_ros_driver/msg/CustomMsg", content)


def _transforms() -> Iterator[Entry]:
    """A way of a vehicle in a map, and a scanner on it."""
    transform = {"translation": dict(x=1.0, y=2.0, z=0.0), "rotation": dict(x=0.0, y=0.0, z=0.0, w=1.0)}
    for time, topic, parent, child in (
        (1.0, "/tf_static", "base_link", "sensor"), (1.0, "/tf", "map", "odom"), (1.0, "/tf", "odom", "base_link"),
        (2.0, "/tf", "map", "odom"), (2.0, "/tf", "odom", "base_link"),
    ):  # fmt: skip
        one = {"header": header_of(time, parent), "child_frame_id": child, "transform": transform}
        yield Entry(time, topic, "tf2_msgs/msg/TFMessage", {"transforms": [one]})


def _maps(folder: Path) -> Iterator[Seed]:
    along, up = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 6.0, 0.1), np.arange(0.0, 3.0, 0.1)))
    wall = np.column_stack([along, np.full_like(along, 2.0), up])
    ground = np.column_stack([along, 2.0 * up, np.zeros_like(along)])
    write_las(folder / "street.las", np.concatenate([wall, ground]), classes=np.repeat([6, 2], len(along)))
    build_map([folder / "street.las"], folder / "city.map", MapOptions(cell=0.24))
    yield _of_file("manifest.json", "manifest", folder / "city.map" / "manifest.json")


def _poses(folder: Path) -> Iterator[Seed]:
    """A localized epoch and one that is not, as POSES.csv and as the Parquet file of a drive."""
    words = {"status": "localized", "reason": "", "scan": "000001.bin", "crs": "EPSG:25832", "epoch": 0}
    rows: list[dict[str, Any]] = [{name: 0.01 for name in COLUMNS} | words]
    rows.append({"time": 1.5, "epoch": 1, "ms": 20.0, "status": "ambiguous", "reason": "two alike"})
    cells = [COLUMNS, *([str(row.get(name, "")) for name in COLUMNS] for row in rows)]
    yield Seed("POSES.csv", "poses", "poses.csv", "".join(",".join(row) + "\r\n" for row in cells).encode())
    table = pyarrow.Table.from_pylist(rows, poses_schema())
    pyarrow.parquet.write_table(table, folder / "poses.parquet", compression="zstd")
    yield _of_file("poses.parquet", "poses", folder / "poses.parquet")
