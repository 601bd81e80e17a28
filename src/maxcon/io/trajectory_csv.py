# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Trajectories as CSV with a header, such as POSES.csv: which column is which, and how sure each pose is."""

import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.trajectory_rows import Line, Row, numbers_of, parsed, refuse

__all__ = ["COVARIANCE_COLUMNS", "CSV_COLUMNS", "OTHER_NAMES", "cells_of", "csv_rows"]

CSV_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "heading")
COVARIANCE_COLUMNS = (
    "cov_x_x", "cov_x_y", "cov_x_heading", "cov_y_y", "cov_y_heading", "cov_heading_heading",
)  # fmt: skip
OTHER_NAMES = ("yaw", "yaw_deg", "azimuth", "bearing", "course", "theta")
"""Of headings, in other programs: some count from the north, or clockwise."""
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_heading")

Column = tuple[int | None, float]
"""Where a number stands in a line, and what makes it s, m, rad; None: nowhere, it is 0."""
TILTS = ("roll", "pitch")


class _CsvHeader(NamedTuple):
    """What stands where in a CSV file."""

    names: list[str]
    pose: list[Column]
    certainty: list[tuple[int, float]]


def csv_rows(file: Path, lines: Iterable[Line], left_out: list[str] | None) -> Iterator[Row]:
    """Rows as time, x, y, z, qx, qy, qz, qw, and the nine numbers of a covariance where the header has such columns."""
    header: _CsvHeader | None = None
    for number, line in lines:
        if line.startswith("#"):
            continue
        if header is None:
            names = cells_of(file, number, line)
            pose = _columns(file, number, names, is_prior=left_out is not None)
            header = _CsvHeader(names, pose, _certainty_columns(file, number, names))
            continue
        row = parsed(left_out, _csv_row, file, number, line, header)
        if row:
            yield number, row


def _csv_row(file: Path, number: int, line: str, header: _CsvHeader) -> list[float]:
    """Return the numbers of a row; none where it has no pose."""
    texts = cells_of(file, number, line)
    if len(texts) != len(header.names):
        words = f"Expected {len(header.names)} columns as in the header, got {len(texts)}. Correct this line."
        refuse(file, number, words)
    if not texts[header.names.index("x")]:
        return []
    wanted = [texts[index] if index is not None else "0" for index, _ in header.pose]
    values = numbers_of(file, number, wanted, ",".join(CSV_COLUMNS))
    scaled = [value * scale for value, (_, scale) in zip(values, header.pose, strict=True)]
    if max(map(abs, scaled[4:])) > 2.0 * math.pi + 1e-6:
        angles = ",".join(header.names[index] for index, _ in header.pose[4:] if index is not None)
        refuse(
            file,
            number,
            f"Expected {angles} within one turn, got {max(values[4:], key=abs):g}. Are these degrees? Then name"
            " the columns roll_deg,pitch_deg,heading_deg; turns on end have to be taken off.",
        )
    covariance = _covariance(file, number, header.names, texts, header.certainty)
    return [*scaled[:4], *quaternions_from_angles(*scaled[4:]).tolist(), *covariance]


def cells_of(file: Path, number: int, line: str) -> list[str]:
    """Return the texts between the commas of a line."""
    try:
        return [text.strip() for text in next(csv.reader([line], strict=True))]
    except csv.Error as error:
        refuse(file, number, f"Expected comma-separated values, got: {error}. Correct or remove this line.")


def _columns(file: Path, number: int, header: list[str], *, is_prior: bool) -> list[Column]:
    """The columns of time, x, y, z, roll, pitch and heading; a prior may do without both of roll and pitch."""
    columns: list[Column] = []
    is_level = is_prior and not any(tilt in header or f"{tilt}_deg" in header for tilt in TILTS)
    for name in CSV_COLUMNS:
        if is_level and name in TILTS:
            columns.append((None, 1.0))
            continue
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
            if "latitude" in header:
                advice = "In latitude and longitude it can only be the --prior of `maxcon localize`."
            if other is not None and not found:
                advice = (
                    f"Rename {other!r}, if it is counted from +x (east) counter-clockwise; a compass counts from north"
                    " clockwise: 90 degrees less that."
                )
            refuse(
                file,
                number,
                f"Expected a header with {','.join(CSV_COLUMNS)} (angles in rad, or as roll_deg,pitch_deg,"
                f"heading_deg), got {what} {name!r} in {got!r}. {advice}",
            )
        columns.append(found[0])
    return columns


def _certainty_columns(file: Path, number: int, header: list[str]) -> list[tuple[int, float]]:
    """The columns of a covariance, those of three standard deviations, or none."""
    in_degrees = f"{SIGMA_COLUMNS[2]}_deg"
    sigmas = (*SIGMA_COLUMNS[:2], in_degrees if in_degrees in header else SIGMA_COLUMNS[2])
    given = [names for names in (COVARIANCE_COLUMNS, sigmas) if any(name in header for name in names)]
    if not given:
        return []
    wrong, got = [name for name in given[0] if header.count(name) != 1], ""
    if len(given) == 2:
        got = "both"
    elif in_degrees in header and SIGMA_COLUMNS[2] in header:
        got = f"both {SIGMA_COLUMNS[2]!r} and {in_degrees!r}"
    elif wrong:
        got = f"{'more than one' if wrong[0] in header else 'no'} {wrong[0]!r}"
    if got:
        refuse(
            file,
            number,
            f"Expected either {','.join(COVARIANCE_COLUMNS)} (m^2, m rad, rad^2) or {','.join(SIGMA_COLUMNS)} (m, rad;"
            f" or {in_degrees}), got {got}. Give all columns of one kind, or none.",
        )
    return [(header.index(name), math.pi / 180.0 if name == in_degrees else 1.0) for name in given[0]]


def _covariance(
    file: Path, number: int, header: list[str], texts: list[str], columns: list[tuple[int, float]]
) -> list[float]:
    """The nine numbers of a row's covariance: NaN where all its columns are empty; none without such columns."""
    wanted = [texts[index] for index, _ in columns]
    if not columns or not any(wanted):
        return [math.nan] * (9 if columns else 0)
    names = ",".join(header[index] for index, _ in columns)
    values = numbers_of(file, number, wanted, names)
    scaled = np.array([value * scale for value, (_, scale) in zip(values, columns, strict=True)])
    if len(columns) == len(SIGMA_COLUMNS):
        if scaled.min() < 0.0:
            refuse(file, number, f"Expected '{names}' >= 0, got {min(values):g}. Correct or empty them.")
        with np.errstate(over="ignore"):
            return np.diag(np.square(scaled)).ravel().tolist()
    covariance = np.zeros((3, 3))
    covariance[np.triu_indices(3)] = scaled
    return (covariance + np.triu(covariance, 1).T).ravel().tolist()
