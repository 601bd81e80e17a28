# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Passes of known offsets over walls of known normals: how far they differ is found, or that it cannot be."""

import numpy as np
import pytest

from maxcon.mapping.build.pass_differences import compare_passes
from maxcon.mapping.build.place_sample import PlaceSample

ROUND = 300.0
"""Between passes, s."""


class Street:
    """Pieces of wall of all orientations, 1.5 m wide and 5 m apart, passed at 2 s each.

    Parameters
    ----------
    errors : array, shape (n_passes, n_walls, 3)
        Of each pass at each wall, m.
    density : array_like, shape (n_passes,) or float
        Points per pass and wall.
    """

    def __init__(self, errors, density=600, noise=0.005, seed=0):
        n_passes, n_walls, _ = errors.shape
        rng = np.random.default_rng(seed)
        axes = np.linalg.qr(rng.normal(size=(n_walls, 3, 3)))[0]
        normals, sides = axes[:, :, 0], axes[:, :, 1:]
        middles = np.column_stack([5.0 * np.arange(n_walls), *rng.uniform(-1.0, 1.0, (2, n_walls))])
        clouds, times = [], []
        for number, n_points in enumerate(np.broadcast_to(density, n_passes)):
            wall = np.repeat(np.arange(n_walls), n_points)
            on_wall = np.einsum("nij,nj->ni", sides[wall], rng.uniform(-0.75, 0.75, (len(wall), 2)))
            roughness = rng.normal(0.0, noise, (len(wall), 1)) * normals[wall]
            clouds.append(middles[wall] + on_wall + roughness + errors[number, wall])
            times.append(ROUND * number + 2.0 * wall + rng.uniform(0.0, 0.5, len(wall)))
        self.points, self.times = np.concatenate(clouds), np.concatenate(times)
        self.across = np.einsum("wi,pwi->pw", normals, errors)

    @property
    def sigma_of_pass(self):
        """The standard deviation that the drawn errors have across the walls, m."""
        return float(np.sqrt(self.across.var(axis=0, ddof=1).mean()))

    def compared(self):
        sample = PlaceSample()
        order = np.random.default_rng(1).permutation(len(self.points))
        sample.add(self.points[order], self.times[order])
        return compare_passes(sample.records())


def drawn(n_passes, sigma, n_walls=100, seed=0):
    return np.random.default_rng(seed).normal(0.0, sigma, (n_passes, n_walls, 3))


@pytest.mark.parametrize("n_passes", [2, 3, 5])
@pytest.mark.parametrize("sigma", [0.005, 0.02, 0.04])
def test_the_errors_of_passes_are_found(n_passes, sigma):
    street = Street(drawn(n_passes, sigma))
    found = street.compared()
    assert found.is_enough
    assert found.n_passes == n_passes
    assert found.sigma_of_pass == pytest.approx(street.sigma_of_pass, rel=0.06)
    assert found.sigma_of_map == pytest.approx(found.sigma_of_pass / np.sqrt(n_passes), rel=0.03)


def test_offsets_are_measured_across_the_walls_only():
    street = Street(drawn(2, 0.0))
    street.points[street.times > ROUND] += [0.03, 0.0, 0.0]  # the same along the street, everywhere
    assert street.compared().sigma_of_pass == pytest.approx(0.03 / np.sqrt(3.0) / np.sqrt(2.0), rel=0.1)


def test_noise_of_points_is_not_taken_for_an_error_of_passes():
    found = Street(drawn(3, 0.0), density=300, noise=0.02).compared()
    assert found.is_enough
    assert found.sigma_of_pass < 0.001  # a mean of 33 points is good to 0.0035 m


def test_what_changed_between_passes_is_left_out():
    errors = drawn(3, 0.02)
    street = Street(errors)
    wanted = street.compared().sigma_of_pass
    errors[1, ::8] += 0.12  # doors that stood open, and cars
    changed = Street(errors)
    assert changed.sigma_of_pass > 1.5 * wanted
    assert changed.compared().sigma_of_pass == pytest.approx(wanted, rel=0.15)


def test_what_is_rough_is_left_out():
    street = Street(drawn(3, 0.01))
    bush = np.random.default_rng(2).uniform(-3.0, 3.0, (60_000, 3)) + [250.0, 20.0, 0.0]
    wanted = street.compared()
    street.points = np.concatenate([street.points, bush])
    street.times = np.concatenate([street.times, np.repeat(ROUND * np.arange(3), 20_000)])
    assert street.compared() == wanted


def test_a_pass_that_left_most_of_the_points_decides_the_map():
    found = Street(drawn(2, 0.02), density=(900, 100)).compared()
    assert found.n_passes == 2
    assert found.sigma_of_map == pytest.approx(found.sigma_of_pass * np.sqrt(0.9**2 + 0.1**2), rel=0.03)


def test_one_pass_cannot_be_compared():
    found = Street(drawn(1, 0.02)).compared()
    assert (found.is_enough, found.n_passes, found.shortcoming) == (False, 1, "one pass only")


def test_a_vehicle_that_waits_makes_no_second_pass():
    street = Street(drawn(2, 0.02))
    street.times[street.times > ROUND] -= ROUND - 55.0
    assert street.compared().shortcoming == "one pass only"


def test_two_passes_that_meet_shortly_are_not_enough():
    found = Street(drawn(2, 0.02, n_walls=14)).compared()  # 28 s each
    assert found.n_places > 0
    assert not found.is_enough
    assert "half minutes only" in found.shortcoming


@pytest.mark.parametrize("n_points", [0, 1, 19, 1000])
def test_points_without_planes_say_nothing(n_points):
    sample = PlaceSample()
    rng = np.random.default_rng(0)
    sample.add(rng.uniform(0.0, 0.5, (n_points, 3)), rng.uniform(0.0, 1000.0, n_points))
    found = compare_passes(sample.records())
    assert not found.is_enough
    assert found.shortcoming == "no planes of points with times"
