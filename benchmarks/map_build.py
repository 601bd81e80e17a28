# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How many points per second does a map build take in, and how much memory?

    python benchmarks/map_build.py CLOUD... [--trajectory TUM]
    python benchmarks/map_build.py --synthetic 50

The first builds from real clouds; the second from so many million points along a simulated road of
kilometres, written as LAS first. Every build is a process of its own, so that its peak memory is its own.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scene import header


def synthetic_cloud(path: Path, n_million: int) -> None:
    """LAS of facades on both sides of a road: 3,000 points per metre, as a mobile mapping vehicle leaves."""
    import laspy

    las_header = laspy.LasHeader(point_format=6, version="1.4")
    las_header.scales = [0.001] * 3
    las_header.offsets = [550_000.0, 5_802_000.0, 60.0]
    rng = np.random.default_rng(0)
    with laspy.open(path, mode="w", header=las_header) as writer:
        for number in range(n_million):
            n = 1_000_000
            along = rng.uniform(0.0, 333.0, n) + 333.0 * number
            side = rng.choice([-1.0, 1.0], n)
            recess = np.where((along % 3.0 < 1.2), 0.25, 0.0)
            records = laspy.ScaleAwarePointRecord.zeros(n, header=las_header)
            records.x = 550_000.0 + along
            records.y = 5_802_000.0 + side * (8.0 + recess) + rng.normal(0.0, 0.01, n)
            records.z = 60.0 + rng.uniform(0.0, 15.0, n)
            records.classification[:] = 6
            records.gps_time = along / 8.0
            writer.write_points(records)
    write_trajectory(path.with_suffix(".txt"), 333.0 * n_million)


def write_trajectory(path: Path, length: float) -> None:
    """The vehicle's: along the middle of the road at 8 m/s."""
    times = np.arange(0.0, length / 8.0 + 0.2, 0.1)
    rows = [f"{t:.3f} {550_000.0 + 8.0 * t:.3f} 5802000.0 62.0 0 0 0 1" for t in times]
    path.write_text("\n".join(rows) + "\n")


def build(clouds: list[str], trajectory: str | None) -> None:
    """Build once and print seconds, points, voxels and peak memory."""
    from maxcon.io.trajectories import read_trajectory
    from maxcon.mapping import MapOptions, build_map

    options = MapOptions(trajectory=read_trajectory(trajectory) if trajectory else None)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        manifest = build_map(clouds, Path(folder) / "benchmark.map", options)
        seconds = time.perf_counter() - start
    n_points = sum(source["n_points"] for source in manifest.build["sources"])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(seconds, n_points, manifest.n_voxels, len(manifest.tiles), peak)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("clouds", nargs="*")
    parser.add_argument("--trajectory")
    parser.add_argument("--synthetic", type=int, metavar="MILLION")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--once", action="store_true", help="build once and print the figures alone")
    options = parser.parse_args()
    if options.once:
        build(options.clouds, options.trajectory)
        return
    with tempfile.TemporaryDirectory() as folder:
        clouds, trajectory = options.clouds, options.trajectory
        if options.synthetic:
            cloud = Path(folder) / "road.las"
            synthetic_cloud(cloud, options.synthetic)
            clouds, trajectory = [str(cloud)], str(cloud.with_suffix(".txt"))
        header("Map build")
        print("| run | points | voxels | tiles | s | points/s | peak GiB |")
        print("|---|---|---|---|---|---|---|")
        for run in range(options.runs):
            command = [sys.executable, __file__, "--once", *clouds]
            command += ["--trajectory", trajectory] if trajectory else []
            result = subprocess.run(command, capture_output=True, text=True, check=True)
            s, n, voxels, tiles, peak = (float(value) for value in result.stdout.split())
            print(f"| {run} | {n:,.0f} | {voxels:,.0f} | {tiles:.0f} | {s:.1f} | {n / s:,.0f} | {peak:.2f} |")


if __name__ == "__main__":
    main()
