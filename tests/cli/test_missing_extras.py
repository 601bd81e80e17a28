# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Without the optional packages: one line that says what to install, before any work is done."""

import sys

import numpy as np
import pytest


@pytest.fixture
def without(monkeypatch):
    """Make packages impossible to import."""

    def hide(*names):
        for name in names:
            for loaded in [n for n in sys.modules if n == name or n.startswith(f"{name}.")]:
                monkeypatch.delitem(sys.modules, loaded)
            monkeypatch.setitem(sys.modules, name, None)

    return hide


@pytest.mark.parametrize("package", ["embreex", "matplotlib", "jinja2"])
def test_a_demo_needs_the_extra_demo(maxcon, refused, without, tmp_path, monkeypatch, package):
    monkeypatch.setattr("maxcon.lab.demo.run.simulate", None)
    without(package)
    refused(maxcon("demo", "--out", tmp_path / "demo"), package, "pip install 'maxcon[demo]'")
    assert list(tmp_path.iterdir()) == []


def test_simulating_needs_the_extra_demo(maxcon, refused, without, tmp_path):
    without("embreex")
    refused(maxcon("simulate", tmp_path / "dataset"), "embreex", "pip install 'maxcon[demo]'")
    assert list(tmp_path.iterdir()) == []


def test_pictures_need_the_extra_demo(maxcon, refused, without, drive, tmp_path):
    without("matplotlib")
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior)
    outputs = ("-o", tmp_path / "poses.csv", "--plot", tmp_path / "pictures")
    refused(maxcon(*arguments, *outputs), "matplotlib", "pip install 'maxcon[demo]'")
    assert list(tmp_path.iterdir()) == []


def test_localizing_needs_no_extra(maxcon, without, drive, tmp_path):
    without("matplotlib", "embreex", "jinja2", "trimesh", "pypcd4")
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior)
    assert maxcon(*arguments, "-o", tmp_path / "poses.csv").code == 0


def test_compressed_pcd_needs_the_extra_pcd(maxcon, refused, without, drive, tmp_path):
    pypcd4 = pytest.importorskip("pypcd4")
    scans = tmp_path / "scans"
    scans.mkdir()
    points = np.fromfile(drive.dataset.scans / "000000.bin", "<f4").reshape(-1, 4)[:, :3]
    points = np.repeat(points[:500], 5, axis=0)  # what does not compress, pypcd4 writes uncompressed
    pypcd4.PointCloud.from_xyz_points(points).save(scans / "386400.0.pcd", encoding=pypcd4.Encoding.BINARY_COMPRESSED)
    arguments = ("localize", drive.city, scans, "--prior", drive.dataset.prior, "-o", tmp_path / "poses.csv")
    assert b"DATA binary_compressed\n" in (scans / "386400.0.pcd").read_bytes()
    assert maxcon(*arguments).code in (0, 1)
    (tmp_path / "poses.csv").unlink()
    without("pypcd4")
    refused(maxcon(*arguments), scans / "386400.0.pcd", "pypcd4", "pip install 'maxcon[pcd]'")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scans"]


def test_a_geopackage_needs_the_extra_export(maxcon, refused, without, drive, tmp_path):
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior)
    maxcon(*arguments, "-o", tmp_path / "poses.csv")
    without("pyogrio")
    ended = maxcon("export", tmp_path / "poses.csv", "-o", tmp_path / "a.gpkg", "--map", drive.city)
    refused(ended, "pyogrio", "pip install 'maxcon[export]'")
    assert [path.name for path in tmp_path.iterdir()] == ["poses.csv"]


def test_workers_of_a_cluster_need_the_extra_engine(maxcon, refused, without, drive, tmp_path):
    without("distributed")
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior)
    ended = maxcon(*arguments, "--scheduler", "tcp://127.0.0.1:8786", "-o", tmp_path / "poses.csv")
    refused(ended, "dask.distributed", "pip install 'maxcon[engine]'")
    assert list(tmp_path.iterdir()) == []
