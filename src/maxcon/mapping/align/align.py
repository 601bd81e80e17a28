"""Alignment of the passes of a mapping campaign: read this page first."""

import math
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from glob import escape
from itertools import chain, compress
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.engine import in_threads
from maxcon.errors import FileError, MapError, OptionError
from maxcon.io.clouds import CloudHeader
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.trajectories import read_trajectory, write_csv, write_tum
from maxcon.map import TileKey
from maxcon.mapping.align.alignment import TABLES, Alignment, files_there, write_tables
from maxcon.mapping.align.passes import Corrections, Passes, read_passes, survey
from maxcon.mapping.align.pose_graph import adjust_by_evidence
from maxcon.mapping.align.visits import Constraint, Places, Visit, match_visits, visits_of
from maxcon.mapping.build.options import parse_classes
from maxcon.mapping.build.sources import common_crs, open_headers
from maxcon.mapping.build.tile_points import TileArrays
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    import laspy
    from laspy.vlrs.vlrlist import VLRList

# Classes without a firm surface, or that change from pass to pass. Ground determines height, roll and pitch.
DEFAULT_DROP = ("vegetation", "noise", "temporal-exclusion")
MOST_THREADS = 4  # by default; each thread holds the points of a place, some 0.4 GiB
N_MATCHINGS = 2  # how often all visits are matched: from corrected poses more points find a partner

ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class AlignmentOptions:
    """How passes are aligned; OptionError if a number is out of range."""

    passes_by: str = "time"  # what tells passes apart: pauses in gps_time; "source": point source ids; "file"
    pause: float = 20.0  # s without a point that separate two passes, where times tell passes apart
    georeference_sigma: float = 0.1  # of each pass's position along any axis, before, m
    georeference_sigma_deg: float = 0.05  # the same of its roll, pitch and heading, degrees
    drift_sigma: float | None = None  # of how a pass's errors change within it, m; 0: rigid; None: the matches decide
    knot_spacing: float = 10.0  # s, largest between two knots of a pass; corrections are interpolated between them
    drop: Sequence[str] | None = None  # classes that are not matched, only moved; `DEFAULT_DROP` if None
    vehicle_classes: Iterable[int] = ()  # numbers of classes that mean vehicles: not matched either
    crs: str | None = None  # of clouds that name none

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle_classes", tuple(self.vehicle_classes))
        above_0 = self.pause, self.georeference_sigma, self.georeference_sigma_deg
        others = self.knot_spacing - 1.0, self.drift_sigma or 0.0
        if not (min(above_0) > 0.0 <= min(others) and all(map(math.isfinite, above_0 + others))):
            raise OptionError(
                "Expected `pause`, `georeference_sigma` and `georeference_sigma_deg` above 0, `knot_spacing` of 1 s or"
                f" more and `drift_sigma` of 0 m or more, got {above_0}, {self.knot_spacing} and {self.drift_sigma}."
            )

    @property
    def prior_sigmas(self) -> NDArray[np.float64]:
        """Standard deviations of the twist of each pass a priori, shape (6,), m and rad."""
        return np.repeat([self.georeference_sigma, math.radians(self.georeference_sigma_deg)], 3)

    def dropped_classes(self) -> frozenset[int]:
        """Class numbers that are not matched."""
        return parse_classes(DEFAULT_DROP if self.drop is None else self.drop, self.vehicle_classes)


def align(
    headers: Sequence[CloudHeader], options: AlignmentOptions, folder: Path, *, n_threads: int, report: Progress
) -> Alignment:
    """Find the corrections that bring the passes of some clouds together; MapError if no two visits match anywhere."""
    passes = survey(headers, options.passes_by, options.pause, report)
    corrections = Corrections.none(passes, options.knot_spacing)
    places, visits = _sort_into_places(headers, passes, options, folder, report), TileArrays(folder)

    def gather(key: TileKey) -> bool:
        """Thin the points of a place to visits; return whether there are two or more."""
        found = visits_of(places.points(key))
        places.buckets.remove(key)
        if len(found) > 1:
            visits.put(key, "visits", **Visit.to_arrays(found))
        return len(found) > 1

    def match(key: TileKey) -> list[Constraint]:
        """Match the visits to a place, from where the corrections put them."""
        return match_visits(places.middle(key), Visit.from_arrays(visits.get(key, "visits")), corrections)

    def at_places(work: Callable[[TileKey], ResultT], keys: Sequence[TileKey], step: str) -> list[ResultT]:
        """Do the work at each place, several at a time; return the results in the order of the places."""
        results = []
        for result in in_threads(work, keys, n_threads):
            results.append(result)
            report(step, len(results), len(keys))
        return results

    keys = places.buckets.keys
    keys = list(compress(keys, at_places(gather, keys, "thinning")))
    drift_sigma = options.drift_sigma
    if drift_sigma is None and all(each.end - each.start <= options.knot_spacing for each in passes):
        drift_sigma = 0.0  # also of passes without times
    for _ in range(N_MATCHINGS):
        matched = list(chain.from_iterable(at_places(match, keys, "matching")))
        constraints = [constraint for constraint in matched if not constraint.fault]
        if not constraints:
            raise _nothing_matched(passes, matched)
        adjusted = adjust_by_evidence(corrections, constraints, options.prior_sigmas, drift_sigma)
        corrections = adjusted.corrections
    return Alignment.of(passes, matched, adjusted, options.prior_sigmas)


def align_files(
    clouds: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], options: AlignmentOptions | None = None, *,
    trajectories: Sequence[str | os.PathLike[str]] = (), overwrite: bool = False, n_threads: int | None = None,
    progress: Progress | None = None,
) -> Alignment:  # fmt: skip
    """Bring the passes of LAS or LAZ clouds together; write corrected clouds, trajectories and tables into a folder.

    `trajectories` of the mapping sensor, on the clock of the points, are corrected like these; `n_threads` places are
    worked on at the same time, at most 4 if None, and do not change the outcome.
    """
    options = options or AlignmentOptions()
    report = progress or (lambda step, done, total: None)
    headers = open_headers(clouds)
    common_crs(headers, options.crs)
    inputs = [header.path for header in headers] + [Path(path) for path in trajectories]
    names = [corrected_name(header.path) for header in headers] + [path.name for path in inputs[len(headers) :]]
    _check_names(inputs, names, Path(out))
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
                " at the same time. Leave out --trajectory, or say --passes time."
            )
        corrections = found.adjusted.corrections
        n_total, n_done = sum(header.n_points for header in headers), 0

        def tick(n_points: int) -> None:
            nonlocal n_done
            n_done += n_points
            report("writing clouds", n_done, n_total)

        outputs = [folder / name for name in names]
        for number, (header, path) in enumerate(zip(headers, outputs, strict=False)):
            write_corrected_cloud(header, number, found.passes, corrections, path, tick)
        for trajectory, path in zip(read, outputs[len(headers) :], strict=True):
            write_corrected_trajectory(path, trajectory, found.passes, corrections)
        summary: dict[str, object] = {
            "passes_by": options.passes_by, "georeference_sigma": options.georeference_sigma,
            "georeference_sigma_deg": options.georeference_sigma_deg, "drift_sigma": found.adjusted.drift_sigma,
            "drift_from": "the ties" if options.drift_sigma is None else "given",
        }  # fmt: skip
        write_tables(folder, found, summary, names)
    return found


def _check_names(inputs: Sequence[Path], names: Sequence[str], out: Path) -> None:
    """Refuse outputs beside an input, as none is ever overwritten, and those of the same name, or a table's."""
    if beside := [path.name for path in inputs if path.resolve().parent == out.resolve()]:
        raise FileError(f"Expected a folder without what is to be aligned, got {out} with {beside[0]}. Name another.")
    if twice := [name for name, number in Counter([*names, *TABLES]).items() if number > 1]:
        raise FileError(f"Expected files with names that differ, got {twice[0]} twice, with the tables. Rename one.")


def _sort_into_places(
    headers: Sequence[CloudHeader], passes: Passes, options: AlignmentOptions, folder: Path, report: Progress
) -> Places:
    """Read all clouds into places, without the classes that are not matched."""
    places = Places(folder, np.floor(passes.passes[0].centre))
    drop = np.array(sorted(options.dropped_classes()))
    n_total, n_done = sum(header.n_points for header in headers), 0
    for file, header in enumerate(headers):
        for part in read_passes(header):
            classes, is_withheld = np.array(part.record["classification"]), np.array(part.record["withheld"], bool)
            is_kept = ~np.isin(classes, drop) & ~is_withheld
            numbers = passes.of_points(part.times, part.source_ids, file)
            places.add(part.points[is_kept], part.times[is_kept], numbers[is_kept])
            n_done += len(numbers)
            report("sorting points", n_done, n_total)
    places.buckets.complete()
    return places


def _nothing_matched(passes: Passes, matched: Sequence[Constraint]) -> MapError:
    if len(passes) == 1 and not matched:
        return MapError(
            "Expected several passes, or one that comes by the same places again, got one pass only: there is nothing"
            " to align. --pause, --passes source and --passes file tell passes apart otherwise."
        )
    why = Counter(each.fault for each in matched).most_common(1)
    got = f"{len(matched)} matched pairs, and of most {why[0][0]}" if why else "no place that two of them saw enough of"
    return MapError(
        f"Expected places that {len(passes)} passes can be matched at, got {got}. Do they overlap, in one CRS, and are"
        " they within 0.6 m of each other?"
    )


def corrected_name(path: Path) -> str:
    """Name of the corrected file of a cloud: plain LAZ, as a COPC orders its points by their coordinates."""
    stem = path.name[: -len(path.suffix)]
    return (stem[: -len(".copc")] if stem.lower().endswith(".copc") else stem) + ".laz"


def write_corrected_cloud(
    header: CloudHeader, file: int, passes: Passes, corrections: Corrections, out: Path, tick: Callable[[int], None]
) -> None:
    """Write cloud number `file` with corrected coordinates as LAZ; all other fields and records are copied."""
    import laspy

    las_header, extended = _header(header.path)
    scales, offsets = np.array(las_header.scales), np.array(las_header.offsets)
    with (
        laz_as_os_error(),
        out.open("w+b") as stream,  # which laspy would leave open where a full disk stops it
        laspy.open(stream, mode="w", header=las_header, do_compress=True, closefd=False) as writer,
    ):
        for part in read_passes(header):
            numbers = passes.of_points(part.times, part.source_ids, file)
            steps = np.rint((corrections.moved(part.points, part.times, numbers) - offsets) / scales)
            if np.abs(steps).max() > np.iinfo(np.int32).max:
                raise FileError(
                    f"Expected room for corrected coordinates in {header.path}, whose scale and offset leave none."
                    " Write it anew with another offset."
                )
            for axis, name in enumerate("XYZ"):
                part.record.array[name] = steps[:, axis].astype(np.int32)
            writer.write_points(part.record)
            tick(len(numbers))
        if len(extended):
            writer.write_evlrs(extended)


def _header(path: Path) -> tuple["laspy.LasHeader", "VLRList"]:
    """Return the header of a LAS file with its VLRs, and its EVLRs; records of COPC are left out."""
    import laspy
    from laspy.vlrs.vlrlist import VLRList

    with path.open("rb") as stream:
        header = laspy.LasHeader.read_from(stream, read_evlrs=False)
        if header.global_encoding.waveform_data_packets_internal:
            raise FileError(
                f"Expected {path} without waveforms inside, got some, which would be lost. Write them to a file aside."
            )
        if header.number_of_evlrs:
            header.read_evlrs(stream)
    extended = VLRList([record for record in header.evlrs or [] if record.user_id != "copc"])
    header.vlrs = VLRList([record for record in header.vlrs if record.user_id != "copc"])
    header.evlrs = None
    return header, extended


def write_corrected_trajectory(path: Path, trajectory: Trajectory, passes: Passes, corrections: Corrections) -> None:
    """Write a trajectory of the mapping sensor, corrected like its points; TUM or CSV, as its suffix says."""
    from scipy.spatial.transform import Rotation

    times, numbers = trajectory.times, passes.at(trajectory.times)
    _, _, turns = corrections.motions(times, numbers)
    turned = Rotation.from_rotvec(turns) * Rotation.from_quat(trajectory.quaternions_xyzw)
    positions = corrections.moved(trajectory.positions, times, numbers)
    write = write_csv if path.suffix.lower() == ".csv" else write_tum
    write(path, Trajectory(times, positions, turned.as_quat(), trajectory.covariances))
