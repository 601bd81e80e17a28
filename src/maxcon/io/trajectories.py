# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Trajectories in files: TUM text, and CSV with a header such as POSES.csv."""

import csv
import math
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from maxcon.atomic import atomic_file
from maxcon.errors import FileError, TrajectoryError
from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.text import numbered_lines, parse_float
from maxcon.trajectory import Trajectory, TrajectoryFault, first_fault

__all__ = ["Prior", "read_prior", "read_trajectory", "write_csv", "write_tum"]

TUM_COLUMNS = "time x y z qx qy qz qw"
CSV_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "heading")
COVARIANCE_COLUMNS = (
    "cov_x_x", "cov_x_y", "cov_x_heading", "cov_y_y", "cov_y_heading", "cov_heading_heading",
)  # fmt: skip
OTHER_NAMES = ("yaw", "yaw_deg", "azimuth", "bearing", "course", "theta")
"""Of headings, in other programs: some count from the north, or clockwise."""
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_heading")

Line = tuple[int, str]
Row = tuple[int, list[float]]
Column = tuple[int, float]
"""Where a number stands in a line, and what makes it s, m, rad."""


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
    readers = {".txt": _tum_rows, ".tum": _tum_rows, ".csv": _csv_rows}
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
            left_out.append(_words(file, row[0], fault.words))
    return good


def _parsed(parse: Callable[[], list[float]], left_out: list[str] | None) -> list[float] | None:
    """Return the numbers of a row; None where it is none, which is told in `left_out` if that is given."""
    try:
        return parse()
    except TrajectoryError as error:
        if left_out is None:
            raise
        left_out.append(str(error))
        return None


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


def _refuse(file: Path, number: int, words: str) -> NoReturn:
    raise TrajectoryError(_words(file, number, words)) from None


def _words(file: Path, number: int, words: str) -> str:
    return f"{file}, line {number}: {words}"


def _numbers(file: Path, number: int, texts: list[str], names: str) -> list[float]:
    values = [parse_float(text) for text in texts]
    if None in values:
        text = texts[values.index(None)][:40]
        _refuse(
            file, number, f"Expected finite numbers for '{names}', got {text!r}. Correct or remove this line."
        )
    return [value for value in values if value is not None]


def _tum_rows(file: Path, lines: Iterable[Line], left_out: list[str] | None) -> Iterator[Row]:
    for number, line in lines:
        texts = line.partition("#")[0].split()
        if texts:
            row = _parsed(lambda: _tum_row(file, number, line, texts), left_out)  # noqa: B023 - called at once
            if row is not None:
                yield number, row


def _tum_row(file: Path, number: int, line: str, texts: list[str]) -> list[float]:
    if len(texts) != 8:
        hint = " Is it CSV? Then name it .csv." if "," in line else " Correct or remove this line."
        _refuse(file, number, f"Expected 8 columns '{TUM_COLUMNS}', got {len(texts)}.{hint}")
    return _numbers(file, number, texts, TUM_COLUMNS)


class _CsvHeader(NamedTuple):
    """What stands where in a CSV file."""

    names: list[str]
    pose: list[Column]
    certainty: list[Column]


def _csv_rows(file: Path, lines: Iterable[Line], left_out: list[str] | None) -> Iterator[Row]:
    """Rows as time, x, y, z, qx, qy, qz, qw, and the nine numbers of a covariance where the header has such columns."""
    header: _CsvHeader | None = None
    for number, line in lines:
        if line.startswith("#"):
            continue
        if header is None:
            names = _cells(file, number, line)
            header = _CsvHeader(names, _columns(file, number, names), _certainty_columns(file, number, names))
            continue
        row = _parsed(lambda: _csv_row(file, number, line, header), left_out)  # noqa: B023 - called at once
        if row:
            yield number, row


def _csv_row(file: Path, number: int, line: str, header: _CsvHeader) -> list[float]:
    """Return the numbers of a row; none where it has no pose."""
    texts = _cells(file, number, line)
    if len(texts) != len(header.names):
        words = f"Expected {len(header.names)} columns as in the header, got {len(texts)}. Correct this line."
        _refuse(file, number, words)
    if not texts[header.pose[1][0]]:
        return []
    values = _numbers(file, number, [texts[index] for index, _ in header.pose], ",".join(CSV_COLUMNS))
    scaled = [value * scale for value, (_, scale) in zip(values, header.pose, strict=True)]
    if max(map(abs, scaled[4:])) > 2.0 * math.pi + 1e-6:
        angles = ",".join(header.names[index] for index, _ in header.pose[4:])
        _refuse(
            file,
            number,
            f"Expected {angles} within one turn, got {max(values[4:], key=abs):g}. Are these degrees? Then name"
            " the columns roll_deg,pitch_deg,heading_deg; turns on end have to be taken off.",
        )
    covariance = _covariance(file, number, header.names, texts, header.certainty)
    return [*scaled[:4], *quaternions_from_angles(*scaled[4:]).tolist(), *covariance]


def _cells(file: Path, number: int, line: str) -> list[str]:
    try:
        return [text.strip() for text in next(csv.reader([line], strict=True))]
    except csv.Error as error:
        _refuse(file, number, f"Expected comma-separated values, got: {error}. Correct or remove this line.")


def _columns(file: Path, number: int, header: list[str]) -> list[Column]:
    """The columns of time, x, y, z, roll, pitch and heading."""
    columns = []
    for name in CSV_COLUMNS:
        found = [(header.index(name), 1.0)] if name in header else []
        if name == "time" and not found and "timestamp" in header:
            found = [(header.index("timestamp"), 1.0)]
        if name in CSV_COLUMNS[4:] and f"{name}_deg" in header:
            found.append((header.index(f"{name}_deg"), math.pi / 180.0))
        if len(found) != 1 or header.count(header[found[0][0]]) != 1:
            got = ",".join(header)[:80]
            what = "no" if not found else "more than one"
            other = next((other for other in OTHER_NAMES if name == "heading" and other in header), None)
            advice = "Name the columns so, separated by commas."
            if other is not None and not found:
                advice = (
                    f"Rename {other!r}, if it is counted from +x (east) counter-clockwise; a compass counts from north"
                    " clockwise: 90 degrees less that."
                )
            _refuse(
                file,
                number,
                f"Expected a header with {','.join(CSV_COLUMNS)} (angles in rad, or as roll_deg,pitch_deg,"
                f"heading_deg), got {what} {name!r} in {got!r}. {advice}",
            )
        columns.append(found[0])
    return columns


def _certainty_columns(file: Path, number: int, header: list[str]) -> list[Column]:
    """The columns of a covariance, those of three standard deviations, or none."""
    in_degrees = f"{SIGMA_COLUMNS[2]}_deg"
    sigmas = (*SIGMA_COLUMNS[:2], in_degrees if in_degrees in header else SIGMA_COLUMNS[2])
    given = [names for names in (COVARIANCE_COLUMNS, sigmas) if any(name in header for name in names)]
    if not given:
        return []
    wrong = [name for name in given[0] if header.count(name) != 1]
    if len(given) == 2:
        got = "both"
    elif in_degrees in header and SIGMA_COLUMNS[2] in header:
        got = f"both {SIGMA_COLUMNS[2]!r} and {in_degrees!r}"
    elif wrong:
        got = f"{'more than one' if wrong[0] in header else 'no'} {wrong[0]!r}"
    else:
        return [(header.index(name), math.pi / 180.0 if name == in_degrees else 1.0) for name in given[0]]
    _refuse(
        file,
        number,
        f"Expected either {','.join(COVARIANCE_COLUMNS)} (m^2, m rad, rad^2) or {','.join(SIGMA_COLUMNS)} (m, rad; or"
        f" {in_degrees}), got {got}. Give all columns of one kind, or none.",
    )


def _covariance(
    file: Path, number: int, header: list[str], texts: list[str], columns: list[Column]
) -> list[float]:
    """The nine numbers of a row's covariance: NaN where all its columns are empty; none without such columns."""
    wanted = [texts[index] for index, _ in columns]
    if not columns or not any(wanted):
        return [math.nan] * (9 if columns else 0)
    names = ",".join(header[index] for index, _ in columns)
    values = _numbers(file, number, wanted, names)
    scaled = np.array([value * scale for value, (_, scale) in zip(values, columns, strict=True)])
    if len(columns) == len(SIGMA_COLUMNS):
        if scaled.min() < 0.0:
            _refuse(file, number, f"Expected '{names}' >= 0, got {min(values):g}. Correct or empty them.")
        with np.errstate(over="ignore"):
            return np.diag(np.square(scaled)).ravel().tolist()
    covariance = np.zeros((3, 3))
    covariance[np.triu_indices(3)] = scaled
    return (covariance + np.triu(covariance, 1).T).ravel().tolist()


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
        _refuse(file, rows[fault.row][0], fault.words)
    return Trajectory(*_arrays(rows))
