# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How many points per second does a map build take in, by how many, and how much memory?

    python benchmarks/map_build.py CLOUD... [--trajectory TUM] [--workers 0,1,2]
    python benchmarks/map_build.py --synthetic 50

The first builds from real clouds; the second from so many million points along a simulated road of
kilometres, written as LAS first. Every build is a process of its own, so that its peak memory is its own. With 0
workers threads of that process make the tiles, with 1 one of them, with more so many processes. Reading is all until
the first tile; what else processors were busy with is making tiles.
"""

import argparse
import hashlib
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from header import header


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


def build(clouds: list[str], trajectory: str | None, n_workers: int) -> None:
    """Build once and print what it took, and what the map's bytes are."""
    from maxcon._system.engine import Engine
    from maxcon.io.trajectories import read_trajectory
    from maxcon.mapping.build import MapOptions, build_map

    options = MapOptions(trajectory=read_trajectory(trajectory) if trajectory else None)
    read = []

    def report(step: str, done: int, total: int) -> None:
        if step == "making tiles" and not read:
            read.append((time.perf_counter() - start, processors()))

    with tempfile.TemporaryDirectory() as name:
        start, folder = time.perf_counter(), Path(name) / "benchmark.map"
        engine = Engine(n_workers) if n_workers > 1 else None
        manifest = build_map(
            clouds, folder, options, n_threads=1 if n_workers == 1 else None, engine=engine, progress=report
        )
        seconds, total = time.perf_counter() - start, processors()
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        n_bytes = sum(path.stat().st_size for path in files)
        checksum = hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:8]
    n_points = sum(source["n_points"] for source in manifest.build["sources"])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    ((read_seconds, read_processors),) = read
    print(
        n_points, manifest.n_voxels, len(manifest.tiles), read_seconds, read_processors, seconds - read_seconds,
        total - read_processors, peak, n_bytes, checksum,
    )  # fmt: skip


def processors() -> float:
    """Seconds of processors that this process and those that it has waited for were busy."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("clouds", nargs="*")
    parser.add_argument("--trajectory")
    parser.add_argument("--synthetic", type=int, metavar="MILLION")
    parser.add_argument("--workers", default="0", help="numbers of workers, in turns (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--once", action="store_true", help="build once and print the figures alone")
    options = parser.parse_args()
    if options.once:
        build(options.clouds, options.trajectory, int(options.workers))
        return
    with tempfile.TemporaryDirectory() as folder:
        clouds, trajectory = options.clouds, options.trajectory
        if options.synthetic:
            cloud = Path(folder) / "road.las"
            synthetic_cloud(cloud, options.synthetic)
            clouds, trajectory = [str(cloud)], str(cloud.with_suffix(".txt"))
        header("Map build")
        print("| workers | points | voxels | tiles | MB | reading s | processors | tiles s | processors | points/s |"
              " peak GiB | map |")  # fmt: skip
        print("|---" * 12 + "|")
        for _ in range(options.runs):
            for workers in options.workers.split(","):
                command = [sys.executable, __file__, *clouds, "--once", "--workers", workers]
                command += ["--trajectory", trajectory] if trajectory else []
                ended = subprocess.run(command, capture_output=True, text=True, check=True)
                *numbers, checksum = ended.stdout.split()
                n_points, n_voxels, n_tiles, reading, read_cpu, making, made_cpu, peak, n_bytes = map(float, numbers)
                print(
                    f"| {workers} | {n_points:,.0f} | {n_voxels:,.0f} | {n_tiles:.0f} | {n_bytes / 1e6:.0f} |"
                    f" {reading:.1f} | {read_cpu:.1f} | {making:.1f} | {made_cpu:.1f} |"
                    f" {n_points / (reading + making):,.0f} | {peak:.2f} | {checksum} |",
                    flush=True,
                )  # fmt: skip


if __name__ == "__main__":
    main()
