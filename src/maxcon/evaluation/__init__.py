# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How good an answer is: against a reference, and by how distinct it is."""

from maxcon.evaluation.accuracy import Accuracy, PoseError, Quantiles, pose_error, summarize
from maxcon.evaluation.distinctness import Distinctness, distinctness, significant_ray

__all__ = [
    "Accuracy",
    "Distinctness",
    "PoseError",
    "Quantiles",
    "distinctness",
    "pose_error",
    "significant_ray",
    "summarize",
]
