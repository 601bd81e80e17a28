"""Roll and pitch of a scan from its own surfaces."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Pose, Scan
from maxcon.refine.tilt import own_tilt, tilt_between

TILTS_DEG = st.floats(-25.0, 25.0)


def room(pose, seed=0, noise_deg=2.0):
    """A scan of a floor and walls that face all around, with noisy normals and some of any direction."""
    rng = np.random.default_rng(seed)
    azimuths = rng.uniform(0.0, 2.0 * math.pi, 800)
    walls = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(800)])
    anywhere = rng.normal(size=(300, 3))
    normals = np.concatenate([walls, np.tile([0.0, 0.0, 1.0], (700, 1)), anywhere])
    normals += math.radians(noise_deg) * rng.normal(size=normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Scan(rng.uniform(-20.0, 20.0, normals.shape), normals @ pose.rotation)


@given(TILTS_DEG, TILTS_DEG, st.floats(-3.0, 3.0))
def test_floors_become_level_and_walls_upright(roll_deg, pitch_deg, heading):
    truth = Pose(0.0, 0.0, 0.0, math.radians(roll_deg), math.radians(pitch_deg), heading)
    roll, pitch = own_tilt(room(truth))
    assert math.degrees(tilt_between(Pose(0.0, 0.0, 0.0, roll, pitch, 0.0), truth)) < 1.0


@pytest.mark.parametrize("n", [0, 50])
def test_too_few_normals_tell_nothing(n):
    normals = np.zeros((1000, 3))
    normals[:n] = [0.0, 0.0, 1.0]
    assert own_tilt(Scan(np.random.default_rng(0).uniform(-20.0, 20.0, (1000, 3)), normals)) is None


def test_the_tilt_between_two_poses_is_that_of_their_up():
    one = Pose(1.0, 2.0, 3.0, 0.0, 0.2, 2.0)
    assert tilt_between(one, Pose(0.0, 0.0, 0.0, 0.0, -0.1, 1.0)) == pytest.approx(0.3)
    assert tilt_between(one, one) == pytest.approx(0.0, abs=1e-7)
