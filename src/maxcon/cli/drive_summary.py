# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What `maxcon localize` says at its end."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from maxcon.drive.localize import DriveOptions, EpochEstimate, Method
    from maxcon.drive.poses_table import RowsThere
    from maxcon.io.scans import Scans
    from maxcon.map import PointMap

__all__ = ["is_whole", "print_alternative", "print_summary"]


def is_whole(epochs: "list[EpochEstimate]", there: "RowsThere", n_epochs: int, *, track: bool) -> bool:
    """Whether every epoch is localized; of a track every one from the first that is.

    A track that begins where several places look alike has no answer until it has seen enough of the way to tell them
    apart: that is how it works, and no fault of the drive.
    """
    are_localized = [epoch.pose_global is not None for epoch in epochs]
    if track and any(are_localized):
        return all(are_localized[are_localized.index(True) :])
    return there.n_localized + sum(are_localized) == n_epochs


def _beginning(epochs: "list[EpochEstimate]") -> str:
    """Where a track begins, in words; empty where it does with the first epoch, or never."""
    first = next((number for number, epoch in enumerate(epochs) if epoch.pose_global is not None), 0)
    return f"the track begins with epoch {epochs[first].epoch}: before, it was not known where" if first else ""


def print_summary(
    epochs: "list[EpochEstimate]",
    out: Path,
    searched: str,
    *,
    there: "RowsThere",
    left_out: "tuple[str, ...]",
    track: bool = False,
) -> None:
    """Say how many epochs are localized, in which time and searched where, and why the others are not.

    And what was in the table before, and which rows of the prior were left out.
    """
    from collections import Counter

    import numpy as np

    if there.n_rows and not epochs:
        typer.echo(
            f"all {there.n_rows} epochs were in {out} already, {there.n_localized} of them localized. Nothing was done:"
            " prior, map and options of this call had no effect; --overwrite makes the table anew with them"
        )
        return
    n_localized = sum(epoch.pose_global is not None for epoch in epochs)
    taken = [epoch.milliseconds for epoch in epochs if epoch.estimate is not None]
    median = f", median {np.median(taken):.0f} ms" if taken else ""
    typer.echo(f"{n_localized} of {len(epochs)} epochs localized{median}; written to {out}")
    if there.n_rows:
        typer.echo(
            f"behind {there.n_rows} that were there, {there.n_localized} of them localized, with the prior, map and"
            " options of their own call"
        )
    if track and (beginning := _beginning(epochs)):
        typer.echo(beginning)
    if left_out:
        typer.echo(f"{len(left_out)} rows of the prior are left out; the first: {left_out[0]}")
    if searched:
        typer.echo(searched)
    n_invalid = sum(epoch.raw.n_dropped_invalid for epoch in epochs)
    n_out_of_range = sum(epoch.raw.n_dropped_range for epoch in epochs)
    n_repeated = sum(epoch.raw.n_dropped_duplicates for epoch in epochs)
    if n_invalid or n_out_of_range or n_repeated:
        repeated = f", {n_repeated:,} that come twice" if n_repeated else ""
        typer.echo(f"left out: {n_invalid:,} points that are no returns, {n_out_of_range:,} out of range{repeated}")
    n_widened = sum(epoch.estimate is not None and epoch.estimate.was_widened for epoch in epochs)
    if n_widened:
        typer.echo(f"{n_widened} {'was' if n_widened == 1 else 'were'} in doubt and searched for farther around")
    others = Counter(epoch.status for epoch in epochs if epoch.pose_global is None)
    for status, number in sorted(others.items()):
        typer.echo(f"{number} {status.value}: {status.explanation}")
    doubtful = [epoch for epoch in epochs if epoch.reason]
    if doubtful:
        first = doubtful[0]
        typer.echo(f"{len(doubtful)} have a reason beside them; the first, epoch {first.epoch}: {first.reason}")


def print_alternative(
    point_map: "PointMap", scans: "Scans", epochs: "list[EpochEstimate]", method: "Method", options: "DriveOptions"
) -> None:
    """Say what prior or scans would have to mean for epochs to be localized, where none is."""
    from maxcon.drive.diagnosis import alternative_that_fits, heights_in_words

    if any(epoch.pose_global is not None for epoch in epochs):
        return
    heights = heights_in_words(point_map, [epoch.prior for epoch in epochs if epoch.prior is not None])
    if heights:
        typer.echo(heights)
        return
    found = alternative_that_fits(point_map, scans, epochs, method, options)
    if found:
        typer.echo(found)
