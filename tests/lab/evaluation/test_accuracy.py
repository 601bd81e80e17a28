# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors and their summary, by values computed by hand."""

import math

import pytest

from maxcon import Pose
from maxcon.lab.evaluation import PoseError, Quantiles, pose_error, summarize


def _pose(x, y, z=0.0, heading_deg=0.0):
    return Pose(x, y, z, 0.1, -0.1, math.radians(heading_deg))


@pytest.mark.parametrize(
    ("heading", "reference", "wanted"),
    [(10.0, 8.0, 2.0), (8.0, 10.0, -2.0), (179.0, -179.0, -2.0), (-179.0, 179.0, 2.0), (0.0, 360.0, 0.0)],
)
def test_heading_is_signed_and_takes_the_shorter_way(heading, reference, wanted):
    error = pose_error(_pose(0.0, 0.0, 0.0, heading), _pose(0.0, 0.0, 0.0, reference))
    assert math.degrees(error.heading) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    ("x", "y", "reference_heading", "along", "across"),
    [
        (2.0, 1.0, 0.0, 2.0, 1.0),
        (-1.0, 2.0, 90.0, 2.0, 1.0),  # driving north: west is to the left
        (1.0, -2.0, 90.0, -2.0, -1.0),
        (3.0, 0.5, 180.0, -3.0, -0.5),
        (1.0, 1.0, 45.0, math.sqrt(2.0), 0.0),
        (1.0, 0.0, 30.0, math.sqrt(0.75), -0.5),
    ],
)
def test_along_and_across_are_those_of_the_reference(x, y, reference_heading, along, across):
    reference = _pose(100.0, -50.0, -9.0, reference_heading)
    error = pose_error(_pose(100.0 + x, -50.0 + y, 9.0, reference_heading + 1.0), reference)
    assert error.along == pytest.approx(along, abs=1e-12)
    assert error.across == pytest.approx(across, abs=1e-12)
    assert error.distance == pytest.approx(math.hypot(x, y))


@pytest.mark.parametrize(
    ("along", "across", "heading_deg", "wanted"),
    [
        (0.3, 0.0, 0.0, True),
        (0.0, -0.3, 0.0, True),
        (0.3001, 0.0, 0.0, False),
        (-0.18, 0.24, 0.0, True),
        (0.25, 0.25, 0.0, False),
        (0.0, 0.0, 1.0, True),
        (0.0, 0.0, -1.0, True),
        (0.0, 0.0, 1.001, False),
        (0.0, 0.0, -1.001, False),
        (0.31, 0.0, 1.1, False),
        (math.nan, 0.0, 0.0, False),
    ],
)
def test_success_is_0_3_m_and_1_degree(along, across, heading_deg, wanted):
    assert PoseError(along, across, math.radians(heading_deg)).is_success is wanted


def test_quantiles_are_of_absolute_errors():
    errors = [(-1) ** k * k / 100 for k in range(101)]
    assert Quantiles.of(errors) == pytest.approx(Quantiles(0.5, 0.95, 0.99, 1.0))
    assert Quantiles.of([3.0, 0.0, -1.0]).median == 1.0


def test_quantiles_of_nothing_or_of_nan_are_nan():
    for errors in ([], [0.1, math.nan, 0.2]):
        found = Quantiles.of(errors)
        assert all(math.isnan(value) for value in (found.median, found.p95, found.p99, found.worst))


def test_summary():
    errors = [
        PoseError(0.06, -0.08, math.radians(-0.5)),
        None,
        PoseError(-0.2, 0.0, math.radians(0.25)),
        PoseError(0.0, 0.6, 0.0),
        PoseError(0.03, 0.04, math.radians(-2.0)),
    ]
    accuracy = summarize(errors)
    assert (accuracy.n_epochs, accuracy.n_success) == (5, 2)
    assert accuracy.distance.median == pytest.approx(0.15)
    assert accuracy.distance.worst == pytest.approx(0.6)
    assert accuracy.heading.worst == pytest.approx(math.radians(2.0))
    assert accuracy.along.median == pytest.approx(0.045)  # of 0, 0.03, 0.06 and 0.2
    assert accuracy.along.worst == pytest.approx(0.2)
    assert accuracy.across.median == pytest.approx(0.06)  # of 0, 0.04, 0.08 and 0.6
    assert accuracy.across.p95 == pytest.approx(0.08 + 0.85 * 0.52)  # rank 2.85 of 0 to 3
    assert accuracy.heading.median == pytest.approx(math.radians(0.375))


def test_nothing_localized_has_no_errors():
    for errors in ([], [None, None]):
        accuracy = summarize(errors)
        assert (accuracy.n_epochs, accuracy.n_success) == (len(errors), 0)
        assert math.isnan(accuracy.distance.median)
        assert math.isnan(accuracy.distance.worst) and math.isnan(accuracy.heading.worst)
        assert math.isnan(accuracy.along.p95) and math.isnan(accuracy.across.p99)
