# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_cloud: the suffix decides, and says so; broken files of every kind end in an error of ours."""

import laspy
import numpy as np
import pyproj
import pytest

from maxcon.errors import FileError
from maxcon.io.clouds import CLOUD_SUFFIXES, open_cloud
from read_clouds import POINTS, read_cloud


def _las(path, point_format, version):
    las = laspy.LasData(laspy.LasHeader(point_format=point_format, version=version))
    las.header.scales, las.header.offsets = np.full(3, 1e-3), POINTS[0]
    las.header.add_crs(pyproj.CRS.from_epsg(25832))
    las.xyz = np.tile(POINTS[:1], (200, 1)) + np.random.default_rng(5).uniform(0.0, 100.0, (200, 3))
    las.write(path)


def _ply(path, encoding):
    properties = "".join(f"property double {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    head = f"ply\nformat {encoding} 1.0\nelement vertex {len(POINTS)}\n{properties}end_header\n"
    rows = np.hstack([POINTS, POINTS])
    if encoding == "ascii":
        body = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()
    else:
        body = rows.astype("<f8" if encoding == "binary_little_endian" else ">f8").tobytes()
    path.write_bytes(head.encode() + body)


WRITERS = {
    "points-1.las": lambda path: _las(path, 1, "1.2"),
    "points-6.las": lambda path: _las(path, 6, "1.4"),
    "points-1.laz": lambda path: _las(path, 1, "1.2"),
    "points-6.laz": lambda path: _las(path, 6, "1.4"),
    "ascii.ply": lambda path: _ply(path, "ascii"),
    "little.ply": lambda path: _ply(path, "binary_little_endian"),
    "big.ply": lambda path: _ply(path, "binary_big_endian"),
    "stored.npz": lambda path: np.savez(path, points=POINTS, classes=np.arange(7)),
    "deflated.npz": lambda path: np.savez_compressed(path, points=POINTS, classes=np.arange(7)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_broken_clouds_end_in_an_error_of_ours(tmp_path, survives_breaking, name):
    path = tmp_path / name
    WRITERS[name](path)
    survives_breaking(path.read_bytes(), path.suffix, read_cloud, n_copies=100)


@pytest.mark.parametrize("name", ["a.pts", "a", "a.dxf"])
def test_other_suffixes_are_refused_with_a_list_of_what_is_read(tmp_path, name):
    (tmp_path / name).write_text("0 0 0")
    suffixes = r"\.las, \.laz, \.ply, \.npz, \.e57, \.xyz, \.csv, \.txt"
    with pytest.raises(FileError, match=rf"suffix {suffixes}, got .*a.* Convert"):
        open_cloud(tmp_path / name)


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_no_file_a_folder_and_an_empty_file(tmp_path, suffix):
    (tmp_path / f"b{suffix}").mkdir()
    (tmp_path / f"c{suffix}").touch()
    for name, words in (("a", "no such file"), ("b", "got the folder"), ("c", rf"c\{suffix}, got an empty file")):
        with pytest.raises(FileError, match=words):
            open_cloud(tmp_path / f"{name}{suffix}")
