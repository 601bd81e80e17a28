# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A round: uneven speed, waits, and a duration that can be asked for."""

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import RoundDriver, circuit_through, drive_round


@pytest.fixture(scope="module")
def circuit():
    return circuit_through()


def _speeds(drive):
    times = np.arange(drive.times[0], drive.times[-1], 0.1)
    positions, _ = drive.at(times)
    return np.linalg.norm(np.diff(positions[:, :2], axis=0), axis=1) / 0.1


def test_it_slows_down_for_turns(circuit):
    drive = drive_round(circuit, RoundDriver(10.0, turn_speed=3.0), 1, height=2.0, start_time=5.0)
    middles = np.searchsorted(circuit.distances, circuit.turns.mean(axis=1))
    speeds = np.linalg.norm(np.diff(drive.positions[:, :2], axis=0), axis=1) / np.diff(drive.times)
    assert (np.abs(speeds[middles] - 3.0) < 0.7).all()
    assert 7.0 < speeds.max() < 12.5
    assert drive.times[0] == 5.0
    assert (np.diff(drive.times) > 0.0).all()


def test_it_brakes_no_harder_than_it_should(circuit):
    drive = drive_round(circuit, RoundDriver(10.0, acceleration=2.0, n_stops=3), 2, height=2.0, start_time=0.0)
    changes = np.abs(np.diff(_speeds(drive))) / 0.1
    assert np.percentile(changes, 99) < 3.0


def test_it_waits_as_often_as_it_is_told(circuit):
    driver = RoundDriver(10.0, n_stops=3, waits=(5.0, 6.0))
    drive = drive_round(circuit, driver, 3, height=2.0, start_time=0.0)
    stands = np.flatnonzero(np.diff(drive.times) > 4.0)
    assert len(stands) == 3
    np.testing.assert_array_equal(drive.positions[stands], drive.positions[stands + 1])
    assert ((np.diff(drive.times)[stands] >= 5.0) & (np.diff(drive.times)[stands] <= 6.0)).all()


def test_the_asked_duration_is_met_and_waits_are_kept(circuit):
    driver = RoundDriver(6.0, n_stops=2, waits=(7.0, 7.0))
    drive = drive_round(circuit, driver, 4, height=2.0, start_time=1000.0, duration=300.0)
    assert drive.times[-1] - drive.times[0] == pytest.approx(300.0, abs=1e-9)
    np.testing.assert_allclose(np.sort(np.diff(drive.times))[-2:], 7.0)


def test_it_wanders_by_decimetres_and_looks_where_it_goes(circuit):
    drive = drive_round(circuit, RoundDriver(10.0, wander=0.3), 5, height=2.0, start_time=0.0)
    offsets = np.linalg.norm(drive.positions[:, :2] - circuit.points, axis=1)
    assert 0.1 < offsets.max() <= 0.3 + 1e-9
    ways = np.gradient(drive.positions[:, :2], axis=0)
    np.testing.assert_allclose(np.cos(np.arctan2(ways[:, 1], ways[:, 0]) - drive.angles[:, 2]), 1.0, atol=1e-6)
    assert np.abs(np.diff(drive.angles[:, 2])).max() < 0.02


def test_rounds_are_seeded(circuit):
    first, second, other = (
        drive_round(circuit, RoundDriver(9.0, n_stops=1), seed, height=2.0, start_time=0.0) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.times, second.times)
    assert first.times[-1] != other.times[-1]


def test_a_round_shorter_than_its_waits_is_refused(circuit):
    driver = RoundDriver(9.0, n_stops=2, waits=(10.0, 10.0))
    with pytest.raises(OptionError, match=r"Expected a round longer than its waits of 20\.0 s, got 15"):
        drive_round(circuit, driver, 1, height=2.0, start_time=0.0, duration=15.0)


@pytest.mark.parametrize(
    "wrong", [{"speed": 0.0}, {"speed": 5.0, "turn_speed": 0.0}, {"speed": 5.0, "acceleration": -1.0}]
)
def test_wrong_drivers_are_refused(wrong):
    with pytest.raises(OptionError, match="Expected speeds"):
        RoundDriver(**wrong)
