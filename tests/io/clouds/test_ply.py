"""PLY: encodings, types, names, other elements, and what is refused."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.errors import FileError
from maxcon.io.clouds.records import ORDERS, TYPES
from read_clouds import POINTS, assert_all_there, read_cloud

ENCODINGS = ORDERS | {"ascii": "="}
XYZ = [("double", "x"), ("double", "y"), ("double", "z")]
HEAD = "ply\nformat ascii 1.0\n"
THREE = "property float x\nproperty float y\nproperty float z\n"


def ply(encoding, properties, columns, before="", after="", body_before=b"", body_after=b"", end="\n"):
    """Bytes of a PLY file of `properties` [(type, name)] with these columns."""
    n = len(columns[0])
    lines = ["ply", f"format {encoding} 1.0", "comment made by a test", *before.split("|"), f"element vertex {n}"]
    lines += [f"property {kind} {name}" for kind, name in properties] + [*after.split("|"), "end_header"]
    head = end.join(line for line in lines if line) + end
    if encoding == "ascii":
        texts = [
            [repr(v.item()) for v in np.asarray(c).astype(TYPES[k])]
            for (k, _), c in zip(properties, columns, strict=True)
        ]
        body = "".join(" ".join(row) + end for row in zip(*texts, strict=True)).encode()
    else:
        records = np.empty(n, [(f"f{i}", ENCODINGS[encoding] + TYPES[k]) for i, (k, _) in enumerate(properties)])
        for i, column in enumerate(columns):
            records[f"f{i}"] = column
        body = records.tobytes()
    return head.encode() + body_before + body + body_after


def read_bytes(tmp_path, content, max_points=1_000_000):
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    return read_cloud(path, max_points)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_everything_reads_back_in_chunks(tmp_path, encoding, end):
    properties = [
        ("uchar", "red"), ("float", "nz"), ("float", "nx"), ("float", "ny"), ("ushort", "classification"),
        ("double", "y"), ("double", "x"), ("double", "z"), ("double", "gps_time"),
    ]  # fmt: skip
    normals = np.random.default_rng(7).normal(size=(7, 3)).astype(np.float32)
    classes, times = np.array([0, 2, 255, 6, 5, 1, 2]), 1.7e9 + np.arange(7) * 0.1
    columns = [np.arange(7), normals[:, 2], normals[:, 0], normals[:, 1], classes, *POINTS.T[[1, 0, 2]], times]
    cloud = read_bytes(tmp_path, ply(encoding, properties, columns, end=end), 3)
    assert_all_there(cloud, normals, classes, times)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("kind", TYPES)
def test_coordinates_of_any_type(tmp_path, encoding, kind):
    columns = [np.array([1, 2]), np.array([3, 4]), np.array([5, 127])]
    cloud = read_bytes(tmp_path, ply(encoding, [(kind, name) for name in "xyz"], columns))
    np.testing.assert_array_equal(cloud.points, np.transpose(columns))
    assert cloud.normals is cloud.classes is cloud.times is None


@given(
    st.sampled_from(list(ENCODINGS)), st.lists(st.tuples(*[st.floats()] * 3), min_size=1, max_size=9), st.integers(1, 4)
)
def test_any_float64_reads_back_also_nan_and_infinity(encoding, rows, max_points):
    points = np.array(rows)
    with tempfile.TemporaryDirectory() as folder:
        cloud = read_bytes(Path(folder), ply(encoding, XYZ, points.T), max_points)
    np.testing.assert_array_equal(cloud.points, points)


@pytest.mark.parametrize(("name", "what"), [
    *((name, "classes") for name in ("classification", "class", "label", "scalar_Classification")),
    *((name, "times") for name in ("gps_time", "time", "scalar_GpsTime")),
])  # fmt: skip
def test_names_of_classes_and_times(tmp_path, name, what):
    cloud = read_bytes(tmp_path, ply("binary_big_endian", [*XYZ, ("float", name)], [*POINTS.T, np.arange(7)]))
    np.testing.assert_array_equal(getattr(cloud, what), np.arange(7))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_other_elements_are_passed_over_but_for_lists_up_to_the_vertices(tmp_path, encoding):
    camera = b"1 2\n3 4\n" if encoding == "ascii" else np.array([(1, 2), (3, 4)], ENCODINGS[encoding] + "f4").tobytes()
    faces = b"3 0 1 2\n" if encoding == "ascii" else b"\x03" + bytes(12)
    content = ply(
        encoding, XYZ, POINTS.T,
        before="element camera 2|property float f|property float cx",
        after="element face 1|property list uchar int vertex_indices",
        body_before=camera, body_after=faces,
    )  # fmt: skip
    np.testing.assert_array_equal(read_bytes(tmp_path, content, 4).points, POINTS)
    before = ply(encoding, XYZ, POINTS.T, before="element face 1|property list uchar int i")
    within = ply(encoding, XYZ, POINTS.T, after="property list uchar int neighbours")
    for content, name in ((before, "face"), (within, "vertex")):
        with pytest.raises(FileError, match=rf"a\.ply to be .*a list in '{name}': export the points alone"):
            read_bytes(tmp_path, content)


@pytest.mark.parametrize(("content", "words"), [
    ("plx\n", "instead of the line 'ply'"),
    ("ply\nformat ascii 1.0\nelement vertex 1\n", "ends with 'end_header'"),
    ("ply\n" + "comment\n" * 40_000, "ends with 'end_header'"),
    ("ply\nelement vertex 1\nproperty float x\nend_header\n", "no header line 'format"),
    ("ply\nformat binary_middle_endian 1.0\nend_header\n", "the header line 'format binary_middle"),
    (HEAD + "end_header\n", "no element 'vertex' among none"),
    (HEAD + "element vertex 0\nproperty float x\nend_header\n", "0 vertices in"),
    (HEAD + "element vertex 1\n" + THREE[:34] + "end_header\n1 2\n", "not one field 'z' of numbers"),
    (HEAD + "element vertex 1\n" + "property float x\n" * 2 + "end_header\n1 2\n", "not one field 'x' of numbers"),
    (HEAD + "element vertex 99999999999\n" + THREE + "end_header\n1\n", "99999999999 vertices in .*truncated"),
    (HEAD + "element vertex 2\n" + THREE + "end_header\n1 2 3\n4.000 5\n", "number of columns changed"),
    (HEAD + "element vertex 2\n" + THREE + "end_header\n1 2 3 4\n4 5 6 7\n", "4 numbers in a row, not 3"),
    (HEAD + "element vertex 2\n" + THREE + "end_header\n1 2 3\n4 five 6\n", "five"),
    (HEAD + "element vertex 2\n" + THREE + "end_header\n1 2 3 \n\n \n\n\n\n", "1 rows of numbers fewer"),
    (HEAD + "element vertex 2\n" + THREE + "end_header\n1 2 3\n" + "4" * 200_000 + "\n", "over 100000 characters"),
])  # fmt: skip
def test_what_cannot_be_is_refused(tmp_path, content, words):
    with pytest.raises(FileError, match=rf"a\.ply to be a PLY file of points, complete, got: .*{words}"):
        read_bytes(tmp_path, content.encode())


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_truncated_file_is_refused(tmp_path, encoding):
    content = ply(encoding, XYZ, POINTS.T)
    for cut in (30, 100):
        with pytest.raises(FileError, match=r"a\.ply.*(truncated|columns changed)"):
            read_bytes(tmp_path, content[:-cut])
