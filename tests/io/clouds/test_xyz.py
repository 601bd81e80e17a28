# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points as text: separators, headers, comments, chunks, and what is refused."""

import numpy as np
import pytest

from maxcon.errors import FileError
from maxcon.io.clouds import open_cloud

ROWS = [
    (550_000.25, 5_802_000.5, 61.125, 2, 7.5),
    (550_001.5, 5_802_001.0, 62.0, 6, 8.5),
    (1.0, 2.0, float("nan"), 6, 9),
]


def _read(path, max_points=1_000_000):
    with open_cloud(path) as reader:
        chunks = list(reader.chunks(max_points))
        assert reader.header.n_points == sum(len(chunk.points) for chunk in chunks)
        return reader.header, chunks


def _write(tmp_path, lines, name="a.xyz"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["a.xyz", "a.csv", "a.txt"])
@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   "])
@pytest.mark.parametrize("header", [None, "x{0}y{0}z{0}Classification{0}gps_time", "//X{0}Y{0}Z{0}label{0}GpsTime"])
def test_columns_by_name_or_the_first_three(tmp_path, name, separator, header):
    lines = [separator.join(map(str, row)) for row in ROWS]
    lines = lines if header is None else [header.format(separator), *lines]
    found, chunks = _read(_write(tmp_path, ["", *lines, ""], name), 2)
    np.testing.assert_array_equal(np.concatenate([c.points for c in chunks]), [row[:3] for row in ROWS])
    assert [len(c.points) for c in chunks] == [2, 1]
    assert found.has_classes == found.has_times == (header is not None) and not found.has_asprs_classes
    if header is not None:
        assert np.concatenate([c.classes for c in chunks]).tolist() == [2, 6, 6]
        assert np.concatenate([c.times for c in chunks]).tolist() == [7.5, 8.5, 9.0]


def test_columns_in_another_order_and_others_between(tmp_path):
    path = _write(tmp_path, ["intensity,northing,easting,height", "9,2,1,3"], "a.csv")
    np.testing.assert_array_equal(_read(path)[1][0].points, [[1.0, 2.0, 3.0]])


def test_a_count_first_a_comment_and_a_byte_order_mark(tmp_path):
    path = _write(tmp_path, ["\ufeff2", "# made by hand", "1 2 3 0.5", "# and", "4 5 6 0.5"])
    np.testing.assert_array_equal(_read(path)[1][0].points, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["1 2"], "got 2 numbers"),
        (["x,y,z"], "x, y, z in each line"),
        (["a,b,c", "1,2,3"], "one column 'x'"),
        (["x,y,z,z", "1,2,3,4"], "more than one"),
        (["x,y,z,a", "1,2,3"], "4 numbers per point"),
        (["1,2,3", "1,2,x"], "rows of numbers"),
        (["1,2,3", "1,2,3,4"], "rows of numbers"),
        (["hello world", "this is text"], "Is it the right file"),
        (["1 " * 5000], "a line of over|x, y, z"),
        (["x y z class", "1 2 3 900"], "class codes from 0 to 255"),
    ],
)
def test_what_is_no_cloud_is_refused(tmp_path, lines, words):
    with pytest.raises(FileError, match=words) as error:
        _read(_write(tmp_path, lines))
    assert "a.xyz" in str(error.value) and "\n" not in str(error.value)


def test_bytes_are_no_text(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_bytes(bytes(range(256)) * 4000)
    with pytest.raises(FileError, match=r"a\.xyz"):
        _read(path)


def test_a_map_of_text(tmp_path):
    from maxcon.mapping.build import MapOptions, build_map

    rng = np.random.default_rng(2)
    wall = np.column_stack([rng.uniform(0, 5, 4000), np.full(4000, 3.0), rng.uniform(0, 3, 4000)])
    path = _write(
        tmp_path, [f"{x:.4f};{y};{z:.4f};6" for x, y, z in (wall + [550_000, 5_802_000, 60]).tolist()], "wall.csv"
    )
    manifest = build_map([path], tmp_path / "wall.map", MapOptions(crs="EPSG:25832"))
    assert manifest.n_points == 4000
