"""Recordings for tests: drives of random scans as bags of ROS 1 and ROS 2 and as MCAP, and captures of a VLP-16."""

import struct

import numpy as np

from maxcon.geometry import Pose
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.recordings.livox import LIVOX
from maxcon.io.recordings.recording import ADDED, Entry, RecordingKind, header_of, write_bag, write_recording
from maxcon.io.scans import RawScan, Scans
from maxcon.lab.simulation.recordings import drive_messages
from maxcon.scan.trajectory import Trajectory

NAMES = {"bag": "drive.bag", "ros2": "drive", "mcap": "drive.mcap"}
"""File or folder of a recording, by its kind; every format that is read."""
START = 1_626_870_701.0
for kind in LIVOX:  # rosbags has no definitions to write these by
    ADDED[kind.replace("Msg", "Point")] = (
        "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
    )
    ADDED[kind] = (
        "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
        "CustomPoint[] points\n"
    )


class MadeScans(Scans):
    """Scans of random points, with times per point if asked for."""

    def __init__(self, n_scans, n_points=500, *, has_times=True):
        self.times = START + 0.1 * np.arange(n_scans)
        self.n_points, self.has_times = n_points, has_times

    def name(self, i):
        return str(i)

    def read(self, i, min_range=1.0, max_range=120.0):
        points = np.random.default_rng(i).uniform(-50, 50, (self.n_points, 3)).astype(np.float32).astype(np.float64)
        offsets = np.linspace(-0.05, 0.05, self.n_points) if self.has_times else None
        return RawScan(points, float(self.times[i]), str(i), len(points), 0, 0, 0, offsets)


def made_prior(times):
    """A drive at 8 m/s."""
    poses = [Pose(550_000 + 8 * (t - times[0]), 5_802_000, 60, 0.01, -0.02, 0.3) for t in times]
    return Trajectory.from_poses(times, poses)


def bend(n=40, turn=0.0):
    """Poses 1 m apart, ten a second, that bend by `turn` (rad) each."""
    headings = 0.8 + turn * np.arange(n)
    steps = np.column_stack([np.cos(headings), np.sin(headings)])
    places = np.array([550_123.0, 5_802_417.0]) + np.concatenate([[[0.0, 0.0]], np.cumsum(steps[:-1], axis=0)])
    poses = [Pose(x, y, 61.0, 0.01, -0.02, h) for (x, y), h in zip(places.tolist(), headings, strict=True)]
    return Trajectory.from_poses(100.0 + 0.1 * np.arange(n), poses)


def write_entries(path, entries):
    """Write messages in the order given, as the kind of recording that a path is named for; return the path."""
    if path.suffix:
        write_recording(path, RecordingKind(path.suffix[1:]), entries)
        return path
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        write_bag(bag, entries)
    return path


def transforms(time, *given, topic="/tf"):
    """Return one message of transforms: (parent, child, pose) each."""

    def content(parent, child, pose):
        turn = quaternions_from_angles(pose.roll, pose.pitch, pose.heading).ravel()
        place = dict(
            translation=dict(zip("xyz", pose.position.tolist(), strict=True)),
            rotation=dict(zip("xyzw", turn.tolist(), strict=True)),
        )
        return {"header": header_of(time, parent), "child_frame_id": child, "transform": place}

    return Entry(time, topic, "tf2_msgs/msg/TFMessage", {"transforms": [content(*one) for one in given]})


def record_drive(path, scans, prior=None, crs="EPSG:25832", **options):
    """Write scans, a prior and odometry as a recording, and return its path."""
    prior = made_prior(scans.times) if prior is None else prior
    return write_entries(path, drive_messages(scans, prior, crs, **options))


# A VLP-16 turns clockwise by 0.4 degrees from one block of a packet to the next; each block has two firings of its
# 16 lasers, one after the other, which leave it at different heights.
BLOCK_TIME, LASER_TIME = 110.592e-6, 2.304e-6
ORDER = np.concatenate([np.arange(0, 16, 2), np.arange(1, 16, 2)])
HEIGHTS = np.array([11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7, -0.7, -2.2, -3.7, -5.1, -6.6, -8.1, -9.7, -11.2]) / 1e3
FIRST_TO_MIDDLE = (899.5 * BLOCK_TIME + 15 * LASER_TIME) / 2.0


def velodyne_points(ranges):
    """Points of a turn, sensor frame, of the ranges of 1800 firings of 16 layers, lowest first."""
    clockwise = np.radians(0.2 * np.arange(1800)[:, None] + ORDER * (LASER_TIME / BLOCK_TIME * 0.4))
    elevations = np.broadcast_to(np.radians(np.arange(-15, 16, 2)), clockwise.shape)
    level, up = ranges * np.cos(elevations), ranges * np.sin(elevations) + HEIGHTS
    return np.stack([level * np.cos(clockwise), -level * np.sin(clockwise), up], axis=2).reshape(-1, 3)


def write_capture(path, turns, times):
    """Write turns, shape (1800, 16) in m, as a .pcap; a time is that of the middle of a turn, s."""
    frames = [struct.pack("<IHHIIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for ranges, time in zip(turns, times, strict=True):
        blocks = np.zeros((76, 12), [("flag", "<u2"), ("azimuth", "<u2"), ("echoes", [("r", "<u2"), ("i", "u1")], 32)])
        blocks["flag"], blocks["azimuth"] = 0xEEFF, (np.arange(912) % 900 * 40).reshape(76, 12)
        # 75 packets hold a turn; one without returns follows, as readers end a turn where azimuths start again.
        echoes = np.zeros((76 * 24, 16))
        echoes[:1800, ORDER] = np.round(ranges / 0.002)
        blocks["echoes"]["r"] = echoes.reshape(76, 12, 32)
        blocks["echoes"]["i"] = 100 * (blocks["echoes"]["r"] > 0)
        for number, packet in enumerate(blocks):
            at = round((time - FIRST_TO_MIDDLE + number * 12 * BLOCK_TIME) * 1e6)
            frames.append(_frame(packet.tobytes() + struct.pack("<IBB", at % 3_600_000_000, 0x37, 0x22), at))
    path.write_bytes(b"".join(frames))
    return path


def _frame(payload, at):
    udp = struct.pack(">HHHH", 2368, 2368, 8 + len(payload), 0) + payload
    addresses = bytes([192, 168, 1, 201]) + bytes([255] * 4)
    packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses + udp
    frame = bytes([255] * 6) + bytes(6) + b"\x08\x00" + packet
    return struct.pack("<IIII", *divmod(at, 10**6), len(frame), len(frame)) + frame
