# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""NPZ clouds: streamed, never unpickled, never trusted."""

import io
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from maxcon.errors import FileError
from maxcon.io.clouds import open_cloud

POINTS = np.random.default_rng(8).uniform(4e5, 6e6, (7, 3))


def read(path, max_points=1_000_000):
    with open_cloud(path) as reader:
        return reader.header, list(reader.chunks(max_points))


def saved(tmp_path, **arrays):
    np.savez(tmp_path / "a.npz", **arrays)
    return tmp_path / "a.npz"


def npy(array, shape=None, descr=None, fortran=False):
    """Bytes of an array in NPY format, its header claiming what it is told."""
    stream = io.BytesIO()
    header = {"shape": shape or array.shape, "descr": descr or array.dtype.str, "fortran_order": fortran}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + array.tobytes()


def archive(tmp_path, compression=zipfile.ZIP_STORED, **members):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", compression) as stream:
        for name, content in members.items():
            stream.writestr(f"{name}.npy", content)
    return tmp_path / "a.npz"


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_everything_reads_back_in_chunks(tmp_path, save):
    classes, times = np.arange(7, dtype=np.int64), 1.7e9 + np.arange(7) * 0.1
    save(tmp_path / "a.npz", points=POINTS, normals=POINTS.astype(">f4"), classes=classes, times=times, other=[1])
    header, chunks = read(tmp_path / "a.npz", 3)
    assert (header.n_points, header.crs) == (7, None)
    assert (header.has_normals, header.has_classes, header.has_times) == (True, True, True)
    assert [len(chunk.points) for chunk in chunks] == [3, 3, 1]
    np.testing.assert_array_equal(np.concatenate([c.points for c in chunks]), POINTS)
    np.testing.assert_array_equal(np.concatenate([c.normals for c in chunks]), POINTS.astype("f4"))
    np.testing.assert_array_equal(np.concatenate([c.classes for c in chunks]), classes)
    np.testing.assert_array_equal(np.concatenate([c.times for c in chunks]), times)
    assert chunks[0].classes.dtype == np.uint8
    assert chunks[0].normals.dtype == np.float64


@given(
    st_np.arrays(
        st.sampled_from(["<f8", ">f8", "<f4", ">f4", "<i4", ">i2", "|u1"]),
        st.tuples(st.integers(1, 9), st.just(3)),
        elements=st.integers(0, 127),
    ),
    st.integers(1, 4),
)
@settings(max_examples=50)
def test_any_type_of_number_reads_back(points, max_points):
    with tempfile.TemporaryDirectory() as folder:
        _, chunks = read(saved(Path(folder), points=points), max_points)
    np.testing.assert_array_equal(np.concatenate([chunk.points for chunk in chunks]), points)


def test_nan_and_infinity_are_kept(tmp_path):
    points = np.array([[np.nan, 1.0, np.inf]])
    np.testing.assert_array_equal(read(saved(tmp_path, points=points))[1][0].points, points)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"arr_0": POINTS}, r"an array `points` in .*a\.npz, got arr_0\. Save it with numpy\.savez"),
        ({"points": POINTS.T}, r"`points` in .*shape \(n, 3\), got \(3, 7\)"),
        ({"points": POINTS[0]}, r"shape \(n, 3\), got \(3,\)"),
        ({"points": POINTS[:0]}, "Expected points in .*got none"),
        ({"points": POINTS, "normals": POINTS[:3]}, "`normals` in .*one row per point, 7, got 3"),
        ({"points": POINTS, "classes": np.zeros((7, 1))}, r"`classes` in .*shape \(n,\), got \(7, 1\)"),
        ({"points": POINTS, "classes": np.full(7, 300)}, "codes from 0 to 255 as 'classes' in .*got 300"),
        ({"points": POINTS.astype(complex)}, "numbers as `points` in .*got complex128"),
        ({"points": POINTS.astype("U30")}, "numbers as `points`"),
        ({"points": np.asfortranarray(POINTS)}, "Fortran order.*ascontiguousarray"),
        ({"points": np.array([[1, 2, None]], dtype=object)}, "numbers as `points` in .*got object"),
    ],
)
def test_arrays_that_cannot_be_used_are_refused(tmp_path, arrays, words):
    path = saved(tmp_path, **arrays)
    with pytest.raises(FileError, match=words):
        read(path)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ((8, 3), "bytes of `points`"),
        ((2**60, 3), "bytes of `points`"),
        ((-1, 3), r"shape \(n, 3\)"),
        ((7, 3, 1), r"shape \(n, 3\)"),
    ],
)
def test_claimed_shapes_are_held_against_the_bytes(tmp_path, shape, words):
    with pytest.raises(FileError, match=words):
        read(archive(tmp_path, points=npy(POINTS, shape=shape)))


def test_what_is_not_an_array_or_not_an_archive_is_refused(tmp_path):
    for content in (b"", b"abc", b"\x93NUMPY\x09\x00" + bytes(100), npy(POINTS, descr="|O")):
        with pytest.raises(FileError, match=r"a\.npz"):
            read(archive(tmp_path, points=content))
    (tmp_path / "b.npz").write_bytes(b"PK but not really")
    with pytest.raises(FileError, match=r"b\.npz to be an NPZ archive, complete"):
        read(tmp_path / "b.npz")


def test_a_bomb_is_refused_when_opened(tmp_path):
    path = archive(tmp_path, zipfile.ZIP_DEFLATED, points=npy(np.zeros((4_000_000, 3))))
    with pytest.raises(FileError, match="unpack to at most 100 times its size"):
        open_cloud(path)


def test_other_compressions_are_refused(tmp_path):
    with pytest.raises(FileError, match="stored or deflated"):
        open_cloud(archive(tmp_path, zipfile.ZIP_LZMA, points=npy(POINTS)))


def test_a_changed_byte_is_noticed_by_the_checksum(tmp_path):
    path = saved(tmp_path, points=POINTS)
    whole = path.read_bytes()
    at = whole.index(POINTS.tobytes())
    path.write_bytes(whole[:at] + b"\x7f" + whole[at + 1 :])
    with pytest.raises(FileError, match="CRC"):
        read(path)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_broken_npz_ends_in_an_error_of_ours(tmp_path, survives_breaking, save):
    save(tmp_path / "whole.npz", points=POINTS, classes=np.arange(7))
    survives_breaking((tmp_path / "whole.npz").read_bytes(), ".npz", read)
