# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of `maxcon localize` that make its epochs a track."""

from pathlib import Path

from maxcon.errors import OptionError

__all__ = ["check_tracking"]


def check_tracking(
    track: bool, odometry: Path | None, drift: float | None, *, deskew: bool = False, is_shared: bool = False
) -> None:
    """Refuse options without effect.

    Raises
    ------
    OptionError
        If odometry is given without tracking or deskewing, or its drift without odometry; or a track is to be shared
        among workers.
    """
    if track and is_shared:
        raise OptionError(
            "Expected one process for --track, as each epoch needs the one before, got --workers or --scheduler. Leave"
            " it out, or take --threads."
        )
    if odometry is not None and not (track or deskew):
        raise OptionError(
            "Expected --odometry together with --track or --deskew, got it alone. Add one, or leave it out."
        )
    if drift is not None and odometry is None:
        raise OptionError("Expected --drift together with --odometry, got it alone. Leave it out.")
