# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scans as PCD files: what was written is read, times of points included."""

import numpy as np
import pytest

from maxcon.errors import MaxconError
from maxcon.io.scans import RawScan, Scans, open_scans
from maxcon.io.scans.description import describe
from maxcon.lab.simulation.datasets.pcd_scans import write_pcd_folder


class Made(Scans):
    """Two scans of random points."""

    def __init__(self, *, has_times):
        self.times, self.has_times = np.array([1_626_870_701.0, 1_626_870_701.1]), has_times

    def name(self, i):
        return str(i)

    def read(self, i, min_range=1.0, max_range=120.0):
        points = np.random.default_rng(i).uniform(-50, 50, (500, 3)).astype(np.float32).astype(np.float64)
        offsets = np.linspace(-0.05, 0.05, 500) if self.has_times else None
        return RawScan(points, float(self.times[i]), str(i), 500, 0, 0, 0, offsets)


@pytest.mark.parametrize("has_times", [True, False])
def test_what_was_written_is_read(tmp_path, has_times):
    made = Made(has_times=has_times)
    write_pcd_folder(tmp_path / "pcd", made)
    scans = open_scans(tmp_path / "pcd")
    np.testing.assert_allclose(scans.times, made.times, atol=1e-8)
    for i in range(2):
        raw, wanted = scans.read(i, 2.0, 200.0), made.read(i)
        is_kept = np.linalg.norm(wanted.points, axis=1) >= 2.0
        np.testing.assert_array_equal(raw.points, wanted.points[is_kept])
        if has_times:
            np.testing.assert_allclose(raw.point_times, wanted.point_times[is_kept], atol=1e-8)
        else:
            assert raw.point_times is None
    (scanner,) = describe(tmp_path / "pcd").scanners
    assert ("t float32" in scanner.fields) == has_times
    assert ("relative" in scanner.times or "from the message" in scanner.times) == has_times


def test_only_a_folder_of_such_files_is_replaced(tmp_path):
    made = Made(has_times=False)
    write_pcd_folder(tmp_path / "pcd", made)
    with pytest.raises(MaxconError):
        write_pcd_folder(tmp_path / "pcd", made)
    write_pcd_folder(tmp_path / "pcd", made, overwrite=True)
    (tmp_path / "pcd" / "thesis.txt").write_text("years of work")
    with pytest.raises(MaxconError):
        write_pcd_folder(tmp_path / "pcd", made, overwrite=True)
    assert (tmp_path / "pcd" / "thesis.txt").exists()
