"""E57: poses of scans, invalid points, chunks, and the odd files of other programs."""

import sys

import numpy as np
import pytest

from maxcon.errors import FileError, MissingExtraError
from maxcon.geometry import Pose
from read_clouds import read_cloud

pye57 = pytest.importorskip("pye57")

HALF = np.sqrt(0.5)


def read_points(path, max_points=1_000_000):
    return read_cloud(path, max_points).points


@pytest.fixture
def two_scans(tmp_path):
    """A file with a scan without a pose, and one that is turned by 90 degrees about z and moved; points in both."""
    rng = np.random.default_rng(0)
    own = [rng.uniform(-20, 20, (n, 3)) for n in (1500, 700)]
    path = tmp_path / "two.e57"
    file = pye57.E57(str(path), mode="w")
    poses = ({}, {"rotation": np.array([HALF, 0, 0, HALF]), "translation": np.array([550_000.25, 5_802_000.5, 60.0])})
    for points, pose in zip(own, poses, strict=True):
        data = {f"cartesian{axis}": points[:, i].copy() for i, axis in enumerate("XYZ")}
        data["cartesianInvalidState"] = (np.arange(len(points)) % 10 == 3).astype(np.int8)
        file.write_scan_raw(data, **pose)
    file.close()
    turned = Pose(550_000.25, 5_802_000.5, 60.0, 0.0, 0.0, np.pi / 2).apply(own[1])
    expected = np.concatenate([own[0], turned])
    invalid = np.concatenate([np.arange(1500), np.arange(700)]) % 10 == 3
    return path, expected, invalid


@pytest.mark.parametrize("max_points", [1_000_000, 400])
def test_poses_are_applied_and_invalid_points_are_none(two_scans, max_points):
    path, expected, invalid = two_scans
    points = read_points(path, max_points)
    assert np.isnan(points[invalid]).all()
    np.testing.assert_allclose(points[~invalid], expected[~invalid], atol=1e-5)  # float32 in the file's scans


def test_a_file_that_is_none_one_cut_off_and_no_package(two_scans, tmp_path, monkeypatch):
    path = two_scans[0]
    content = path.read_bytes()
    for number, broken in enumerate((b"no", content[: len(content) // 2], b"\0" * 3000, content[:1000] + b"\xff" * 9)):
        file = tmp_path / f"{number}.e57"
        file.write_bytes(broken)
        with pytest.raises(FileError, match=rf"{number}\.e57") as error:
            read_points(file)
        assert "\n" not in str(error.value)
    monkeypatch.setitem(sys.modules, "pye57", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[e57\]'"):
        read_points(path)


def test_points_of_real_files(real_data):
    folder = real_data("recorders/e57")
    moved = read_points(folder / "pye57" / "translationWithoutRotation.e57")
    np.testing.assert_allclose(moved.min(axis=0), [4.0, 5.0, 6.0])
    sphere = read_points(folder / "cry-inc" / "tiny_spherical.e57")
    distances = np.linalg.norm(sphere[np.isfinite(sphere).all(axis=1)], axis=1)
    assert distances.max() < 10.0 and distances.min() > 0.5
    doubles, integers = (read_points(folder / "cry-inc" / f"bunny{kind}.e57") for kind in ("Double", "Int24"))
    np.testing.assert_allclose(doubles, integers, atol=1e-4)
