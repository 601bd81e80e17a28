# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Records that claim to unpack to more than their bytes can hold are refused before Arrow makes room for it."""

import struct
from contextlib import suppress

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maxcon.map.record_claims import check_claims
from maxcon.map.records import record_of


def content_of(values):
    return record_of("classes", (0, 0), pa.record_batch({"a": values, "b": values})).content


@pytest.mark.parametrize("n", [0, 1, 100, 100_000])
def test_what_was_written_is_fine(n):
    check_claims(content_of(np.random.default_rng(n).integers(0, 255, n)))
    check_claims(content_of(np.zeros(n)))  # it shrinks most


def claims(content):
    """Where in a record the claimed lengths stand: those that are as long as the values."""
    wanted = struct.pack("<q", 8 * 5000)
    return [at for at in range(0, len(content) - 8, 8) if content[at : at + 8] == wanted]


@pytest.mark.parametrize("claim", [2**40, 2**62, 50_000_000])
def test_a_claim_that_cannot_be_is_refused(claim):
    content = bytearray(content_of(np.arange(5000)))
    places = claims(content)
    assert len(places) == 2
    for place in places:
        changed = content.copy()
        struct.pack_into("<q", changed, place, claim)
        with pytest.raises(ValueError, match="unpack"):
            check_claims(bytes(changed))


@given(data=st.data())
def test_damage_is_refused_in_one_of_the_ways_that_are_known(data):
    content = bytearray(content_of(np.arange(300)))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with suppress(ValueError, OSError, EOFError, pa.ArrowException):
        check_claims(bytes(content[: data.draw(st.integers(0, len(content)))]))
