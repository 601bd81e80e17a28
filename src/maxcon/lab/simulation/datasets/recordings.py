# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A dataset's drive as a file of each kind: a bag, an MCAP file, a capture of packets, or PCD files."""

from enum import StrEnum
from pathlib import Path

from maxcon.io.recordings.writing import RecordingKind
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation.datasets.dataset_files import CRS
from maxcon.lab.simulation.datasets.recorded_drive import record_drive

__all__ = ["RECORDING_NAMES", "RecordingKind", "ScansKind", "record_dataset", "write_dataset_scans"]


class ScansKind(StrEnum):
    """Formats that hold scans only, without poses."""

    PCAP = "pcap"
    PCD = "pcd"


RECORDING_NAMES: dict[RecordingKind | ScansKind, str] = {
    RecordingKind.ROS1: "drive.bag",
    RecordingKind.ROS2: "drive_ros2",
    RecordingKind.MCAP: "drive.mcap",
    ScansKind.PCAP: "drive.pcap",
    ScansKind.PCD: "drive_pcd",
}
"""File or folder, in that of the dataset, of each kind of recording."""


def record_dataset(dataset: Dataset, kind: RecordingKind, *, sigma: float = 0.0) -> Path:
    """Write the scans of a dataset, its first prior and its odometry as a recording into its folder; return the path.

    It raises what `record_drive` raises.
    """
    path = dataset.folder / RECORDING_NAMES[kind]
    odometry = None if dataset.odometry is None else read_trajectory(dataset.odometry)
    scans, prior = open_scans(dataset.scans, dataset.times), read_trajectory(dataset.prior)
    record_drive(path, kind, scans, prior, dataset.crs or CRS, sigma=sigma, odometry=odometry, overwrite=True)
    return path


def write_dataset_scans(dataset: Dataset, kind: ScansKind) -> Path:
    """Write the scans of a dataset as a capture of packets or as PCD files into its folder; return the path.

    It raises what `write_capture` and `write_pcd_folder` raise.
    """
    from maxcon.lab.simulation.datasets.pcd_scans import write_pcd_folder
    from maxcon.lab.simulation.datasets.velodyne_packets import write_capture

    path, scans = dataset.folder / RECORDING_NAMES[kind], open_scans(dataset.scans, dataset.times)
    if kind is ScansKind.PCAP:
        write_capture(path, scans)
    else:
        write_pcd_folder(path, scans, overwrite=True)
    return path
