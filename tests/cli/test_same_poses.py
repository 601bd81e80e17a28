# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One simulated drive in six formats has the same poses within 1 cm."""

import numpy as np
import pytest

from localized_poses import localized_poses
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.simulation import simulate
from maxcon.lab.simulation.datasets.recordings import RecordingKind, ScansKind, record_dataset, write_dataset_scans
from maxcon.lab.simulation.sensing.firing_scanner import FiringScanner
from maxcon.mapping.build import MapOptions, build_map

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
pytest.importorskip("velodyne_decoder")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, thin_profiles):
    """A drive of four epochs with the scanner whose packets can be written."""
    return simulate(
        tmp_path_factory.mktemp("drive") / "dataset", n_epochs=4, seed=3, before=30.0, after=20.0,
        mapping_scanners=thin_profiles, scanner=FiringScanner(),
    )  # fmt: skip


@pytest.fixture(scope="module")
def city(dataset, tmp_path_factory):
    """Its map."""
    folder = tmp_path_factory.mktemp("map") / "city.map"
    options = MapOptions(trajectory=read_trajectory(dataset.map_trajectory), vehicle_classes=(64,))
    build_map(dataset.map_clouds, folder, options)
    return folder


def test_six_formats_have_the_same_poses(maxcon, dataset, city, tmp_path):
    sources = {"KITTI": dataset.scans}
    sources |= {kind.value: record_dataset(dataset, kind) for kind in RecordingKind}
    sources |= {kind.value: write_dataset_scans(dataset, kind) for kind in ScansKind}
    poses = {}
    for name, scans in sources.items():
        has_poses = name in list(RecordingKind)
        prior = () if has_poses else ("--prior", dataset.prior)
        ended = maxcon("localize", city, scans, *prior, "-o", tmp_path / f"{name}.csv", "-q")
        assert (ended.code, ended.err) == (0, ""), name
        poses[name] = localized_poses(tmp_path / f"{name}.csv")
    assert len(poses) == 6
    for name, found in poses.items():
        off = np.abs(found - poses["KITTI"])
        assert off[:, :4].max() < (0.01 if name == "pcap" else 1e-4), (name, off.max(axis=0))
        assert off[:, 4].max() < np.radians(0.01), (name, off.max(axis=0))


def test_the_command_writes_packets_of_a_scanner_that_has_such(maxcon, refused, tmp_path):
    arguments = ("simulate", tmp_path / "dataset", "--recording")
    refused(maxcon(*arguments, "pcap", "--scanner", "vlp-32c"), "the packets of a vlp-16", "--scanner vlp-32c")
    refused(maxcon(*arguments, "pcap", "--scene", "suburb"), "the packets of a vlp-16", "--scene suburb")
    refused(maxcon(*arguments, "cdr"), "one of bag, ros2, mcap, pcap, pcd", "'cdr'")
    assert not list(tmp_path.iterdir())
