"""Clouds of any layout: what was put into the bytes comes out of them, and times are understood."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.io.point_records import FORMATS, decode_points, find_point_times, records_of_message

CODES = {name: code for code, name in FORMATS.items()}
STAMP = 1_714_506_077_250_967_979


def _points(n, rng):
    """Returns at different places, as float32 can hold them."""
    points = rng.uniform(-80.0, 80.0, (n, 3)).astype(np.float32).astype(np.float64)
    points[:, 0] += np.arange(n)
    return points.astype(np.float32).astype(np.float64)


def field(name, offset, datatype, count=0):
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


def decoded(message, **changes):
    return decode_points(records_of_message(SimpleNamespace(**vars(message) | changes)), STAMP)


def _packed(columns, *, order, gaps, tail, height, row_padding, rng):
    """Put columns (name, type, values) into bytes, with gaps before the fields and padding behind points and rows."""
    n = len(columns[0][2])
    fields, offset = [], 0
    for (name, kind, _), gap in zip(columns, gaps, strict=True):
        offset += gap
        fields.append(field(name, offset, CODES[kind]))
        offset += np.dtype(kind).itemsize
    step = offset + tail
    data = rng.integers(0, 256, (n, step), dtype=np.uint8)
    for one, (_, kind, values) in zip(fields, columns, strict=True):
        cast = np.asarray(values).astype(f"{order}{kind}")
        size = cast.dtype.itemsize
        data[:, one.offset : one.offset + size] = cast.view(np.uint8).reshape(n, size)
    width = n // height
    rows = rng.integers(0, 256, (height, width * step + row_padding), dtype=np.uint8)
    rows[:, : width * step] = data.reshape(height, width * step)
    return SimpleNamespace(
        fields=fields, width=width, height=height, point_step=step, row_step=rows.shape[1],
        is_bigendian=order == ">", data=rows.tobytes(),
    )  # fmt: skip


TIMES = {
    "absolute float64 s": ("timestamp", "f8", lambda t: STAMP * 1e-9 + t),
    "absolute float64 ns": ("timestamp", "f8", lambda t: float(STAMP) + t * 1e9),
    "relative float32 s": ("time", "f4", lambda t: t),
    "relative float32 s, to the last": ("time", "f4", lambda t: t - 0.1),
    "relative float32 ms": ("t", "f4", lambda t: t * 1e3),
    "relative uint32 ns": ("t", "u4", lambda t: np.rint(t * 1e9)),
    "relative uint32 us": ("offset_time", "u4", lambda t: np.rint(t * 1e6)),
    "relative int32 ns, to the last": ("t", "i4", lambda t: np.rint((t - 0.1) * 1e9)),
}
# Steps of the numbers: a float64 of 1.7e18 ns or of 1.7e9 s, a float32 of 100 ms, a microsecond.
STEPS = {"absolute float64 s": 5e-7, "absolute float64 ns": 6e-7, "relative uint32 us": 1e-6}


@st.composite
def layouts(draw):
    """Everything but the points: order of fields and bytes, gaps, padding, rows, what else is stored, how times are."""
    return dict(
        seed=draw(st.integers(0, 2**32 - 1)), order=draw(st.sampled_from("<>")),
        coordinate=draw(st.sampled_from(["f4", "f8"])), capitals=draw(st.booleans()),
        times=draw(st.sampled_from([None, *TIMES])), ring=draw(st.sampled_from([None, "u1", "u2", "i4"])),
        gaps=draw(st.lists(st.integers(0, 9), min_size=9, max_size=9)), tail=draw(st.integers(0, 7)),
        height=draw(st.sampled_from([1, 1, 4, 16])), row_padding=draw(st.integers(0, 40)),
        n_nan=draw(st.integers(0, 5)), n_zero=draw(st.integers(0, 5)), n_twice=draw(st.integers(0, 5)),
    )  # fmt: skip


@given(layout=layouts())
def test_what_is_packed_in_any_layout_comes_out(layout):
    rng = np.random.default_rng(layout["seed"])
    n = 64
    points, times, rings = _points(n, rng), np.linspace(0.0, 0.1, n), rng.integers(0, 100, n)
    stored = points.copy()
    spoiled = rng.permutation(np.arange(1, n - 1))
    bad = spoiled[: layout["n_nan"] + layout["n_zero"]]
    stored[bad[: layout["n_nan"]], rng.integers(0, 3, layout["n_nan"])] = rng.choice([np.nan, np.inf, -np.inf])
    stored[bad[layout["n_nan"] :]] = rng.choice([0.0, -0.0])
    twice = spoiled[len(bad) : len(bad) + layout["n_twice"]]
    stored[twice] = stored[0]
    names = "XYZ" if layout["capitals"] else "xyz"
    columns = [(name, layout["coordinate"], stored[:, axis]) for axis, name in enumerate(names)]
    columns.append(("intensity", "f4", rng.uniform(0, 1, n)))
    if layout["times"]:
        name, kind, write = TIMES[layout["times"]]
        columns.append((name, kind, write(times)))
    if layout["ring"]:
        columns.append(("ring", layout["ring"], rings))
    columns = [columns[i] for i in rng.permutation(len(columns))]
    record = _packed(
        columns, order=layout["order"], gaps=layout["gaps"][: len(columns)], tail=layout["tail"],
        height=layout["height"], row_padding=layout["row_padding"] if layout["height"] > 1 else 0, rng=rng,
    )  # fmt: skip
    cloud = decoded(record)
    kept = np.setdiff1d(np.arange(n), np.concatenate([bad, twice]))
    assert (cloud.n_points, cloud.n_invalid, cloud.n_duplicates) == (n, len(bad), len(twice))
    np.testing.assert_array_equal(cloud.points, points[kept])
    if layout["ring"]:
        np.testing.assert_array_equal(cloud.rings, rings[kept])
    if not layout["times"]:
        assert cloud.times.offsets is None
        return
    wanted = times[kept] - (0.1 if "to the last" in layout["times"] else 0.0)
    tolerance = STEPS.get(layout["times"], 2e-8)
    np.testing.assert_allclose(cloud.times.offsets, wanted, atol=tolerance, rtol=0, err_msg=cloud.times.words)


def _columns(**columns):
    return {name: np.asarray(values) for name, values in columns.items()}


def test_seconds_and_nanoseconds_in_two_fields_are_exact():
    nanoseconds = STAMP + np.arange(-87_000_000, 1, 1_000_000)
    columns = _columns(time_sec=(nanoseconds // 10**9).astype("u4"), time_nsec=(nanoseconds % 10**9).astype("u4"))
    times = find_point_times(columns, STAMP)
    np.testing.assert_allclose(times.offsets, (nanoseconds - STAMP) * 1e-9, atol=1e-15)
    assert "absolute" in times.kind and "time of the last point" in times.words
    assert times.middle == pytest.approx(-0.0435)


@pytest.mark.parametrize(("times", "stamp", "first", "words"), [
    (np.arange(3_500_000_000, 3_600_000_000, 10**6).astype("u4"), STAMP, 0.0, ("another clock", "nanoseconds")),
    (STAMP * 1e-9 + 3.0 + np.linspace(0, 0.1, 50), STAMP, 3.0, ("lie near the message's time",)),
    (np.linspace(0, 1e8, 50).astype("u4"), 100 * 10**9, 0.0, ("from the message's time: +0.000000 to +0.1",)),
], ids=["since boot", "a clock that is 3 s off", "a simulated clock"])  # fmt: skip
def test_clocks_that_times_count_on(times, stamp, first, words):
    found = find_point_times(_columns(t=times), stamp)
    assert found.offsets.min() == pytest.approx(first, abs=1e-6)
    assert np.ptp(found.offsets) == pytest.approx(0.1, abs=1.1e-3)
    assert all(part in found.words for part in words)


@pytest.mark.parametrize("values", [
    np.zeros(10, "f4"), np.full(10, 1.7e9, "f4"), np.array([0.0, np.nan, 0.1], "f8"), np.array([0.0, 1e30], "f8"),
    np.array([0.0, math.inf], "f8"), np.array([0.0, 5e-4], "f8"),
], ids=["zeros", "too coarse", "NaN", "too long", "infinite", "too short"])  # fmt: skip
def test_times_that_make_no_sense_are_not_taken(values):
    times = find_point_times(_columns(time=values), STAMP)
    assert times.offsets is None and "not understood" in times.words
    assert times.middle == 0.0


def _simple(n=10):
    rng = np.random.default_rng(0)
    columns = [(name, "f4", column) for name, column in zip("xyz", _points(n, rng).T, strict=True)]
    return _packed(columns, order="<", gaps=[0, 0, 0], tail=4, height=1, row_padding=0, rng=rng)


def test_one_row_may_leave_out_its_length_and_the_last_padding_and_a_cloud_its_points():
    record = _simple()
    whole = decoded(record)
    bare = decoded(record, row_step=0, data=record.data[:-4])
    np.testing.assert_array_equal(bare.points, whole.points)
    assert find_point_times(_columns(t=np.empty(0, "u4")), STAMP).middle == 0.0
    assert find_point_times(_columns(intensity=np.zeros(3)), STAMP).kind == "no field"
    cloud = decoded(record, width=0, data=b"", row_step=0)
    assert cloud.points.shape == (0, 3) and cloud.n_points == 0


@pytest.mark.parametrize(("change", "words"), [
    (dict(data=b"\0" * 100), "strides is incompatible"), (dict(width=2**31, height=2**31), "or over 50,000,000"),
    (dict(width=-1), "-1 x 1 points"), (dict(width=5, height=2, row_step=3), "in rows of 3"),
    (dict(point_step=10), "of the 10 bytes"), (dict(fields=()), "one field 'x'"),
    (dict(fields=(field("x", 0, 6), field("y", 4, 7))), "x uint32"),
    (dict(fields=(*_simple().fields, field("x", 12, 7))), "one field 'x'"),
    (dict(fields=(*_simple().fields, field("t", 2**31 - 1, 7))), "fields beyond byte 1,048,576"),
    (dict(fields=(field("x", 0, 7, 2**20), *_simple().fields[1:])), "fields beyond byte 1,048,576"),
    (dict(fields=(field("x", 0, 99), *_simple().fields[1:])), "one field 'x'"),
])  # fmt: skip
def test_what_contradicts_itself_is_refused(change, words):
    with pytest.raises((ValueError, TypeError), match=re.escape(words)):
        decoded(_simple(), **change)
