# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Columns of a row of the table: of its epoch, and of a method's answer to it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import along_and_across
from maxcon.lab.evaluation import Distinctness, pose_error
from maxcon.map import PointMap

__all__ = ["Answer", "answer_columns", "reference_columns"]

MEASURES = ("peak_ratio", "kurtosis", "divergence", "spread")


@dataclass(frozen=True, slots=True)
class Answer:
    """A method's answer to an epoch; poses in the local frame of its map.

    estimate: the answer.
    milliseconds: from points in memory to the pose.
    distinctness: measures of methods that have scores of cells.
    starts: where each start of a method with several ended.
    """

    estimate: Estimate
    milliseconds: float
    distinctness: Distinctness | None = None
    starts: tuple[Estimate, ...] = ()


def reference_columns(prior: Pose | None, reference: Pose | None) -> dict[str, Any]:
    """Reference pose of an epoch, and the error of its prior; no columns where they are not known."""
    columns: dict[str, Any] = {}
    if reference is not None:
        columns |= {f"reference_{name}": getattr(reference, name) for name in ("x", "y", "z", "heading")}
    if reference is not None and prior is not None:
        error = pose_error(prior, reference)
        columns |= {"prior_distance": error.distance, "prior_heading_error": error.heading}
    return columns


def answer_columns(answer: Answer, reference: Pose | None, point_map: PointMap) -> dict[str, Any]:
    """Pose, errors and measures of an answer, also of one that the method does not trust."""
    estimate = answer.estimate
    columns: dict[str, Any] = {"status": estimate.status.value, "is_localized": estimate.is_localized}
    columns |= {"ms": answer.milliseconds, "score": estimate.score, "share": estimate.share}
    if estimate.reason:
        columns["reason"] = estimate.reason
    if math.isfinite(estimate.runner_up):
        columns["runner_up"] = estimate.runner_up
    if answer.starts:
        columns["n_starts"] = len(answer.starts)
    columns["was_widened"] = estimate.was_widened
    if estimate.status is Status.NO_MATCH:
        return columns | ({"n_converged": 0} if answer.starts else {})
    pose = point_map.frame.pose_to_global(estimate.pose)
    columns |= {name: getattr(pose, name) for name in ("x", "y", "z", "roll", "pitch", "heading")}
    if answer.distinctness is not None:
        measures = {name: getattr(answer.distinctness, name) for name in MEASURES}
        columns |= {name: value for name, value in measures.items() if math.isfinite(value)}
    if reference is not None:
        columns |= _certainty_columns(estimate, reference)
        error = pose_error(estimate.pose, reference)
        columns |= {"distance": error.distance, "along": error.along, "across": error.across}
        columns |= {"heading_error": error.heading, "is_success": error.is_success}
        if answer.starts:
            n_converged = sum(
                start.status is not Status.NO_MATCH and pose_error(start.pose, reference).is_success
                for start in answer.starts
            )
            columns |= {"n_converged": n_converged, "is_success": n_converged == len(answer.starts)}
    return columns


def _certainty_columns(estimate: Estimate, reference: Pose) -> dict[str, Any]:
    """Standard deviations, protection level and normalized squared error (NEES), along and across the reference."""
    columns: dict[str, Any] = {"height_error": estimate.pose.z - reference.z}
    if not np.isfinite(estimate.covariance).all():
        return columns
    covariance = along_and_across(estimate.covariance, reference.heading)
    error = pose_error(estimate.pose, reference)
    offset = np.array([error.along, error.across])
    columns |= {"sigma_along": math.sqrt(covariance[0, 0]), "sigma_across": math.sqrt(covariance[1, 1])}
    columns |= {"sigma_z": math.sqrt(estimate.covariance[2, 2]), "sigma_heading": math.sqrt(estimate.covariance[5, 5])}
    columns["nees"] = float(offset @ np.linalg.solve(covariance, offset))
    if math.isfinite(estimate.protection_level[0]):
        columns |= dict(zip(("protection_along", "protection_across"), estimate.protection_level, strict=True))
    return columns
