# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Ordered map: results in the order of what they are made of, whoever is done first."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


def ordered_map(
    pool: ThreadPoolExecutor, work: Callable[[ItemT], ResultT], items: Iterable[ItemT], n_ahead: int
) -> Iterator[ResultT]:
    """Yield what is made of each item, in their order; at most `n_ahead` are begun before the first is asked for."""
    begun: deque[Future[ResultT]] = deque()
    for item in items:
        begun.append(pool.submit(work, item))
        if len(begun) >= n_ahead:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()


def in_order_of(items: Iterable[ItemT], results: Iterable[tuple[ItemT, ResultT]]) -> Iterator[ResultT]:
    """Yield the results of items, which come with them in any order, in the order of the items; early ones wait."""
    early: dict[ItemT, ResultT] = {}
    coming = iter(results)
    for item in items:
        while item not in early:
            done, result = next(coming)
            early[done] = result
        yield early.pop(item)
    for _ in coming:  # let it end
        pass
