"""Clouds as the drivers of Livox, Hesai and Ouster record them: points, rings and times come out as they went in."""

import struct

import numpy as np
import pytest

from maxcon.errors import FileError
from maxcon.io.recordings.clouds import open_clouds
from maxcon.io.recordings.livox import records_of_livox
from maxcon.io.recordings.recording import Entry, Message, header_of
from maxcon.io.scans import describe, open_scans
from recorded_drives import NAMES, START, write_entries

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
N, LAST = 400, 99_750_000  # points of a scan, and when the last one was measured, ns after the first
CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def points_of(seed):
    """Returns as float32 holds them; one in ten is at (0, 0, 0), as where nothing came back."""
    points = np.random.default_rng(seed).uniform(-60.0, 60.0, (N, 3)).astype(np.float32).astype(np.float64)
    points[5::10] = 0.0
    return points


OFFSETS = np.linspace(0, LAST, N).astype(np.int64)
ARE_RETURNS = np.arange(N) % 10 != 5


def assert_read(path, words, rings, offsets):
    """Three scans of a recording are those that went in, with rings, and with times around the middle of each."""
    scans, middle = open_scans(path), (offsets[ARE_RETURNS].min() + offsets[ARE_RETURNS].max()) / 2.0
    assert words in scans.words
    for i in range(3):
        raw = scans.read(i, 0.0, 200.0)
        np.testing.assert_array_equal(raw.points, points_of(i)[ARE_RETURNS])
        assert scans.times[i] == raw.time == pytest.approx(START + 0.1 * i + middle * 1e-9, abs=1e-6)
        np.testing.assert_allclose(raw.point_times, (offsets[ARE_RETURNS] - middle) * 1e-9, atol=1e-6)
    cloud = next(iter(open_clouds(path).clouds())).points()
    assert cloud.n_invalid == N // 10
    np.testing.assert_array_equal(cloud.rings, rings[ARE_RETURNS])


def livox(seed, package="livox_ros_driver2", frame="livox_frame", clock=0):
    """A CustomMsg, written field by field; `clock` is by how much the scanner's is ahead of the header's, ns."""
    stamp = round((START + 0.1 * seed) * 1e9)
    points = [
        dict(offset_time=int(t), x=x, y=y, z=z, reflectivity=i % 256, tag=0x10, line=i % 4)
        for i, (t, (x, y, z)) in enumerate(zip(OFFSETS, points_of(seed).tolist(), strict=True))
    ]
    content = {
        "header": header_of(stamp * 1e-9, frame), "timebase": stamp + clock, "point_num": N, "lidar_id": 192,
        "rsvd": np.zeros(3, np.uint8), "points": points,
    }  # fmt: skip
    return Entry(stamp * 1e-9 + 0.1, "/livox/lidar", f"{package}/msg/CustomMsg", content)


@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize(("package", "frame"), [("livox_ros_driver", "livox_frame"), ("livox_ros_driver2", "")])
def test_what_livox_drivers_record_is_read(kind, package, frame, tmp_path):
    path = write_entries(tmp_path / NAMES[kind], [livox(i, package, frame) for i in range(3)])
    assert_read(path, "timestamp (uint64): ns, absolute", np.arange(N) % 4, OFFSETS)
    ((told, _),) = describe(path).scanners
    assert told["rings"] == "4 (0 to 3)" and "reflectivity uint8" in told["fields"] and "10.0 % no" in told["points"]
    assert open_clouds(path).frame == frame


@pytest.mark.parametrize(("clock", "words"), [
    (-1_234_000, "ns, absolute"), (-round(START * 1e9), "ns, relative"), (10**15, "of another clock"),
])  # fmt: skip
def test_the_clock_of_a_livox(clock, words, tmp_path):
    """On the message's clock, not told, or since the scanner was switched on."""
    scans = open_scans(write_entries(tmp_path / "drive.bag", [livox(0, clock=clock)]))
    assert words in scans.words
    first = clock * 1e-9 if words == "ns, absolute" else 0.0
    assert scans.times[0] == pytest.approx(START + first + LAST / 2e9, abs=1e-6)


def test_a_livox_beside_a_cloud_must_be_asked_for_and_a_broken_one_is_told(tmp_path):
    registered = hesai(0)._replace(topic="/cloud_registered")  # as FAST-LIO publishes it, in coordinates of the map
    path = write_entries(tmp_path / "drive.bag", [livox(0), registered])
    with pytest.raises(FileError, match=r"/cloud_registered .*/livox/lidar .*CustomMsg.*--topic"):
        open_scans(path)
    assert len(open_scans(path, topic="/livox/lidar")) == 1
    assert len(describe(path).scanners) == 2


def of_bytes(data, encoding="ros1"):
    return records_of_livox(Message("/livox/lidar", "livox_ros_driver/msg/CustomMsg", encoding, 0, data))


def test_points_without_a_tag_big_endian_ones_and_none():
    head = struct.pack("<4I4sQIII", 7, 5, 6, 4, b"lidr", 10**9, 2, 0, 2)
    points = b"".join(struct.pack("<I3f2B", 10 * i, 1.0 + i, 2.0, 3.0, 4, i) for i in range(2))
    stamp, records = of_bytes(head + points)
    assert stamp == 5_000_000_006 and records.dtype.names == ("timestamp", "x", "y", "z", "reflectivity", "line")
    assert [list(map(float, row)) for row in records.tolist()] == [[1e9, 1, 2, 3, 4, 0], [1e9 + 10, 2, 2, 3, 4, 1]]
    for broken in (head + points[:-1], head + points + b"\0", head[:30], head[:-1] + b"\x7f"):
        with pytest.raises((ValueError, struct.error)):
            of_bytes(broken)
    head = struct.pack(">4x3I6s6xQIII", 5, 6, 6, b"lidar\0", 10**9, 2, 0, 2)
    points = struct.pack(">I3f3BxI3f3B", 0, 1.0, 2.0, 3.0, 4, 5, 6, 10, 2.0, 2.0, 3.0, 4, 5, 6)
    _, records = of_bytes(head + points, "cdr")
    assert records["x"].tolist() == [1.0, 2.0] and records["timestamp"].tolist() == [10**9, 10**9 + 10]
    assert len(of_bytes(head[:-4] + bytes(4), "cdr")[1]) == 0


# --- PointCloud2, with the fields of other drivers --------------------------------------------------------------


def layout(*fields, step):
    """The type of a point of fields (name, type, offset)."""
    names, formats, offsets = zip(*fields, strict=True)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})


XYZ = (("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8))
HESAI = (
    layout(*XYZ, ("intensity", "<f4", 12), ("ring", "<u2", 16), ("timestamp", "<f8", 18), step=26),
    layout(*XYZ, ("intensity", "<f4", 16), ("timestamp", "<f8", 24), ("ring", "<u2", 32), step=48),
)
OUSTER = layout(
    *XYZ, ("intensity", "<f4", 16), ("t", "<u4", 20), ("reflectivity", "<u2", 24), ("ring", "<u2", 26),
    ("ambient", "<u2", 28), ("range", "<u4", 32), step=48,
)  # fmt: skip


def cloud(seed, dtype, height, stamp, **columns):
    """A message of points with times of its own, as a driver packs it."""
    records = np.zeros(N, dtype)
    for name, values in {**dict(zip("xyz", points_of(seed).T, strict=True)), **columns}.items():
        records[name] = values
    fields = [dict(name=n, offset=at, datatype=CODES[kind.str[1:]], count=1) for n, (kind, at) in dtype.fields.items()]
    content = {
        "header": header_of(stamp, "lidar"), "height": height, "width": N // height, "fields": fields,
        "is_bigendian": False, "point_step": dtype.itemsize, "row_step": dtype.itemsize * N // height,
        "data": records.view(np.uint8), "is_dense": True,
    }  # fmt: skip
    return Entry(stamp, "/lidar", "sensor_msgs/msg/PointCloud2", content)


def hesai(seed, of=0):
    stamp = START + 0.1 * seed
    return cloud(seed, HESAI[of], 1, stamp, timestamp=stamp + OFFSETS * 1e-9, ring=np.arange(N) % 128)


def ouster(seed):
    """All pixels of the image, 40 layers of 10 columns: those of a layer behind each other, each column at one time."""
    columns = np.tile(np.linspace(0, LAST, 10).astype(np.uint32), 40)
    return cloud(seed, OUSTER, 40, START + 0.1 * seed, t=columns, ring=np.repeat(np.arange(40), 10), range=9)


@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize(("driver", "words", "rings", "offsets"), [
    (lambda seed: hesai(seed, 0), "timestamp (float64): s, absolute", np.arange(N) % 128, OFFSETS),
    (lambda seed: hesai(seed, 1), "timestamp (float64): s, absolute", np.arange(N) % 128, OFFSETS),
    (ouster, "t (uint32): ns, relative", np.arange(N) // 10, np.tile(np.linspace(0, LAST, 10), 40)),
], ids=["Hesai", "Hesai, aligned", "Ouster"])  # fmt: skip
def test_fields_of_other_drivers(kind, driver, words, rings, offsets, tmp_path):
    assert_read(write_entries(tmp_path / NAMES[kind], [driver(i) for i in range(3)]), words, rings, offsets)
