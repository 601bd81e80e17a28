"""LAS and LAZ: every point format, chunks, CRS, and headers that claim what is not there."""

import struct
import sys
from multiprocessing import get_context

import numpy as np
import pyproj
import pytest

from maxcon.errors import CrsError, FileError
from maxcon.io.clouds import las as las_reader
from maxcon.io.clouds import open_cloud
from maxcon.mapping.build.sources import common_crs
from read_clouds import read_cloud
from written_las import write_las

FORMATS = [(0, "1.2"), (1, "1.2"), (3, "1.3"), (6, "1.4"), (7, "1.4"), (8, "1.4")]


def write(path, n=1000, **how):
    """Random points with classes and, where the format has them, times."""
    rng = np.random.default_rng(5)
    points = [458000.0, 5429000.0, 100.0] + rng.integers(0, 100_000, (n, 3)) * 0.001
    return write_las(path, points, classes=rng.integers(0, 32, n), times=47451.0 + np.arange(n) * 1e-4, **how)


@pytest.mark.parametrize(("point_format", "version"), FORMATS)
@pytest.mark.parametrize(("suffix", "extra"), [(".las", ()), (".laz", ()), (".LAS", ["ring"]), (".LAZ", ["ring"])])
def test_points_classes_and_times_of_every_format(tmp_path, point_format, version, suffix, extra):
    path = tmp_path / f"cloud{suffix}"
    las = write(path, point_format=point_format, version=version, extra=extra)
    cloud = read_cloud(path, max_points=300)
    assert cloud.sizes == [300, 300, 300, 100]
    np.testing.assert_allclose(cloud.points, las.xyz, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(cloud.classes, np.array(las.classification))
    header = cloud.header
    assert (header.path, header.crs, header.has_normals, header.has_classes) == (path, None, False, True)
    assert header.has_times == (point_format != 0) == (cloud.times is not None)
    if point_format:
        np.testing.assert_array_equal(cloud.times, las.gps_time)


@pytest.mark.parametrize("most_in_parallel", [2_000_000, 1000])
def test_chunks_cross_the_compressed_ones_whatever_their_size(tmp_path, monkeypatch, most_in_parallel):
    las = write(tmp_path / "a.laz", 60_000)
    monkeypatch.setattr(las_reader, "MAX_PARALLEL_CHUNK", most_in_parallel)
    cloud = read_cloud(tmp_path / "a.laz", 17_000)
    assert len(cloud.chunks) == 4
    np.testing.assert_allclose(cloud.points, las.xyz, rtol=0, atol=1e-6)


def test_each_iteration_begins_anew_and_leaving_the_block_ends_it(tmp_path):
    write(tmp_path / "a.las")
    with open_cloud(tmp_path / "a.las") as reader:
        first = next(reader.chunks(10)).points
        running = reader.chunks(10)
        np.testing.assert_array_equal(next(running).points, first)
    assert list(running) == []


def header_of(path):
    with open_cloud(path) as reader:
        return reader.header


def with_evlr(path, user, record, content, claimed=None):
    """Append an extended record and enter it into the LAS 1.4 header."""
    whole = bytearray(path.read_bytes())
    struct.pack_into("<QI", whole, 235, len(whole), 1)
    length = len(content) if claimed is None else claimed
    whole += struct.pack("<H16sHQ32s", 0, user, record, length, b"") + content
    path.write_bytes(whole)


def test_the_crs_is_found_before_and_behind_the_points(tmp_path):
    path = tmp_path / "a.las"
    for point_format, version in ((1, "1.2"), (6, "1.4")):
        write(path, 10, point_format=point_format, version=version, crs=25832)
        assert pyproj.CRS.from_wkt(header_of(path).crs).to_epsg() == 25832
    wkt = pyproj.CRS.from_epsg(25833).to_wkt().encode() + b"\0"
    for content, words in ((wkt, ""), (b"nonsense", "Invalid"), (b"\xff\xfe", "can't decode")):
        write(path, 10)
        with_evlr(path, b"LASF_Projection", 2112, content)
        header = header_of(path)
        assert words in header.crs_fault
        assert header.crs is None if words else pyproj.CRS.from_wkt(header.crs).to_epsg() == 25833
    write(path, 10)
    with_evlr(path, b"someone", 1, b"abc", claimed=2**62)
    with pytest.raises(FileError, match=r"a\.las .*the last of 1 extended records: truncated"):
        open_cloud(path)


def patched(path, offset, layout, *values):
    whole = bytearray(path.read_bytes())
    struct.pack_into(layout, whole, offset, *values)
    path.write_bytes(whole)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("offset", "layout", "value", "words"), [
    (0, "<I", 0, "no LAS header"), (96, "<I", 2**32 - 1, "points of 30 bytes from byte 4294967295"),
    (100, "<I", 2**32 - 1, "4294967295 records"), (105, "<H", 0, "points of 0 bytes"),
    (131, "<d", 0.0, "scales and offsets of"), (155, "<d", float("nan"), "scales and offsets of"),
    (247, "<Q", 0, "says 0 points"), (243, "<I", 2**32 - 1, "extended records"),
])  # fmt: skip
def test_a_header_that_cannot_be_is_refused(tmp_path, suffix, offset, layout, value, words):
    path = tmp_path / f"a{suffix}"
    write(path)
    patched(path, offset, layout, value)
    with pytest.raises(FileError, match=words) as caught:
        open_cloud(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_truncated_file_is_refused_when_opened(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write(path, 5000)
    whole = path.read_bytes()
    for part in (0.0, 0.1, 0.5, 0.9, 0.999):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(FileError, match=rf"a\{suffix}"):
            open_cloud(path)


@pytest.mark.parametrize(("suffix", "point_format", "claimed", "words"), [
    (".las", 6, 2**40, "1099511627776 points in its header, and bytes for 120000"),
    (".laz", 6, 2**40, "chunks of 150000 points for 1099511627776"),
    (".laz", 6, 140_000, r"a\.laz"),
    *((".las", kind, 1000, "1000 points in its header, and bytes for 120000") for kind in (3, 6)),
    *((".laz", kind, 1000, "chunks of 150000 points for 1000") for kind in (3, 6)),
])  # fmt: skip
def test_more_points_or_fewer_than_there_are(tmp_path, suffix, point_format, claimed, words):
    path = tmp_path / f"a{suffix}"
    write(path, 120_000, point_format=point_format)
    patched(path, 107, "<I", claimed if point_format < 6 else 0)
    if path.read_bytes()[25] >= 4:
        patched(path, 247, "<Q", claimed)
    with pytest.raises(FileError, match=words):
        read_cloud(path)


@pytest.mark.skipif(sys.platform == "win32", reason="no `resource`: the memory cannot be asked for")
def test_layers_longer_than_the_file_are_refused_without_allocating(tmp_path):
    import resource

    path = tmp_path / "a.laz"
    write(path, 60_000)
    start = struct.unpack_from("<I", path.read_bytes(), 96)[0]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for layer in range(9):
        patched(path, start + 8 + 30 + 4 + 4 * layer, "<I", 0xE0000000)
    with pytest.raises(FileError, match=r"layers of .* bytes in chunk 0"):
        read_cloud(path)
    unit = 1.0 if sys.platform == "darwin" else 1e3  # bytes there, kB elsewhere
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * unit < 200e6


def geo_keys(*keys, n_keys=None, version=1):
    rows = struct.pack("<4H", version, 1, 0, len(keys) if n_keys is None else n_keys)
    return rows + b"".join(struct.pack("<4H", *key) for key in keys)


def with_record(path, content, number=34735, user=b"LASF_Projection"):
    """Put one record between the header and the points."""
    whole = bytearray(path.read_bytes())
    header_bytes, start = struct.unpack_from("<HI", whole, 94)
    record = struct.pack("<H16sHH32s", 0, user, number, len(content), b"") + content
    struct.pack_into("<II", whole, 96, header_bytes + len(record), 1)
    path.write_bytes(bytes(whole[:header_bytes]) + record + bytes(whole[start:]))


@pytest.mark.parametrize(("content", "number", "words"), [
    (geo_keys((3072, 0, 1, 25833), n_keys=9), 34735, "damaged directory of 9"),
    (geo_keys((3072, 0, 1, 25833), version=513), 34735, "damaged directory"),
    (geo_keys((3072, 0, 1, 9999)), 34735, "EPSG:9999"), (geo_keys((3072, 0, 1, 32767)), 34735, "EPSG:32767"),
    (geo_keys((3072, 0, 1, 40000)), 34735, "EPSG:40000"), (geo_keys((1024, 0, 1, 1)), 34735, "without a code"),
    (b"\1\0\1", 34735, "damaged directory"), (b"PROJCS[cut", 2112, "WKT that it does not"),
    (b"\xff\xff\xff", 2112, "WKT that it does not"),
])  # fmt: skip
def test_a_damaged_crs_is_not_none(tmp_path, content, number, words):
    write(tmp_path / "a.las", 10, point_format=3)
    with_record(tmp_path / "a.las", content, number)
    with open_cloud(tmp_path / "a.las") as reader:
        header = reader.header
        assert sum(len(chunk.points) for chunk in reader.chunks()) == 10
    assert header.crs is None and words in header.crs_fault
    with pytest.raises(CrsError, match=r"PROJ knows in .*a\.las, got .*Say which it is with --crs"):
        common_crs([header], None)
    assert "25833" in common_crs([header], "EPSG:25833")


def test_geotiff_keys_and_the_record_of_liblas(tmp_path):
    write(tmp_path / "a.las", 10, point_format=3)
    with_record(tmp_path / "a.las", geo_keys((1024, 0, 1, 1), (3072, 0, 1, 25833)))
    wkt = pyproj.CRS.from_epsg(25832).to_wkt().encode() + b"\0"
    write(tmp_path / "b.las", 10, point_format=3)
    with_record(tmp_path / "b.las", wkt, 2112, b"liblas")
    for name, code in (("a.las", 25833), ("b.las", 25832)):
        assert pyproj.CRS.from_wkt(header_of(tmp_path / name).crs).to_epsg() == code


def read_again(path, n_points):
    with open_cloud(path) as reader:
        assert sum(len(chunk.points) for chunk in reader.chunks()) == n_points


def test_laz_is_read_after_a_fork(tmp_path):
    """The decompressor's threads do not survive a fork: the child waited for them for ever."""
    write(tmp_path / "a.laz", 120_000)
    with open_cloud(tmp_path / "a.laz") as reader:
        n_points = sum(len(chunk.points) for chunk in reader.chunks())
    child = get_context("fork").Process(target=read_again, args=(tmp_path / "a.laz", n_points))
    child.start()
    child.join(300.0)
    is_waiting = child.is_alive()
    child.kill()
    child.join()
    assert not is_waiting and child.exitcode == 0
