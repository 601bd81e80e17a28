# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tracking over a drive: each scan is searched where the one before and the motion since allow it to be."""

from maxcon.drive.tracking.hypothesis import Hypothesis
from maxcon.drive.tracking.motion import Motion, MotionNoise
from maxcon.drive.tracking.options import TrackingOptions
from maxcon.drive.tracking.tracker import Tracker
from maxcon.drive.tracking.uncertain_pose import UncertainPose

__all__ = ["Hypothesis", "Motion", "MotionNoise", "Tracker", "TrackingOptions", "UncertainPose"]
