# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a localized drive leaves: POSES.csv, begun or gone on with, pictures of its epochs, and a summary."""

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.options import TableOptions
from maxcon.cli.terminal import Stop, compiling_told, step_bars
from maxcon.errors import FileError, MaxconError, OptionError

if TYPE_CHECKING:
    from maxcon.cli.drive_inputs import OpenedDrive
    from maxcon.drive.localize import DriveOptions, EpochEstimate, Method
    from maxcon.drive.poses_table import RowsThere
    from maxcon.drive.within_sigmas import WithinSigmas
    from maxcon.io.scans import Scans
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap
    from maxcon.scan.trajectory import Trajectory

N_PICTURES = 10
"""Pictures drawn when none are asked for by number, evenly over the drive."""


# --- before the work -------------------------------------------------------------------------------------------


def check_outputs(
    out: Path, table: TableOptions, *, prior: Path | None = None, plot: Path | None = None, report: Path | None = None
) -> None:
    """Refuse outputs that cannot be written, or would replace anything unasked."""
    from maxcon._system.atomic import check_folder, check_writable
    from maxcon.lab.report import check_jinja2
    from maxcon.plotting.figure import check_matplotlib

    named = [path.resolve() for path in (prior, out, table.tum, report) if path is not None]
    if len(set(named)) < len(named):
        raise OptionError("Expected different files as --prior, --out, --tum and --report, got one twice. Rename one.")
    if out.suffix.lower() not in ("", ".csv", ".txt"):
        raise OptionError(
            f"Expected a .csv as --out, got {out}. Write POSES.csv; `maxcon export` turns it into other formats."
        )
    if report is not None:
        check_jinja2()
        check_matplotlib()
    for path in (out, table.tum, report):
        if path is not None:
            check_writable(path)
    if plot is not None:
        check_folder(plot)
    if out.is_file() and not table.resume and not table.overwrite:
        raise FileError(
            f"Expected {out} not to exist yet, but it does. Go on with it (--resume), replace it (--overwrite), or name"
            " another."
        )


def parse_epochs(text: str | None, n_epochs: int) -> frozenset[int]:
    """Return epoch numbers of "0,5,10-20" or "all"; ten evenly over the drive for None."""
    if text is None:
        return frozenset(range(0, n_epochs, max(1, -(-n_epochs // N_PICTURES))))
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


# --- while epochs come -----------------------------------------------------------------------------------------


def written(
    out: Path,
    there: "RowsThere",
    drive: "Iterator[EpochEstimate]",
    n_epochs: int,
    quiet: bool,
    draw: "Callable[[EpochEstimate], None] | None" = None,
) -> "list[EpochEstimate]":
    """Write the row of each epoch once it is localized, and draw it; return all without their points."""
    from maxcon.drive.poses_table import GrowingTable

    epochs = []
    with GrowingTable(out, there) as table:
        try:
            with step_bars(quiet) as report, compiling_told(quiet):
                for epoch in drive:
                    table.add(epoch)
                    if draw is not None:
                        draw(epoch)
                    epochs.append(epoch.without_points())
                    report("localizing", there.n_rows + len(epochs), n_epochs)
        except (MaxconError, Stop) as error:
            kept = f"{table.n_rows} of {n_epochs} epochs are kept in {out}: go on with --resume"
            if isinstance(error, Stop):
                error.is_told = True
                typer.echo(f"maxcon: stopped; {kept if table.n_rows else 'nothing was written'}", err=True)
            elif table.n_rows:
                raise type(error)(f"{error} {kept}.") from error
            raise
        if table.n_rows == 0:
            raise FileError(epochs[0].reason)
    return epochs


def drawer(
    folder: Path, wanted: frozenset[int], point_map: "PointMap", method: "MaximumConsensus | WithinSigmas", name: str
) -> Callable[["EpochEstimate"], None]:
    """Return a function that draws an epoch into the folder, if it is wanted; `name` is that of the objective."""
    from maxcon._system.atomic import make_folder, sweep
    from maxcon.localizer import MaximumConsensus
    from maxcon.plotting.epoch import plot_epoch
    from maxcon.plotting.figure import check_matplotlib

    check_matplotlib()
    sweep(folder)

    def draw(epoch: "EpochEstimate") -> None:
        if epoch.epoch not in wanted or epoch.estimate is None or epoch.prior is None:
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
            title=f"Epoch {epoch.epoch} ({epoch.raw.name}), {name}, {searching.multiplicity}",
        )

    return draw


# --- when all are done -----------------------------------------------------------------------------------------


def write_trajectory(tum: Path, out: Path, there: "RowsThere", epochs: "list[EpochEstimate]") -> None:
    """Write the poses of all epochs, also of those that were there, as TUM; say so where there are none."""
    from maxcon.drive.poses_table import localized_trajectory
    from maxcon.io.trajectories import read_trajectory, write_tum

    if there.n_rows == 0:
        trajectory = localized_trajectory(epochs)
    else:
        is_any = there.n_localized or any(epoch.pose_global is not None for epoch in epochs)
        trajectory = read_trajectory(out) if is_any else None
    if trajectory is None:
        typer.echo(f"no pose to write: {tum} is not written")
    else:
        write_tum(tum, trajectory, "T_map_sensor, localized by maxcon")


def report_drive(
    page: Path, out: Path, drive: "OpenedDrive", reference: "Trajectory | None", assumed: dict[str, str]
) -> None:
    """Write the page of a drive, of all rows of its table."""
    from maxcon.cli.map_words import sigma_words
    from maxcon.export import read_rows
    from maxcon.lab.report.drive_page import LocalizedDrive, write_drive_page
    from maxcon.map.manifest import read_manifest

    prior, entry = drive.prior.trajectory, drive.entry
    facts = {
        "Map": f"{entry.map}, voxels of {drive.point_map.cell:g} m", "Scans": f"{entry.scans}",
        "Sigma of the map": sigma_words(read_manifest(entry.map)), "Rough poses": f"{entry.prior or entry.scans}",
        **assumed,
    }  # fmt: skip
    localized = LocalizedDrive(read_rows(out), drive.point_map, drive.scans, drive.opener.drive, prior, reference)
    write_drive_page(page, localized, f"{entry.scans.name} in {Path(entry.map).name}", facts)
    typer.echo(f"a page of it: {page}")


def is_whole(epochs: "list[EpochEstimate]", there: "RowsThere", n_epochs: int, *, track: bool = False) -> bool:
    """Whether every epoch is localized; of a track every one from the first that is.

    A track that begins where several places look alike has no answer until it has seen enough of the way to tell them
    apart: that is how it works, and no fault of the drive.
    """
    are_localized = [epoch.pose_global is not None for epoch in epochs]
    if track and any(are_localized):
        return all(are_localized[are_localized.index(True) :])
    return there.n_localized + sum(are_localized) == n_epochs


def print_summary(
    epochs: "list[EpochEstimate]",
    out: Path,
    searched: str,
    *,
    there: "RowsThere",
    left_out: "tuple[str, ...]" = (),
    track: bool = False,
) -> None:
    """Say how many epochs are localized, in which time and searched where, and why the others are not."""
    from statistics import median

    if there.n_rows and not epochs:
        typer.echo(
            f"all {there.n_rows} epochs were in {out} already, {there.n_localized} of them localized. Nothing was done:"
            " prior, map and options of this call had no effect; --overwrite makes the table anew with them"
        )
        return
    taken = [epoch.milliseconds for epoch in epochs if epoch.estimate is not None]
    time = f", median {median(taken):.0f} ms" if taken else ""
    others = Counter(epoch.status for epoch in epochs if epoch.pose_global is None)
    typer.echo(f"{len(epochs) - others.total()} of {len(epochs)} epochs localized{time}; written to {out}")
    if there.n_rows:
        typer.echo(
            f"behind {there.n_rows} that were there, {there.n_localized} of them localized, with the prior, map and"
            " options of their own call"
        )
    first = next((number for number, epoch in enumerate(epochs) if epoch.pose_global is not None), 0)
    if track and first:
        typer.echo(f"the track begins with epoch {epochs[first].epoch}: before, it was not known where")
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
    for status, number in sorted(others.items()):
        typer.echo(f"{number} {status.value}: {status.explanation}")
    doubtful = [epoch for epoch in epochs if epoch.reason]
    if doubtful:
        number, reason = doubtful[0].epoch, doubtful[0].reason
        typer.echo(f"{len(doubtful)} have a reason beside them; the first, epoch {number}: {reason}")


def print_alternative(
    point_map: "PointMap", scans: "Scans", epochs: "list[EpochEstimate]", method: "Method", options: "DriveOptions"
) -> None:
    """Say what prior or scans would have to mean for epochs to fit better."""
    from maxcon.drive.diagnosis import alternative_that_fits, heights_in_words

    is_any_localized = any(epoch.pose_global is not None for epoch in epochs)
    priors = [epoch.prior for epoch in epochs if epoch.prior is not None and not is_any_localized]
    words = heights_in_words(point_map, priors) or alternative_that_fits(point_map, scans, epochs, method, options)
    if words:
        typer.echo(words)
