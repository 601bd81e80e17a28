"""Scan normals against surfaces that are known, seen by a synthetic ring scanner."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Scan
from maxcon.io.scans import open_scans
from maxcon.lab.simulation import ScannerLayout
from maxcon.scan.scan import estimate_scan_normals


def directions(n_rings=16, low_deg=-15.0, high_deg=15.0, step_deg=0.2, jitter_deg=0.0, seed=0):
    """Unit vectors of the beams of a ring scanner: 16 rings, 2 degrees apart, as of a VLP-16."""
    rng = np.random.default_rng(seed)
    elevations = np.radians(np.linspace(low_deg, high_deg, n_rings))
    azimuths = np.radians(np.arange(0.0, 360.0, step_deg))
    elevations, azimuths = (grid.ravel() for grid in np.meshgrid(elevations, azimuths, indexing="ij"))
    elevations = elevations + np.radians(rng.normal(0.0, jitter_deg, len(elevations)))
    level = np.cos(elevations)
    return np.column_stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)])


def angle_errors_deg(normals, true):
    return np.degrees(np.arccos(np.clip((normals * true).sum(axis=1), -1.0, 1.0)))


def assert_unit_and_turned_to_the_sensor(points, normals):
    lengths = np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(lengths[lengths > 0.0], 1.0, atol=1e-12)
    assert ((normals * points).sum(axis=1) <= 0.0).all()


def test_a_step_in_depth_is_not_bridged():
    """A pillar 2 m before a wall: at its edges no normal looks along the step."""
    beams = directions()
    beams = beams[beams[:, 1] > 0.15]
    ranges = np.where(np.abs(np.arctan2(beams[:, 0], beams[:, 1])) < 0.2, 6.0, 8.0) / beams[:, 1]
    points = (ranges + np.random.default_rng(1).normal(0.0, 0.03, len(beams)))[:, None] * beams
    normals = estimate_scan_normals(points[points[:, 2] > -1.7])
    has_normal = normals.any(axis=1)
    errors = angle_errors_deg(normals, np.array([0.0, -1.0, 0.0]))[has_normal]
    assert has_normal.mean() > 0.9 and np.quantile(errors, 0.99) < 15.0


@given(st.integers(0, 2**32), st.integers(0, 200), st.sampled_from([1e-6, 1e-2, 1.0, 50.0, 1e6]))
def test_whatever_comes_normals_are_unit_vectors_or_zeros(seed, n, scale):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3)) * scale
    points[rng.random(n) < 0.1] = 0.0
    points[rng.random(n) < 0.3, 2] = 0.0
    points[rng.random(n) < 0.1, :2] = 0.0  # straight up and down
    normals = estimate_scan_normals(points)
    assert normals.shape == points.shape
    assert_unit_and_turned_to_the_sensor(points, normals)


# Elevations of rings, deg: 16 evenly, 32 unevenly spaced, 64 in two blocks, 64 and 128 evenly.
RINGS_DEG = {
    "8 rings": np.linspace(-10.0, 10.0, 8), "16 rings": np.linspace(-15.0, 15.0, 16),
    "32 uneven rings": np.degrees(ScannerLayout.VLP_32C.scanner().elevations),
    "64 rings in two blocks": np.degrees(ScannerLayout.HDL_64E.scanner().elevations),
    "64 rings": np.linspace(-22.5, 22.5, 64), "128 rings": np.linspace(-22.5, 22.5, 128),
}  # fmt: skip


def room():
    """Five walls around the sensor, upright and leaning, at no special azimuth: unit normals, distances."""
    turns = 0.4 + np.arange(5) * 2.0 * np.pi / 5.0
    leaning = np.array([-0.25, 0.0, -0.25, 0.0, 0.35])
    normals = np.column_stack([-np.cos(turns), -np.sin(turns), leaning])
    return normals / np.linalg.norm(normals, axis=1)[:, None], np.array([8.0, 6.0, 15.0, 10.0, 7.0])


def sweep(layout, speed=0.0, noise=0.02, step_deg=0.35):
    """What a scanner sees of the room, and the true normals.

    It turns at 10 Hz and moves along x at `speed` (m/s); points are moved to where it is at the middle of the scan.
    """
    rng = np.random.default_rng(len(layout))
    if layout == "a cone":  # solid state: directions at random
        up, turn = rng.uniform(np.cos(np.radians(38.0)), 1.0, 12_000), rng.uniform(0.0, 2.0 * np.pi, 12_000)
        level = np.sqrt(1.0 - up * up)
        beams = np.column_stack([up, level * np.cos(turn), level * np.sin(turn)])
        origins = np.zeros_like(beams)
    else:
        beams = np.concatenate([directions(1, ring, ring, step_deg) for ring in RINGS_DEG[layout]])
        turn = np.arctan2(beams[:, 1], beams[:, 0]) % (2.0 * np.pi)
        origins = np.outer((turn / (2.0 * np.pi) - 0.5) * 0.1, [speed, 0.0, 0.0])
    normals, distances = room()
    with np.errstate(divide="ignore"):
        ranges = -(distances + origins @ normals.T) / (beams @ normals.T)
    ranges[ranges <= 0.5] = np.inf
    nearest, wall_seen = ranges.min(axis=1), ranges.argmin(axis=1)
    noisy = nearest + rng.normal(0.0, noise, len(nearest))
    return origins + noisy[:, None] * beams, normals[wall_seen]


@pytest.mark.parametrize(("speed", "is_thinned"), [(0.0, False), (15.0, False), (15.0, True)])
@pytest.mark.parametrize("layout", [*RINGS_DEG, "a cone"])
def test_whatever_the_layout_walls_get_their_normals(layout, speed, is_thinned):
    points, true = sweep(layout, speed)
    if is_thinned:  # one point of each voxel of 25 cm
        _, kept = np.unique(np.floor(points / 0.25).astype(int), axis=0, return_index=True)
        points, true = points[kept], true[kept]
    normals = estimate_scan_normals(points)
    assert_unit_and_turned_to_the_sensor(points, normals)
    has_normal = normals.any(axis=1)
    errors = angle_errors_deg(normals, true)[has_normal]
    assert has_normal.mean() > (0.75 if is_thinned else 0.85) and np.median(errors) < 3.0
    assert np.quantile(errors, 0.9) < (12.0 if is_thinned else 6.0)
    assert (np.abs(normals[has_normal, 2]) > 0.8).mean() < 0.005  # no wall is taken for ground


@pytest.mark.parametrize("elevation_deg", [-12.0, 1.0])
@pytest.mark.parametrize("speed", [0.0, 15.0])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_lone_ring_gives_no_vertical_normals(elevation_deg, speed, noise, monkeypatch):
    monkeypatch.setitem(RINGS_DEG, "one ring", np.array([elevation_deg]))
    points, _ = sweep("one ring", speed, noise, step_deg=0.1)
    normals = estimate_scan_normals(points)
    assert not (np.abs(normals[:, 2]) > 0.5).any() and normals.any(axis=1).mean() < 0.01


def test_points_in_one_direction_may_come_in_any_order_and_be_many():
    """Two echoes of a beam have the same angles: they, too, are told apart by where they are."""
    points, _ = sweep("16 rings")
    points = np.concatenate([points, 1.25 * points[::3], np.tile(points[:1], (40, 1)) * np.linspace(1, 2, 40)[:, None]])
    normals = estimate_scan_normals(points)
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(points))
        assert (estimate_scan_normals(points[order]) == normals[order]).all()
    rng = np.random.default_rng(0)
    points = rng.normal(size=(150_000, 3)) * [1e-3, 1e-3, 1e-3] + [20.0, 3.0, 1.0]  # all in one direction
    normals = estimate_scan_normals(points)
    assert_unit_and_turned_to_the_sensor(points, normals)


@pytest.mark.parametrize("drive", ["kitti360-suburb/scans", "kitti360-suburb/scans_raw", "kitti-0013/scans"])
def test_real_scans_have_horizontal_normals(real_data, drive):
    """Every fourth of 64 layers; the deskewed ones had none once."""
    folder = real_data(drive)
    scans = open_scans(folder)
    for i in range(0, len(scans), 8):
        normals = estimate_scan_normals(scans.read(i).points)
        is_horizontal = normals.any(axis=1) & (np.abs(normals[:, 2]) < 0.3)
        assert is_horizontal.mean() > (0.25 if drive.startswith("kitti360") else 0.06)
        assert normals.any(axis=1).mean() < 0.8  # bushes have none


def test_memory_does_not_grow_with_the_epochs():
    scans = [sweep("16 rings", 3.0 * i, step_deg=0.8)[0] for i in range(5)]

    def prepare(n_epochs):
        for i in range(n_epochs):
            assert Scan(scans[i % len(scans)]).normals.any()

    prepare(5)
    tracemalloc.start()
    try:
        prepare(5)
        held, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        prepare(20)
        held_after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    largest = max(scan.nbytes for scan in scans)
    assert held_after - held < 0.1 * largest and peak - held < 12 * largest
