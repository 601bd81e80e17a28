# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv of `maxcon localize`: begun, gone on with, kept when the command is stopped; pictures of its epochs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.terminal import compiling_told, progress_bar
from maxcon.errors import FileError, MaxconError, OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from maxcon.drive.localize import EpochEstimate
    from maxcon.drive.poses_table import GrowingTable, RowsThere
    from maxcon.drive.within_sigmas import WithinSigmas
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap

__all__ = ["check_table", "drawer", "parse_epochs", "read_there", "write_trajectory", "written"]

GO_ON = "go on with --resume"
# Pictures drawn when none are asked for by number, evenly over the drive.
N_PICTURES = 10


def check_table(out: Path, *, resume: bool, overwrite: bool, track: bool) -> None:
    """Refuse to replace a table without being asked to, and what cannot be gone on with."""
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
    """Return what is there of the table, if it is gone on with."""
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
    """Write each epoch's row once it is localized; return all without their points. Draw those that are wanted."""
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


def parse_epochs(text: str | None, n_epochs: int) -> frozenset[int]:
    """Epoch numbers of "0,5,10-20" or "all"; ten evenly over the drive for None."""
    if text is None:
        step = max(1, -(-n_epochs // N_PICTURES))
        return frozenset(range(0, n_epochs, step))
    if text.strip().lower() == "all":
        return frozenset(range(n_epochs))
    numbers: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        last = last if dash else first
        is_listed = all(n.isascii() and n.isdigit() and len(n) < 19 for n in (first, last))
        if not (is_listed and int(first) <= int(last) < n_epochs):
            raise OptionError(
                f"Expected --plot-epochs to list epochs from 0 to {n_epochs - 1}, such as 0,5,10-20, or all,"
                f" got {part.strip()[:40]!r}."
            )
        numbers.update(range(int(first), int(last) + 1))
    return frozenset(numbers)


def drawer(
    folder: Path, point_map: "PointMap", method: "MaximumConsensus | WithinSigmas", objective: str
) -> Callable[["EpochEstimate"], None]:
    """Return a function that draws an epoch into the folder."""
    from maxcon._system.atomic import make_folder, sweep
    from maxcon.localizer import MaximumConsensus
    from maxcon.plotting.epoch import plot_epoch
    from maxcon.plotting.figure import check_matplotlib

    check_matplotlib()
    sweep(folder)

    def draw(epoch: "EpochEstimate") -> None:
        if epoch.estimate is None or epoch.prior is None:
            return
        searching = method if isinstance(method, MaximumConsensus) else method.at(epoch.raw.time)
        make_folder(folder)
        plot_epoch(
            folder / f"{epoch.epoch:06d}.png",
            accumulator=searching.accumulate(epoch.scan, point_map, epoch.prior),
            objective=searching.cell_search.objective,
            estimate=epoch.estimate,
            scan=epoch.scan,
            point_map=point_map,
            title=f"Epoch {epoch.epoch} ({epoch.raw.name}), {objective}, {searching.multiplicity}",
        )

    return draw
