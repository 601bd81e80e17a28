"""PCD scans: three encodings, legal variants of the header, and headers that lie."""

import struct
import sys

import numpy as np
import pytest

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds import open_cloud
from maxcon.io.clouds.pcd import PcdReader
from read_clouds import read_cloud

# Few distinct values: what does not compress, pypcd4 writes uncompressed.
POINTS = np.random.default_rng(9).integers(-3, 4, (50, 3)).astype(np.float32)


def header(**changes):
    lines = {
        "VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1", "WIDTH": "2",
        "HEIGHT": "1", "VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": "2", "DATA": "ascii",
    }  # fmt: skip
    lines.update(changes)
    return "# .PCD\n" + "".join(f"{key} {value}\n" for key, value in lines.items() if value is not None)


def read(tmp_path, content):
    path = tmp_path / "a.pcd"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_cloud(path).points


def compressed(tmp_path, n_extra=0):
    """Bytes of a compressed file, with `n_extra` numbers per point in one field between x and y."""
    pypcd4 = pytest.importorskip("pypcd4")
    extra = np.arange(50 * n_extra, dtype=np.uint16).reshape(n_extra, 50)
    columns = [POINTS[:, 0], *extra, POINTS[:, 1], POINTS[:, 2]]
    names = ("x", *[f"e{i}" for i in range(n_extra)], "y", "z")
    types = (np.float32, *[np.uint16] * n_extra, np.float32, np.float32)
    pypcd4.PointCloud.from_points(columns, names, types).save(
        tmp_path / "c.pcd", encoding=pypcd4.Encoding.BINARY_COMPRESSED
    )
    whole = (tmp_path / "c.pcd").read_bytes()
    assert b"DATA binary_compressed\n" in whole
    return whole


def test_ascii_with_any_blanks_and_binary_of_mixed_types(tmp_path):
    content = (
        header(FIELDS="i y x z", SIZE="4 4 4 4", TYPE="U F F F", COUNT="2 1 1 1") + "9 9 2  1\t3 \r\n\n8 8 5 4 nan\n"
    )
    np.testing.assert_array_equal(read(tmp_path, content), [[1, 2, 3], [4, 5, np.nan]])
    records = np.zeros(50, [("n", "<u2", 3), ("z", "<f8"), ("x", "<f8"), ("ring", "u1"), ("y", "<f4")])
    for axis, name in enumerate("xyz"):
        records[name] = POINTS[:, axis]
    head = header(
        FIELDS="_ z x _ y", SIZE="2 8 8 1 4", TYPE="U F F U F", COUNT="3 1 1 1 1", WIDTH="10",
        HEIGHT="5", POINTS="50", DATA="binary",
    )  # fmt: skip
    np.testing.assert_array_equal(read(tmp_path, head.encode() + records.tobytes()), POINTS)


@pytest.mark.parametrize("n_extra", [0, 1, 3])
def test_binary_compressed(tmp_path, n_extra):
    np.testing.assert_array_equal(read(tmp_path, compressed(tmp_path, n_extra)), POINTS)


def test_lines_that_a_header_may_leave_out(tmp_path):
    body = "1 2 3\n4 5 6\n"
    for changes in ({"COUNT": None}, {"VIEWPOINT": None}, {"POINTS": None}, {"VERSION": ".6"}, {"HEIGHT": None}):
        np.testing.assert_array_equal(read(tmp_path, header(**changes) + body), [[1, 2, 3], [4, 5, 6]])
    whole = compressed(tmp_path)
    start = whole.index(b"COUNT")
    assert len(read(tmp_path, whole[:start] + whole[whole.index(b"\n", start) + 1 :])) == 50


@pytest.mark.parametrize(("changes", "words"), [
    ({"FIELDS": "x y i"}, "one field 'z' of numbers among x"), ({"COUNT": "2 1 1"}, "one field 'x'"),
    ({"COUNT": "0 1 1"}, "of different lengths"), ({"COUNT": "1 1 99999999999"}, "of different lengths"),
    ({"SIZE": "4 4"}, "of different lengths"), ({"SIZE": "4 4 3"}, "types other than F, U, I"),
    ({"POINTS": "3"}, "3 points, WIDTH 2 and HEIGHT 1"), ({"POINTS": "0", "WIDTH": "0"}, "got: 0 points"),
    ({"POINTS": "1e3"}, "whole numbers as POINTS.*'1e3'"),
    ({"DATA": "zip"}, "DATA 'zip', not ascii, binary, binary_compressed"),
    ({"COLOUR": "red", "DATA": None}, "header line 'COLOUR', not VERSION"),
    ({"DATA": "binary", "POINTS": "900", "WIDTH": "900"}, "bytes of points, not 10800: truncated"),
    ({"DATA": "binary_compressed"}, "points of 24 bytes"),
    ({"POINTS": "3", "WIDTH": "3"}, "1 rows of numbers fewer: truncated"),
])  # fmt: skip
def test_headers_that_cannot_be_are_refused(tmp_path, changes, words):
    with pytest.raises(FileError, match=rf"a\.pcd.*{words}"):
        read(tmp_path, header(**changes) + "1.00 2.00 3.00\n4.00 5.00 6.00\n")


def test_other_files_and_compressed_sizes_that_lie_are_refused(tmp_path):
    for content in (b"", b"DATA", b"\x00" * 100, b"# c\n" * 30_000):
        with pytest.raises(FileError, match=r"a\.pcd"):
            read(tmp_path, content)
    whole = compressed(tmp_path)
    at = whole.index(b"DATA binary_compressed\n") + 23
    for packed, unpacked, words in (
        (2**32 - 1, 600, "bytes of points, not .*truncated"), (100, 2**32 - 1, "points of 600 bytes"),
        (1, 600, "1 bytes that unpack to 600"), (50, 600, "to be a PCD file of .*, complete"),
    ):  # fmt: skip
        with pytest.raises(FileError, match=words):
            read(tmp_path, whole[:at] + struct.pack("<II", packed, unpacked) + whole[at + 8 :])


def test_compressed_points_need_the_extra(tmp_path, monkeypatch):
    whole = compressed(tmp_path)
    monkeypatch.setitem(sys.modules, "lzf", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[pcd\]'"):
        read(tmp_path, whole)


def test_real_scans(real_data):
    paths = sorted(real_data("street-pcd").glob("*.pcd"))
    assert [len(PcdReader(path).records()) for path in paths] == [119_978, 116_651, 115_151]


@pytest.mark.parametrize("encoding", ["ASCII", "BINARY", "BINARY_COMPRESSED"])
def test_a_cloud_comes_in_pieces_with_normals_and_times(tmp_path, encoding):
    """The same points, normals and times from any encoding, however large the pieces."""
    pypcd4 = pytest.importorskip("pypcd4")
    normals = np.tile(np.float32([0, 0, 1]), (50, 1))
    times = np.repeat(np.arange(5.0), 10)
    columns = [*POINTS.T, *normals.T, times]
    names = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "gps_time")
    cloud = pypcd4.PointCloud.from_points(columns, names, (np.float32,) * 6 + (np.float64,))
    cloud.save(tmp_path / "a.pcd", encoding=pypcd4.Encoding[encoding])
    assert f"DATA {encoding.lower()}\n".encode() in (tmp_path / "a.pcd").read_bytes()
    for max_points, n_pieces in ((7, 8), (50, 1), (1000, 1)):
        with open_cloud(tmp_path / "a.pcd") as reader:
            header, chunks = reader.header, list(reader.chunks(max_points))
        assert (header.n_points, header.has_normals, header.has_times, header.has_classes) == (50, True, True, False)
        assert len(chunks) == n_pieces
        for name, wanted in (("points", POINTS), ("normals", normals), ("times", times)):
            np.testing.assert_array_equal(np.concatenate([getattr(chunk, name) for chunk in chunks]), wanted)
