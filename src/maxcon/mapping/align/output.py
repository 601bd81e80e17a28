# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Files of an alignment: corrected clouds and trajectories, tables, and a summary."""

import csv
import json
import math
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maxcon._system.regular_file import read_regular
from maxcon._system.version import __version__
from maxcon.errors import FileError
from maxcon.io.clouds import CloudHeader
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.trajectories import write_csv, write_tum
from maxcon.mapping.align.alignment import Alignment, is_contradicted
from maxcon.mapping.align.corrections import Corrections
from maxcon.mapping.align.passes import Passes, read_passes
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    import laspy
    from laspy.vlrs.vlrlist import VLRList

MOST_EXTENDED_BYTES = 2**28
"""Largest size of the extended records (EVLRs) behind the points, which are copied as a whole."""
SUMMARY = "alignment.json"
TABLES = (SUMMARY, "rounds.csv", "residuals.csv", "ties.csv", "corrections.csv")
LARGEST_SUMMARY = 2**24
"""Bytes."""
AXES = ("x", "y", "z")


def corrected_name(path: Path) -> str:
    """Name of the corrected file of a cloud: plain LAZ, as a COPC orders its points by their coordinates."""
    stem = path.name[: -len(path.suffix)]
    return (stem[: -len(".copc")] if stem.lower().endswith(".copc") else stem) + ".laz"


def write_corrected_cloud(
    header: CloudHeader, file: int, passes: Passes, corrections: Corrections, out: Path, tick: Callable[[int], None]
) -> None:
    """Write a cloud with corrected coordinates, chunk by chunk; all other fields and records are copied.

    FileError if a corrected coordinate does not fit the scale and offset of the file, or the file holds waveforms.

    `header`: header of the cloud; `file`: its number among all clouds; `corrections`: motions of the passes; `out`:
    file to write, LAZ; `tick`: called with the number of points after each chunk.
    """
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
        n_extended = header.number_of_evlrs or 0
        if n_extended and path.stat().st_size - header.start_of_first_evlr > MOST_EXTENDED_BYTES:
            raise FileError(
                f"Expected at most {MOST_EXTENDED_BYTES:,} bytes behind the points of {path}, got more."
                " Write it anew without them."
            )
        if n_extended:
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


def files_there(folder: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the names of all files of the alignment in a folder, as it says itself; of its tables, if it says none."""
    try:
        named = json.loads(read_regular(Path(folder) / SUMMARY, LARGEST_SUMMARY))["files"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        named = []
    names = named if isinstance(named, list) else []
    return (*TABLES, *(name for name in names if isinstance(name, str)))


def write_tables(folder: Path, alignment: Alignment, summary: dict[str, object], files: Sequence[str]) -> None:
    """Write all tables of an alignment; lengths in m, angles in degrees.

    `alignment`: the outcome; `summary`: options, for the summary; `files`: names of the corrected clouds and
    trajectories in the folder: an alignment that replaces it replaces them.
    """
    for name, table in zip(TABLES[1:], (_passes, _pairs, _constraints, _corrections), strict=True):
        with (folder / name).open("w", encoding="utf-8", newline="") as stream:
            rows = ([_cell(value) for value in row] for row in table(alignment))
            csv.writer(stream, lineterminator="\n").writerows(rows)
    content = summary | {
        "n_rounds": len(alignment.passes),
        "n_ties": len(alignment.constraints),
        "n_contradicted": alignment.n_contradicted,
        "n_refused": dict(sorted(alignment.refused.items())),
        "inflation": round(alignment.adjusted.inflation, 3),
        "sigma": {
            "of_round_before": round(alignment.sigma_before, 5),
            "of_round": round(alignment.sigma_of_pass, 5),
            "of_map": round(alignment.sigma_of_map, 5),
            "of_datum": round(alignment.sigma_of_datum, 5),
        },
        "words": [each.words for each in alignment.connectivity if each.words],
        "files": list(files),
    }
    text = json.dumps({"program": f"maxcon {__version__}", **content}, indent=2, allow_nan=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8", newline="\n")


Row = Sequence[object]


def _cell(value: object) -> object:
    return "" if isinstance(value, float) and math.isnan(value) else value


def _passes(alignment: Alignment) -> Iterable[Row]:
    yield [
        "round", "name", "n_points", "start_s", "end_s", "n_ties", "group",
        *(f"{what}_{axis}" for what in ("shift", "turn_deg", "sigma") for axis in AXES), "words",
    ]  # fmt: skip
    for number, (each, found) in enumerate(zip(alignment.passes, alignment.connectivity, strict=True), 1):
        values = np.concatenate([found.shift, np.degrees(found.turn), found.sigma])
        yield [
            number, each.name, each.n_points, each.start, each.end, found.n_constraints, found.component + 1,
            *(round(value, 6) for value in values.tolist()), found.words,
        ]  # fmt: skip


def _pairs(alignment: Alignment) -> Iterable[Row]:
    sizes = ("horizontal_before", "horizontal_after", "height_before", "height_after")
    yield [
        "round_a",
        "round_b",
        "n_ties",
        "n_contradicted",
        *(f"{name}_{of}" for name in sizes for of in ("median", "95")),
    ]
    for pair in alignment.pairs:
        values = pair.horizontal_before + pair.horizontal_after + pair.height_before + pair.height_after
        first, second = pair.passes
        yield [first + 1, second + 1, pair.n_constraints, pair.n_contradicted, *(round(value, 5) for value in values)]


def _constraints(alignment: Alignment) -> Iterable[Row]:
    yield [
        "x", "y", "round_a", "round_b", "time_a", "time_b", "share", "weight", "is_contradicted",
        *(f"{what}_{axis}" for what in ("before", "after", "sigma") for axis in AXES),
    ]  # fmt: skip
    weights, residuals = alignment.adjusted.weights, alignment.adjusted.residuals
    for each, residual, weight in zip(alignment.constraints, residuals, weights, strict=True):
        values = np.concatenate([each.pose.position, residual[:3], np.sqrt(np.diag(each.covariance)[:3])])
        yield [
            *(round(value, 3) for value in each.place[:2].tolist()), *(number + 1 for number in each.passes),
            *(round(time, 3) for time in each.times), round(each.ratio, 3), round(float(weight), 4),
            int(is_contradicted(weight)), *(round(value, 5) for value in values.tolist()),
        ]  # fmt: skip


def _corrections(alignment: Alignment) -> Iterable[Row]:
    """A row for each knot: how what was measured then, about there, is moved."""
    yield ["round", "time", *(f"{what}{axis}" for what in ("", "shift_", "turn_deg_") for axis in AXES)]
    corrections = alignment.adjusted.corrections
    for number in range(corrections.n_passes):
        first, end = corrections.firsts[number], corrections.firsts[number + 1]
        for knot in range(first, end):
            time = float(corrections.starts[number] + (knot - first) * corrections.steps[number])
            place = corrections.knot_centres[knot]
            twist = corrections.twist_at(place, time, number)
            twist[3:] = np.degrees(twist[3:])
            yield [number + 1, round(time, 3), *np.round(place, 3).tolist(), *np.round(twist, 6).tolist()]
