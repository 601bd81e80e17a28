"""Points as drivers of scanners and PCD files store them: arrays of records, which fields are understood, and how."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.io.text import printable

FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # by codes of PointField
RINGS = ("ring", "channel", "laser_id", "line", "laser_number")  # names under which drivers store the layer of a point
MAX_POINTS, MAX_BYTES = 50_000_000, 2**20  # of a cloud, of one point: NumPy counts the bytes of a record in 32 bits
MIXERS = tuple(np.uint64(odd) for odd in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9))
PAIRS = (("time_sec", "time_nsec"), ("sec", "nsec"), ("timestampsec", "timestampnsec"))
NAMES = ("timestamp", "time_stamp", "timestamps", "time", "times", "t", "offset_time", "time_offset", "t_offset")
TIME_FIELDS = frozenset([*NAMES, *(name for pair in PAIRS for name in pair)])  # all of these, in small letters
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # nanoseconds of each unit
UNIT_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
LONGEST, SHORTEST = 2 * 10**9, 10**6  # a scan, ns: some scanners turn once in a second, some drivers send each packet
SAME_CLOCK = 60 * 10**9  # absolute times nearer to the message's, ns, are on its clock; a scanner's may be seconds off


@dataclass(frozen=True, slots=True, eq=False)
class PointTimes:
    """When the points of a scan were measured."""

    offsets: NDArray[np.float64] | None  # (n,), s after the time of the message; None where no field makes sense
    kind: str  # field, unit and reference of the times, without figures: usually the same for all scans of a recording
    words: str  # the same with the figures of this scan that speak for it

    @property
    def middle(self) -> float:
        """Half-way between the first and the last point, from the time of the message, s; 0 where not known."""
        if self.offsets is None or len(self.offsets) == 0:
            return 0.0
        return float(self.offsets.min() + self.offsets.max()) / 2.0


class CloudPoints(NamedTuple):
    """The returns of a cloud: finite, not at (0, 0, 0), and each once."""

    points: NDArray[np.float64]  # shape (n, 3), float64; sensor frame, m
    times: PointTimes  # when each was measured, and how its field of times was understood
    rings: NDArray[np.int64] | None  # shape (n,), or None; layer of the scanner, where the cloud says
    n_points: int  # in the record
    n_invalid: int  # at (0, 0, 0), or not finite
    n_duplicates: int  # of the others: at the place of one before them
    fields: str = ""  # names and types of all fields of a point, where the cloud tells them


def record_type(names: Sequence[str], kinds: Sequence[Any], offsets: Sequence[int] | None = None) -> np.dtype[np.void]:
    """Return the type of one point, with fields one behind the other or at offsets; a name given again is "x#2"."""
    seen: Counter[str] = Counter()
    unique = []
    for name in names:
        seen[name] += 1
        unique.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    if offsets is None:
        return np.dtype(list(zip(unique, kinds, strict=True)))
    return np.dtype({"names": unique, "formats": list(kinds), "offsets": list(offsets)})


def records_of_message(content: Any) -> NDArray[np.void]:
    """Return the points of a sensor_msgs/PointCloud2, shape (height, width); ValueError if it contradicts itself."""
    width, height, step = content.width, content.height, content.point_step
    order = ">" if content.is_bigendian else "<"
    known = [field for field in content.fields if field.datatype in FORMATS]
    if any(field.offset + 8 * field.count > MAX_BYTES for field in known):
        raise ValueError(f"fields beyond byte {MAX_BYTES:,} of a point")
    # Some drivers write a count of 0 for a single number.
    kinds = [f"{f'({field.count},)' if field.count > 1 else ''}{order}{FORMATS[field.datatype]}" for field in known]
    dtype = record_type([field.name for field in known], kinds, [field.offset for field in known])
    coordinate_fields(dtype)
    # A cloud of one row may leave out its length, or say something else.
    row_step = step * width if height == 1 else content.row_step
    if not 0 <= width * height <= MAX_POINTS or min(width, height) < 0 or row_step < step * width:
        raise ValueError(f"{width} x {height} points of {step} bytes in rows of {row_step}, or over {MAX_POINTS:,}")
    if width * height == 0:
        return np.empty((0, 0), dtype)
    if dtype.itemsize > step:
        raise ValueError(f"fields up to byte {dtype.itemsize} of the {step} bytes of a point")
    return np.ndarray((height, width), dtype, content.data, strides=(row_step, step))


def words_of(dtype: np.dtype[np.void]) -> str:
    """Return "x float32 at 0, ring uint16 at 16" or the like."""
    fields: Any = dtype.fields
    places = ((name, *fields[name][:2]) for name in dtype.names or ())
    return ", ".join(
        f"{printable(name)} {kind.base.name}{''.join(f'[{n}]' for n in kind.shape)} at {offset}"
        for name, kind, offset in places
    )


def coordinate_fields(dtype: np.dtype[np.void], kinds: str = "f", axes: Sequence[str] = "xyz") -> list[str]:
    """Return the names of the fields of three coordinates, or their capitals; ValueError where one is none."""
    names = dtype.names or ()
    found = [axis if axis in names else axis.upper() for axis in axes]
    for name in found:
        if name not in names or f"{name}#2" in names or dtype[name].kind not in kinds:
            raise ValueError(f"not one field {name.lower()!r} of numbers among {words_of(dtype)[:120] or 'no fields'}")
    return found


def times_and_rings(records: NDArray[np.void], rows: NDArray[np.intp] | None = None) -> dict[str, NDArray[Any]]:
    """Return the fields that may be times or rings by their names, for some of the points."""
    wanted = [name for name in records.dtype.names or () if name.lower() in TIME_FIELDS or name in RINGS]
    return {name: _taken(_column(records, name), rows) for name in wanted if not records.dtype[name].shape}


def decode_points(records: NDArray[np.void], stamp: int) -> CloudPoints:
    """Return the returns of a cloud whose message has the time `stamp`, ns."""
    coordinates, rows = _returns(records)
    n_returns = len(rows)
    coordinates = [_taken(values, rows) for values in coordinates]
    once = _first_of_each(coordinates)
    if once is not None:
        rows, coordinates = rows[once], [_taken(values, once) for values in coordinates]
    columns = times_and_rings(records, rows)
    ring = next((columns[name] for name in RINGS if name in columns), None)
    rings = None if ring is None or ring.dtype.kind == "f" else ring.astype(np.int64)
    points, times = np.stack(coordinates, axis=1, dtype=np.float64), find_point_times(columns, stamp)
    counts = records.size, records.size - n_returns, n_returns - len(rows)
    return CloudPoints(points, times, rings, *counts, words_of(records.dtype))


def decode_times(records: NDArray[np.void], stamp: int) -> PointTimes:
    """Return the times of the returns alone."""
    return find_point_times(times_and_rings(records, _returns(records)[1]), stamp)


def _column(records: NDArray[np.void], name: str) -> NDArray[Any]:
    """The numbers of a field, of all points, row by row; shape (n,), in the order of bytes of this machine."""
    return np.ascontiguousarray(records[name], records.dtype[name].newbyteorder("=")).reshape(-1)


def _taken(column: NDArray[Any], rows: NDArray[np.intp] | None) -> NDArray[Any]:
    """The numbers of some rows; the column itself where it is all of them."""
    return column if rows is None or len(rows) == len(column) else column.take(rows)


def _returns(records: NDArray[np.void]) -> tuple[list[NDArray[Any]], NDArray[np.intp]]:
    """The columns of x, y and z, and the rows of points that are finite and not at (0, 0, 0)."""
    x, y, z = (_column(records, name) for name in coordinate_fields(records.dtype))
    return [x, y, z], np.flatnonzero(are_returns(x, y, z))


def are_returns(x: NDArray[np.floating], y: NDArray[np.floating], z: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which points are finite and not at (0, 0, 0), shape (n,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        squared = x * x
        squared += y * y
        squared += z * z
    is_return = (squared > 0.0) & (squared < np.inf)
    # Squares leave the range of floats before coordinates do: what seems to be no return is checked exactly.
    rows = np.flatnonzero(~is_return)
    places = np.stack([x[rows], y[rows], z[rows]], axis=1)
    is_return[rows] = np.isfinite(places).all(axis=1) & places.any(axis=1)
    return is_return


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


def find_point_times(columns: Mapping[str, NDArray[np.generic]], stamp: int) -> PointTimes:
    """Return when the returns of a scan were measured: columns are the values of fields, stamp the message's time, ns.

    A unit is right if the scan then lasts between 1 ms and 2 s; times near the message's are absolute ones. Where
    several units are possible, floating-point numbers are in the largest, integers in the smallest of them.
    """
    names = {name.lower(): name for name in reversed(list(columns))}
    pair = next(([names[name] for name in pair] for pair in PAIRS if set(pair) <= set(names)), None)
    name = next((names[name] for name in NAMES if name in names), None)
    if pair is not None:
        label = " + ".join(pair)
        values = columns[pair[0]]
    elif name is not None:
        label = f"{name} ({columns[name].dtype.name})"
        values = columns[name]
    else:
        return PointTimes(None, "no field", "the points have no field of times")
    if not len(values):
        return PointTimes(np.empty(0), label, f"{label}: no points")
    return _of_field(label, values, stamp) if pair is None else _of_pair(label, values, columns[pair[1]], stamp)


def _of_pair(label: str, seconds: NDArray[np.generic], nanoseconds: NDArray[np.generic], stamp: int) -> PointTimes:
    # A float64 of seconds since 1970 has steps of 0.2 us; whole seconds less those of the message are exact.
    whole, begin = divmod(stamp, 10**9)
    offsets = (seconds.astype(np.float64) - whole) + (nanoseconds.astype(np.float64) - begin) * 1e-9
    span = float(np.ptp(offsets))
    if not 0.0 < span * 1e9 <= LONGEST:
        return _not_understood(label, f"they last {span:.6g} s")
    return _absolute(label, "s + ns", f"seconds and nanoseconds, last {span:.6f} s", offsets)


def _of_field(label: str, values: NDArray[np.generic], stamp: int) -> PointTimes:
    low, high = values.min(), values.max()
    is_float = values.dtype.kind == "f"
    if is_float and not (np.isfinite(low) and np.isfinite(high)):
        return _not_understood(label, "some are NaN or infinite")
    if low == high:
        return _not_understood(label, f"all are {low}")
    # Differences of integers are exact, also where float64 would round the integers themselves.
    exact = (values.astype(np.float64 if is_float else np.int64) - low.item()).astype(np.float64)
    span, begin = float(exact.max()), float(low.item())
    unit = _unit(begin, span, stamp, is_float=is_float)
    if unit is None:
        return _not_understood(label, f"they range over {span:.6g}: between 1 ms and 2 s in no unit")
    scale = UNITS[unit] * 1e-9
    offsets, begin_seconds = exact * scale, begin * scale
    if is_float:
        first = (float(low) * scale - stamp // 10**9) - stamp % 10**9 * 1e-9
    else:
        first = (int(low) * UNITS[unit] - stamp) * 1e-9
    words = f"{UNIT_WORDS[unit]}, as they range over {span:.6g}"
    if abs(first) <= SAME_CLOCK * 1e-9 < abs(begin_seconds):
        return _absolute(label, f"{unit}, absolute", words, first + offsets)
    if abs(begin_seconds) <= LONGEST * 1e-9:
        offsets = begin_seconds + offsets
        where = f"{offsets.min():+.6f} to {offsets.max():+.6f} s"
        return _told(label, offsets, f"{unit}, relative", f"{words}; from the message's time: {where}")
    told = f"{words}; they begin at {begin_seconds:.6g} s, far from the message's {stamp * 1e-9:.6g} s"
    told += ": another clock (since boot?), so that the message's time is held for the first point's"
    return _told(label, offsets, f"{unit}, of another clock (since boot?)", told)


def _unit(begin: float, span: float, stamp: int, *, is_float: bool) -> str | None:
    """The unit in which times are near that of the message, or a scan lasts as long as it may."""
    for name, unit in UNITS.items():
        is_near = abs(begin * unit - stamp) <= SAME_CLOCK < abs(begin) * unit
        if is_near and span * unit <= LONGEST:
            return name
    possible = [name for name, unit in UNITS.items() if SHORTEST <= span * unit <= LONGEST]
    if not possible:
        return None
    return possible[0] if is_float else possible[-1]


def _absolute(label: str, kind: str, words: str, offsets: NDArray[np.float64]) -> PointTimes:
    """Absolute times, on the clock of the message."""
    if abs(float(offsets[0])) > SAME_CLOCK * 1e-9:
        begin = f"they begin {float(offsets.min()):.6g} s from the message's time: another clock, so that the message's"
        told = f"{words}; {begin} time is held for the first point's"
        return _told(label, offsets - offsets.min(), f"{kind}, of another clock", told)
    span = float(np.ptp(offsets))
    ends = "last" if abs(offsets.max()) < 0.1 * span else "first" if abs(offsets.min()) < 0.1 * span else ""
    beside = f"; the message has the time of the {ends} point" if ends else ""
    where = f"{offsets.min():+.6f} to {offsets.max():+.6f} s from it{beside}"
    kind = kind if "absolute" in kind else f"{kind}, absolute"
    return _told(label, offsets, kind, f"{words}, and lie near the message's time: {where}")


def _not_understood(label: str, why: str) -> PointTimes:
    return _told(label, None, "not understood", f"not understood, as {why}")


def _told(label: str, offsets: NDArray[np.float64] | None, kind: str, words: str) -> PointTimes:
    return PointTimes(offsets, f"{label}: {kind}", f"{label}: {words}")
