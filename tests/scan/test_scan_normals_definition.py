"""Normals of a scan against their definition: one point at a time, as the page of the decision tells it.

The definition and the compiled code share numbers (heights, gates, ratios), directions (held to numpy's by tests of
their own) and the guess which window to try first in each band of elevation (`window_kernels`, held to a definition by
theirs), for where windows begin decides in which one two rings are found. All else is written twice. Windows are
counted in cells of the grid of elevation and azimuth, here as there: where a window ends, and what is picked from it,
are part of the result.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.scan import grid_kernels as grids
from maxcon.scan import normal_kernels as rules
from maxcon.scan import window_kernels as windows
from maxcon.scan.scan import estimate_scan_normals

LEAST_LEVEL = 1e-3  # m: straight above the sensor, no angle to the side is enough


class Directions(NamedTuple):
    """Points sorted by cell, in a cell by azimuth, x, y and z: sizes of cells and windows in rad."""

    points: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    row_step: float
    n_columns: int
    first_heights: np.ndarray  # half the height of the window that is tried first, for each point


class Outcome(NamedTuple):
    normal: np.ndarray
    growths: int  # how often the window grew before it ended
    end: str
    was_picked: bool  # some of what lay in the last window was left out


def sorted_by_direction(points):
    """Directions of points, and the number of each in the scan."""
    elevations, azimuths = windows.elevations_of(points.ravel()), windows.azimuths_of(points.ravel())
    lowest, highest = elevations.min(), elevations.max()
    first = np.empty(windows.BANDS, np.int64)
    row_step = (
        windows.WINDOWS[windows.first_windows(elevations, azimuths, lowest, highest, first)] / grids.CELLS_PER_WINDOW
    )
    n_rows = int((highest - lowest) / row_step + 1.0)
    n_columns = min(grids.MOST_COLUMNS, int(2.0 * np.pi / row_step))
    rows = ((elevations - lowest) / row_step).astype(int)
    columns = ((azimuths + np.pi) / (2.0 * np.pi) * n_columns).astype(int) % n_columns
    heights = np.array(windows.WINDOWS)[first[rows * windows.BANDS // n_rows]]
    order = np.lexsort((*points.T[::-1], azimuths, columns, rows))
    in_order = [values[order] for values in (points, rows, columns)]
    return Directions(*in_order, row_step, n_columns, heights[order]), order


def candidates_of(scan, i, height):
    """Numbers of the candidates in a window around point i, whether it is full, and whether some were left out.

    It is full, and grows no more, if they are many, and some of them in its highest and in its lowest row.
    """
    level, distance = np.hypot(*scan.points[i, :2]), np.linalg.norm(scan.points[i])
    to_side = max(rules.ALONG * height * distance, rules.ALONG_METRES) / max(level, LEAST_LEVEL)
    columns = int(min(to_side, rules.MOST_ALONG) / (2.0 * np.pi) * scan.n_columns + 0.5)
    columns = min(columns, scan.n_columns // 2 - 1)
    rows = int(np.ceil(height / scan.row_step - 1e-9))
    most = max(grids.LEAST_PER_ROW, min(grids.MOST_PER_ROW, grids.MOST_PER_WINDOW // (2 * rows + 1)))
    is_in_rows = np.abs(scan.rows - scan.rows[i]) <= rows
    picked, n_left_out = [], 0
    # Behind the seam of azimuths columns count on from the other end; what lies there is picked for itself.
    for turn in (-scan.n_columns, 0, scan.n_columns):
        is_inside = is_in_rows & (np.abs(scan.columns + turn - scan.columns[i]) <= columns)
        for row in np.unique(scan.rows[is_inside]):
            run = np.flatnonzero(is_inside & (scan.rows == row))
            picked.append(run[:: -(-len(run) // most)])
            n_left_out += len(run) - len(picked[-1])
    picked = np.concatenate(picked)
    reached = np.abs(scan.rows[picked] - scan.rows[i]) == rows
    above = scan.rows[picked] > scan.rows[i]
    has_both_sides = (reached & above).any() and (reached & ~above).any()
    return picked, has_both_sides and len(picked) >= grids.ENOUGH, n_left_out > 0


def plane_of(neighbours, point, height):
    """Unit normal, turned to the sensor, or zeros, and whether the neighbours are spread in two dimensions."""
    nothing, level = np.zeros(3), np.hypot(*point[:2])
    if len(neighbours) < windows.LEAST_NEIGHBOURS or level == 0.0:
        return nothing, False
    along = np.array([-point[1], point[0], 0.0]) / level
    up = np.cross(point, along) / np.linalg.norm(point)
    offsets = neighbours - neighbours.mean(axis=0)
    to_side, to_top = offsets @ along, offsets @ up
    slope = to_side @ to_top / max(to_side @ to_side, 1e-12 * len(neighbours))
    deviation = np.sqrt(np.mean((to_top - slope * to_side) ** 2))
    _, sizes, axes = np.linalg.svd(offsets, full_matrices=False)
    _, middle, smallest = sizes / np.sqrt(len(neighbours))
    least = max(windows.LEAST_SPREAD * height * np.linalg.norm(point), rules.LEAST_SPREAD_METRES)
    if deviation < least or middle < least:
        return nothing, False
    if smallest**2 > rules.FLATNESS * middle**2:
        return nothing, True
    return (-axes[2] if axes[2] @ point > 0.0 else axes[2]), True


def outcome_at(scan, i):
    """Let the window around point i grow until it holds two rings, or may not grow any more."""
    point, was_picked = scan.points[i], False
    distance = np.linalg.norm(point)
    first_height = max(scan.first_heights[i], rules.NEAR_METRES / max(distance, 1e-3))
    for growths in range(rules.MOST_GROWTHS + 1):
        height = windows.GROWTH**growths * first_height
        if height > windows.HIGHEST:
            return Outcome(np.zeros(3), growths, "too high", was_picked)
        picked, is_full, was_picked = candidates_of(scan, i, height)
        gate = max(rules.GATE_METRES, rules.GATE * height * distance)
        is_near = ((scan.points[picked] - point) ** 2).sum(axis=1) <= gate**2
        normal, is_spread = plane_of(scan.points[picked[is_near]], point, height)
        if is_spread:
            return Outcome(normal, growths, "plane" if normal.any() else "not flat", was_picked)
        if is_full:
            return Outcome(normal, growths, "full", was_picked)
    return Outcome(np.zeros(3), rules.MOST_GROWTHS, "too high", was_picked)


def worthwhile_growths(outcomes):
    """How often windows grow before all but a few of the planes that are not level are found, in a sample."""
    sample = outcomes[:: -(-len(outcomes) // rules.SAMPLE)]
    needed = np.array([o.growths for o in sample if o.normal.any() and abs(o.normal[2]) < rules.LEVEL])
    return next(g for g in range(rules.MOST_GROWTHS + 1) if (needed <= g).sum() >= rules.WORTHWHILE * len(needed))


def defined_normals(points):
    """Normals of a scan's points, (n, 3), n > 0, and how often each end came (Counter)."""
    scan, order = sorted_by_direction(points)
    outcomes = [outcome_at(scan, i) for i in range(len(points))]
    last = worthwhile_growths(outcomes)
    normals, ends = np.empty_like(points), Counter()
    for place, outcome in zip(order, outcomes, strict=True):
        is_tried = outcome.growths <= last
        normals[place] = outcome.normal if is_tried else 0.0
        ends[outcome.end if is_tried else "not worthwhile"] += 1
        ends["picked"] += is_tried and outcome.was_picked
        ends["grown"] += is_tried and outcome.growths > 0 and outcome.end == "plane"
    return normals, ends


def assert_as_defined(points):
    """The same points have a normal, and the same one; return how often each end came."""
    expected, ends = defined_normals(points)
    normals = estimate_scan_normals(points)
    np.testing.assert_array_equal(normals.any(axis=1), expected.any(axis=1))
    # A plane that runs through the sensor is turned to it either way.
    is_edge_on = np.abs((expected * points).sum(axis=1)) < 1e-9 * np.linalg.norm(points, axis=1)
    sign = np.where(is_edge_on, np.sign((normals * expected).sum(axis=1)), 1.0)
    np.testing.assert_allclose(sign[:, None] * normals, expected, rtol=0.0, atol=1e-9)
    return ends


RINGS_DEG = {
    "1 ring": [1.0], "8 rings": np.linspace(-10.0, 10.0, 8), "16 rings": np.linspace(-15.0, 15.0, 16),
    "uneven rings": [-25.0, -16.0, -11.0, -8.0, -6.0, -5.0, -4.3, -3.7, -3.3, -3.0, -2.7, -2.0, 0.3, 3.3, 10.3],
    "64 rings": np.linspace(-24.0, 2.0, 64),
}  # fmt: skip


def beams_of(layout, azimuth, rng, n=450):
    """About n unit vectors within 17 degrees of an azimuth (rad), and the moment of each, 0 to 1."""
    if layout == "a cone":  # solid state: directions at random
        turns, elevations = rng.uniform(-0.3, 0.3, n), np.arcsin(rng.uniform(-0.3, 0.3, n))
    else:
        rings = np.radians(RINGS_DEG[layout])
        turns = np.tile(np.linspace(-0.3, 0.3, n // len(rings)), len(rings))
        elevations = np.repeat(rings, n // len(rings)) + rng.normal(0.0, 1e-4, len(turns))
    level = np.cos(elevations)
    beams = np.column_stack([level * np.cos(azimuth + turns), level * np.sin(azimuth + turns), np.sin(elevations)])
    return beams, (turns + 0.3) / 0.6


# Planes around a view along x: unit normal, distance of the sensor, m; the nearest in front of a beam is seen.
SLOPE = np.array([-0.8, 0.0, -0.6])
GROUND = ((0.0, 0.0, 1.0), 1.7)
PLANES = {
    "a wall close by": [((-1.0, 0.0, 0.0), 1.8)],
    "a wall": [((-np.cos(0.5), -np.sin(0.5), 0.0), 7.0), GROUND],
    "a wall far off": [((-1.0, 0.0, 0.0), 40.0), GROUND],
    "a corner": [((-np.cos(0.6), -np.sin(0.6), 0.0), 6.0), ((-np.cos(0.8), np.sin(0.8), 0.0), 5.0)],
    "a roof": [(tuple(SLOPE), 9.0), GROUND],
}


def scene(layout, planes, azimuth=0.0, speed=0.0, noise=0.02, seed=0, **beams):
    """What a scanner that looks along an azimuth, rad, sees of planes while it moves to the left at a speed, m/s."""
    rng = np.random.default_rng(seed)
    c, s = np.cos(azimuth), np.sin(azimuth)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    directions, moments = beams_of(layout, azimuth, rng, **beams)
    origins = np.outer((moments - 0.5) * 0.1 * speed, rotation[:, 1] + [0.0, 0.0, 0.1])
    ranges = np.full(len(directions), np.inf)
    for normal, distance in PLANES[planes]:
        normal = rotation @ normal
        ahead = -(distance + origins @ normal) / (directions @ normal)
        ranges = np.where((ahead > 0.0) & (ahead < ranges), ahead, ranges)
    seen = ranges < 100.0
    noisy = ranges[seen] + rng.normal(0.0, noise, seen.sum())
    return origins[seen] + noisy[:, None] * directions[seen]


LAYOUTS = [*RINGS_DEG, "a cone"]


@pytest.mark.parametrize("planes", PLANES)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_planes_and_corners(layout, planes):
    ends = assert_as_defined(scene(layout, planes, azimuth=0.7))
    if planes == "a wall" and layout != "1 ring":
        assert ends["plane"] > 95


@pytest.mark.parametrize("layout", LAYOUTS)
def test_deskewed_and_thinned(layout):
    assert_as_defined(scene(layout, "a wall", azimuth=-1.0, speed=15.0))
    points = scene(layout, "a corner", azimuth=2.0, n=1000)
    _, kept = np.unique(np.floor(points / 0.2).astype(int), axis=0, return_index=True)
    assert len(kept) < 0.95 * len(points)
    assert_as_defined(points[kept])


@pytest.mark.parametrize("azimuth", [np.pi, -np.pi + 0.2, np.pi - 0.29])
@pytest.mark.parametrize("layout", ["16 rings", "a cone"])
def test_across_the_seam_of_azimuths(layout, azimuth):
    points = scene(layout, "a corner", azimuth)
    assert (points[:, 1] > 0.0).any() and (points[:, 1] < 0.0).any()
    assert assert_as_defined(points)["plane"] > 95


@pytest.mark.parametrize("azimuth", [0.0, np.pi / 2.0, np.pi])
def test_along_the_axes_without_noise(azimuth):
    """Of the columns that give a normal, all but one are next to nothing."""
    assert assert_as_defined(scene("16 rings", "a wall close by", azimuth, noise=0.0))["plane"] > 95


def test_duplicates_echoes_and_points_without_a_direction():
    points = scene("16 rings", "a wall", azimuth=3.0, n=600)
    many = np.concatenate([
        points, points[::2], 1.2 * points[::3],
        np.tile(points[50], (60, 1)),  # in one place
        np.outer(np.linspace(0.9, 1.1, 60), points[90]),  # in one direction
        np.zeros((7, 3)), np.outer(np.linspace(-3.0, 3.0, 9), [0.0, 0.0, 1.0]),
    ])  # fmt: skip
    assert assert_as_defined(np.random.default_rng(0).permutation(many))["plane"] > 200


@pytest.mark.parametrize("seed", range(2))
def test_scattered_points(seed):
    rng = np.random.default_rng(seed)
    assert_as_defined(rng.uniform(-6.0, 6.0, (800, 3)) * [1.0, 1.0, 0.3])
    assert_as_defined(rng.normal(size=(500, 3)) * [0.3, 0.5, 0.02] + [6.0, 3.0, 1.0])


def test_the_scenes_bring_every_end_about():
    """Otherwise they would agree on what never happens."""
    bush = np.random.default_rng(0).normal(size=(300, 3)) + [8.0, 0.0, 0.0]
    ends = assert_as_defined(bush)
    for layout, planes in (("16 rings", "a wall close by"), ("uneven rings", "a wall"), ("64 rings", "a wall")):
        ends += assert_as_defined(scene(layout, planes, n=900))
    for end in ("plane", "not flat", "full", "too high", "not worthwhile", "picked", "grown"):
        assert ends[end] > 20, end


@given(
    st.integers(0, 2**32), st.integers(1, 250), st.sampled_from([*LAYOUTS, "clutter"]), st.sampled_from(list(PLANES)),
    st.floats(-np.pi, np.pi), st.sampled_from([0.0, 15.0]), st.sampled_from([0.0, 0.02, 0.1]), st.booleans(),
)  # fmt: skip
def test_few_points_of_any_scene(seed, n, layout, planes, azimuth, speed, noise, is_coarse):
    rng = np.random.default_rng(seed)
    if layout == "clutter":
        points = rng.normal(size=(n, 3)) * rng.uniform(0.05, 5.0, 3) + rng.normal(size=3) * 4.0
    else:
        points = scene(layout, planes, azimuth, speed, noise, seed, n=max(n, 64))
    if is_coarse:  # with points in one place, in one direction, and at the sensor
        points = np.round(points * 16.0) / 16.0
    assert_as_defined(rng.permutation(points)[:n] if len(points) else np.ones((1, 3)))
