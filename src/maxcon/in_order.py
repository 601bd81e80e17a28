# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Work by several threads whose results come in the order of what they are made of."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

__all__ = ["in_order"]

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


def in_order(
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
