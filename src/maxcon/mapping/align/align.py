# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rounds of a campaign brought together: read this page first."""

import math
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from glob import escape
from pathlib import Path
from typing import TypeVar

import numpy as np

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.progress import Progress
from maxcon.errors import FileError, MapError, OptionError
from maxcon.io.clouds import CloudHeader
from maxcon.io.trajectories import read_trajectory
from maxcon.mapping.align.alignment import Alignment
from maxcon.mapping.align.corrected_files import (
    corrected_name,
    corrected_trajectory,
    write_corrected_cloud,
    write_trajectory,
)
from maxcon.mapping.align.corrections import Corrections
from maxcon.mapping.align.matching import Tie, match_visits
from maxcon.mapping.align.options import AlignmentOptions
from maxcon.mapping.align.places import PLACE_EDGE, PlaceKey, Places
from maxcon.mapping.align.pose_graph import adjust_by_evidence
from maxcon.mapping.align.residuals import remaining_sigma
from maxcon.mapping.align.rounds import Rounds, read_rounds, survey
from maxcon.mapping.align.tables import TABLES, files_there, write_tables
from maxcon.mapping.align.tied import datum_sigma, tied_rounds
from maxcon.mapping.align.visits import load_visits, save_visits, visits_of
from maxcon.mapping.build.sources import common_crs, open_headers

__all__ = ["align", "align_files"]

MOST_THREADS = 4
"""By default; each thread holds the points of a place, some 0.4 GiB."""
N_MATCHINGS = 2
"""How often all visits are matched: from corrected poses more points find a partner."""

Given = TypeVar("Given")
Made = TypeVar("Made")


def align(
    headers: Sequence[CloudHeader], options: AlignmentOptions, folder: Path, *, n_threads: int, report: Progress
) -> Alignment:
    """Find the corrections that bring the rounds of some clouds together.

    Parameters
    ----------
    headers : sequence of CloudHeader
        LAS or LAZ files.
    options : AlignmentOptions
        Options of the alignment.
    folder : Path
        An empty folder for intermediate files; it is empty afterwards.
    n_threads : int
        Places worked on at the same time; what is found does not depend on it.
    report : callable
        Called with (step, done, of how many).

    Raises
    ------
    MapError
        If no two visits to any place could be tied.
    """
    rounds = survey(headers, options.rounds_by, options.pause, report)
    corrections = Corrections.none(rounds, options.knot_spacing)
    places = _sort_into_places(headers, rounds, options, folder, report)
    keys = _gather_visits(places, folder, n_threads, report)

    drift_sigma = options.drift_sigma
    if drift_sigma is None and all(each.end - each.start <= options.knot_spacing for each in rounds.rounds):
        drift_sigma = 0.0  # also of rounds without times
    for _ in range(N_MATCHINGS):
        matched = _match(keys, places, folder, corrections, n_threads, report)
        ties = tuple(tie for tie in matched if not tie.fault)
        if not ties:
            raise _nothing_tied(rounds, matched)
        adjusted = adjust_by_evidence(corrections, ties, options.georeference, drift_sigma)
        corrections = adjusted.corrections
    for key in keys:
        _visits_path(folder, key).unlink()

    tied = tuple(tied_rounds(rounds, ties, adjusted, options.georeference))
    sigma_of_round = remaining_sigma(ties, adjusted, is_after=True)
    n_tied = sum(each.group == 0 for each in tied)
    sigma_of_map = math.hypot(sigma_of_round, adjusted.drift_sigma) / math.sqrt(n_tied)
    return Alignment(
        rounds, ties, Counter(tie.fault for tie in matched if tie.fault), adjusted, tied,
        remaining_sigma(ties, adjusted, is_after=False), sigma_of_round, sigma_of_map,
        datum_sigma(rounds, adjusted),
    )  # fmt: skip


def align_files(
    clouds: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    options: AlignmentOptions | None = None,
    *,
    trajectories: Sequence[str | os.PathLike[str]] = (),
    overwrite: bool = False,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Alignment:
    """Bring the rounds of some clouds together, and write corrected clouds, trajectories and tables.

    Parameters
    ----------
    clouds : sequence of path
        LAS or LAZ files, in any number of tiles.
    out : path
        Folder to write; it appears when all is done.
    options : AlignmentOptions, optional
        Options of the alignment; the defaults if None.
    trajectories : sequence of path
        Trajectories of the mapping sensor, TUM or CSV, on the clock of the points: corrected like these.
    overwrite : bool
        Whether an alignment that stands there is replaced; anything else there is an error.
    n_threads : int, optional
        Places worked on at the same time; the number of processors, but at most 4, if None.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Alignment

    Raises
    ------
    FileError, CrsError, OptionError, TrajectoryError, MapError
        If an input or an option cannot be used, nothing can be tied, or `out` cannot be written.
    """
    options = options or AlignmentOptions()
    report = progress or (lambda step, done, total: None)
    headers = open_headers(clouds)
    common_crs(headers, options.crs)
    _check_apart([header.path for header in headers] + [Path(path) for path in trajectories], Path(out))
    names = _distinct([corrected_name(header.path) for header in headers], "clouds")
    trajectory_names = _distinct([Path(path).name for path in trajectories], "trajectories")
    read = [read_trajectory(path) for path in trajectories]
    if overwrite:
        check_replaceable(out, "an alignment", [escape(name) for name in files_there(out)])
    with atomic_folder(out, overwrite=overwrite) as folder:
        with tempfile.TemporaryDirectory(dir=folder) as between:
            threads = n_threads or min(MOST_THREADS, os.cpu_count() or 1)
            found = align(headers, options, Path(between), n_threads=threads, report=report)
        if read and not found.rounds.are_apart:
            raise OptionError(
                "Expected rounds one after the other, to know which a pose of the trajectory belongs to, got rounds"
                " at the same time. Leave out --trajectory, or say --rounds time."
            )
        corrections = found.adjusted.corrections
        n_total, n_done = sum(header.n_points for header in headers), 0

        def tick(n_points: int) -> None:
            nonlocal n_done
            n_done += n_points
            report("writing clouds", n_done, n_total)

        for number, (header, name) in enumerate(zip(headers, names, strict=True)):
            write_corrected_cloud(header, number, found.rounds, corrections, folder / name, tick)
        for trajectory, name in zip(read, trajectory_names, strict=True):
            write_trajectory(folder / name, corrected_trajectory(trajectory, found.rounds, corrections))
        write_tables(folder, found, options, [*names, *trajectory_names])
    return found


def _check_apart(inputs: Sequence[Path], out: Path) -> None:
    """Refuse to write where an input lies: none is ever overwritten."""
    for path in inputs:
        if path.resolve().parent == out.resolve():
            raise FileError(
                f"Expected a folder without what is to be aligned, got {out} with {path.name}. Name another folder."
            )


def _distinct(names: list[str], what: str) -> list[str]:
    """Refuse outputs of the same name, or with the name of a table."""
    for name, number in Counter(names).items():
        if number > 1 or name in TABLES:
            raise FileError(
                f"Expected {what} with names that differ, got {name} twice, with those of the tables. Rename one."
            )
    return names


def _sort_into_places(
    headers: Sequence[CloudHeader], rounds: Rounds, options: AlignmentOptions, folder: Path, report: Progress
) -> Places:
    """Read all clouds into places, without the classes that are not matched."""
    places = Places(folder, np.floor(rounds.rounds[0].centre))
    drop = np.array(sorted(options.dropped_classes()))
    n_total, n_done = sum(header.n_points for header in headers), 0
    for file, header in enumerate(headers):
        for part in read_rounds(header):
            is_kept = ~np.isin(part.classes, drop) & ~part.is_withheld
            numbers = rounds.of_points(part.times, part.source_ids, file)
            places.add(part.points[is_kept], part.times[is_kept], numbers[is_kept])
            n_done += len(numbers)
            report("sorting points", n_done, n_total)
    places.complete()
    return places


def _gather_visits(places: Places, folder: Path, n_threads: int, report: Progress) -> list[PlaceKey]:
    """Thin the points of each place to visits; return the places that have two or more."""

    def gather(key: PlaceKey) -> PlaceKey | None:
        visits = visits_of(places.points(key), PLACE_EDGE)
        if len(visits) > 1:
            save_visits(_visits_path(folder, key), visits)
        return key if len(visits) > 1 else None

    gathered = _in_threads(gather, places.keys, n_threads, "thinning", report)
    for key in places.keys:
        places.remove(key)
    return [key for key in gathered if key is not None]


def _match(
    keys: Sequence[PlaceKey], places: Places, folder: Path, corrections: Corrections, n_threads: int, report: Progress
) -> list[Tie]:
    """Match the visits to each place, from where the corrections put them."""

    def match(key: PlaceKey) -> list[Tie]:
        return match_visits(places.middle(key), load_visits(_visits_path(folder, key)), corrections)

    found = _in_threads(match, keys, n_threads, "matching", report)
    return [tie for ties in found for tie in ties]


def _in_threads(
    work: Callable[[Given], Made], given: Sequence[Given], n_threads: int, step: str, report: Progress
) -> list[Made]:
    """Call a function with each item, several at a time; return its results in the order of the items."""
    made = []
    with ThreadPoolExecutor(n_threads) as pool:
        try:
            for one in pool.map(work, given):
                made.append(one)
                report(step, len(made), len(given))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return made


def _visits_path(folder: Path, key: PlaceKey) -> Path:
    return folder / f"{key[0]}_{key[1]}.npz"


def _nothing_tied(rounds: Rounds, matched: Sequence[Tie]) -> MapError:
    if len(rounds) == 1 and not matched:
        return MapError(
            "Expected several rounds, or one that comes by the same places again, got one pass only: there is nothing"
            " to align. --pause, --rounds source and --rounds file tell rounds apart otherwise."
        )
    why = Counter(tie.fault for tie in matched).most_common(1)
    got = f"{len(matched)} matched pairs, and of most {why[0][0]}" if why else "no place that two of them saw enough of"
    return MapError(
        f"Expected places that {len(rounds)} rounds can be matched at, got {got}. Do they overlap, in one CRS, and are"
        " they within 0.6 m of each other?"
    )
