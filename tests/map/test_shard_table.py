# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The index of a section: it comes back as it was, and bytes that are no index are refused."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon.map.manifest import ShardFile, ShardTable
from written_maps import table_of

FILES = tuple(ShardFile(f"tiles/{number}", 10_000) for number in range(3))
ROWS = st.lists(
    st.tuples(
        st.tuples(st.integers(-(2**21), 2**21), st.integers(-(2**21), 2**21)),
        st.integers(0, 10_000), st.integers(0, 2**61),
        st.integers(0, 2), st.integers(0, 5000), st.integers(1, 5000), st.binary(min_size=32, max_size=32),
    ),
    max_size=40, unique_by=lambda row: row[0],
)  # fmt: skip


@given(ROWS, st.binary(max_size=50))
def test_what_is_written_is_what_is_read(rows, schema):
    table = ShardTable.of_rows(schema, FILES, rows)
    again = ShardTable.from_bytes(table.to_bytes(), FILES)
    assert again == table
    assert len(again) == len(rows)
    by_key = again.rows_by_key()
    for row in rows:
        at = by_key[row[0]]
        got = (again.n_rows[at], again.n_points[at], again.shards[at], again.offsets[at], again.lengths[at])
        assert got == row[1:6]
        assert again.checksums[at].tobytes() == row[6]


def test_the_order_of_rows_does_not_matter():
    rows = [((x, y), 1, 1, 0, 0, 1, bytes([x, y] * 16)) for x in range(4) for y in range(4)]
    assert ShardTable.of_rows(b"", FILES, rows[::-1]) == ShardTable.of_rows(b"", FILES, rows)


def test_tables_that_differ_are_not_equal():
    table = table_of(3)
    assert table != table_of(4)
    assert table != table_of(3, schema=b"another")
    assert table != table_of(3, "ground")
    assert table != 7


@given(st.data())
@settings(max_examples=200)
def test_bytes_that_were_changed_are_a_table_or_refused(data):
    """Checksums notice any change before; these are the bytes another program could have written."""
    content = bytearray(table_of(5).to_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    files = table_of(5).files
    try:
        table = ShardTable.from_bytes(bytes(content), files)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        assert (table.offsets + table.lengths <= files[0].n_bytes).all()
        assert len(table.rows_by_key()) == len(table)


@pytest.mark.parametrize("content", [b"", b"x", b"ARROW1", bytes(1000)])
def test_what_is_no_index(content):
    with pytest.raises(ValueError):
        ShardTable.from_bytes(content, FILES)


def test_a_hundred_thousand_tiles_are_read_in_less_than_a_second():
    n = 100_000
    rng = np.random.default_rng(0)
    x, y = np.divmod(np.arange(n), 400)
    rows = list(
        zip(
            zip(x.tolist(), y.tolist(), strict=True), [9] * n, [9] * n, [0] * n, range(n), [1] * n,
            map(bytes, rng.integers(0, 256, (n, 32), np.uint8)), strict=True,
        )
    )  # fmt: skip
    content = ShardTable.of_rows(b"", (ShardFile("tiles/0", n),), rows).to_bytes()
    start = time.process_time()
    table = ShardTable.from_bytes(content, (ShardFile("tiles/0", n),))
    assert len(table.rows_by_key()) == n
    assert time.process_time() - start < 1.0
