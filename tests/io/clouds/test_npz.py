"""NPZ clouds: never unpickled, never trusted."""

import io
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from maxcon.errors import FileError
from maxcon.io.clouds import open_cloud
from read_clouds import POINTS, assert_all_there, read_cloud


def saved(folder, save=np.savez, **arrays):
    save(folder / "a.npz", **arrays)
    return folder / "a.npz"


def npy(array, shape=None, descr=None):
    """Bytes of an array in NPY format, its header claiming what it is told."""
    stream = io.BytesIO()
    header = {"shape": shape or array.shape, "descr": descr or array.dtype.str, "fortran_order": False}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + array.tobytes()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_everything_reads_back_in_chunks(tmp_path, save):
    classes, times = np.arange(7, dtype=np.int64), 1.7e9 + np.arange(7) * 0.1
    normals = POINTS.astype(">f4")
    points = np.asfortranarray(POINTS)
    cloud = read_cloud(saved(tmp_path, save, points=points, normals=normals, classes=classes, times=times, x=[1]), 3)
    assert_all_there(cloud, normals, classes, times)


@given(
    st_np.arrays(
        st.sampled_from(["<f8", ">f8", "<f4", ">f4", "<i4", ">i2", "|u1"]),
        st.tuples(st.integers(1, 9), st.just(3)),
        elements=st.integers(0, 127),
    ),
    st.integers(1, 4),
)
@example(np.array([[np.nan, 1.0, np.inf]]), 1)
def test_any_type_of_number_reads_back(points, max_points):
    with tempfile.TemporaryDirectory() as folder:
        np.testing.assert_array_equal(read_cloud(saved(Path(folder), points=points), max_points).points, points)


@pytest.mark.parametrize(("arrays", "words"), [
    ({"arr_0": POINTS}, r"numpy\.savez\(path, points=\.\.\.\).*no array `points` among arr_0"),
    ({"points": POINTS.T}, r"`points` of shape \(3, 7\), not \(n, 3\)"),
    ({"points": POINTS[:0]}, "0 of `points`"),
    ({"points": POINTS, "normals": POINTS[:3]}, "not one per point: 7 of `points`, 3 of `normals`"),
    ({"points": POINTS, "classes": np.zeros((7, 1))}, r"`classes` of shape \(7, 1\), not \(n,\)"),
    ({"points": POINTS, "classes": np.full(7, 300)}, "300 as a class, which is no code from 0 to 255"),
    ({"points": POINTS.astype(complex)}, "`points` of complex128"),
    ({"points": np.array([[1, 2, None]], dtype=object)}, "`points` of object"),
])  # fmt: skip
def test_arrays_that_cannot_be_used_are_refused(tmp_path, arrays, words):
    with pytest.raises(FileError, match=words):
        read_cloud(saved(tmp_path, **arrays))


@pytest.mark.parametrize(("content", "compression", "words"), [
    (npy(POINTS, shape=(8, 3)), zipfile.ZIP_STORED, "buffer is too small"),
    (npy(POINTS, shape=(2**60, 3)), zipfile.ZIP_STORED, r"a\.npz"),
    (npy(POINTS, shape=(-1, 3)), zipfile.ZIP_STORED, "negative dimensions"),
    (b"\x93NUMPY\x09\x00" + bytes(100), zipfile.ZIP_STORED, r"a\.npz"),
    (npy(np.zeros((800_000, 3))), zipfile.ZIP_DEFLATED, "unpack to .* times their size, not at most 100"),
])  # fmt: skip
def test_what_an_archive_claims_is_held_against_its_bytes(tmp_path, content, compression, words):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", compression) as stream:
        stream.writestr("points.npy", content)
    with pytest.raises(FileError, match=words):
        open_cloud(tmp_path / "a.npz")


def test_a_changed_byte_is_noticed_by_the_checksum(tmp_path):
    path = saved(tmp_path, points=POINTS)
    whole = path.read_bytes()
    at = whole.index(POINTS.tobytes())
    path.write_bytes(whole[:at] + b"\x7f" + whole[at + 1 :])
    with pytest.raises(FileError, match="CRC"):
        read_cloud(path)
