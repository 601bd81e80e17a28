"""The court: its map, and scans of it in KITTI's format."""

import numpy as np
import pytest
from court_drive import CELL, COURT, FRAME, N_SCANS, seen, truth, walls

from maxcon import PointMap


@pytest.fixture(scope="session")
def point_map():
    return PointMap.from_points(*walls(COURT), CELL, frame=FRAME)


@pytest.fixture(scope="session")
def scan_paths(tmp_path_factory):
    """Ten scans of the court; the fifth is no file of points, the last one empty within the range limits."""
    folder = tmp_path_factory.mktemp("scans")
    for epoch in range(N_SCANS):
        sensor = seen(*walls(COURT), truth(epoch), seed=epoch)[0] * (1e-3 if epoch == N_SCANS - 1 else 1.0)
        np.column_stack([sensor, np.zeros(len(sensor))]).astype("<f4").tofile(folder / f"{epoch:06d}.bin")
    (folder / "000004.bin").write_bytes(b"none")
    return sorted(folder.glob("*.bin"))
