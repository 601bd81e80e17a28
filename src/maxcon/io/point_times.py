# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""When each point of a scan was measured: which field says so, in which unit, counted from when, and why."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PAIRS = (("time_sec", "time_nsec"), ("sec", "nsec"), ("timestampsec", "timestampnsec"))
"""Fields that hold seconds, and the nanoseconds to add."""
NAMES = ("timestamp", "time_stamp", "timestamps", "time", "times", "t", "offset_time", "time_offset", "t_offset")
"""Fields that hold a time, in small letters; the first of these that is there is taken."""
TIME_FIELDS = frozenset([*NAMES, *(name for pair in PAIRS for name in pair)])  # all of these, in small letters
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # nanoseconds of each unit
UNIT_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
LONGEST, SHORTEST = 2 * 10**9, 10**6
"""Between the first and the last point of a scan, ns: some scanners turn once in a second, some drivers pass on every
packet, of about a millisecond."""
SAME_CLOCK = 60 * 10**9
"""Absolute times nearer to the message's, ns, are on its clock; a scanner's own may be off by seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class PointTimes:
    """When the points of a scan were measured."""

    # Shape (n,), float64, or None; from the time of the message to that of each point, s; None where no field tells, or
    # its values make no sense
    offsets: NDArray[np.float64] | None
    kind: str  # field, unit and reference of the times, without figures: usually the same for all scans of a recording
    words: str  # the same with the figures of this scan that speak for it

    @property
    def middle(self) -> float:
        """Half-way between the first and the last point, from the time of the message, s; 0 where not known."""
        if self.offsets is None or len(self.offsets) == 0:
            return 0.0
        return float(self.offsets.min() + self.offsets.max()) / 2.0


def find_point_times(columns: Mapping[str, NDArray[np.generic]], stamp: int) -> PointTimes:
    """Return the times of the points of a scan.

    columns: shape (n,); values of each field, for the points that are returns.
    stamp: time of the message, ns.

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
        return PointTimes(offsets, f"{label}: {unit}, relative", f"{label}: {words}; from the message's time: {where}")
    told = f"{words}; they begin at {begin_seconds:.6g} s, far from the message's {stamp * 1e-9:.6g} s"
    return PointTimes(
        offsets,
        f"{label}: {unit}, of another clock (since boot?)",
        f"{label}: {told}: another clock (since boot?), so that the message's time is held for the first point's",
    )


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
        return PointTimes(
            offsets - offsets.min(),
            f"{label}: {kind}, of another clock",
            f"{label}: {words}; they begin {float(offsets.min()):.6g} s from the message's time: another clock, so that"
            " the message's time is held for the first point's",
        )
    span = float(np.ptp(offsets))
    ends = "last" if abs(offsets.max()) < 0.1 * span else "first" if abs(offsets.min()) < 0.1 * span else ""
    beside = f"; the message has the time of the {ends} point" if ends else ""
    return PointTimes(
        offsets,
        f"{label}: {kind}" if "absolute" in kind else f"{label}: {kind}, absolute",
        f"{label}: {words}, and lie near the message's time: {offsets.min():+.6f} to {offsets.max():+.6f} s from it"
        f"{beside}",
    )


def _not_understood(label: str, why: str) -> PointTimes:
    return PointTimes(None, f"{label}: not understood", f"{label}: not understood, as {why}")
