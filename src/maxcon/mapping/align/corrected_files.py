# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Corrected clouds and trajectories: all fields as they were, only moved."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.clouds import CloudHeader
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.trajectories import write_csv, write_tum
from maxcon.mapping.align.corrections import Corrections
from maxcon.mapping.align.rounds import Rounds, read_rounds
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    import laspy
    from laspy.vlrs.vlrlist import VLRList

__all__ = ["corrected_name", "corrected_trajectory", "write_corrected_cloud", "write_trajectory"]

MOST_EXTENDED_BYTES = 2**28
"""Largest size of the extended records (EVLRs) behind the points, which are copied as a whole."""


def corrected_name(path: Path) -> str:
    """Name of the corrected file of a cloud: plain LAZ, as a COPC orders its points by their coordinates."""
    stem = path.name[: -len(path.suffix)]
    return (stem[: -len(".copc")] if stem.lower().endswith(".copc") else stem) + ".laz"


def write_corrected_cloud(
    header: CloudHeader, file: int, rounds: Rounds, corrections: Corrections, out: Path, tick: Callable[[int], None]
) -> None:
    """Write a cloud with corrected coordinates, chunk by chunk; all other fields and records are copied.

    Parameters
    ----------
    header : CloudHeader
        Header of the cloud.
    file : int
        Its number among all clouds.
    rounds : Rounds
        All rounds.
    corrections : Corrections
        Motions of the rounds.
    out : Path
        File to write, LAZ.
    tick : callable
        Called with the number of points after each chunk.

    Raises
    ------
    FileError
        If a corrected coordinate does not fit the scale and offset of the file, or the file holds waveforms.
    """
    import laspy

    las_header, extended = _header(header.path)
    scales, offsets = np.array(las_header.scales), np.array(las_header.offsets)
    with (
        laz_as_os_error(),
        out.open("w+b") as stream,  # which laspy would leave open where a full disk stops it
        laspy.open(stream, mode="w", header=las_header, do_compress=True, closefd=False) as writer,
    ):
        for part in read_rounds(header):
            numbers = rounds.of_points(part.times, part.source_ids, file)
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
    kept = [record for record in header.vlrs if record.user_id != "copc"]
    header.vlrs = VLRList(kept)
    header.evlrs = None
    return header, extended


def corrected_trajectory(trajectory: Trajectory, rounds: Rounds, corrections: Corrections) -> Trajectory:
    """Return a trajectory of the mapping sensor, corrected like the points that it measured at the same times."""
    from scipy.spatial.transform import Rotation

    numbers = rounds.at(trajectory.times)
    positions: NDArray[np.float64] = corrections.moved(trajectory.positions, trajectory.times, numbers)
    _, _, turns = corrections.motions(trajectory.times, numbers)
    turned = Rotation.from_rotvec(turns) * Rotation.from_quat(trajectory.quaternions_xyzw)
    return Trajectory(trajectory.times, positions, turned.as_quat(), trajectory.covariances)


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory as its suffix says: TUM or CSV."""
    if path.suffix.lower() == ".csv":
        write_csv(path, trajectory)
    else:
        write_tum(path, trajectory)
