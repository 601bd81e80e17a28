# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packets of a VLP-16: an independent decoder finds the points that were put in, up to what packets can say."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon.errors import ArrayError, OptionError
from maxcon.io.scans import RawScan, Scans, open_scans
from maxcon.lab.simulation import RotatingScanner
from maxcon.lab.simulation.datasets.velodyne_packets import packets_of_scan, write_capture
from maxcon.lab.simulation.sensing.firing_scanner import FiringScanner

pytest.importorskip("velodyne_decoder")


class AlongRays(Scans):
    """Every ray of a scanner returns, at a range of its own."""

    def __init__(self, scanner, times):
        self.scanner, self.times = scanner, np.array(times)

    def name(self, i):
        return str(i)

    def read(self, i, min_range=1.0, max_range=120.0):
        ranges = np.random.default_rng(i).uniform(2.0, 90.0, len(self.scanner.directions))
        points = self.scanner.directions * ranges[:, None]
        if isinstance(self.scanner, FiringScanner):
            points[:, 2] += np.tile(self.scanner.heights, self.scanner.n_columns)
        return RawScan(points.astype(np.float32).astype(np.float64), float(self.times[i]), str(i), len(points), 0, 0)


def test_a_decoder_finds_the_points_and_the_times_of_the_scans(tmp_path):
    written = AlongRays(FiringScanner(), [386400.0, 386400.11, 386407.0])
    write_capture(tmp_path / "drive.pcap", written)
    read = open_scans(tmp_path / "drive.pcap")
    np.testing.assert_allclose(read.times, written.times, atol=5e-6)
    for i in range(3):
        true, raw = written.read(i).points, read.read(i, 0.0, 200.0)
        distances, rows = cKDTree(true).query(raw.points)
        assert len(raw.points) == len(np.unique(rows)) == len(true) == 28_800
        ranges = np.linalg.norm(true[rows], axis=1)
        # 2 mm in range and 0.01 degrees in azimuth: half of each at most.
        assert (distances < 0.0011 + np.radians(0.0055) * ranges).all()
        assert raw.point_times.min() == pytest.approx(-0.0497, abs=1e-4)


def test_points_of_another_scanner_are_refused(tmp_path):
    with pytest.raises(ArrayError, match="on the rays of a VLP-16"):
        write_capture(tmp_path / "drive.pcap", AlongRays(RotatingScanner(), [1.0]))
    with pytest.raises(ArrayError, match="up to 131 m"):
        packets_of_scan(140.0 * FiringScanner().directions[:1], 1.0)
    assert not list(tmp_path.iterdir())


def test_turns_that_overlap_are_refused(tmp_path):
    with pytest.raises(OptionError, match=r"at least a turn of 100\.9 ms apart"):
        write_capture(tmp_path / "drive.pcap", AlongRays(FiringScanner(), [1.0, 1.06]))
    assert not list(tmp_path.iterdir())
