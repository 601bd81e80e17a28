# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Alignment of the passes of a mapping campaign: read this page first."""

import math
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import TypeVar

import numpy as np

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.progress import Progress
from maxcon.errors import FileError, MapError, OptionError
from maxcon.io.clouds import CloudHeader
from maxcon.io.trajectories import read_trajectory
from maxcon.map import TileKey
from maxcon.mapping.align.alignment import Alignment
from maxcon.mapping.align.corrections import Corrections
from maxcon.mapping.align.output import (
    TABLES,
    corrected_name,
    files_there,
    write_corrected_cloud,
    write_corrected_trajectory,
    write_tables,
)
from maxcon.mapping.align.passes import Passes, read_passes, survey
from maxcon.mapping.align.pose_graph import Georeference, adjust_by_evidence
from maxcon.mapping.align.visits import Constraint, Places, Visit, match_visits, visits_of
from maxcon.mapping.build.options import parse_classes
from maxcon.mapping.build.sources import common_crs, open_headers
from maxcon.mapping.build.tile_points import TileArrays

DEFAULT_DROP = ("vegetation", "noise", "temporal-exclusion")
"""Classes without a firm surface, or that change from pass to pass. Ground determines height, roll and pitch."""
MOST_THREADS = 4
"""By default; each thread holds the points of a place, some 0.4 GiB."""
N_MATCHINGS = 2
"""How often all visits are matched: from corrected poses more points find a partner."""

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class AlignmentOptions:
    """How passes are aligned; OptionError if a number is out of range.

    Parameters
    ----------
    passes_by : str
        What tells passes apart: "time", by pauses in gps_time; "source", by point source ids; "file".
    pause : float
        Seconds without a point that separate two passes, where times tell passes apart.
    georeference_sigma : float
        How well each pass is georeferenced: standard deviation of its position along any axis, m.
    georeference_sigma_deg : float
        The same of its roll, pitch and heading, degrees.
    drift_sigma : float or None
        Standard deviation, m, of how a pass's errors change within it, along any axis; 0 for rigid passes, None to let
        the matches decide.
    knot_spacing : float
        Largest time between two knots of a pass that drifts, s; corrections are interpolated between knots.
    drop : sequence of str, optional
        Classes that are not matched (they are moved like all others); vegetation, noise, temporal exclusion if None.
    vehicle_classes : iterable of int
        Class numbers that mean vehicles: not matched either.
    crs : str, optional
        CRS of clouds that name none.
    """

    passes_by: str = "time"
    pause: float = 20.0
    georeference_sigma: float = 0.1
    georeference_sigma_deg: float = 0.05
    drift_sigma: float | None = None
    knot_spacing: float = 10.0
    drop: Sequence[str] | None = None
    vehicle_classes: Iterable[int] = ()
    crs: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle_classes", tuple(self.vehicle_classes))
        for name in ("pause", "georeference_sigma", "georeference_sigma_deg"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise OptionError(f"Expected `{name}` above 0, got {value}.")
        if not 1.0 <= self.knot_spacing < math.inf:
            raise OptionError(f"Expected `knot_spacing` of 1 s or more, got {self.knot_spacing}. The default is 10.")
        if self.drift_sigma is not None and not 0.0 <= self.drift_sigma < math.inf:
            raise OptionError(f"Expected `drift_sigma` of 0 m or more, got {self.drift_sigma}. 0 is for rigid passes.")

    @property
    def georeference(self) -> Georeference:
        """The prior of each pass."""
        return Georeference(self.georeference_sigma, math.radians(self.georeference_sigma_deg))

    def dropped_classes(self) -> frozenset[int]:
        """Class numbers that are not matched."""
        return parse_classes(DEFAULT_DROP if self.drop is None else self.drop, self.vehicle_classes)


def align(
    headers: Sequence[CloudHeader], options: AlignmentOptions, folder: Path, *, n_threads: int, report: Progress
) -> Alignment:
    """Find the corrections that bring the passes of some clouds together.

    MapError if no two visits to any place could be matched.

    `n_threads`: places worked on at the same time; the outcome does not depend on it.
    """
    passes = survey(headers, options.passes_by, options.pause, report)
    corrections = Corrections.none(passes, options.knot_spacing)
    places = _sort_into_places(headers, passes, options, folder, report)
    visits = TileArrays(folder)
    keys = _gather_visits(places, visits, n_threads, report)

    def match(key: TileKey) -> list[Constraint]:
        """Match the visits to a place, from where the corrections put them."""
        return match_visits(places.middle(key), Visit.from_arrays(visits.get(key, "visits")), corrections)

    drift_sigma = options.drift_sigma
    if drift_sigma is None and all(each.end - each.start <= options.knot_spacing for each in passes):
        drift_sigma = 0.0  # also of passes without times
    for _ in range(N_MATCHINGS):
        found = _in_threads(match, keys, n_threads, "matching", report)
        matched = [constraint for constraints in found for constraint in constraints]
        constraints = [constraint for constraint in matched if not constraint.fault]
        if not constraints:
            raise _nothing_matched(passes, matched)
        adjusted = adjust_by_evidence(corrections, constraints, options.georeference, drift_sigma)
        corrections = adjusted.corrections
    return Alignment.of(passes, matched, adjusted, options.georeference)


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
    """Bring the passes of some clouds together, and write corrected clouds, trajectories and tables.

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
        Whether an alignment that is there is replaced; anything else there is an error.
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
        If an input or an option cannot be used, nothing can be matched, or `out` cannot be written.
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
        if read and not found.passes.are_apart:
            raise OptionError(
                "Expected passes one after the other, to know which a pose of the trajectory belongs to, got passes"
                " at the same time. Leave out --trajectory, or say --rounds time."
            )
        corrections = found.adjusted.corrections
        n_total, n_done = sum(header.n_points for header in headers), 0

        def tick(n_points: int) -> None:
            nonlocal n_done
            n_done += n_points
            report("writing clouds", n_done, n_total)

        for number, (header, name) in enumerate(zip(headers, names, strict=True)):
            write_corrected_cloud(header, number, found.passes, corrections, folder / name, tick)
        for trajectory, name in zip(read, trajectory_names, strict=True):
            write_corrected_trajectory(folder / name, trajectory, found.passes, corrections)
        summary: dict[str, object] = {
            "rounds_by": options.passes_by,
            "georeference_sigma": options.georeference_sigma,
            "georeference_sigma_deg": options.georeference_sigma_deg,
            "drift_sigma": found.adjusted.drift_sigma,
            "drift_from": "the ties" if options.drift_sigma is None else "given",
        }
        write_tables(folder, found, summary, [*names, *trajectory_names])
    return found


def _check_apart(inputs: Sequence[Path], out: Path) -> None:
    """Refuse to write into the folder of an input: none is ever overwritten."""
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
    headers: Sequence[CloudHeader], passes: Passes, options: AlignmentOptions, folder: Path, report: Progress
) -> Places:
    """Read all clouds into places, without the classes that are not matched."""
    places = Places(folder, np.floor(passes.passes[0].centre))
    drop = np.array(sorted(options.dropped_classes()))
    n_total, n_done = sum(header.n_points for header in headers), 0
    for file, header in enumerate(headers):
        for part in read_passes(header):
            is_kept = ~np.isin(part.classes, drop) & ~part.is_withheld
            numbers = passes.of_points(part.times, part.source_ids, file)
            places.add(part.points[is_kept], part.times[is_kept], numbers[is_kept])
            n_done += len(numbers)
            report("sorting points", n_done, n_total)
    places.buckets.complete()
    return places


def _gather_visits(places: Places, visits: TileArrays, n_threads: int, report: Progress) -> list[TileKey]:
    """Thin the points of each place to visits; return the places that have two or more."""

    def gather(key: TileKey) -> TileKey | None:
        found = visits_of(places.points(key))
        places.buckets.remove(key)
        if len(found) < 2:
            return None
        visits.put(key, "visits", **Visit.to_arrays(found))
        return key

    gathered = _in_threads(gather, places.buckets.keys, n_threads, "thinning", report)
    return [key for key in gathered if key is not None]


def _in_threads(
    work: Callable[[ItemT], ResultT], items: Sequence[ItemT], n_threads: int, step: str, report: Progress
) -> list[ResultT]:
    """Call a function with each item, several at a time; return its results in the order of the items."""
    results = []
    with ThreadPoolExecutor(n_threads) as pool:
        try:
            for result in pool.map(work, items):
                results.append(result)
                report(step, len(results), len(items))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return results


def _nothing_matched(passes: Passes, matched: Sequence[Constraint]) -> MapError:
    if len(passes) == 1 and not matched:
        return MapError(
            "Expected several passes, or one that comes by the same places again, got one pass only: there is nothing"
            " to align. --pause, --rounds source and --rounds file tell passes apart otherwise."
        )
    why = Counter(each.fault for each in matched).most_common(1)
    got = f"{len(matched)} matched pairs, and of most {why[0][0]}" if why else "no place that two of them saw enough of"
    return MapError(
        f"Expected places that {len(passes)} passes can be matched at, got {got}. Do they overlap, in one CRS, and are"
        " they within 0.6 m of each other?"
    )
