# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv of `maxcon localize`: begun, gone on with, and what is said of it when the command is stopped."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.compiling import compiling_told
from maxcon.cli.progress import progress_bar
from maxcon.errors import FileError, MaxconError, OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from maxcon.drive.localize import EpochEstimate
    from maxcon.drive.poses_table import GrowingTable, RowsThere

__all__ = ["check_table", "read_there", "write_trajectory", "written"]

GO_ON = "go on with --resume"


def check_table(out: Path, *, resume: bool, overwrite: bool, track: bool) -> None:
    """Refuse to replace a table without being asked to, and what cannot be gone on with.

    Raises
    ------
    OptionError, FileError
        If it is so.
    """
    if resume and overwrite:
        raise OptionError("Expected either --resume or --overwrite, got both. Leave one out.")
    if resume and track:
        raise OptionError(
            "Expected --resume without --track, got both: where a track was is not in the table. Begin anew with"
            " --overwrite."
        )
    if out.is_file() and not resume and not overwrite:
        raise FileError(
            f"Expected {out} not to exist yet, but it does. Go on with it (--resume), replace it (--overwrite), or name"
            " another."
        )


def read_there(out: Path, times: "NDArray[np.float64]", *, resume: bool) -> "RowsThere":
    """Return what is there of the table, if it is gone on with.

    Raises
    ------
    FileError
        If that is not the beginning of the table of these scans.
    """
    from maxcon.drive.poses_table import RowsThere, rows_there

    return rows_there(out, times) if resume else RowsThere()


def written(
    out: Path,
    there: "RowsThere",
    drive: "Iterator[EpochEstimate]",
    n_epochs: int,
    draw: "Callable[[EpochEstimate], None] | None",
    wanted: frozenset[int],
    quiet: bool,
) -> "list[EpochEstimate]":
    """Write each epoch's row once it is localized; return all without their points. Draw those that are wanted.

    Raises
    ------
    FileError
        If not one scan can be read, or a row cannot be written.
    """
    from maxcon.drive.poses_table import GrowingTable

    epochs = []
    with GrowingTable(out, there) as table, _kept_told(out, table, n_epochs):
        with (
            progress_bar("localizing", n_epochs, "epochs", quiet, n_before=there.n_rows) as advance,
            compiling_told(quiet),
        ):
            for epoch in drive:
                table.add(epoch)
                if draw is not None and epoch.epoch in wanted:
                    draw(epoch)
                epochs.append(epoch.without_points())
                advance()
        if table.n_rows == 0:
            raise FileError(epochs[0].reason)
    return epochs


@contextmanager
def _kept_told(out: Path, table: "GrowingTable", n_epochs: int) -> Iterator[None]:
    """Say which rows are kept where a drive ends before its time."""
    try:
        yield
    except MaxconError as error:
        if table.n_rows == 0:
            raise
        kept = f"{table.n_rows} of {n_epochs} epochs are kept in {out}: {GO_ON}"
        raise type(error)(f"{error} {kept[0].upper()}{kept[1:]}.") from error
    except SystemExit:  # a signal
        kept = f"{table.n_rows} of {n_epochs} epochs are kept in {out}: {GO_ON}"
        typer.echo(f"maxcon: stopped; {kept if table.n_rows else 'nothing was written'}", err=True)
        raise


def write_trajectory(tum: Path, out: Path, there: "RowsThere", epochs: "list[EpochEstimate]") -> None:
    """Write the poses of all epochs, also of those that were there, as TUM; say so where there are none."""
    from maxcon.drive.poses_table import localized_trajectory
    from maxcon.io.trajectories import read_trajectory, write_tum

    trajectory = localized_trajectory(epochs) if there.n_rows == 0 else None
    if there.n_localized or (there.n_rows and any(epoch.pose_global is not None for epoch in epochs)):
        trajectory = read_trajectory(out)
    if trajectory is None:
        typer.echo(f"no pose to write: {tum} is not written")
    else:
        write_tum(tum, trajectory, "T_map_sensor, localized by maxcon")
