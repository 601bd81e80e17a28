"""Road users: what rays meet, where they stand, and how much of a scan they hide."""

import numpy as np
import pytest

from maxcon.lab.simulation.furniture import LasClass, boxes
from maxcon.lab.simulation.scanners import RotatingScanner
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, STREET_ANGLE
from maxcon.lab.simulation.traffic import CrowdedCaster, RoadUser, RoadUserShape, Traffic


@pytest.fixture(scope="module")
def box():
    """4 m long, 2 m wide, 1 m high."""
    return RoadUserShape(boxes([[-2.0, -1.0, 0.0]], [[2.0, 1.0, 1.0]], LasClass.VEHICLE))


def _rays(*ways):
    directions = np.array(ways, np.float32)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_rays_meet_a_box_where_it_stands(box):
    user = RoadUser(box, 10.0, 0.0, 0.5, np.pi / 2.0)  # across: 9 to 11 m away, 2 m to either side
    origin = np.array([0.0, 0.0, 1.0], np.float32)
    rays = _rays([1, 0, 0], [9, 1.9, 0], [9, 2.1, 0], [-1, 0, 0], [9, 0, 0.4], [9, 0, 0.6])
    rows, hits = user.cast(np.broadcast_to(origin, rays.shape), rays)
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
    assert np.mean(np.array(ratios) > 0.28) > 0.7 and np.mean(parked) < 0.25


def test_road_users_stand_where_they_may(hard_campaign, thin_scanner):
    traffic, blocks, kinds = Traffic(CAMPAIGN_GRID, 0), np.array(CAMPAIGN_GRID.blocks()), set()
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
