# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What `maxcon localize` says at its end."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from maxcon.drive import EpochEstimate

__all__ = ["print_summary"]


def print_summary(epochs: "list[EpochEstimate]", out: Path, searched: str) -> None:
    """Say how many epochs are localized, in which time and searched where, and why the others are not."""
    from collections import Counter

    import numpy as np

    n_localized = sum(epoch.pose_global is not None for epoch in epochs)
    taken = [epoch.milliseconds for epoch in epochs if epoch.estimate is not None]
    median = f", median {np.median(taken):.0f} ms" if taken else ""
    typer.echo(f"{n_localized} of {len(epochs)} epochs localized{median}; written to {out}")
    if searched:
        typer.echo(searched)
    n_invalid = sum(epoch.raw.n_dropped_invalid for epoch in epochs)
    n_out_of_range = sum(epoch.raw.n_dropped_range for epoch in epochs)
    n_repeated = sum(epoch.raw.n_dropped_duplicates for epoch in epochs)
    if n_invalid or n_out_of_range or n_repeated:
        repeated = f", {n_repeated:,} that come twice" if n_repeated else ""
        typer.echo(
            f"left out: {n_invalid:,} points that are no returns, {n_out_of_range:,} out of range{repeated}"
        )
    n_widened = sum(epoch.estimate is not None and epoch.estimate.was_widened for epoch in epochs)
    if n_widened:
        typer.echo(f"{n_widened} were in doubt and searched for farther around")
    others = Counter(epoch.status for epoch in epochs if epoch.pose_global is None)
    for status, number in sorted(others.items()):
        typer.echo(f"{number} {status.value}: {status.explanation}")
    doubtful = [epoch for epoch in epochs if epoch.reason]
    if doubtful:
        first = doubtful[0]
        typer.echo(
            f"{len(doubtful)} have a reason beside them; the first, epoch {first.epoch}: {first.reason}"
        )
