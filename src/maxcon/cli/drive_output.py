"""What a localized drive leaves: POSES.csv, begun or gone on with, pictures of its epochs, and a summary."""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import typer
from numpy.typing import NDArray

from maxcon._system.atomic import check_folder, check_writable, make_folder, sweep
from maxcon._system.engine import Engine
from maxcon.cli.drive_inputs import DriveOpener, OpenedDrive
from maxcon.cli.map_words import assumed_words, sigma_words
from maxcon.cli.options import TableOptions
from maxcon.cli.terminal import Stop, compiling_told, print_json, step_bars
from maxcon.drive.diagnosis import above_ground, alternative_that_fits, heights_in_words
from maxcon.drive.localize import EpochEstimate
from maxcon.drive.many import ManyDrivesJob, localize_drives, read_drives
from maxcon.drive.poses_table import GrowingTable, RowsThere, localized_trajectory, rows_there
from maxcon.errors import FileError, MaxconError, OptionError
from maxcon.export import read_rows
from maxcon.export.scene import CellScores
from maxcon.io.crs import crs_name
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.evaluation import PROMISED, SUCCESS_WORDS
from maxcon.lab.report import check_jinja2
from maxcon.lab.report.drive_page import ReportedDrive, write_drive_page
from maxcon.localizer import MaximumConsensus
from maxcon.map.manifest import read_manifest
from maxcon.plotting.epoch import plot_epoch
from maxcon.plotting.figure import check_matplotlib
from maxcon.scan.trajectory import Trajectory

PAGES = (".html", ".htm")
N_PICTURES = 10  # pictures drawn when none are asked for by number, evenly over the drive


def check_outputs(
    out: Path, table: TableOptions, *, prior: Path | None = None, plot: Path | None = None, report: Path | None = None
) -> None:
    """Refuse outputs that cannot be written, or would replace anything unasked."""
    named = [path.resolve() for path in (prior, out, table.tum, report) if path is not None]
    if len(set(named)) < len(named):
        raise OptionError("Expected different files as --prior, --out, --tum and --report, got one twice. Rename one.")
    if out.suffix.lower() not in ("", ".csv", ".txt"):
        raise OptionError(f"Expected a .csv as --out, got {out}. Write .csv; `maxcon export` turns it into others.")
    if report is not None:
        if report.suffix.lower() not in PAGES:
            raise OptionError(f"Expected a page {' or '.join(PAGES)} as --report, got {report}. Rename it.")
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


def drawer(drive: OpenedDrive, folder: Path, wanted: frozenset[int]) -> Callable[[EpochEstimate], None]:
    """Return a function that draws an epoch into the folder, if it is wanted."""
    check_matplotlib()
    sweep(folder)

    def draw(epoch: EpochEstimate) -> None:
        if epoch.epoch not in wanted or epoch.estimate is None or epoch.prior is None:
            return
        method = _method_of(drive, epoch)
        make_folder(folder)
        plot_epoch(
            folder / f"{epoch.epoch:06d}.png", accumulator=method.accumulate(epoch.scan, drive.point_map, epoch.prior),
            objective=method.cell_search.objective, estimate=epoch.estimate, scan=epoch.scan, point_map=drive.point_map,
            title=f"Epoch {epoch.epoch} ({epoch.raw.name}), {drive.opener.method.objective}, {method.multiplicity}",
        )  # fmt: skip

    return draw


def cell_scores_of(drive: OpenedDrive, epoch: EpochEstimate) -> CellScores | None:
    """Return the scores of the cells around the prior of an epoch, searched anew; None where none were searched."""
    if epoch.estimate is None or epoch.prior is None:
        return None
    return CellScores.searched(_method_of(drive, epoch), epoch.scan, drive.point_map, epoch.prior)


def _method_of(drive: OpenedDrive, epoch: EpochEstimate) -> MaximumConsensus:
    searching = drive.searching
    return searching if isinstance(searching, MaximumConsensus) else searching.at(epoch.raw.time)


@dataclass
class TableOfDrive:
    """POSES.csv of a drive while it grows, and what is said of it in the end: sentences, or their facts as JSON."""

    out: Path
    options: TableOptions
    times: NDArray[np.float64]  # of the scans, s
    is_track: bool = False
    epochs: list[EpochEstimate] = field(default_factory=list)  # those of this call, without their points
    facts: dict[str, Any] = field(default_factory=dict)  # that were said

    def say(self, *lines: str, **facts: Any) -> None:
        """Print the lines that are not empty, unless their facts are printed in the end instead."""
        self.facts |= facts
        for line in () if self.options.is_json else filter(None, lines):
            typer.echo(line)

    @cached_property
    def there(self) -> RowsThere:
        """The rows that are there to go on with."""
        return rows_there(self.out, self.times) if self.options.resume else RowsThere()

    def write(
        self, drive: Iterator[EpochEstimate], quiet: bool, draw: Callable[[EpochEstimate], None] | None = None
    ) -> None:
        """Write the row of each epoch once it is localized, and draw it."""
        n_epochs = len(self.times)
        with GrowingTable(self.out, self.there) as table:
            try:
                with step_bars(quiet) as report, compiling_told(quiet):
                    for epoch in drive:
                        table.add(epoch)
                        if draw is not None:
                            draw(epoch)
                        self.epochs.append(epoch.without_points())
                        report("localizing", self.there.n_rows + len(self.epochs), n_epochs)
            except (MaxconError, Stop) as error:
                kept = f"{table.n_rows} of {n_epochs} epochs are kept in {self.out}: go on with --resume"
                if isinstance(error, Stop):
                    error.is_told = True
                    typer.echo(f"maxcon: stopped; {kept if table.n_rows else 'nothing was written'}", err=True)
                elif table.n_rows:
                    raise type(error)(f"{error} {kept}.") from error
                raise
            if table.n_rows == 0:
                raise FileError(self.epochs[0].reason)

    def end(self) -> None:
        """Print the facts, if asked; exit with 1 unless all epochs are localized, of a track from the first that is."""
        if self.options.is_json:
            print_json(self.facts)
        are_localized = [epoch.pose_global is not None for epoch in self.epochs]
        if self.is_track and any(are_localized):
            is_whole = all(are_localized[are_localized.index(True) :])
        else:
            is_whole = self.there.n_localized + sum(are_localized) == len(self.times)
        if not is_whole:
            raise typer.Exit(1)

    def write_tum(self) -> None:
        """Write the poses of all epochs, also of those that were there, as TUM, if asked; say where there are none."""
        tum = self.options.tum
        if tum is None:
            return
        if self.there.n_rows == 0:
            trajectory = localized_trajectory(self.epochs)
        else:
            is_any = self.there.n_localized or any(epoch.pose_global is not None for epoch in self.epochs)
            trajectory = read_trajectory(self.out) if is_any else None
        if trajectory is None:
            self.say(f"no pose to write: {tum} is not written")
        else:
            write_tum(tum, trajectory, "T_map_sensor, localized by maxcon")
            self.say(tum=str(tum))

    def print_summary(self, map_: Path | str, searched: str, left_out: tuple[str, ...] = ()) -> None:
        """Say how many epochs are localized, in which time and searched where, and why the others are not."""
        there, epochs, say = self.there, self.epochs, self.say
        n_localized = sum(epoch.pose_global is not None for epoch in epochs)
        say(
            poses=str(self.out), epochs=len(epochs), localized=n_localized, epochs_before=there.n_rows,
            localized_before=there.n_localized,
        )  # fmt: skip
        if there.n_rows and not epochs:
            say(
                f"all {there.n_rows} epochs were in {self.out} already, {there.n_localized} of them localized."
                " Nothing was done: inputs and options of this call had no effect; --overwrite makes the table"
                " anew with them"
            )
            return
        taken = [epoch.milliseconds for epoch in epochs if epoch.estimate is not None]
        milliseconds = median(taken) if taken else None
        time = f", median {milliseconds:.0f} ms" if taken else ""
        say(f"{n_localized} of {len(epochs)} epochs localized{time}; written to {self.out}", median_ms=milliseconds)
        if there.n_rows:
            say(
                f"behind {there.n_rows} that were there, {there.n_localized} of them localized, with inputs and"
                " options of their own call"
            )
        first = next((number for number, epoch in enumerate(epochs) if epoch.pose_global is not None), 0)
        if self.is_track and first:
            begin = epochs[first].epoch
            say(f"the track begins with epoch {begin}: before, its place was not known", track_begins=begin)
        if left_out:
            words = f"{len(left_out)} rows of the prior are left out; the first: {left_out[0]}"
            say(words, prior_rows_left_out=len(left_out))
        assumed = assumed_words(read_manifest(map_))
        say(searched, assumed, searched=searched, assumed=assumed)
        n_invalid = sum(epoch.raw.n_dropped_invalid for epoch in epochs)
        n_out_of_range = sum(epoch.raw.n_dropped_range for epoch in epochs)
        n_repeated = sum(epoch.raw.n_dropped_duplicates for epoch in epochs)
        repeated = f", {n_repeated:,} that come twice" if n_repeated else ""
        words = f"left out: {n_invalid:,} points that are no returns, {n_out_of_range:,} out of range{repeated}"
        counts = {"no_returns": n_invalid, "out_of_range": n_out_of_range, "repeated": n_repeated}
        say(words if any(counts.values()) else "", points_left_out=counts)
        widened = [epoch.epoch for epoch in epochs if epoch.estimate is not None and epoch.estimate.was_widened]
        n = len(widened)
        named = f"epoch{'s' * (n > 1)} {', '.join(map(str, widened[:5]))}{', ...' if n > 5 else ''}"
        words = f"{n} {'was' if n == 1 else 'were'} in doubt and searched for farther around: {named}"
        say(words if n else "", widened=widened)
        others = sorted(Counter(epoch.status for epoch in epochs if epoch.pose_global is None).items())
        explained = {status.value: {"epochs": number, "explanation": status.explanation} for status, number in others}
        say(*(f"{number} {status.value}: {status.explanation}" for status, number in others), not_localized=explained)
        reasons = {epoch.epoch: epoch.reason for epoch in epochs if epoch.reason}
        for number, reason in list(reasons.items())[:1]:
            say(f"{len(reasons)} have a reason beside them; the first, epoch {number}: {reason}")
        say(reasons=reasons)


def searched_words(drive: OpenedDrive, epochs: list[EpochEstimate]) -> str:
    """Return which spaces of standard deviations were searched, in a line, or that those of the prior were not."""
    given, windows = drive.opener.space, drive.windows
    if windows is None:
        options = (
            ("--half-width", given.half_width), ("--heading-half-width-deg", given.heading_half_width_deg),
            ("--sigma-position", given.sigma_position),
        )  # fmt: skip
        instead = next((name for name, value in options if value is not None), "--track")
        return "" if drive.prior.trajectory.covariances is None else f"the prior's covariances are not used: {instead}"
    times = [epoch.raw.time for epoch in epochs if epoch.estimate is not None]
    covariances = [windows.prior.covariance_at(time, windows.max_gap) for time in times]
    known = [covariance for covariance in covariances if covariance is not None]
    source = "the prior's covariances" if given.sigma_position is None else "--sigma-position"
    if not known:
        return f"windows from {source}: none"
    found = [windows.space(covariance) for covariance in known]
    offsets = _range([space.half_width for space in found], "m")
    turns = _range([space.heading_half_width_deg for space in found], "degrees")
    n_cut = sum(windows.reach(covariance) > windows.largest_half_width for covariance in known)
    cut = f"; {n_cut} of them cut at {windows.largest_half_width:g} m" if n_cut else ""
    others = f"; {len(times) - len(known)} epochs without" if len(known) < len(times) else ""
    return f"windows from {source}: half width {offsets}, {turns}{cut}{others}"


def _range(values: list[float], unit: str) -> str:
    low, high = f"{min(values):.1f}", f"{max(values):.1f}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def report_drive(
    page: Path | None, table: TableOfDrive, drive: OpenedDrive, reference: Trajectory | None, assumed: dict[str, str]
) -> None:
    """Say how far all rows of its table are from a reference, and write the page of a drive, where there is one."""
    prior, entry = drive.prior.trajectory, drive.entry
    facts = {
        "Map": f"{entry.map}, voxels of {drive.point_map.cell:g} m; CRS: {crs_name(drive.point_map.frame.crs)}",
        "Scans": f"{entry.scans}",
        "Sigma of the map": sigma_words(read_manifest(entry.map)),
        "Rough poses": f"{drive.opener.recording.at or entry.prior or entry.scans}",
        **assumed,
    }  # fmt: skip
    reported = ReportedDrive(read_rows(table.out), drive.point_map, drive.scans, drive.opener.drive, prior, reference)
    if reference is not None:
        _say_accuracy(reported.accuracy(), table)
    if page is not None:
        write_drive_page(page, reported, f"{entry.scans.name} in {Path(entry.map).name}", facts)
        table.say(f"a page of it: {page}", report=str(page))


def _say_accuracy(found: dict[str, Any], table: TableOfDrive) -> None:
    rows = found.pop("rows") if found["n"] else []
    errors = [{**row, "of": asdict(row["of"]), "within": [*filter(math.isfinite, row["within"])]} for row in rows]
    table.say(accuracy={**found, "rows": errors})
    if not rows:
        table.say("from the reference: no localized scan has a pose there; are its times those of the scans?")
        return
    table.say(
        f"from the reference: {found['n']} localized scans, {found['n_wrong']} farther than {SUCCESS_WORDS}; protection"
        f" level exceeded in {found['n_beyond']} of {found['n_levels']}"
    )
    for row in rows:
        of, unit = row["of"], "degrees" if row["unit"] == "°" else row["unit"]
        shares, promised = (" ".join(f"{100.0 * one:.0f}" for one in each) for each in (row["within"], PROMISED))
        within = f"; within 1, 2, 3 sigma {shares} % (promised {promised})" if shares else ""
        table.say(f"  {row['name']:<8} median {of.median:.3f}, 95 % {of.p95:.3f}, worst {of.worst:.3f} {unit}{within}")


def say_alternative(drive: OpenedDrive, table: TableOfDrive) -> None:
    """Say how high the prior lies above the ground, and what it or scans would have to mean to fit better."""
    priors = np.array([epoch.prior.position for epoch in table.epochs if epoch.prior is not None]).reshape(-1, 3)
    fits = alternative_that_fits(
        drive.point_map, drive.scans, table.epochs, drive.searching, drive.opener.drive,
        has_angles=drive.entry.prior is not None and drive.entry.prior.suffix.lower() == ".csv",
    )  # fmt: skip
    height = heights_in_words(above_ground(drive.point_map, priors))
    table.say(height, fits, height_of_prior=height, alternative=fits)


def printed(drive: Iterator[EpochEstimate]) -> Iterator[EpochEstimate]:
    """Print a line for each epoch once it is done."""
    for epoch in drive:
        pose = epoch.pose_global
        words = epoch.reason or epoch.status.explanation
        if pose is not None:
            words = f"x {pose.x:.3f} y {pose.y:.3f} z {pose.z:.3f} m, heading {math.degrees(pose.heading):.2f} degrees"
        typer.echo(f"{epoch.raw.name}: {epoch.status.value}{'; ' if words else ''}{words}")
        yield epoch.without_points()


def localize_many(
    drives: Path, map_folder: Path | None, out: Path, opener: DriveOpener, engine: Engine, quiet: bool
) -> None:
    """Localize a table of drives into a dataset; MaxconError if a drive cannot be localized, when the others are."""
    entries = read_drives(drives, map_folder)
    with step_bars(quiet) as report:
        done = localize_drives(entries, ManyDrivesJob(opener), out, engine, report)
    old = f", {done.n_epochs - done.n_new} of them were there" if done.n_epochs > done.n_new else ""
    typer.echo(f"{done.n_localized:,} of {done.n_epochs:,} epochs of {done.n_drives:,} drives localized{old}; in {out}")
    if done.refused:
        name, reason = next(iter(done.refused.items()))
        raise MaxconError(
            f"Expected drives that can be localized, but {len(done.refused)} of {len(entries)} cannot; the first,"
            f" {name}: {reason}"
        )
    if done.n_localized < done.n_epochs:
        raise typer.Exit(1)
