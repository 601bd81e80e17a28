"""Cities, suburbs and road users: seeded, with every class; what repeats, what stays, what changes between days."""

import numpy as np
import pytest

from maxcon import Scan
from maxcon.lab.simulation import ScannerLayout
from maxcon.lab.simulation.city import build_city, build_periodic_city
from maxcon.lab.simulation.drive import drive_along
from maxcon.lab.simulation.furniture import LasClass, boxes
from maxcon.lab.simulation.scanners import RotatingScanner
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, STREET_ANGLE, StreetGrid
from maxcon.lab.simulation.suburb_ground import draw_road
from maxcon.lab.simulation.traffic import CrowdedCaster, RoadUser, RoadUserShape, Traffic

CROSS = StreetGrid(u_lines=(0.0,), v_lines=(0.0,), carriageway=4.0, sidewalk=2.0, margin=30.0)
VEHICLES = LasClass.VEHICLE


def _normals(patch):
    """Normals of triangles, twice as long as their areas."""
    return np.cross(patch.corners[:, 1] - patch.corners[:, 0], patch.corners[:, 2] - patch.corners[:, 0])


def test_every_class_is_there_and_no_facade_is_parallel_to_an_axis(city):
    assert set(np.unique(city.classes)) == set(LasClass) - {LasClass.UNCLASSIFIED}
    assert np.abs(city.corners).max() < 400.0  # finite, and float32 is good to 0.03 mm there
    normals = _normals(city)
    lengths = np.linalg.norm(normals, axis=1)
    upright = (city.classes == LasClass.BUILDING) & (np.abs(normals[:, 2]) < 1e-6 * lengths) & (lengths > 1.0)
    assert upright.sum() > 1000
    assert (np.abs(normals[upright, :2]) / lengths[upright, None]).min() > 0.4


def test_parked_cars_change_and_nothing_else():
    city = build_city(1, CROSS._replace(margin=60.0))
    monday, tuesday = city.with_parked_cars(1), city.with_parked_cars(2)
    np.testing.assert_array_equal(monday.corners, tuesday.with_parked_cars(1).corners)
    assert not np.array_equal(monday.corners, tuesday.corners)
    np.testing.assert_array_equal(*(one.corners[one.classes != VEHICLES] for one in (monday, tuesday)))
    assert not (city.with_parked_cars(1, occupancy=0.0).classes == VEHICLES).any()


@pytest.fixture(scope="module")
def periodic_city():
    return build_periodic_city(1)


def _triangles(corners):
    """Triangles as a set: corners in order of their coordinates, rounded to the millimetre."""
    rows = np.round(corners.reshape(len(corners), -1), 3).astype(np.float32) + np.float32(0.0)
    return {tuple(row) for row in rows.tolist()}


def test_facades_keep_the_period_along_the_whole_street_whatever_the_seed(periodic_city):
    fabric = periodic_city.fabric
    fronts = fabric.corners[fabric.classes == LasClass.BUILDING]
    v = CAMPAIGN_GRID.v_lines[0] + CAMPAIGN_GRID.half_width
    on_line = np.abs(fronts[..., 1] - v + 0.2).max(axis=1) < 1e-6  # pilasters of one side of the first street
    edges = np.unique(np.round(fronts[on_line][..., 0], 6))
    assert np.ptp(edges) > 300.0
    assert set(np.round(edges % 3.0, 6) % 3.0) == {0.0, 0.25, 2.75}
    one, other = (build_periodic_city(seed, CROSS) for seed in (1, 2))
    np.testing.assert_array_equal(one.fabric.corners, other.fabric.corners)
    assert not np.array_equal(one.items[0].corners, other.items[0].corners)


def test_a_quarter_of_the_items_goes_and_nothing_else():
    city = build_periodic_city(1, CROSS._replace(margin=60.0))
    gone = city.draw_gone(5)
    assert len(gone) == round(0.25 * len(city.items))
    assert gone == city.draw_gone(5)
    assert gone != city.draw_gone(6)
    before, after = city.city(), city.city(gone)
    assert len(before) - len(after) == sum(len(city.items[number]) for number in gone)
    assert _triangles(after.corners) < _triangles(before.corners)


@pytest.fixture(scope="module")
def road():
    return draw_road(460.0, [0, 0])


def test_addresses_are_found_again_and_laid_things_stand_on_the_ground(road):
    along, left = np.linspace(5.0, 455.0, 80), np.linspace(-20.0, 20.0, 80)
    np.testing.assert_allclose(road.addresses(road.places(along, left)), [along, left], atol=0.05)
    plank = boxes([[0.0, -0.1, 0.0]], [[0.2, 0.1, 1.0]], LasClass.UNCLASSIFIED)
    laid = road.laid(plank, 200.0, 5.0).corners.reshape(-1, 3)
    heights = laid[:, 2] - road.ground_heights(*road.addresses(laid[:, :2]))
    assert np.minimum(np.abs(heights), np.abs(heights - 1.0)).max() < 0.01


@pytest.mark.parametrize("is_back", [False, True])
def test_a_drive_follows_the_ground(road, is_back):
    drive = road.on_ground(drive_along(road.route(-1.2, 1, is_back=is_back), 2, height=2.0))
    along, left = road.addresses(drive.positions[:, :2])
    heights = drive.positions[:, 2] - road.ground_heights(along, left)
    assert np.abs(heights - 2.0).max() < 0.1
    steps = np.diff(drive.positions, axis=0)
    climb = steps[:, 2] / np.linalg.norm(steps[:, :2], axis=1)
    assert np.corrcoef(climb, -np.tan(drive.angles[1:, 1]))[0, 1] > 0.8
    side = np.where(is_back, -1.0, 1.0)
    rises = side * (road.ground_heights(along, left + 0.75) - road.ground_heights(along, left - 0.75)) / 1.5
    assert np.abs(drive.angles[:, 0] - np.arctan(rises)).max() < np.radians(1.0)


def _on_both_days(suburb, las_class):
    days = suburb.mapping.caster.city, suburb.scan_caster.city
    return [day.corners[day.classes == las_class] for day in days]


@pytest.mark.parametrize("las_class", [LasClass.GROUND, LasClass.BUILDING, LasClass.POLE])
def test_what_is_built_stays(suburb, las_class):
    first, second = _on_both_days(suburb, las_class)
    assert len(first) > 0
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("las_class", [LasClass.HIGH_VEGETATION, LasClass.UNCLASSIFIED, LasClass.VEHICLE])
def test_leaves_and_cars_do_not_stay(suburb, las_class):
    first, second = (corners.mean(axis=1).round(4).tolist() for corners in _on_both_days(suburb, las_class))
    known = set(map(tuple, first))
    assert np.mean([tuple(center) in known for center in second]) < 0.7


def _scans(suburb, layout):
    for epoch in suburb.epochs(5):
        points = suburb.scan(epoch, layout.scanner()).points
        yield (points - epoch.reference.position) @ epoch.reference.rotation


def test_ranges_and_the_ratio_of_points_with_a_normal_are_those_of_real_scans(suburb):
    ratios = [np.any(Scan(points).normals != 0.0, axis=1).mean() for points in _scans(suburb, ScannerLayout.VLP_16)]
    assert 0.24 < np.mean(ratios) < 0.50, ratios
    ranges = np.concatenate([np.linalg.norm(p, axis=1) for p in _scans(suburb, ScannerLayout.HDL_64E)])
    low, middle, high = np.percentile(ranges, [10, 50, 90])
    assert 3.0 < low < 6.0
    assert 5.5 < middle < 9.5
    assert 14.0 < high < 27.0


def test_all_epochs_lie_on_the_road(suburb):
    epochs = suburb.epochs(suburb.n_epochs_of_drive)
    np.testing.assert_allclose(np.diff([epoch.time for epoch in epochs]), 0.1, atol=1e-6)
    along, _ = suburb.road.addresses(np.array([epoch.reference.position[:2] for epoch in epochs]))
    np.testing.assert_allclose(along[[0, -1]], [0.0, suburb.road.length], atol=0.5)
    assert (np.diff(along) > 0.0).all()


@pytest.fixture(scope="module")
def box():
    """4 m long, 2 m wide, 1 m high."""
    return RoadUserShape(boxes([[-2.0, -1.0, 0.0]], [[2.0, 1.0, 1.0]], LasClass.VEHICLE))


@pytest.fixture(scope="module")
def traffic():
    return Traffic(CAMPAIGN_GRID, 0)


def _rays(*ways):
    directions = np.array(ways, np.float32)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_rays_meet_a_box_where_it_stands(box):
    user = RoadUser(box, 10.0, 0.0, 0.5, np.pi / 2.0)  # across: 9 to 11 m away, 2 m to either side
    origin = np.array([0.0, 0.0, 1.0], np.float32)
    rays = _rays([1, 0, 0], [9, 1.9, 0], [9, 2.1, 0], [-1, 0, 0], [9, 0, 0.4], [9, 0, 0.6])
    rows, hits = user.cast(origin, rays)
    np.testing.assert_array_equal(rows, [0, 1, 4])
    np.testing.assert_allclose(hits.ranges, [9.0, np.hypot(9.0, 1.9), np.hypot(9.0, 0.4)], rtol=1e-5)


def test_the_nearest_is_met_and_its_normal_and_class_are_its_own(hard_campaign, box):
    pose = hard_campaign.epochs(1)[0].reference
    ahead = _rays([np.cos(pose.heading), np.sin(pose.heading), -0.1])
    users = [RoadUser(box, pose.x + d * ahead[0, 0], pose.y + d * ahead[0, 1], 1.0, pose.heading) for d in (12.0, 7.0)]
    caster = CrowdedCaster(hard_campaign.scan_caster, users)
    hits = caster.cast(pose.position.astype(np.float32)[None], ahead)
    assert hits.ranges[0] == pytest.approx(5.0 / np.hypot(ahead[0, 0], ahead[0, 1]), rel=0.02)
    assert caster.classes[hits.triangles[0]] == LasClass.VEHICLE
    assert hits.triangles[0] >= len(hard_campaign.scan_caster.normals) + len(box.patch)
    np.testing.assert_allclose(np.abs(caster.normals[hits.triangles[0], :2] @ ahead[0, :2]), 1.0, atol=0.02)


def test_30_percent_of_the_returns_are_on_unmapped_objects_and_parked_cars_alone_are_not_enough(hard_campaign):
    scanner, ratios, parked = RotatingScanner(azimuth_step_deg=1.0), [], []
    for epoch in hard_campaign.epochs(30):
        alone = scanner.scan(hard_campaign.scan_caster, epoch.reference, epoch.time, np.random.default_rng(0))
        parked.append((alone.classes == LasClass.VEHICLE).mean())
        ratios.append((hard_campaign.scan(epoch, scanner).classes == LasClass.VEHICLE).mean())
    assert 0.28 < np.mean(ratios) < 0.36
    assert min(ratios) > 0.18  # in the middle of a crossing there is no room for more
    assert np.mean(np.array(ratios) > 0.28) > 0.7
    assert np.mean(parked) < 0.25


def test_road_users_stand_where_they_may(hard_campaign, thin_scanner, traffic):
    blocks = np.array(CAMPAIGN_GRID.blocks())
    kinds = set()
    for epoch in hard_campaign.epochs(12):
        rng = np.random.default_rng(epoch.tick)
        users = traffic.draw(hard_campaign.scan_caster, thin_scanner, epoch.reference, rng)
        for user in users:
            corners = user.shape.patch.placed(*user[1:]).corners[..., :2].reshape(-1, 2)
            assert np.linalg.norm(corners - epoch.reference.position[:2], axis=1).min() > 2.0
            u = corners @ [[np.cos(STREET_ANGLE)], [np.sin(STREET_ANGLE)]]
            v = corners @ [[-np.sin(STREET_ANGLE)], [np.cos(STREET_ANGLE)]]
            is_in = (u > blocks[:, 0]) & (u < blocks[:, 1]) & (v > blocks[:, 2]) & (v < blocks[:, 3])
            assert not is_in.any()
            kinds.add(user.shape.half_length > 1.0)
        places = np.array([[user.x, user.y] for user in users]).reshape(-1, 2)
        gaps = np.linalg.norm(places[:, None] - places, axis=2) + 9.0 * np.eye(len(places))
        assert gaps.size == 0 or gaps.min() > 0.4
    assert kinds == {True, False}  # vehicles and pedestrians
