# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from maxcon.mapping.align.passes import Corrections, Pass, Passes


def passes_of(durations, seed=0):
    """Passes of some seconds each, a hundred apart, along x."""
    rng = np.random.default_rng(seed)
    passes = []
    for number, duration in enumerate(durations):
        times = 1000.0 * number + np.arange(duration) + 0.5
        middles = np.column_stack([8.0 * np.arange(duration), rng.normal(0.0, 3.0, (duration, 2))])
        passes.append(Pass(f"pass {number + 1}", times, middles, 1000, middles.mean(axis=0)))
    return Passes("time", tuple(passes), np.zeros(len(passes), np.int64))


def some_corrections(seed, durations=(45, 3, 20), size=1.0):
    rng = np.random.default_rng(seed)
    none = Corrections.none(passes_of(durations, seed), 10.0)
    sigmas = size * np.repeat([0.1, 0.01], 3)
    return none.changed(rng.normal(size=(len(durations), 6)) * sigmas, rng.normal(size=(len(none.knots), 6)) * sigmas)


def some_points(seed, corrections, n=50):
    rng = np.random.default_rng(seed)
    passes = rng.integers(0, len(corrections.centres), n)
    times = 1000.0 * passes + rng.uniform(-5.0, 50.0, n)
    return rng.uniform(-200.0, 200.0, (n, 3)), times, passes


@given(st.integers(0, 1000))
def test_without_drift_a_pass_moves_as_one_and_without_corrections_not_at_all(seed):
    corrections = some_corrections(seed)
    points, times, passes = some_points(seed, corrections)
    none = Corrections.none(passes_of((45, 3, 20)), 10.0)
    np.testing.assert_allclose(none.moved(points, times, passes), points, atol=1e-12)
    corrections = corrections.changed(corrections.wholes, np.zeros_like(corrections.knots))
    turns = Rotation.from_rotvec(corrections.wholes[passes, 3:])
    centres = corrections.centres[passes]
    wanted = turns.apply(points - centres) + centres + corrections.wholes[passes, :3]
    np.testing.assert_allclose(corrections.moved(points, times, passes), wanted, atol=1e-9)


@given(st.integers(0, 1000))
def test_nothing_jumps_at_a_knot(seed):
    corrections = some_corrections(seed)
    points, _, _ = some_points(seed, corrections)
    at_knot = corrections.starts[0] + corrections.steps[0] * np.arange(1, 4)
    for time in at_knot:
        before, after = (
            corrections.moved(points, np.full(len(points), time + step), np.zeros(len(points), int))
            for step in (-1e-7, 1e-7)
        )
        np.testing.assert_allclose(before, after, atol=1e-6)


def test_what_adjustment_takes_for_the_derivative_is_it():
    small = some_corrections(3, size=1e-4)
    places, times, passes = some_points(3, small)
    twists = small.jacobian(places, times, passes) @ np.concatenate([small.wholes, small.knots]).ravel()
    for *where, twist in zip(places, times, passes, twists.reshape(-1, 6), strict=True):
        np.testing.assert_allclose(small.twist_at(*where), twist, atol=1e-6)
