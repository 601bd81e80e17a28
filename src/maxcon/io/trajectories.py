# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Trajectories in files: TUM text, and CSV with a header such as POSES.csv."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, TrajectoryError
from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.pose_tables import (
    COVARIANCE_COLUMNS,
    CSV_COLUMNS,
    UNCLEAR_HEADINGS,
    PoseTable,
    TableColumn,
    read_pose_table,
    rows_of_lines,
)
from maxcon.io.text import numbered_lines
from maxcon.scan.trajectory import Trajectory, first_fault

TUM_COLUMNS = "time x y z qx qy qz qw"
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_heading")


class Prior(NamedTuple):
    """Rough poses, and what is wrong with the rows that are no poses."""

    trajectory: Trajectory
    left_out: tuple[str, ...]


def read_prior(path: str | os.PathLike[str]) -> Prior:
    """Return the trajectory in `path` without the rows that are no poses: loggers end in the middle of a line.

    Files and errors are those of `read_trajectory`; roll and pitch may be missing, and single rows are refused only
    where most are no poses, or times do not increase.
    """
    left_out: list[str] = []
    return Prior(_read(Path(path), left_out), tuple(left_out))


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory in `path`, T_map_sensor in global coordinates.

    path: `.txt` or `.tum`: one pose per line, `time x y z qx qy qz qw` (s, m), `#` begins a comment. `.csv`: a header
        with time, x, y, z, roll, pitch, heading (s, m, rad), or roll_deg, pitch_deg, heading_deg in degrees; other
        columns are ignored, and so are rows with an empty x (not localized). How well poses are known, axes of the CRS:
        either cov_x_x, cov_x_y, cov_x_heading, cov_y_y, cov_y_heading, cov_heading_heading (m^2, m rad, rad^2), as
        POSES.csv has them, or standard deviations sigma_x, sigma_y (m), sigma_heading (rad) or sigma_heading_deg. All
        are empty in a row where that is not known.

    FileError if the file is missing, not a file, cannot be read, or has another suffix; TrajectoryError if a line is
    not a pose, times do not increase, a covariance is none, some of its columns are missing, or there is no pose; file
    and line are named.
    """
    return _read(Path(path), None)


def _read(file: Path, left_out: list[str] | None) -> Trajectory:
    """Return the trajectory in a file; rows that are no poses are told in `left_out`, or refused if it is None."""
    table, arrays = _read_rows(file, is_prior=left_out is not None)
    if left_out is None and table.faults:
        raise TrajectoryError(table.told_faults()[0])
    arrays = table.good(*arrays)
    if left_out is not None:
        arrays = _good_poses(table, arrays)
        left_out += table.told_faults()
        if len(left_out) > len(table.rows):
            raise TrajectoryError(left_out[0])
    if not table.rows:
        raise TrajectoryError(f"{file}: Expected at least one pose, got none. Was it written to its end?")
    fault = first_fault(*arrays)
    if fault is not None:
        table.refuse(fault.words, table.lines[fault.row])
    return Trajectory(*arrays)


def _good_poses(table: PoseTable, arrays: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Leave out rows that are no poses, whatever the order of their times."""
    if not table.rows or first_fault(*arrays) is None:
        return arrays
    for row, line in enumerate(table.lines):
        fault = first_fault(*(array[row : row + 1] for array in arrays))
        if fault is not None:
            table.faults[line] = fault.words
    return table.good(*arrays)


def _read_rows(file: Path, *, is_prior: bool) -> tuple[PoseTable, list[NDArray[np.float64]]]:
    """Table, and times, positions, quaternions, covariances if any, of its rows."""
    suffix = file.suffix.lower()
    if suffix in (".txt", ".tum"):
        return _read_tum(file)
    if suffix == ".csv":
        return _read_csv(file, is_prior=is_prior)
    raise FileError(
        f"Expected a trajectory with suffix .txt, .tum or .csv, got {file}."
        f" Rename it: .txt for lines of '{TUM_COLUMNS}', .csv for a table with a header."
    )


def _read_tum(file: Path) -> tuple[PoseTable, list[NDArray[np.float64]]]:
    """As `_read_rows`, of lines of eight numbers."""

    def of_count(cells: list[str]) -> str:
        is_csv = any("," in cell for cell in cells)
        hint = "Is it CSV? Then name it .csv." if is_csv else "Correct or remove this line."
        return f"Expected 8 columns '{TUM_COLUMNS}', got {len(cells)}. {hint}"

    table = PoseTable(file, TUM_COLUMNS.split(), 0)
    rows_of_lines(table, numbered_lines(file, "a trajectory"), lambda line: line.partition("#")[0].split(), of_count)
    values = table.numbers([TableColumn(index) for index in range(8)], TUM_COLUMNS)
    return table, [values[:, 0], values[:, 1:4], values[:, 4:]]


def _read_csv(file: Path, *, is_prior: bool) -> tuple[PoseTable, list[NDArray[np.float64]]]:
    """As `_read_rows`, of a table with a header; epochs not localized are left out."""
    table = read_pose_table(file)
    if not table.names:
        return table, [np.empty(0), np.empty((0, 3)), np.empty((0, 4))]
    columns = _pose_columns(table, is_prior=is_prior)
    certainty = _certainty_columns(table)
    table.keep(table.texts("x"))
    values = table.numbers(columns, ",".join(CSV_COLUMNS))
    angles = [column for column in columns[4:] if column is not None]
    names = ",".join(table.names[column.place] for column in angles)
    most = np.abs(values[:, 4:]).max(axis=1, initial=0.0)
    table.add_faults(
        most > 2.0 * math.pi + 1e-6,
        lambda row: (
            f"Expected {names} within one turn, got {_farthest(table.rows[row], angles)}. Are these degrees? Then name"
            " the columns roll_deg,pitch_deg,heading_deg; turns on end have to be taken off."
        ),
    )
    arrays = [values[:, 0], values[:, 1:4], quaternions_from_angles(*values[:, 4:].T)]
    return table, [*arrays, _covariances(table, certainty)] if certainty else arrays


def _farthest(cells: list[str], angles: list[TableColumn]) -> str:
    return f"{float(max((cells[column.place] for column in angles), key=lambda text: abs(float(text)))):g}"


def _pose_columns(table: PoseTable, *, is_prior: bool) -> list[TableColumn | None]:
    """The columns of time, x, y, z, roll, pitch and heading; a prior may do without both of roll and pitch."""
    columns = {name: table.find(name) for name in CSV_COLUMNS}
    needed = set(CSV_COLUMNS)
    if is_prior and columns["roll"] is None and columns["pitch"] is None:
        needed -= {"roll", "pitch"}
    missing = next((name for name in CSV_COLUMNS if name in needed and columns[name] is None), None)
    if missing is not None:
        advice = "Name the columns so, separated by commas."
        other = next((other for other in UNCLEAR_HEADINGS if missing == "heading" and other in table.names), None)
        if other is not None:
            advice = (
                f"Rename {other!r}, if it is counted from +x (east) counter-clockwise; a compass counts from north"
                " clockwise: 90 degrees less that."
            )
        elif "latitude" in table.names:
            advice = "In latitude and longitude it can only be the --prior of `maxcon localize`."
        table.refuse(
            f"Expected a header with {','.join(CSV_COLUMNS)} (angles in rad, or as roll_deg,pitch_deg,heading_deg), got"
            f" no {missing!r} in {','.join(table.names)[:80]!r}. {advice}"
        )
    return list(columns.values())


def _certainty_columns(table: PoseTable) -> list[TableColumn]:
    """The columns of a covariance, those of three standard deviations, or none."""
    found = [[table.find(name) for name in kind] for kind in (COVARIANCE_COLUMNS, SIGMA_COLUMNS)]
    given = [kind for kind in found if any(kind)]
    if not given:
        return []
    columns = [column for column in given[0] if column is not None]
    if len(given) == 2 or len(columns) < len(given[0]):
        names = COVARIANCE_COLUMNS if given[0] is found[0] else SIGMA_COLUMNS
        got = "both" if len(given) == 2 else f"no {names[given[0].index(None)]!r}"
        table.refuse(
            f"Expected either {','.join(COVARIANCE_COLUMNS)} (m^2, m rad, rad^2) or {','.join(SIGMA_COLUMNS)} (m, rad;"
            f" or sigma_heading_deg), got {got}. Give all columns of one kind, or none."
        )
    return columns


def _covariances(table: PoseTable, columns: list[TableColumn]) -> NDArray[np.float64]:
    """Covariances of all rows, shape (n, 3, 3); NaN where all columns are empty."""
    names = ",".join(table.names[column.place] for column in columns)
    is_known = np.array([any(cells[column.place] for column in columns) for cells in table.rows], dtype=bool)
    values = table.numbers(columns, names, may_be_empty=True)
    is_part = is_known & np.isnan(values).any(axis=1)
    table.add_faults(is_part, f"Expected finite numbers for '{names}', got ''. Give all of them, or none.")
    covariances = np.zeros((len(values), 3, 3))
    if len(columns) == len(SIGMA_COLUMNS):
        table.add_faults(
            values.min(axis=1, initial=0.0) < 0.0,
            lambda row: f"Expected '{names}' >= 0, got {values[row].min():g}. Correct or empty them.",
        )
        with np.errstate(over="ignore"):
            covariances[:, range(3), range(3)] = values**2
        covariances[~is_known] = np.nan
        return covariances
    rows, others = np.triu_indices(3)
    covariances[:, rows, others] = covariances[:, others, rows] = values
    return covariances


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory, comment: str = "") -> None:
    """Write `trajectory` as TUM text, with `comment` at the top; every number reads back as the same float64.

    FileError if the file cannot be written; one that is there is replaced.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()] + ["# time_s x_m y_m z_m qx qy qz qw"]
    rows = zip(trajectory.times, trajectory.positions, trajectory.quaternions_xyzw, strict=True)
    lines += [" ".join(_numbers(time, position, quaternion)) for time, position, quaternion in rows]
    _write(path, lines)


def write_csv(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write `trajectory` as CSV: time, x, y, z, roll, pitch, heading in s, m, rad, and covariances if it has them.

    Times and positions read back as the same float64. FileError if the file cannot be written; one that is there is
    replaced.
    """
    covariances = trajectory.covariances
    lines = [",".join(CSV_COLUMNS if covariances is None else CSV_COLUMNS + COVARIANCE_COLUMNS)]
    for row, (time, angles) in enumerate(zip(trajectory.times, trajectory.angles, strict=True)):
        texts = _numbers(time, trajectory.positions[row], angles)
        if covariances is not None:
            upper = covariances[row][np.triu_indices(3)].tolist()
            texts += ["" if math.isnan(value) else repr(value) for value in upper]
        lines.append(",".join(texts))
    _write(path, lines)


def _numbers(time: float, position: NDArray[np.float64], turns: NDArray[np.float64]) -> list[str]:
    """Shortest decimals that read back as the same numbers, and at least 6, 4 and 9 of them."""
    values = [(time, 6), *((value, 4) for value in position), *((value, 9) for value in turns)]
    return [np.format_float_positional(value, unique=True, min_digits=decimals) for value, decimals in values]


def _write(path: str | os.PathLike[str], lines: list[str]) -> None:
    with atomic_file(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
