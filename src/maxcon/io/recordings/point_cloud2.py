# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Point clouds as recorders store them: bytes, and a description of the fields in them (sensor_msgs/PointCloud2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.recordings.point_times import TIME_FIELDS, PointTimes, find_point_times

__all__ = ["CloudPoints", "CloudRecord", "FieldDescription", "decode_cloud", "fields_in_words"]

FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Kinds of numbers by their code in sensor_msgs/PointField."""
RINGS = ("ring", "channel", "laser_id", "line", "laser_number")
"""Names under which drivers store the layer of a point."""
MAX_POINTS = 50_000_000
MIXERS = tuple(np.uint64(odd) for odd in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9))


@dataclass(frozen=True, slots=True)
class FieldDescription:
    """One number, or a few of a kind, of each point.

    Parameters
    ----------
    name : str
        Such as x, intensity or timestamp.
    offset : int
        Where in a point's bytes it begins; it need not be aligned.
    datatype : int
        1 to 8: int8, uint8, int16, uint16, int32, uint32, float32, float64.
    count : int
        How many such numbers; 0 is read as 1, as some drivers write it.
    """

    name: str
    offset: int
    datatype: int
    count: int = 1

    @property
    def kind(self) -> str:
        """Type of the number, as NumPy names it: uint32."""
        return np.dtype(FORMATS[self.datatype]).name if self.datatype in FORMATS else "unknown"


@dataclass(frozen=True, slots=True, eq=False)
class CloudRecord:
    """A cloud as it was recorded, nothing of it interpreted yet.

    Parameters
    ----------
    fields : tuple of FieldDescription
        What each point holds.
    width, height : int
        Points in a row, and rows; one row if the cloud is not organized.
    point_step, row_step : int
        Bytes from one point to the next, and from one row to the next; more than their fields take where there is
        padding.
    is_big_endian : bool
        Order of the bytes of a number.
    data : bytes or array of uint8
        The rows.
    stamp : int
        Time of the message, ns.
    """

    fields: tuple[FieldDescription, ...]
    width: int
    height: int
    point_step: int
    row_step: int
    is_big_endian: bool
    data: bytes | NDArray[np.uint8]
    stamp: int


@dataclass(frozen=True, slots=True, eq=False)
class CloudPoints:
    """The returns of a cloud: finite, not at (0, 0, 0), and each once.

    Parameters
    ----------
    points : array, shape (n, 3), float64
        Sensor frame, m.
    times : PointTimes
        When each was measured, and how that was understood.
    rings : array, shape (n,), or None
        Layer of the scanner, where the cloud says.
    n_points : int
        Points in the record.
    n_invalid : int
        Of these at (0, 0, 0), or with coordinates that are not finite.
    n_duplicates : int
        Of the others those at the very place of one before them.
    """

    points: NDArray[np.float64]
    times: PointTimes
    rings: NDArray[np.int64] | None
    n_points: int
    n_invalid: int
    n_duplicates: int


def decode_cloud(record: CloudRecord) -> CloudPoints:
    """Return the returns of a recorded cloud, whatever its layout.

    Raises
    ------
    FileError
        If x, y or z is missing, a field does not fit into its point, or there are fewer bytes than points.
    """
    layout = _Layout.of(record)
    points = np.stack([layout.column(layout.coordinate(axis)).astype(np.float64) for axis in "xyz"], axis=1)
    kept, n_invalid = _returns(points)
    once = _first_of_each(points[kept])
    rows = kept if once is None else kept[once]
    wanted = [field for field in record.fields if field.count <= 1 and field.datatype in FORMATS]
    columns = {
        field.name: (field.kind, layout.column(field)[rows])
        for field in wanted
        if field.name.lower() in TIME_FIELDS or field.name in RINGS
    }
    ring = next((columns[name][1] for name in RINGS if name in columns), None)
    return CloudPoints(
        points=points[rows],
        times=find_point_times(columns, record.stamp),
        rings=None if ring is None or ring.dtype.kind == "f" else ring.astype(np.int64),
        n_points=len(points),
        n_invalid=n_invalid,
        n_duplicates=len(kept) - len(rows),
    )


def _refuse(expected: str, got: str) -> FileError:
    return FileError(f"Expected a point cloud with {expected}, got {got}. Was it recorded whole?")


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """Where the numbers of a record lie; checked against its bytes."""

    record: CloudRecord
    row_step: int

    @classmethod
    def of(cls, record: CloudRecord) -> "_Layout":
        n_points = record.width * record.height
        if min(record.width, record.height) < 0 or n_points > MAX_POINTS:
            raise _refuse(f"at most {MAX_POINTS:,} points", f"{record.width} x {record.height}")
        # A cloud of one row may leave out the length of rows, or say something else.
        row_step = record.point_step * record.width if record.height == 1 else record.row_step
        if row_step < record.point_step * record.width:
            raise _refuse(
                f"rows of {record.width} points of {record.point_step} bytes", f"rows of {row_step} bytes"
            )
        layout = cls(record, row_step)
        if n_points and (n_needed := layout._n_needed()) > len(record.data):
            raise _refuse(f"{n_needed:,} bytes of points", f"{len(record.data):,}")
        return layout

    def _n_needed(self) -> int:
        """Bytes up to the end of the last field of the last point; the padding behind it may be missing."""
        record = self.record
        ends = [0]
        for field in record.fields:
            size = np.dtype(FORMATS[field.datatype]).itemsize if field.datatype in FORMATS else 0
            ends.append(field.offset + size * max(field.count, 1))
            if field.offset < 0 or ends[-1] > record.point_step:
                raise _refuse(
                    f"the field {field.name!r} within the {record.point_step} bytes of a point",
                    f"it at byte {field.offset} to {ends[-1]}",
                )
        return (record.height - 1) * self.row_step + (record.width - 1) * record.point_step + max(ends)

    def coordinate(self, axis: str) -> FieldDescription:
        """The field of x, y or z; in capitals where there is none in small letters."""
        for name in (axis, axis.upper()):
            found = [field for field in self.record.fields if field.name == name]
            if len(found) == 1 and found[0].count <= 1 and found[0].datatype in (7, 8):
                return found[0]
        names = ", ".join(f"{field.name} ({field.kind})" for field in self.record.fields)
        raise _refuse(f"one field {axis!r} of floating-point numbers", names[:120] or "no fields")

    def column(self, field: FieldDescription) -> NDArray[np.generic]:
        """The number of a field, of all points, row by row; shape (n,)."""
        record = self.record
        order = ">" if record.is_big_endian else "<"
        view: NDArray[np.generic] = np.ndarray(
            (record.height, record.width),
            dtype=f"{order}{FORMATS[field.datatype]}",
            buffer=record.data,
            offset=field.offset if record.width * record.height else 0,
            strides=(self.row_step, record.point_step),
        )
        return view.astype(view.dtype.newbyteorder("=")).reshape(-1)


def _returns(points: NDArray[np.float64]) -> tuple[NDArray[np.intp], int]:
    """Rows of points that are finite and not at (0, 0, 0), and how many are not."""
    is_return = np.isfinite(points).all(axis=1) & (points != 0.0).any(axis=1)
    rows = np.flatnonzero(is_return)
    return rows, len(points) - len(rows)


def _first_of_each(points: NDArray[np.float64]) -> NDArray[np.intp] | None:
    """Rows of the first point at each place, in order; None where no place comes twice."""
    bits = (points + 0.0).view(np.uint64)  # + 0.0: -0.0 is at the same place
    mixed = bits ^ (
        bits >> np.uint64(31)
    )  # float32 leaves the lower bits empty, and products never reach them
    keys = mixed[:, 0] * MIXERS[0] ^ mixed[:, 1] * MIXERS[1] ^ mixed[:, 2] * MIXERS[2]
    in_order = np.sort(keys)
    if not (in_order[1:] == in_order[:-1]).any():
        return None
    order = np.argsort(keys, kind="stable")
    is_same = np.r_[False, keys[order[1:]] == keys[order[:-1]]]
    repeated = np.flatnonzero(is_same)
    if (bits[order[repeated]] != bits[order[repeated - 1]]).any():  # two places with one key
        order = np.unique(points, axis=0, return_index=True)[1]
        return np.sort(order)
    return np.sort(order[~is_same])


def fields_in_words(fields: Sequence[FieldDescription]) -> str:
    """Return "x float32 at 0, ring uint16 at 16" or the like."""
    return ", ".join(
        f"{field.name} {field.kind}{f'[{field.count}]' if field.count > 1 else ''} at {field.offset}"
        for field in fields
    )
