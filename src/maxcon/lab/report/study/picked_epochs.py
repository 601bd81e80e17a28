# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which epochs the scenes of a study show: a crossing, a street, and one in which the count fails."""

from dataclasses import dataclass

import numpy as np

from maxcon.lab.report.study.statistics import common_epochs
from maxcon.lab.study import MethodRows

__all__ = ["PictureEpochs", "pick_epochs"]

# Errors of priors that are near, m: see `pick_epochs`.
NEAR = 1.5


@dataclass(frozen=True, slots=True)
class PictureEpochs:
    """Which epochs the pictures show, chosen by the table of the study.

    crossing: where the count is the most distinct: surfaces face in several directions.
    street: where the count is right and the least distinct: nearly all surfaces face across.
    failure: where the count is farthest off while Helmert's score is right; None if there is no such epoch.
    """

    crossing: int
    street: int
    failure: int | None


def pick_epochs(count: MethodRows, helmert: MethodRows) -> PictureEpochs | None:
    """Pick the epochs to show; None if there is none in which both count and Helmert's score succeed.

    Crossing and street are taken from epochs whose prior is within 1.5 m of the reference, if there are any: their
    peak is not at the border of the search space.
    """
    epochs = common_epochs({"count": count, "helmert": helmert}, ("count", "helmert"))
    here = [np.isin(rows.numbers("epoch"), epochs) for rows in (count, helmert)]
    succeeds = [rows.numbers("is_success")[at] == 1.0 for rows, at in zip((count, helmert), here, strict=True)]
    is_good, is_lost = succeeds[0] & succeeds[1], ~succeeds[0] & succeeds[1]
    if not is_good.any():
        return None
    is_near = is_good & (np.nan_to_num(count.numbers("prior_distance")[here[0]]) <= NEAR)
    is_shown = is_near if is_near.any() else is_good
    distinct = np.nan_to_num(count.numbers("kurtosis")[here[0]])
    errors = np.where(is_lost, np.nan_to_num(count.numbers("distance")[here[0]]), 0.0)
    return PictureEpochs(
        crossing=int(epochs[np.argmax(np.where(is_shown, distinct, -1.0))]),
        street=int(epochs[np.argmin(np.where(is_shown, distinct, np.inf))]),
        failure=int(epochs[np.argmax(errors)]) if errors.any() else None,
    )
