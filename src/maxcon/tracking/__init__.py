# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tracking over a drive: each scan is searched where the one before and the motion since allow it to be."""

from maxcon.tracking.hypothesis import Hypothesis
from maxcon.tracking.motion import Motion, MotionNoise
from maxcon.tracking.options import TrackingOptions
from maxcon.tracking.tracker import Tracker
from maxcon.tracking.uncertain_pose import UncertainPose

__all__ = ["Hypothesis", "Motion", "MotionNoise", "Tracker", "TrackingOptions", "UncertainPose"]
