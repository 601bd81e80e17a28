# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How good answers are: their errors, how distinct their peaks are, and whether their stated certainty holds."""

from maxcon.lab.evaluation.accuracy import (
    SUCCESS_DISTANCE,
    SUCCESS_WORDS,
    Accuracy,
    PoseError,
    Quantiles,
    pose_error,
    summarize,
)
from maxcon.lab.evaluation.certainty import (
    ALERT_LIMIT,
    PROMISED,
    PROMISED_PLANE,
    Coverage,
    MeanSquare,
    ProtectionCounts,
    RiskCoverage,
    clopper_pearson,
    least_to_prove,
    upper_bound,
    wilson_interval,
)
from maxcon.lab.evaluation.distinctness import Distinctness, distinctness, significant_ray

__all__ = [
    "ALERT_LIMIT",
    "PROMISED",
    "PROMISED_PLANE",
    "SUCCESS_DISTANCE",
    "SUCCESS_WORDS",
    "Accuracy",
    "Coverage",
    "Distinctness",
    "MeanSquare",
    "PoseError",
    "ProtectionCounts",
    "Quantiles",
    "RiskCoverage",
    "clopper_pearson",
    "distinctness",
    "least_to_prove",
    "pose_error",
    "significant_ray",
    "summarize",
    "upper_bound",
    "wilson_interval",
]
