# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Trajectories in files: TUM text, and CSV with a header such as POSES.csv."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, TrajectoryError
from maxcon.io.text import numbered_lines
from maxcon.io.trajectory_csv import COVARIANCE_COLUMNS, CSV_COLUMNS, csv_rows
from maxcon.io.trajectory_rows import Line, Row, numbers_of, parsed, refuse, words_of_line
from maxcon.scan.trajectory import Trajectory, TrajectoryFault, first_fault

__all__ = ["Prior", "read_prior", "read_trajectory", "write_csv", "write_tum"]

TUM_COLUMNS = "time x y z qx qy qz qw"


class Prior(NamedTuple):
    """Rough poses, and what is wrong with the rows that are no poses."""

    trajectory: Trajectory
    left_out: tuple[str, ...]


def read_prior(path: str | os.PathLike[str]) -> Prior:
    """Return the trajectory in `path` without the rows that are no poses: loggers end in the middle of a line.

    Parameters
    ----------
    path : path
        As of `read_trajectory`.

    Raises
    ------
    FileError, TrajectoryError
        As `read_trajectory`, but for single rows: only where most are no poses, or times do not increase.
    """
    left_out: list[str] = []
    return Prior(_read(Path(path), left_out), tuple(left_out))


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory in `path`, T_map_sensor in global coordinates.

    Parameters
    ----------
    path : path
        `.txt` or `.tum`: one pose per line, `time x y z qx qy qz qw` (s, m), `#` begins a comment.
        `.csv`: a header with time, x, y, z, roll, pitch, heading (s, m, rad), or roll_deg, pitch_deg,
        heading_deg in degrees; other columns are ignored, and so are rows with an empty x (not localized).
        How well poses are known, axes of the CRS: either cov_x_x, cov_x_y, cov_x_heading, cov_y_y, cov_y_heading,
        cov_heading_heading (m^2, m rad, rad^2), as POSES.csv has them, or standard deviations sigma_x, sigma_y (m),
        sigma_heading (rad) or sigma_heading_deg. All are empty in a row where that is not known.

    Raises
    ------
    FileError
        If the file is missing, not a file, cannot be read, or has another suffix.
    TrajectoryError
        If a line is not a pose, times do not increase, a covariance is none, some of its columns are missing, or
        there is no pose; file and line are named.
    """
    return _read(Path(path), None)


def _read(file: Path, left_out: list[str] | None) -> Trajectory:
    """Return the trajectory in a file; rows that are no poses are told in `left_out`, or refused if it is None."""
    readers = {".txt": _tum_rows, ".tum": _tum_rows, ".csv": csv_rows}
    read = readers.get(file.suffix.lower())
    if read is None:
        raise FileError(
            f"Expected a trajectory with suffix .txt, .tum or .csv, got {file}."
            f" Rename it: .txt for lines of '{TUM_COLUMNS}', .csv for a table with a header."
        )
    rows = list(read(file, numbered_lines(file, "a trajectory"), left_out))
    if left_out is not None:
        rows = _good_rows(file, rows, left_out)
        if len(left_out) > len(rows):
            raise TrajectoryError(left_out[0])
    if not rows:
        raise TrajectoryError(f"{file}: Expected at least one pose, got none. Was it written to its end?")
    return _trajectory(file, rows)


def _good_rows(file: Path, rows: list[Row], left_out: list[str]) -> list[Row]:
    """Return the rows that are poses, and tell of the others, whatever the order of their times."""
    if not rows or _fault(rows) is None:
        return rows
    good = []
    for row in rows:
        fault = _fault([row])
        if fault is None:
            good.append(row)
        else:
            left_out.append(words_of_line(file, row[0], fault.words))
    return good


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory, comment: str = "") -> None:
    """Write `trajectory` as TUM text; every number reads back as the same float64.

    Parameters
    ----------
    path : path
        Replaced if it exists.
    trajectory : Trajectory
        What to write, s and m.
    comment : str
        Put at the top, each line behind a `#`.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines.append("# time_s x_m y_m z_m qx qy qz qw")
    for time, position, quaternion in zip(
        trajectory.times, trajectory.positions, trajectory.quaternions_xyzw, strict=True
    ):
        texts = [_text(time, 6), *(_text(v, 4) for v in position), *(_text(v, 9) for v in quaternion)]
        lines.append(" ".join(texts))
    _write(path, lines)


def write_csv(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write `trajectory` as CSV: time, x, y, z, roll, pitch, heading in s, m, rad, and covariances if it has them.

    Parameters
    ----------
    path : path
        Replaced if it exists.
    trajectory : Trajectory
        What to write. Times and positions read back as the same float64.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    names = CSV_COLUMNS if trajectory.covariances is None else CSV_COLUMNS + COVARIANCE_COLUMNS
    lines = [",".join(names)]
    for number, angles in enumerate(trajectory.angles):
        time, position = trajectory.times[number], trajectory.positions[number]
        texts = [_text(time, 6), *(_text(v, 4) for v in position), *(_text(v, 9) for v in angles)]
        if trajectory.covariances is not None:
            covariance = trajectory.covariances[number][np.triu_indices(3)].tolist()
            texts += ["" if math.isnan(value) else repr(value) for value in covariance]
        lines.append(",".join(texts))
    _write(path, lines)


def _text(value: float, decimals: int) -> str:
    """Return the shortest decimals that read back as `value`, and at least `decimals` of them."""
    return np.format_float_positional(value, unique=True, min_digits=decimals)


def _write(path: str | os.PathLike[str], lines: list[str]) -> None:
    with atomic_file(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _tum_rows(file: Path, lines: Iterable[Line], left_out: list[str] | None) -> Iterator[Row]:
    for number, line in lines:
        texts = line.partition("#")[0].split()
        if texts:
            row = parsed(left_out, _tum_row, file, number, line, texts)
            if row is not None:
                yield number, row


def _tum_row(file: Path, number: int, line: str, texts: list[str]) -> list[float]:
    if len(texts) != 8:
        hint = " Is it CSV? Then name it .csv." if "," in line else " Correct or remove this line."
        refuse(file, number, f"Expected 8 columns '{TUM_COLUMNS}', got {len(texts)}.{hint}")
    return numbers_of(file, number, texts, TUM_COLUMNS)


def _fault(rows: list[Row]) -> TrajectoryFault | None:
    return first_fault(*_arrays(rows))


def _arrays(rows: list[Row]) -> tuple[NDArray[np.float64], ...]:
    """Times, positions, quaternions, and covariances if there are such."""
    values: NDArray[np.float64] = np.array([row for _, row in rows])
    covariances = (values[:, 8:].reshape(-1, 3, 3),) if values.shape[1] > 8 else ()
    return values[:, 0], values[:, 1:4], values[:, 4:8], *covariances


def _trajectory(file: Path, rows: list[Row]) -> Trajectory:
    fault = _fault(rows)
    if fault is not None:
        refuse(file, rows[fault.row][0], fault.words)
    return Trajectory(*_arrays(rows))
