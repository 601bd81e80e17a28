"""Poses of one CRS in another, against pyproj by hand: positions, grid convergence, covariances, heights."""

import numpy as np
import pytest
from pyproj import CRS, Proj, Transformer

from maxcon.errors import CrsError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.geometry.pose import wrap_angle
from maxcon.io.poses_between_crs import poses_in_crs
from maxcon.scan.trajectory import Trajectory

COVARIANCE = np.array([[4.0, 1.0, 0.1], [1.0, 9.0, 0.2], [0.1, 0.2, 0.01]])


def poses(x, y, covariances=None):
    own = [Pose(x + 9.0 * i, y - 4.0 * i, 115.0 + i, 0.01, -0.02, 1.3 * i - 2.0) for i in range(4)]
    return Trajectory.from_poses(np.arange(4.0), own, covariances)


def convergence(code, x, y):
    places = Transformer.from_crs(code, CRS(code).geodetic_crs, always_xy=True).transform(x, y)
    return np.radians(Proj(CRS(code)).get_factors(*places).meridian_convergence)


@pytest.mark.parametrize(("source", "target", "place", "turn_deg"), [
    (25832, 25833, (760_000.0, 5_430_000.0), -4.53),  # UTM 32 to UTM 33: along the border of the zones
    (25833, 25832, (239_000.0, 5_430_000.0), 4.53),
    (25832, 31467, (458_888.0, 5_429_081.0), 0.0),  # ETRS89 to DHDN, whose axes are named north and east
    (31467, 25833, (3_458_947.0, 5_430_814.0), -4.54),
])  # fmt: skip
def test_positions_and_headings_are_those_of_pyproj(source, target, place, turn_deg):
    own = poses(*place)
    got, words = poses_in_crs(own, f"EPSG:{source}", f"EPSG:{target}", "a.txt")
    by_hand = Transformer.from_crs(source, target, always_xy=True, allow_ballpark=False)
    x, y = by_hand.transform(*own.positions[:, :2].T)
    np.testing.assert_allclose(got.positions, np.column_stack([x, y, own.positions[:, 2]]), rtol=0, atol=1e-6)
    turn = convergence(target, x, y) - convergence(source, *own.positions[:, :2].T)
    assert np.degrees(turn) == pytest.approx(turn_deg, abs=0.02)
    roll, pitch, heading = got.angles.T
    is_same_datum = 31467 not in (source, target)
    # From one datum to the other the meridians themselves are turned, by 2 seconds of arc.
    within = 1e-8 if is_same_datum else 1.1e-5
    np.testing.assert_allclose(wrap_angle(heading - own.angles[:, 2]), turn, rtol=0, atol=within)
    np.testing.assert_allclose([roll, pitch], [[0.01] * 4, [-0.02] * 4], atol=1e-12)
    assert ", exactly, heights" in words or not is_same_datum
    assert f"heights as they are, headings turned by {np.degrees(turn[0]):+.1f}" in words


def test_covariances_turn_and_a_change_of_the_datum_is_added_to_them():
    own = poses(760_000.0, 5_430_000.0, np.stack([COVARIANCE, COVARIANCE, np.full((3, 3), np.nan), COVARIANCE]))
    got, _ = poses_in_crs(own, "EPSG:25832", "EPSG:25833", "a.txt", exact_to=0.06)
    turn = (got.angles - own.angles)[0, 2]
    matrix = Pose(0.0, 0.0, 0.0, 0.0, 0.0, turn).rotation
    np.testing.assert_allclose(got.covariances[0], matrix @ COVARIANCE @ matrix.T, atol=1e-9)
    assert np.isnan(got.covariances[2]).all()
    shifted, words = poses_in_crs(own, "EPSG:25832", "EPSG:3068", "a.txt")  # Soldner's of Berlin, which has no grid
    turn = (shifted.angles - own.angles)[0, 2]
    matrix = Pose(0.0, 0.0, 0.0, 0.0, 0.0, turn).rotation
    added = shifted.covariances[0] - matrix @ COVARIANCE @ matrix.T
    np.testing.assert_allclose(added, np.diag([9.0, 9.0, 0.0]), atol=1e-9)
    assert "exact to 3 m" in words
    with pytest.raises(CrsError, match=r"a.txt exact to a voxel of the map, at most 0.06 m.*--allow-inexact-crs"):
        poses_in_crs(own, "EPSG:25832", "EPSG:3068", "a.txt", exact_to=0.06)


def test_poses_in_the_map_s_own_plane_stay_and_heights_do_unless_both_crs_say_what_theirs_are():
    own = poses(458_888.0, 5_429_081.0)
    for source, target in (("EPSG:25832", "EPSG:25832"), ("EPSG:25832", "EPSG:25832+7837")):
        got, words = poses_in_crs(own, source, target, "a.txt", exact_to=0.0)
        np.testing.assert_array_equal(got.positions, own.positions)
        np.testing.assert_allclose(got.quaternions_xyzw, own.quaternions_xyzw, atol=1e-12)
        assert "turned by +0.000 degrees" in words
    feet = own.positions * [1.0, 1.0, 1.0 / 0.3048]
    lifted = Trajectory(own.times, feet, own.quaternions_xyzw)
    got, words = poses_in_crs(lifted, "EPSG:25832+8228", "EPSG:25832", "a.txt")  # NAVD88 heights in feet
    np.testing.assert_allclose(got.positions, own.positions, atol=1e-6)
    assert "heights times 0.3048" in words


@pytest.mark.parametrize(("source", "target", "place", "kind", "words"), [
    ("EPSG:25832", None, (4e5, 5e6), CrsError, "a map with a CRS, to transform a.txt.*--crs"),
    ("EPSG:4326", "EPSG:25832", (8.4, 49.0), CrsError, "projected CRS of a.txt, got WGS 84.*time,latitude"),
    ("EPSG:4978", "EPSG:25832", (4e6, 6e5), CrsError, "projected CRS of a.txt"),
    ("EPSG:9", "EPSG:25832", (4e5, 5e6), CrsError, "EPSG:9"),
    ("EPSG:25833", "EPSG:25832", (1e12, 5e6), TrajectoryError, "a.txt.*is defined, got x 1e\\+12"),
])  # fmt: skip
def test_what_cannot_be_transformed_is_refused(source, target, place, kind, words):
    with pytest.raises(kind, match=words):
        poses_in_crs(poses(*place), source, target, "a.txt")
