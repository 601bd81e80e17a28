# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which tiles are kept, which go first, and what several threads that load tiles wait for."""

import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from maxcon.map.tile import TileCache


@dataclass(frozen=True)
class Tile:
    """What is asked of a tile."""

    n_bytes: int


def loaded(cache, numbers, n_bytes=10):
    """Load tiles by their numbers; return the numbers of those that had to be made."""
    made = []
    for number in numbers:
        cache.load((number, 0), lambda number=number: made.append(number) or Tile(n_bytes))
    return made


def kept(cache):
    return [number for number in range(10) if (number, 0) in cache]


def test_what_is_kept_is_not_made_again():
    cache = TileCache(100)
    assert loaded(cache, [1, 2, 1, 2, 2]) == [1, 2]
    assert cache.load((1, 0), lambda: Tile(0)) is cache.load((1, 0), lambda: Tile(0))
    assert kept(pickle.loads(pickle.dumps(cache))) == []


def test_those_used_longest_ago_go_first_and_no_more_than_must():
    cache = TileCache(30)
    assert loaded(cache, [1, 2, 3]) == [1, 2, 3]  # as many as fit
    assert loaded(cache, [1, 4]) == [4]  # in the place of 2
    assert kept(cache) == [1, 3, 4]
    assert loaded(cache, [5], n_bytes=25) == [5]  # in the place of all
    assert kept(cache) == [5]
    assert loaded(cache, [6], n_bytes=5) == [6]
    assert kept(cache) == [5, 6]


def test_the_last_one_is_kept_whatever_its_size():
    cache = TileCache(9)
    assert loaded(cache, [1, 1, 2, 2, 1]) == [1, 2, 1]
    assert kept(cache) == [1]


def test_what_cannot_be_made_is_asked_for_again():
    def fail():
        raise OSError("gone")

    cache = TileCache(100)
    with pytest.raises(OSError, match="gone"):
        cache.load((1, 0), fail)
    assert loaded(cache, [1]) == [1]


def test_threads_make_different_tiles_at_once():
    """Each waits until the others are at it, too: under one lock none would ever be done."""
    cache, together = TileCache(1000), threading.Barrier(4, timeout=60)

    def make():
        together.wait()
        return Tile(1)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda number: cache.load((number, 0), make), range(4)))
    assert kept(cache) == [0, 1, 2, 3]


@pytest.mark.parametrize("error", [None, OSError("gone")])
def test_a_tile_that_several_threads_ask_for_is_made_once(error):
    cache, made, may_end = TileCache(1000), [], threading.Event()

    def make():
        made.append(1)
        assert may_end.wait(60)
        if error is not None:
            raise error
        return Tile(1)

    with ThreadPoolExecutor(4) as pool:
        first = pool.submit(cache.load, (1, 0), make)
        while not made:
            pass
        others = [pool.submit(cache.load, (1, 0), make) for _ in range(3)]
        while sum(future.running() for future in others) < 3:
            pass
        threading.Timer(0.05, may_end.set).start()
    assert all(future.exception() is error for future in (first, *others))
    assert made == [1] or error is not None  # who asks after an error tries again
    assert ((1, 0) in cache) == (error is None)
