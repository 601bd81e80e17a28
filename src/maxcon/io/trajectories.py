"""Trajectories in files: TUM text, and CSV with a header such as POSES.csv."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, TrajectoryError
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.fixes import RecordedPoses
from maxcon.io.text import UNCLEAR_HEADINGS, PoseTable, numbered_lines, read_pose_table
from maxcon.scan.trajectory import Trajectory, first_fault

TUM_COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
KITTI_COLUMNS = tuple(f"{part}{row}" for row in (1, 2, 3) for part in ("r1", "r2", "r3", "t"))
MOST_ALONG_Z = 0.8  # where more of the way lies along the sensor's own z axis, it is the optical axis of a camera
CSV_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "heading")
ROTATION_TOLERANCE = 1e-2
COVARIANCE_COLUMNS = tuple(f"cov_{of}" for of in ("x_x", "x_y", "x_heading", "y_y", "y_heading", "heading_heading"))
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_heading")


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory in `path`, T_map_sensor in global coordinates.

    - `.txt` or `.tum`: one pose per line, `time x y z qx qy qz qw` (s, m), `#` begins a comment.
    - `.csv`: a header with time, x, y, z, roll, pitch, heading (s, m, rad), or roll_deg, pitch_deg, heading_deg in
      degrees; other columns are ignored, and so are rows with an empty x (not localized). How well poses are known,
      axes of the CRS: either cov_x_x, cov_x_y, cov_x_heading, cov_y_y, cov_y_heading, cov_heading_heading (m^2, m rad,
      rad^2), as POSES.csv has them, or standard deviations sigma_x, sigma_y (m), sigma_heading (rad) or
      sigma_heading_deg. All are empty in a row where that is not known.

    FileError if the file is missing, not a file, cannot be read, or has another suffix; TrajectoryError if a line is
    not a pose, times do not increase, a covariance is none, some of its columns are missing, or there is no pose; file
    and line are named.
    """
    return _read(Path(path), is_prior=False).trajectory


def read_poses_of_scans(path: str | os.PathLike[str], times: NDArray[np.float64]) -> Trajectory:
    """Return the poses in a file of scans at `times`, shape (n,), s: of `read_trajectory`, or KITTI's, one per scan."""
    file = Path(path)
    is_kitti = file.suffix.lower() == ".kitti"
    if file.suffix.lower() == ".txt":
        first = next((line for _, line in numbered_lines(file, "a trajectory") if not line.startswith("#")), "")
        is_kitti = len(first.split()) == len(KITTI_COLUMNS)
    if not is_kitti:
        return read_trajectory(file)
    from scipy.spatial.transform import Rotation

    table = read_pose_table(file, names=KITTI_COLUMNS)
    values = table.numbers(KITTI_COLUMNS)
    (values,) = table.good([values], may_leave_out=False)
    if len(values) != len(times):
        raise TrajectoryError(
            f"Expected a pose for each of the {len(times)} scans in {file}, which has no times, got {len(values)}. Give"
            " poses with times (TUM), or the scans that they belong to."
        )
    matrices = values.reshape(-1, 3, 4)
    rotations, positions = matrices[:, :, :3], matrices[:, :, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        is_wrong = ~((off <= ROTATION_TOLERANCE) & (np.linalg.det(rotations) > 0.0))
        steps = np.einsum("nji,nj->ni", rotations[:-1], np.diff(positions, axis=0))
        along_z, way = np.abs(steps[:, 2]).sum(), np.linalg.norm(steps, axis=1).sum()
    if is_wrong.any():
        row = int(np.argmax(is_wrong))
        table.refuse("Expected a rotation and a position, row by row, got none. Correct this line.", table.lines[row])
    if along_z > MOST_ALONG_Z * way > 0.0:
        raise TrajectoryError(
            f"Expected poses of the scanner in {file}, got some that move along its z axis, as KITTI's own do, which"
            " are of a camera. Turn them into the scanner's (calib.txt), or give them with times (TUM)."
        )
    return Trajectory(times, positions, Rotation.from_matrix(rotations).as_quat())


def read_prior(path: str | os.PathLike[str]) -> RecordedPoses:
    """Return a trajectory without the rows that are no poses, as loggers end in the middle of a line."""
    return _read(Path(path), is_prior=True)


def _read(file: Path, *, is_prior: bool) -> RecordedPoses:
    suffix = file.suffix.lower()
    if suffix in (".txt", ".tum"):
        table = read_pose_table(file, names=TUM_COLUMNS)
        values = table.numbers(TUM_COLUMNS)
        arrays = [values[:, 0], values[:, 1:4], values[:, 4:]]
    elif suffix == ".csv":
        table, arrays = _read_csv(file, is_prior=is_prior)
    else:
        raise FileError(
            f"Expected a trajectory with suffix .txt, .tum or .csv, got {file}. Rename it: .txt for lines of"
            f" '{' '.join(TUM_COLUMNS)}', .csv for a table with a header."
        )
    arrays = table.good(arrays, may_leave_out=is_prior)
    fault = first_fault(*arrays)
    if fault is not None and is_prior:  # leave out rows that are no poses, whatever the order of their times
        for row, line in enumerate(table.lines):
            if own := first_fault(*(array[row : row + 1] for array in arrays)):
                table.faults[line] = own.words
        arrays = table.good(arrays, may_leave_out=True)
        fault = first_fault(*arrays)
    if fault is not None:
        table.refuse(fault.words, table.lines[fault.row])
    return RecordedPoses(Trajectory(*arrays), left_out=table.told_faults())


def _read_csv(file: Path, *, is_prior: bool) -> tuple[PoseTable, list[NDArray[np.float64]]]:
    """Table, and times, positions, quaternions, covariances if any, of its rows; those not localized are left out."""
    table = read_pose_table(file)
    if not table.names:
        return table, []
    names = {name: table.name_of(name) for name in CSV_COLUMNS}
    needed = [name for name in CSV_COLUMNS if name not in ("roll", "pitch")]
    if not is_prior or names["roll"] or names["pitch"]:
        needed = list(CSV_COLUMNS)
    missing = [name for name in needed if names[name] is None]
    if missing:
        unclear = [name for name in UNCLEAR_HEADINGS if name in table.names]
        advice = "Name the columns so, separated by commas."
        if "latitude" in table.names:
            advice = "In latitude and longitude it can only be the --prior of `maxcon localize`."
        elif missing[0] == "heading" and unclear:
            advice = (
                f"Rename {unclear[0]!r}, if it is counted from +x (east) counter-clockwise; a compass counts from north"
                " clockwise: 90 degrees less that."
            )
        table.refuse(
            f"Expected a header with {','.join(CSV_COLUMNS)} (angles in rad, or as roll_deg,pitch_deg,heading_deg), got"
            f" no {missing[0]!r} in {','.join(table.names)[:80]!r}. {advice}"
        )
    table.keep(table.texts("x"))
    values = table.numbers(needed)
    if len(needed) < len(CSV_COLUMNS):
        values = np.insert(values, [4, 4], 0.0, axis=1)
    return table, [values[:, 0], values[:, 1:4], quaternions_from_angles(*values[:, 4:].T), *_covariances(table)]


def _covariances(table: PoseTable) -> list[NDArray[np.float64]]:
    """Covariances of all rows, (n, 3, 3), NaN where all columns are empty; nothing where there are no such columns."""
    given = [kind for kind in (COVARIANCE_COLUMNS, SIGMA_COLUMNS) if any(map(table.name_of, kind))]
    if not given:
        return []
    missing = [name for name in given[0] if not table.name_of(name)]
    if missing:
        table.refuse(
            f"Expected either {','.join(COVARIANCE_COLUMNS)} (m^2, m rad, rad^2) or {','.join(SIGMA_COLUMNS)} (m, rad;"
            f" or sigma_heading_deg), got {'both' if len(given) == 2 else f'no {missing[0]!r}'}. Give all columns of"
            " one kind, or none."
        )
    values = table.numbers(given[0], may_be_empty=True)
    is_empty = np.isnan(values)
    for row in np.flatnonzero(is_empty.any(axis=1) & ~is_empty.all(axis=1)).tolist():
        table.add_fault(row, f"Expected finite numbers as '{','.join(given[0])}', all of them or none, got ''.")
    covariances = np.zeros((len(values), 3, 3))
    rows, others = np.diag_indices(3) if given[0] is SIGMA_COLUMNS else np.triu_indices(3)
    with np.errstate(over="ignore"):
        covariances[:, rows, others] = covariances[:, others, rows] = values**2 if len(rows) == 3 else values
    covariances[is_empty.all(axis=1)] = np.nan
    return [covariances]


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory, comment: str = "") -> None:
    """Write `trajectory` as TUM text, with `comment` at the top; every number reads back as the same float64."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()] + ["# time_s x_m y_m z_m qx qy qz qw"]
    rows = zip(trajectory.times, trajectory.positions, trajectory.quaternions_xyzw, strict=True)
    lines += [" ".join(_numbers(time, position, quaternion)) for time, position, quaternion in rows]
    _write(path, lines)


def write_csv(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write `trajectory` as CSV, with covariances if it has them; times and positions read back as the same float64."""
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
