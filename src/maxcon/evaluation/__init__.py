# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How good an answer is, against a reference."""

from maxcon.evaluation.accuracy import Accuracy, PoseError, pose_error, summarize

__all__ = ["Accuracy", "PoseError", "pose_error", "summarize"]
