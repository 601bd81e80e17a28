# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""From files to pictures: scans in a folder and rough poses in a text file, localized and drawn."""

import tempfile
from pathlib import Path

import numpy as np
from localize_one_scan import room

import maxcon


def write_drive(folder: Path, points: np.ndarray) -> None:
    """Write what a recorder would have: four scans of a drive along the street, and its rough poses as TUM."""
    (folder / "scans").mkdir()
    lines = []
    for second in range(4):
        seen = np.random.default_rng(second).choice(len(points), 20_000, replace=False)
        points_sensor = points[seen] - [5.0 * second - 8.0, 0.5, 1.8]
        np.savez(folder / "scans" / f"{second}.0.npz", points=points_sensor)
        lines.append(f"{second} {5.0 * second - 7.5} 0.1 1.8 0 0 0 1")
    (folder / "gnss.txt").write_text("\n".join(lines))


def localize_and_draw(folder: Path, point_map: maxcon.PointMap) -> None:
    """Localize the drive in a folder, and draw its poses and its last epoch there."""
    scans = maxcon.open_scans(folder / "scans")  # or a recording: "drive.bag", "drive.mcap"
    prior = maxcon.read_trajectory(folder / "gnss.txt")
    method = maxcon.MaximumConsensus(maxcon.SearchSpace(half_width=1.5, cell=0.06))

    epochs = list(maxcon.localize_drive(point_map, scans, prior, method))
    for epoch in epochs:
        print(f"{epoch.raw.name}: {epoch.status}, x {epoch.pose_global.x:.2f} m")

    poses = maxcon.Trajectory.from_poses(scans.times, [epoch.pose_global for epoch in epochs])
    maxcon.plot_poses(folder / "poses.png", poses, point_map, prior=prior)
    maxcon.plot_epoch(
        folder / "epoch.png",
        accumulator=method.accumulate(epochs[-1].scan, point_map, epochs[-1].prior),
        objective=maxcon.Helmert(),
        estimate=epochs[-1].estimate,
        scan=epochs[-1].scan,
        point_map=point_map,
        title="The last scan of the street",
    )


def main() -> None:
    points, normals = room()
    with tempfile.TemporaryDirectory() as name:
        write_drive(Path(name), points)
        localize_and_draw(Path(name), maxcon.PointMap.from_points(points, normals))
        print("pictures:", *sorted(path.name for path in Path(name).glob("*.png")))


if __name__ == "__main__":
    main()
