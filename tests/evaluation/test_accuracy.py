# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors and their summary, by values computed by hand."""

import math

import pytest

from maxcon import Pose
from maxcon.evaluation import Accuracy, PoseError, pose_error, summarize


def _pose(x, y, z=0.0, heading_deg=0.0):
    return Pose(x, y, z, 0.1, -0.1, math.radians(heading_deg))


def test_distance_is_that_in_x_and_y():
    error = pose_error(_pose(3.0, 4.0, 9.0), _pose(0.0, 0.0, -9.0))
    assert error.distance == 5.0
    assert error.heading == 0.0


@pytest.mark.parametrize(
    ("heading", "reference", "wanted"),
    [(10.0, 8.0, 2.0), (8.0, 10.0, -2.0), (179.0, -179.0, -2.0), (-179.0, 179.0, 2.0), (0.0, 360.0, 0.0)],
)
def test_heading_is_signed_and_takes_the_shorter_way(heading, reference, wanted):
    error = pose_error(_pose(0.0, 0.0, 0.0, heading), _pose(0.0, 0.0, 0.0, reference))
    assert math.degrees(error.heading) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    ("distance", "heading_deg", "wanted"),
    [
        (0.3, 0.0, True),
        (0.3001, 0.0, False),
        (0.0, 1.0, True),
        (0.0, -1.0, True),
        (0.0, 1.001, False),
        (0.0, -1.001, False),
        (0.31, 1.1, False),
        (math.nan, 0.0, False),
    ],
)
def test_success_is_0_3_m_and_1_degree(distance, heading_deg, wanted):
    assert PoseError(distance, math.radians(heading_deg)).is_success is wanted


def test_summary():
    errors = [
        PoseError(0.1, math.radians(-0.5)),
        None,
        PoseError(0.2, math.radians(0.25)),
        PoseError(0.6, 0.0),
        PoseError(0.05, math.radians(-2.0)),
    ]
    accuracy = summarize(errors)
    assert (accuracy.n_epochs, accuracy.n_success) == (5, 2)
    assert accuracy.median_distance == pytest.approx(0.15)
    assert accuracy.worst_distance == 0.6
    assert accuracy.worst_heading == pytest.approx(math.radians(2.0))


def test_nothing_localized_has_no_errors():
    for errors in ([], [None, None]):
        accuracy = summarize(errors)
        assert (accuracy.n_epochs, accuracy.n_success) == (len(errors), 0)
        assert math.isnan(accuracy.median_distance)
        assert math.isnan(accuracy.worst_distance) and math.isnan(accuracy.worst_heading)


def test_one_epoch_is_its_own_summary():
    assert summarize([PoseError(0.2, -0.01)]) == Accuracy(1, 1, 0.2, 0.2, 0.01)
