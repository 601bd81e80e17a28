# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np

from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.simulation import PriorErrors


def test_priors_are_off_by_no_more_than_their_bounds():
    reference = Pose(10.0, 20.0, 2.0, 0.01, -0.01, 3.14)
    errors, rng = PriorErrors(), np.random.default_rng(0)
    priors = [errors.prior(reference, rng) for _ in range(500)]
    offsets = np.array([prior.position - reference.position for prior in priors])
    turns = np.degrees([wrap_angle(prior.heading - reference.heading) for prior in priors])
    tilts = np.degrees([(prior.roll - reference.roll, prior.pitch - reference.pitch) for prior in priors])
    for values, bound in ((offsets[:, :2], 2.5), (offsets[:, 2], 0.01), (turns, 1.8), (tilts, 0.05)):
        assert 0.9 * bound < np.abs(values).max() <= bound + 1e-9
