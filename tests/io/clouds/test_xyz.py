"""Points as text: separators, headers, comments, chunks, what is refused; and suffixes of all clouds."""

import numpy as np
import pytest

from maxcon.errors import FileError
from maxcon.io.clouds import CLOUD_SUFFIXES, open_cloud
from read_clouds import read_cloud

ROWS = [
    (550_000.25, 5_802_000.5, 61.125, 2, 7.5), (550_001.5, 5_802_001.0, 62.0, 6, 8.5), (1.0, 2.0, float("nan"), 6, 9),
]  # fmt: skip


def _write(tmp_path, lines, name="a.xyz"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "separator"), [("a.xyz", " "), ("a.xyz", "   "), ("a.csv", ","), ("a.csv", ";"), ("a.txt", "\t")]
)
@pytest.mark.parametrize("header", [None, "x{0}y{0}z{0}Classification{0}gps_time", "//X{0}Y{0}Z{0}label{0}GpsTime"])
def test_columns_by_name_or_the_first_three(tmp_path, name, separator, header):
    lines = [separator.join(map(str, row)) for row in ROWS]
    lines = lines if header is None else [header.format(separator), *lines]
    cloud = read_cloud(_write(tmp_path, ["", *lines, ""], name), 2)
    np.testing.assert_array_equal(cloud.points, [row[:3] for row in ROWS])
    assert cloud.sizes == [2, 1]
    assert cloud.header.has_classes == cloud.header.has_times == (header is not None)
    assert not cloud.header.has_asprs_classes
    if header is not None:
        assert (cloud.classes.tolist(), cloud.times.tolist()) == ([2, 6, 6], [7.5, 8.5, 9.0])


@pytest.mark.parametrize(("lines", "points"), [
    (["intensity,northing,easting,height", "9,2,1,3"], [[1, 2, 3]]),
    (["2", "# made by hand", "1 2 3 0.5", "# and", "4 5 6 0.5"], [[1, 2, 3], [4, 5, 6]]),
    (["1 2 3", "4 5 6"], [[1, 2, 3], [4, 5, 6]]),
    (["x;y;z", "1;2;3"], [[1, 2, 3]]),
])  # fmt: skip
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_headers_counts_comments_and_a_byte_order_mark(tmp_path, lines, points, mark):
    """A file without a header that began with a byte order mark was refused."""
    np.testing.assert_array_equal(read_cloud(_write(tmp_path, [mark + lines[0], *lines[1:]])).points, points)


@pytest.mark.parametrize(("lines", "words"), [
    (["1 2"], "2 numbers per point, not 3"), (["x,y,z"], "x, y, z in each line"),
    (["a,b,c", "1,2,3"], "not one column 'x'"), (["x,y,z,z", "1,2,3,4"], "more than one column 'z'"),
    (["x,y,z,a", "1,2,3"], "3 numbers per point, not 4"), (["1,2,3", "1,2,x"], "could not convert"),
    (["1,2,3", "1,2,3,4"], "number of columns changed"), (["hello world", "this is text"], "no such line"),
    (["1 " * 50_001], "a line of over"), (["x y z class", "1 2 3 900"], "900 as a class"),
    ([bytes(range(256)).decode("latin-1") * 400], "no such line"),
])  # fmt: skip
def test_what_is_no_cloud_is_refused(tmp_path, lines, words):
    with pytest.raises(FileError, match=rf"a\.xyz to be points as text.*{words}") as error:
        read_cloud(_write(tmp_path, lines))
    assert "\n" not in str(error.value)


def test_a_trajectory_is_no_cloud(tmp_path):
    poses = ["# timestamp x y z qx qy qz qw", *(f"{time} 550000 5802000 62 0 0 0.6 0.8" for time in range(3))]
    with pytest.raises(FileError, match=r"a\.xyz, got a trajectory: .* as --trajectory"):
        open_cloud(_write(tmp_path, poses))
    for others in (poses[:2], [*poses, poses[1]], [*poses, "9 8 7 6 0 0 0 2"]):
        assert len(read_cloud(_write(tmp_path, others)).points) == len(others) - 1


def test_other_suffixes_and_empty_files(tmp_path):
    (tmp_path / "a.dxf").write_text("0 0 0")
    suffixes = r"\.las, \.laz, \.ply, \.pcd, \.npz, \.e57, \.xyz, \.csv, \.txt"
    with pytest.raises(FileError, match=rf"suffix {suffixes}, got .*a\.dxf\. Convert"):
        open_cloud(tmp_path / "a.dxf")
    for suffix in CLOUD_SUFFIXES:
        (tmp_path / f"c{suffix}").touch()
        with pytest.raises(FileError, match=rf"c\{suffix}, an empty file"):
            open_cloud(tmp_path / f"c{suffix}")
