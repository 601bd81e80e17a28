"""Ground plane fits: slopes, camber, kerbs, ramps, cars; where nothing can be told; and without a map."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap, Pose, Scan
from maxcon.refine import fit_ground, fit_ground_plane, ground_kernels, pose_above_ground

CELL = 0.06
WALL, FACING = np.array([[0.0, 50.0, 2.0]]), np.array([[0.0, -1.0, 0.0]])
HEIGHT = 1.8


def flat(x, y):
    return 0.0 * x


def slope(x, y):
    return 0.12 * x - 0.03 * y


def camber(x, y):
    return -0.03 * np.abs(y)


def kerb(x, y):
    return 0.12 * (np.abs(y) > 4.0)


def ramp(x, y):
    return 0.15 * np.clip(x - 5.0, 0.0, 12.0)


def hill(x, y):
    return 1.5 * np.sin(x / 25.0) + 0.01 * y


GROUNDS = (flat, slope, camber, kerb, ramp, hill)


def map_of(ground, reach=45.0, keep=None, seed=0):
    """A map with the heights of a ground, shape (z of x and y), every 20 cm and rough by 1 cm."""
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-reach, reach, 0.2)]))
    z = ground(x, y) + np.random.default_rng(seed).normal(0.0, 0.01, len(x))
    points = np.column_stack([x, y, z])
    return PointMap.from_points(WALL, FACING, CELL, ground=points if keep is None else points[keep(x, y)])


@pytest.fixture(scope="module")
def maps():
    return {ground: map_of(ground) for ground in GROUNDS}


def on(ground, x=0.0, y=0.0, heading=0.0):
    """The pose of a sensor above a ground, upright on it."""
    step = 0.5
    slope_x, slope_y = (
        (ground(x + dx, y + dy) - ground(x - dx, y - dy)) / (2.0 * step) for dx, dy in ((step, 0.0), (0.0, step))
    )
    c, s = math.cos(heading), math.sin(heading)
    along, across = c * slope_x + s * slope_y, -s * slope_x + c * slope_y
    pitch = -math.atan(along)
    return Pose(x, y, float(ground(x, y)) + HEIGHT, math.atan(across * math.cos(pitch)), pitch, heading)


def scan_of(ground, pose, *, cars=0.0, n_rings=40, noise=0.02, seed=0, sector=math.pi):
    """A scan of a ground from a pose, in rings; on a share of the azimuths a box 1.5 m high hides it from 5 m on."""
    rng = np.random.default_rng(seed)
    azimuths, distances = (
        grid.ravel()
        for grid in np.meshgrid(np.radians(np.arange(0, 360.0, 0.5)), HEIGHT / np.tan(np.linspace(0.05, 0.7, n_rings)))
    )
    is_seen = np.abs((azimuths - pose.heading + math.pi) % (2.0 * math.pi) - math.pi) <= sector
    azimuths, distances = azimuths[is_seen], distances[is_seen]
    x, y = pose.x + distances * np.cos(azimuths), pose.y + distances * np.sin(azimuths)
    z = ground(x, y) + rng.normal(0.0, noise, len(x))
    blocks = rng.random(36) < cars
    z += np.where(blocks[(azimuths / (2.0 * math.pi) * 36).astype(int) % 36] & (distances > 5.0), 1.5, 0.0)
    return Scan((np.column_stack([x, y, z]) - pose.position) @ pose.rotation)


def tilt_between(one, other):
    """Angle between the verticals of two poses, degrees."""
    cosine = (one.rotation.T @ [0.0, 0.0, 1.0]) @ (other.rotation.T @ [0.0, 0.0, 1.0])
    return math.degrees(math.acos(min(1.0, cosine)))


def off_by(pose, height, roll_deg, pitch_deg):
    roll, pitch = pose.roll + math.radians(roll_deg), pose.pitch + math.radians(pitch_deg)
    return replace(pose, z=pose.z + height, roll=roll, pitch=pitch)


@given(
    ground=st.sampled_from(GROUNDS), height=st.floats(-2.0, 2.0), roll_deg=st.floats(-1.5, 1.5),
    pitch_deg=st.floats(-1.5, 1.5), heading=st.floats(-3.0, 3.0), cars=st.sampled_from([0.0, 0.2, 0.35]),
    seed=st.integers(0, 2**32),
)  # fmt: skip
def test_height_and_tilt_of_a_prior_are_corrected(maps, ground, height, roll_deg, pitch_deg, heading, cars, seed):
    pose = on(ground, heading=heading)
    scan, prior = scan_of(ground, pose, cars=cars, seed=seed), off_by(pose, height, roll_deg, pitch_deg)
    fit = fit_ground(scan, maps[ground], prior)
    assert fit is not None and abs(fit.pose.z - pose.z) < 0.05
    assert tilt_between(fit.pose, pose) < 0.25
    assert (fit.pose.x, fit.pose.y, fit.pose.heading) == (pose.x, pose.y, pose.heading)
    assert fit.height == pytest.approx(fit.pose.z - (pose.z + height))


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("offset", [(3.0, 0.0), (-2.0, 2.0), (0.0, -3.0)])
def test_at_a_wrong_place_the_height_is_that_of_this_place(maps, ground, offset):
    """A prior 3 m and 2 degrees off, and 1 m too high: what it gets is what stands upright where it is."""
    pose = on(ground)
    there = on(ground, *offset)
    prior = off_by(replace(pose, x=offset[0], y=offset[1], heading=math.radians(2.0)), 1.0, 0.5, -0.5)
    fit = fit_ground(scan_of(ground, pose), maps[ground], prior)
    assert fit is not None and abs(fit.pose.z - there.z) < 0.15


def test_a_right_prior_stays_and_a_narrow_view_tells_less_of_the_tilt(maps):
    pose = on(hill, 4.0, -3.0, 0.7)
    fit = fit_ground(scan_of(hill, pose), maps[hill], pose)
    assert abs(fit.height) < 0.02 and math.degrees(fit.tilt) < 0.1
    assert fit.spread < 0.04 and fit.ratio > 0.9
    assert fit.sigma_height < 0.01 and math.degrees(fit.sigma_tilt) < 0.1
    pose = on(flat)
    wide, narrow = (fit_ground(scan_of(flat, pose, sector=sector), maps[flat], pose) for sector in (math.pi, 0.3))
    assert narrow.sigma_tilt > 2.0 * wide.sigma_tilt and abs(narrow.height) < 0.05


def test_under_a_bridge_and_on_it():
    """The level that is nearest to most of the ground near the sensor."""
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-35.0, 35.0, 0.2)]))
    road, deck = np.column_stack([x, y, 0.0 * x]), np.column_stack([x, y, 0.0 * x + 5.5])[np.abs(x) < 8.0]
    point_map = PointMap.from_points(WALL, FACING, CELL, ground=np.concatenate([road, deck]))
    below = on(flat)
    fit = fit_ground(scan_of(flat, below), point_map, off_by(below, 1.2, 0.5, 0.5))
    assert abs(fit.pose.z - below.z) < 0.05
    above = replace(below, z=below.z + 5.5)
    seen = scan_of(lambda x, y: np.where(np.abs(x) < 8.0, 5.5, 0.0), above)
    fit = fit_ground(seen, point_map, off_by(above, -1.2, 0.5, 0.5))
    assert abs(fit.pose.z - above.z) < 0.05


def test_a_ceiling_is_not_taken_for_the_floor_above_it():
    """In a garage more cells show the ceiling, 25 cm below the next floor, than the floor between parked cars."""
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-25.0, 25.0, 0.2)]))
    floors = np.concatenate([np.column_stack([x, y, np.full(len(x), 2.8 * storey)]) for storey in range(3)])
    storeys = PointMap.from_points(WALL, FACING, CELL, ground=floors)
    truth = Pose(0.0, 0.0, 2.8 + HEIGHT, 0.0, 0.0, 0.0)
    seen = scan_of(flat, replace(truth, z=HEIGHT)).points.copy()
    seen[np.abs(seen[:, 1]) > 4.0, 2] += 2.55
    for height in (0.0, 0.6, -0.6):
        fit = fit_ground(Scan(seen), storeys, off_by(truth, height, 0.3, 0.2))
        assert abs(fit.pose.z - truth.z) < 0.02


def test_fences_below_and_reflections_do_not_pull_it_down(maps):
    pose = on(camber)
    scan = scan_of(camber, pose)
    rng = np.random.default_rng(1)
    under = scan.points[rng.random(len(scan)) < 0.02] - [0.0, 0.0, 2.5]
    fit = fit_ground(Scan(np.concatenate([scan.points, under])), maps[camber], off_by(pose, -0.8, 1.0, -1.0))
    assert abs(fit.pose.z - pose.z) < 0.05


def test_where_it_cannot_be_told_nothing_is_said(maps):
    here, ground = on(flat), maps[flat]
    scan = scan_of(flat, here)
    rng = np.random.default_rng(0)
    azimuths, heights, far = (rng.uniform(*ends, 20_000) for ends in ((-math.pi, math.pi), (2.0, 15.0), (5.0, 25.0)))
    walls_around = np.column_stack([far * np.cos(azimuths), far * np.sin(azimuths), heights])
    speck = map_of(flat, keep=lambda x, y: np.hypot(x - 6.0, y) < 1.5)
    assert fit_ground(scan, PointMap.from_points(WALL, FACING, CELL), here) is None  # no ground in the map
    assert fit_ground(scan, ground, on(flat, 500.0)) is None
    assert fit_ground(scan, ground, off_by(here, 6.0, 0.0, 0.0)) is None
    assert fit_ground(scan, speck, here) is None
    for points in (np.empty((0, 3)), [[5.0, 0.0, -HEIGHT]], walls_around):
        assert fit_ground(Scan(points), ground, here) is None


@given(seed=st.integers(0, 2**32), height=st.floats(-1.0, 1.0))
def test_the_order_of_points_does_not_matter(maps, seed, height):
    pose = on(hill)
    scan = scan_of(hill, pose)
    order = np.random.default_rng(seed).permutation(len(scan))
    one, other = (fit_ground(s, maps[hill], off_by(pose, height, 0.3, 0.3)) for s in (scan, Scan(scan.points[order])))
    assert abs(one.pose.z - other.pose.z) < 1e-6


def plain_most_frequent(points, below, near, reach, width):
    """The median of the five bins that hold most, the middle ones weighing more."""
    some = below[(np.hypot(points[:, 0], points[:, 1]) <= near) & (np.abs(below) <= reach)]
    if not len(some):
        return 0.0
    counts = np.bincount(((some + reach) / width).astype(int), minlength=round(2 * reach / width) + 1)
    most = (np.argmax(np.convolve(counts, [1, 2, 3, 2, 1], mode="same")) + 0.5) * width - reach
    return np.median(some[np.abs(some - most) <= 2.5 * width])


@given(st.integers(0, 2**32), st.integers(0, 200))
def test_the_most_frequent_height_is_that_of_a_histogram(seed, n):
    rng = np.random.default_rng(seed)
    points, below = rng.uniform(-20, 20, (n, 3)), rng.choice([-1.0, 0.3, 2.4], n) + rng.normal(0.0, 0.2, n)
    got = ground_kernels.most_frequent(points, below, 12.0, 2.5, 0.1)
    assert got == plain_most_frequent(points, below, 12.0, 2.5, 0.1)


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.03, -0.02)])
def test_without_a_map_height_and_tilt_are_those_above_the_scan_s_own_plane(roll, pitch):
    pose = Pose(0.0, 0.0, HEIGHT, roll, pitch, 0.0)
    found = fit_ground_plane(scan_of(flat, pose, cars=0.2))
    assert (found.z, found.roll, found.pitch) == pytest.approx((HEIGHT, roll, pitch), abs=0.01)
    assert (found.x, found.y, found.heading) == (0.0, 0.0, 0.0)
    assert fit_ground_plane(Scan([[5.0, 0.0, -HEIGHT]])) is None


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_clutter_that_hides_most_of_the_ground_is_not_taken_for_it(maps, seed):
    pose, rng = Pose(0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0), np.random.default_rng(seed)
    points = scan_of(flat, pose, seed=seed).points
    is_hidden = rng.random(len(points)) < 0.9
    points = points + is_hidden[:, None] * [0.0, 0.0, 1.0] * rng.uniform(1.0, 1.02, (len(points), 1))
    at_edge = points[np.hypot(points[:, 0], points[:, 1]) > 4.0]
    assert fit_ground_plane(Scan(at_edge)).z == pytest.approx(HEIGHT, abs=0.05)
    assert fit_ground(Scan(at_edge), maps[flat], pose).height == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2.0, -2.0])
def test_above_the_ground_of_a_map_a_sensor_is_as_upright_as_above_its_own(maps, heading):
    found = pose_above_ground(maps[slope], 5.0, 6.0, heading, Pose(0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0))
    wanted = on(slope, 5.0, 6.0, heading)
    assert found.z == pytest.approx(wanted.z, abs=0.03) and tilt_between(found, wanted) < 0.1
    nowhere = pose_above_ground(maps[slope], 500.0, 0.0, heading, wanted)
    assert (nowhere.z, nowhere.roll, nowhere.pitch) == (wanted.z, wanted.roll, wanted.pitch)
