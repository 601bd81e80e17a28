# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The scene the benchmarks share: a simulated street, mapped, and a VLP-16 in it."""

import platform
import time
from pathlib import Path

import numpy as np

import maxcon
from maxcon.geometry import Pose
from maxcon.lab.demo import DemoDrive, prepare_demo
from maxcon.lab.simulation import LasClass, RotatingScanner, SimulatedWorld

N_POINTS = 24_000
BEFORE = 120.0


def street(folder: Path) -> DemoDrive:
    """A street of 120 m before a crossing, mapped; about 2 million voxels."""
    return prepare_demo(folder, n_epochs=1, seed=0, progress=lambda *_: None, before=BEFORE)


def scans(drive: DemoDrive, n_scans: int, azimuth_step_deg: float = 0.13) -> list[tuple[maxcon.Scan, Pose]]:
    """Scans of exactly 24,000 off-ground points along the drive, and their priors in the map's frame.

    A VLP-16 has 28,800 rays, a third on the ground: to get so many off it, the rays lie closer here.
    """
    from maxcon.lab.simulation.datasets import CITY_ORIGIN

    world = SimulatedWorld.build(0, BEFORE, 50.0)
    scanner = RotatingScanner(azimuth_step_deg=azimuth_step_deg)
    rng = np.random.default_rng(0)
    found = []
    epochs = world.epochs(n_scans)
    for epoch, rough in zip(epochs, world.uniform_priors(epochs), strict=True):
        returns = world.scan(epoch, scanner)
        is_off_ground = returns.classes != LasClass.GROUND
        points = (returns.points[is_off_ground] - epoch.reference.position) @ epoch.reference.rotation
        chosen = np.sort(rng.permutation(len(points))[:N_POINTS])
        prior = drive.point_map.frame.pose_to_local(rough.translated(CITY_ORIGIN))
        found.append((maxcon.Scan(points[chosen]), prior))
    return found


def times_ms(call, n=15):
    """Times of a call, ms, after one to warm up."""
    call()
    taken = []
    for _ in range(n):
        start = time.perf_counter()
        call()
        taken.append(1e3 * (time.perf_counter() - start))
    return np.array(taken)


def header(title: str) -> None:
    """Say what was measured, and where."""
    print(f"# {title}\n\nmaxcon {maxcon.__version__}, Python {platform.python_version()}, {_processor()}\n")


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({len(names)} processors)" if names else platform.processor()
