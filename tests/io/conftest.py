# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The breaking of files."""

import time

import numpy as np
import pytest

from maxcon.errors import MaxconError


def broken_copies(whole, n_copies, seed=0):
    """Truncations at many places, then flipped bits, most of them in the header and at the end."""
    rng = np.random.default_rng(seed)
    n = len(whole)
    for cut in np.unique(np.concatenate([rng.integers(0, n, n_copies // 3), np.arange(0, min(n, 400), 17)])):
        yield whole[:cut]
    for i in range(n_copies):
        copy = bytearray(whole)
        span = (n, min(n, 500), min(n, 120))[i % 3]
        for at in rng.integers(0, span, 1 + i % 4):
            copy[n - 1 - at if i % 7 == 6 else at] ^= 1 << int(rng.integers(8))
        yield bytes(copy)
    for i in range(n_copies // 3):
        copy = bytearray(whole)
        at = int(rng.integers(0, max(1, min(n, 500) - 8)))
        copy[at : at + 4] = (b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\xff\xff\xff\x7f")[i % 3]
        yield bytes(copy)


@pytest.fixture
def survives_breaking(tmp_path):
    """Check that reading broken copies ends well or in a MaxconError of one line, soon."""

    def check(whole, suffix, read, n_copies=150):
        path = tmp_path / f"broken{suffix}"
        n_refused = 0
        for content in broken_copies(whole, n_copies):
            path.write_bytes(content)
            begin = time.perf_counter()
            try:
                read(path)
            except MaxconError as error:
                n_refused += 1
                assert path.name in str(error), str(error)
                assert "\n" not in str(error), str(error)
            assert time.perf_counter() - begin < 100.0
        assert n_refused > n_copies // 4

    return check
