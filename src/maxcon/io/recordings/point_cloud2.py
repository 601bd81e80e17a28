# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Point clouds as recorders store them: bytes, and a description of the fields in them (sensor_msgs/PointCloud2)."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.io.point_times import TIME_FIELDS, Column, PointTimes, find_point_times
from maxcon.io.text import printable

FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Kinds of numbers by their code in sensor_msgs/PointField."""
RINGS = ("ring", "channel", "laser_id", "line", "laser_number")
"""Names under which drivers store the layer of a point."""
MAX_POINTS = 50_000_000
MIXERS = tuple(np.uint64(odd) for odd in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9))
"""Odd factors by which the bits of x, y and z are hashed."""


@dataclass(frozen=True, slots=True)
class FieldDescription:
    """One number, or a few of a kind, of each point: a sensor_msgs/PointField.

    It begins `offset` bytes from the point's first one, aligned or not; `datatype` 1 to 8 is int8, uint8, int16,
    uint16, int32, uint32, float32, float64; a `count` of 0 is read as 1, as some drivers write it.
    """

    name: str
    offset: int
    datatype: int
    count: int = 1

    @property
    def kind(self) -> str:
        """Type of the number, as NumPy names it: uint32."""
        return np.dtype(FORMATS[self.datatype]).name if self.datatype in FORMATS else "unknown"

    @property
    def end(self) -> int:
        """Where in a point's bytes it ends."""
        size = np.dtype(FORMATS[self.datatype]).itemsize if self.datatype in FORMATS else 0
        return self.offset + size * max(self.count, 1)


@dataclass(frozen=True, slots=True, eq=False)
class CloudRecord:
    """A cloud as it was recorded, nothing of it interpreted yet: a sensor_msgs/PointCloud2.

    It has `height` rows of `width` points; `point_step` and `row_step` are the bytes from one point, and one row, to
    the next, padding included; `stamp` is the time of the message, ns.
    """

    fields: tuple[FieldDescription, ...]
    width: int
    height: int
    point_step: int
    row_step: int
    is_big_endian: bool
    data: bytes | NDArray[np.uint8]
    stamp: int

    @classmethod
    def of_message(cls, content: Any, stamp: int) -> Self:
        """Return the record of a decoded message."""
        return cls(
            fields=tuple(FieldDescription(f.name, f.offset, f.datatype, f.count) for f in content.fields),
            width=content.width,
            height=content.height,
            point_step=content.point_step,
            row_step=content.row_step,
            is_big_endian=bool(content.is_bigendian),
            data=content.data,
            stamp=stamp,
        )

    @property
    def words(self) -> str:
        """Return "x float32 at 0, ring uint16 at 16" or the like."""
        return ", ".join(
            f"{printable(field.name)} {field.kind}{f'[{field.count}]' if field.count > 1 else ''} at {field.offset}"
            for field in self.fields
        )


@dataclass(frozen=True, slots=True, eq=False)
class CloudPoints:
    """The returns of a cloud: finite, not at (0, 0, 0), and each once.

    points: shape (n, 3), float64; sensor frame, m.
    times: when each was measured, and how its field of times was understood.
    rings: shape (n,), or None; layer of the scanner, where the cloud says.
    n_points, n_invalid, n_duplicates: points in the record; those at (0, 0, 0) or with coordinates that are not finite;
        of the others those with the same coordinates as one before them.
    """

    points: NDArray[np.float64]
    times: PointTimes
    rings: NDArray[np.int64] | None
    n_points: int
    n_invalid: int
    n_duplicates: int


def decode_cloud(record: CloudRecord) -> CloudPoints:
    """Return the returns of a recorded cloud, whatever its layout; ValueError if it contradicts itself."""
    coordinates, rows = _returns(record)
    n_returns = len(rows)
    coordinates = [_taken(values, rows) for values in coordinates]
    once = _first_of_each(coordinates)
    if once is not None:
        rows, coordinates = rows[once], [_taken(values, once) for values in coordinates]
    points = np.stack(coordinates, axis=1, dtype=np.float64)
    columns = _times_and_rings(record, rows)
    ring = next((columns[name][1] for name in RINGS if name in columns), None)
    n_points = record.width * record.height
    return CloudPoints(
        points=points,
        times=find_point_times(columns, record.stamp),
        rings=None if ring is None or ring.dtype.kind == "f" else ring.astype(np.int64),
        n_points=n_points,
        n_invalid=n_points - n_returns,
        n_duplicates=n_returns - len(rows),
    )


def decode_times(record: CloudRecord) -> PointTimes:
    """Return the times of the returns of a recorded cloud alone."""
    return find_point_times(_times_and_rings(record, _returns(record)[1]), record.stamp)


def _times_and_rings(record: CloudRecord, rows: NDArray[np.intp]) -> dict[str, Column]:
    """Types and values of the fields that may be times or rings, for some of the points."""
    columns = {}
    for field in record.fields:
        is_wanted = field.name.lower() in TIME_FIELDS or field.name in RINGS
        if is_wanted and field.count <= 1 and field.datatype in FORMATS:
            columns[field.name] = (field.kind, _taken(_column(record, field), rows))
    return columns


def _taken(column: NDArray[Any], rows: NDArray[np.intp]) -> NDArray[Any]:
    """The numbers of some rows; the column itself where it is all of them."""
    return column if len(rows) == len(column) else column.take(rows)


def _row_step(record: CloudRecord) -> int:
    """Bytes from row to row: a cloud of one row may leave that out, or say something else."""
    return record.point_step * record.width if record.height == 1 else record.row_step


def _check_size(record: CloudRecord) -> None:
    """Refuse fields that leave their point, points that leave their row, and fewer bytes than points."""
    width, height, step, row_step = record.width, record.height, record.point_step, _row_step(record)
    if min(width, height) < 0 or width * height > MAX_POINTS or row_step < step * width:
        raise ValueError(f"{width} x {height} points of {step} bytes in rows of {row_step}, or over {MAX_POINTS:,}")
    for field in record.fields:
        if width * height and (field.offset < 0 or field.end > step):
            at = f"at byte {field.offset} to {field.end}"
            raise ValueError(f"the field {field.name[:40]!r} {at} of the {step} bytes of a point")
    # The padding behind the last point may be missing.
    last = max((field.end for field in record.fields), default=0)
    n_needed = (height - 1) * row_step + (width - 1) * step + last if width * height else 0
    if n_needed > len(record.data):
        raise ValueError(f"{len(record.data):,} bytes of points, not {n_needed:,}")


def _coordinate_field(record: CloudRecord, axis: str) -> FieldDescription:
    """The field of x, y or z; in capitals where there is none in small letters."""
    for name in (axis, axis.upper()):
        found = [field for field in record.fields if field.name == name]
        if len(found) == 1 and found[0].count <= 1 and found[0].datatype in (7, 8):
            return found[0]
    names = ", ".join(f"{printable(field.name)} ({field.kind})" for field in record.fields)
    raise ValueError(f"not one field {axis!r} of floating-point numbers among {names[:120] or 'no fields'}")


def _column(record: CloudRecord, field: FieldDescription) -> NDArray[Any]:
    """The number of a field, of all points, row by row; shape (n,)."""
    view: NDArray[Any] = np.ndarray(
        (record.height, record.width),
        dtype=f"{'>' if record.is_big_endian else '<'}{FORMATS[field.datatype]}",
        buffer=record.data,
        offset=field.offset if record.width * record.height else 0,
        strides=(_row_step(record), record.point_step),
    )
    return np.ascontiguousarray(view, dtype=view.dtype.newbyteorder("=")).reshape(-1)


def _returns(record: CloudRecord) -> tuple[list[NDArray[Any]], NDArray[np.intp]]:
    """The columns of x, y and z, and the rows of points that are finite and not at (0, 0, 0)."""
    _check_size(record)
    x, y, z = (_column(record, _coordinate_field(record, axis)) for axis in "xyz")
    with np.errstate(over="ignore", invalid="ignore"):
        squared = x * x
        squared += y * y
        squared += z * z
        is_return = (squared > 0.0) & (squared < np.inf)
        # Squares leave the range of floats before coordinates do: what seems to be no return is checked exactly.
        rows = np.flatnonzero(~is_return)
        places = np.stack([x[rows], y[rows], z[rows]], axis=1)
        is_return[rows] = np.isfinite(places).all(axis=1) & places.any(axis=1)
    return [x, y, z], np.flatnonzero(is_return)


def _first_of_each(coordinates: list[NDArray[np.floating]]) -> NDArray[np.intp] | None:
    """Rows of the first point at each place, in order; None where no place comes twice."""
    # + 0.0 makes -0.0 equal to 0.0. The bits of coordinates are hashed by MIXERS; those of float32 alone would leave
    # the lower half of a product empty.
    whole = [values + values.dtype.type(0.0) for values in coordinates]
    bits = [values.view(f"u{values.dtype.itemsize}").astype(np.uint64) for values in whole]
    keys = np.zeros(len(whole[0]), np.uint64)
    for number, mixer in zip(bits, MIXERS, strict=True):
        keys ^= number
        keys *= mixer
        keys ^= keys >> np.uint64(29)
    in_order = np.sort(keys)
    if not (in_order[1:] == in_order[:-1]).any():
        return None
    order = np.argsort(keys, kind="stable")
    is_same = np.r_[False, keys[order[1:]] == keys[order[:-1]]]
    repeated = np.flatnonzero(is_same)
    if any((number[order[repeated]] != number[order[repeated - 1]]).any() for number in bits):
        # Two different points have the same hash: compare coordinates instead.
        order = np.unique(np.stack(whole, axis=1), axis=0, return_index=True)[1]
        return np.sort(order)
    return np.sort(order[~is_same])
