# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which tiles are kept, and which go first."""

from dataclasses import dataclass

import pytest

from maxcon.map.tile import TileCache


@dataclass(frozen=True)
class Tile:
    """What is asked of a tile."""

    n_bytes: int


@pytest.fixture
def loaded():
    """Load tiles of 10 bytes by their numbers; return the numbers of those that had to be made."""

    def load(kept, numbers, n_bytes=10):
        made = []
        for number in numbers:
            kept.load((number, 0), lambda number=number: made.append(number) or Tile(n_bytes))
        return made

    return load


def test_what_is_kept_is_not_made_again(loaded):
    kept = TileCache(100)
    assert loaded(kept, [1, 2, 1, 2, 2]) == [1, 2]
    assert kept.load((1, 0), lambda: Tile(0)) is kept.load((1, 0), lambda: Tile(0))


def test_those_used_longest_ago_go_first_and_no_more_than_must(loaded):
    kept = TileCache(30)
    assert loaded(kept, [1, 2, 3]) == [1, 2, 3]  # as many as fit
    assert loaded(kept, [1, 4]) == [4]  # in the place of 2
    assert sorted(kept) == [(1, 0), (3, 0), (4, 0)]
    assert loaded(kept, [5], n_bytes=25) == [5]  # in the place of all
    assert sorted(kept) == [(5, 0)]
    assert loaded(kept, [6], n_bytes=5) == [6]
    assert sorted(kept) == [(5, 0), (6, 0)]


def test_the_last_one_is_kept_whatever_its_size(loaded):
    kept = TileCache(9)
    assert loaded(kept, [1, 1, 2, 2, 1]) == [1, 2, 1]
    assert list(kept) == [(1, 0)]


def test_what_cannot_be_made_is_asked_for_again(loaded):
    def fail():
        raise OSError("gone")

    kept = TileCache(100)
    with pytest.raises(OSError, match="gone"):
        kept.load((1, 0), fail)
    assert loaded(kept, [1]) == [1]
